"""The notebooks in docs/notebooks: stored with the outputs of their code, and right with the names of today."""

import re

import matplotlib.pyplot as plt
import nbformat
import numpy as np
import pytest
from installed import looked_up_anew
from notebooks import FOLDER, NAMES, code_cells, execute, read, source_hash

from discsim.parts import EFFECTS

MAX_BYTES = 500_000
# A path of a machine, a user's folder, or the command of a kernel.
PLACES = re.compile(r"(?<![\w.])/(?:home|root|tmp|work|usr|opt|Users|var|private)/|[A-Z]:\\\\|ipykernel|site-packages")
# Values for the cell tagged "parameters", by notebook: runs of a second.
TINY = {
    "compare_with_fits": {"particles": 500, "until": "150 yr", "pixels": 80, "steps": 3},
    "fragmentation": {"gas_particles": 1500, "dust_particles": 300, "cells": 64, "until": "8 yr"},
    "own_force": {"precession_orbits": 12, "drag_time": 0.5, "steps_per_orbit": 30},
    "planet_and_dust_rings": {"gas_particles": 600, "grains": 1500, "orbits": 0.2},
}


def outputs(book):
    return [out for cell in code_cells(book) for out in cell.outputs]


@pytest.mark.parametrize("name", NAMES)
def test_stored_with_the_outputs_of_its_code(name):
    book = read(name)
    cells = code_cells(book)
    assert source_hash(book) == book.metadata["discsim"]["code_sha256"], "run tests/helpers/notebooks.py again"
    assert [cell.execution_count for cell in cells] == [*range(1, len(cells) + 1)]
    assert not [out for out in outputs(book) if out.output_type == "error" or out.get("name") == "stderr"]
    assert sum("image/png" in out.get("data", {}) for out in outputs(book)) >= 2


@pytest.mark.parametrize("name", NAMES)
def test_stored_without_a_trace_of_the_machine(name):
    path = FOLDER / f"{name}.ipynb"
    texts = [cell.source for cell in read(name).cells]
    texts += [
        str(text) for out in outputs(read(name)) for kind, text in out.get("data", {}).items() if kind[:4] == "text"
    ]
    texts += [out["text"] for out in outputs(read(name)) if "text" in out]
    assert not [text for text in texts if PLACES.search(text)]
    assert path.stat().st_size < MAX_BYTES
    assert set(read(name).metadata) == {"kernelspec", "language_info", "discsim"}
    assert all(set(cell.metadata) <= {"tags"} for cell in read(name).cells)


def test_every_notebook_is_in_the_site_and_its_links_lead_somewhere():
    page = (FOLDER / "index.md").read_text(encoding="utf-8")
    (tree,) = re.findall(r"```\{toctree\}\n(.*?)```", page, re.S)
    assert {line for line in tree.split("\n") if line and line[0] != ":"} == {"../notebook", *NAMES}
    for name in NAMES:
        assert f"({name}.ipynb)" in page
        for cell in read(name).cells:
            for target in re.findall(
                r"\]\(([^)#:]+)(?:#[^)]*)?\)", cell.source if cell.cell_type == "markdown" else ""
            ):
                assert (FOLDER / target).is_file(), target


@pytest.fixture
def names(request, tmp_path, monkeypatch):
    """The variables of a notebook after its cells, executed in this process with small runs."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(EFFECTS, "added", {})
    found, name = {"__name__": "__main__"}, request.param
    with looked_up_anew():
        for cell in code_cells(read(name)):
            exec(compile(cell.source, name, "exec"), found)
            if "parameters" in cell.metadata.get("tags", ()):
                assert TINY[name].keys() <= found.keys()
                found |= TINY[name]
        yield found
    plt.close("all")


@pytest.mark.slow  # it compiles and runs a disc with a planet
@pytest.mark.parametrize("names", ["planet_and_dust_rings"], indirect=True)
def test_the_planet_notebook_makes_two_images_of_one_disc(names):
    """The flux differs by that of the noise, 15 uJy times the root of the number of beams; it is below 4 sigma."""
    sky, observed = names["sky"], names["observed"]
    noise = 15e-6 * np.sqrt(observed.values.size / observed.pixels_per_beam)
    assert 0.0 < abs((observed.flux - sky.flux).value) < 4.0 * noise + 0.01 * sky.flux.value
    assert names["run"].populations == ["fine", "coarse"] and len(names["run"]) == 21


@pytest.mark.slow  # it compiles and runs a cooling disc
@pytest.mark.parametrize("names", ["fragmentation"], indirect=True)
def test_the_toomre_mass_of_the_notebook_is_that_of_its_power_law(names):
    """With Sigma = M / (2 pi ln(outer / inner) r^2) it is pi^5 (M / (2 pi ln 3))^3 everywhere.

    Tapers raise Sigma by a tenth, few particles scatter it; the cube root of the mass is linear in Sigma.
    """
    mass = names["toomre_mass"]
    middle = mass[len(mass) // 4 : 3 * len(mass) // 4]
    expected = np.pi**5 * (0.2 / (2.0 * np.pi * np.log(3.0))) ** 3 * 1047.6
    assert np.cbrt(middle).mean() == pytest.approx(1.1 * np.cbrt(expected), rel=0.1)
    assert names["growth"]["number"].to_list() == [len(table) for table in names["tables"]]


@pytest.mark.parametrize("names", ["own_force"], indirect=True)
def test_forces_of_the_notebook_agree_with_their_closed_forms(names):
    """The next order of the precession is (b/a)^2 = 1.4%; within an orbit the pericentre swings by 0.5 deg."""
    swing = 0.5 / names["turned"].index[-1]
    np.testing.assert_allclose(names["measured"], names["rate"].value, rtol=0.02, atol=2.0 * swing)
    assert np.abs(names["history"]["a"][0] / names["exact"] - 1.0).max() < 1e-4
    assert np.abs(names["integral"] / names["integral"].iloc[0] - 1.0).max() < 0.01


@pytest.mark.parametrize("names", ["compare_with_fits"], indirect=True)
def test_the_observation_of_the_notebook_is_read_as_it_was_written(names):
    assert abs(names["wavelength"].to_value("mm") - 1.3) < 1e-12
    assert names["centre"].separation(names["SkyCoord"]("04h33m34.6s +24d21m08s")).arcsec < 1e-6
    np.testing.assert_allclose(names["data"].value, names["telescope"].values, rtol=1e-6, atol=1e-12)
    assert (
        names["chi2"].to_numpy().argmin()
        == np.abs(names["chi2"] - names["chi_squared"](names["best"])).to_numpy().argmin()
    )


# Statements about the results of the whole notebooks, run in a cell at their end.
WHOLE = {
    "compare_with_fits": """
assert abs(best_i - 42) <= 2 and abs(best_pa - 112) <= 3
assert chi_squared(best) < 2.2 * beams < chi_squared(guess) < chi_squared(smooth)
assert abs(noise.to_value("uJy/beam") - 80) < 12
""",
    "fragmentation": """
assert np.nanmean(toomre.values[:2, inside]) > 1.3 and len(clumps) >= 3
assert 0.15 < clumps["gas"].median() / np.median(toomre_mass) < 2
""",
    "own_force": """
assert np.allclose(measured, rate.value, rtol=0.03)
assert np.abs(history["a"][0] / exact - 1).max() < 1e-4
""",
    "planet_and_dust_rings": """
place, over = (table.loc[name] for name in ("radius of the maximum [au]", "over the start"))
assert abs(place["ring of 3 mm"] - place["gas pressure"]) < 2.5 and 35 < place["ring of 3 mm"] < 45
assert over["ring of 3 mm"] > 2 * over["ring of 0.3 mm"]
assert (gas.values[-1] / gas.values[0])[near].min() < 0.75
""",
}


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_the_whole_notebook_runs_and_finds_what_it_says(name, tmp_path):
    book = read(name)
    book.cells.append(nbformat.v4.new_code_cell(WHOLE[name]))
    execute(book, tmp_path)
