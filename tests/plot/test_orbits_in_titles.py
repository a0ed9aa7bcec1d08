"""Times in orbits: snapshots found by them, titles, axes of time and the lines of a run."""

import copy
import math
import re

import numpy as np
import pytest
from test_plot import command, labels
from two_sizes import TABLES, write_two_sizes

import discsim
from discsim.output.fields.base import PlotError
from discsim.output.fields.display import DisplayOptions
from discsim.output.history import COLUMNS
from discsim.plot.request import Request
from discsim.report.conservation import conserved_quantities
from discsim.report.figures import history_figures, snapshot_figure
from discsim.run.runner import run_scene
from discsim.scene import load_scene
from discsim.scene.overrides import Option

PLANET = {"mass": "0.021 Msun", "semi_major_axis": "4.2 au", "softening": "0.2 au", "eccentricity": 0.3}
ORBIT = 2 * math.pi * math.sqrt(2.1**3 / 1.03)  # of the planet: the units are 2 au and the mass of the star
CIRCULAR = 2 * math.pi * math.sqrt(1.7**3)  # at 3.4 au


@pytest.fixture(scope="module")
def make(tmp_path_factory):
    """A function that writes a run with other tables, at 0, 0.7, 1.9 and 5 orbits of the planet."""
    folder = tmp_path_factory.mktemp("runs")
    return lambda name, **tables: write_two_sizes(
        folder / name, ORBIT * np.array([0.0, 0.7, 1.9, 5.0]), copy.deepcopy(TABLES) | tables
    )


@pytest.fixture(scope="module")
def planet(make):
    return make("planet", companion=PLANET)


@pytest.fixture(scope="module")
def counted(make):
    return make("counted", run={"until": "5 orbits at 3.4 au"})


@pytest.fixture(scope="module")
def plain(make):
    return make("plain")


def figure_of(*paths, kind=None, at=(), compare=False):
    return Request(
        list(paths), ["gas.surface_density"], kind, at, compare=compare, display=DisplayOptions(pixels=60)
    ).figure()


def axis_of_time(figure):
    (label,) = (each for each in labels(figure) if each.startswith("t "))
    return label, figure.axes[0].get_ylim()


def test_snapshots_are_found_by_orbits_of_the_planet_and_at_a_radius(planet):
    run = discsim.open_run(planet)
    for text, number in (("0.6 orbits", 1), ("2 orbits of the companion", 2), ("1 orbit", 1), ("9 orbits", 3)):
        assert run.at(text).time == pytest.approx(ORBIT * (0.0, 0.7, 1.9, 5.0)[number], rel=1e-12)
    # Between the last snapshots by a thousandth of an orbit: the mass of the planet does not count at a radius.
    middle = 0.5 * (1.9 + 5.0) * ORBIT / (2 * math.pi * math.sqrt(2.1**3))
    assert run.at(f"{middle - 1e-3} orbits at 4.2 au").time < run.at(f"{middle + 1e-3} orbits at 4.2 au").time
    figures = [figure_of(planet, at=[f"{middle + each} orbits at 4.2 au"]) for each in (-1e-3, 1e-3)]
    assert [figure.get_suptitle().split("(")[1] for figure in figures] == [
        "1.9 orbits of the companion)", "5 orbits of the companion)",
    ]  # fmt: skip


def test_titles_have_the_orbits_of_the_scene(planet, counted, plain):
    years = ORBIT * discsim.open_run(planet).units.time.to("yr")
    last = f"t = {5 * years:.4g} yr"
    for path, orbits in (
        (planet, " (5 orbits of the companion)"), (plain, ""),
        (counted, f" ({5 * ORBIT / CIRCULAR:.4g} orbits at 3.4 au)"),
    ):  # fmt: skip
        assert figure_of(path).get_suptitle() == f"Two sizes\n{last}{orbits}"
        snap = discsim.read_snapshot(path)
        assert f"{last}{orbits}".removeprefix("t = ") in repr(snap) and f"to {last[4:]}{orbits}" in repr(
            discsim.open_run(path)
        )
    caption = f"Snapshot 0003, {last} (5 orbits of the companion)."
    assert snapshot_figure(planet / "snapshots" / "0003.h5").caption == caption
    columns = [axes.get_title() for axes in figure_of(planet, at=["0 yr", "0.7 orbits"]).axes if axes.get_title()]
    assert columns == [
        f"t = {each}"
        for each in ("0 (0 orbits of the companion)", f"{0.7 * years:.4g} yr (0.7 orbits of the companion)")
    ]


def test_one_time_of_runs_with_other_orbits_is_said_once_in_years(planet, plain):
    assert figure_of(planet, plain).get_suptitle() == f"t = {discsim.read_snapshot(plain).time_text}"


def test_the_axis_of_time_is_in_orbits_where_the_scene_gives_them(planet, counted, plain):
    years = 5 * ORBIT * discsim.open_run(planet).units.time.to("yr")
    label, (low, high) = axis_of_time(figure_of(counted, kind="time"))
    assert label == "t [orbits at 3.4 au]" and low == 0.0 and high == pytest.approx(5 * ORBIT / CIRCULAR, rel=1e-6)
    for paths in ([plain], [planet], [counted, plain]):
        label, ends = axis_of_time(figure_of(*paths, kind="time"))
        assert label == "t [yr]" and ends == pytest.approx((0.0, years), rel=1e-6)
    label, ends = axis_of_time(figure_of(counted, counted, kind="time", compare=True))
    assert label == "t [orbits at 3.4 au]"
    axes = discsim.open_run(counted).plot("gas.surface_density", kind="time")
    assert axes.get_ylabel() == "t [orbits at 3.4 au]"


@pytest.mark.parametrize(
    "text", ["nan orbits", "orbits at", "2 orbits at 5 s", "2 orbits", "2 orbits\x1b", "2 orbits at -3 au"]
)
def test_a_wrong_number_of_orbits_is_one_message_about_the_option(plain, text):
    with pytest.raises(PlotError, match=r"^at: "):
        discsim.open_run(plain).at(text)
    done = command("plot", plain, "--at", text)
    assert done.exit_code == 2 and done.output.startswith("--at: ") and done.output.count("\n") == 1
    assert "\x1b" not in done.output


def test_the_history_in_a_report_has_the_same_axis(counted, monkeypatch):
    seen = []
    monkeypatch.setattr("discsim.report.figures._png_text", lambda figure: seen.append(figure.axes[0]) or "")
    rows = [dict.fromkeys(COLUMNS, "1.0") | {"time": str(time), "dt": "0.1"} for time in (0.0, 5.0 * CIRCULAR)]
    scene = load_scene(counted / "scene.toml")
    history_figures(scene, rows, list(conserved_quantities(scene, rows)))
    assert [axes.get_xlabel() for axes in seen] == 2 * ["t [orbits at 3.4 au]"]
    assert seen[1].get_ylabel() == "step [yr]" and seen[1].lines[0].get_xdata()[-1] == pytest.approx(5.0, rel=1e-12)


def test_a_run_and_its_continuation_report_orbits(tmp_path, monkeypatch):
    """A run of 70 grains ends where the companion is after this number of orbits; scene.toml keeps the text."""
    monkeypatch.setattr("discsim.output.figure.last_state_figure", lambda snapshot, figure: figure.touch())
    tables = {
        "units": {"system": "code"}, "run": {"until": "0.02 orbits", "every": "0.01 orbits", "threads": 1},
        "space": {"size": 12.0}, "initial": {"kind": "disc", "mass": 1e-3, "inner": 1.0, "outer": 2.0},
        "star": {"mass": 0.7}, "dust": {"particles": 70, "ratio": 0.01},
        "companion": {"mass": 0.03, "semi_major_axis": 4.2, "softening": "0.3"},
    }  # fmt: skip
    out, orbit = tmp_path / "out", 2 * math.pi * math.sqrt(4.2**3 / 0.73)
    assert run_scene(load_scene(tables), out, quiet=True) == 0
    longer = load_scene(tables, [Option("--until", "run.until", "0.03 orbits")])
    assert run_scene(longer, out, resume=True, quiet=True) == 0
    run = discsim.open_run(out)
    np.testing.assert_allclose(run.times.value / orbit, [0.0, 0.01, 0.02, 0.03], rtol=1e-12, atol=0.0)
    assert 'until = "0.03 orbits"' in (out / "scene.toml").read_text()
    log = (out / "run.log").read_text()
    assert f"t = {0.01 * orbit:.4g} of {0.02 * orbit:.4g} (0.01 of 0.02 orbits of the companion)" in log
    assert f"resumed at t = {0.02 * orbit:.4g} (0.02 orbits of the companion)" in log
    assert re.search(r"done at t = \S+ \(0\.03 orbits of the companion\)", log)
