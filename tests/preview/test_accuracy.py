"""What `discsim check` says of accuracy: estimates that follow the settings, and what runs of these settings had."""

import re

import pytest

from discsim import load_scene
from discsim.preview import accuracy
from discsim.preview.check import report
from discsim.preview.derived import derived_rows

TWIN = "setups/twin_twoway.toml"


def number(scene, name):
    """The first number of a row."""
    text = dict(accuracy.accuracy_rows(scene))[name]
    return float(re.match(r"[\d.e-]+", text)[0])


@pytest.mark.parametrize(
    "name, change, factor",
    [
        ("error of the pressure force", "gas.particles=10_000", 4.0),  # (h/H)^2, and h goes with 1 / sqrt(n)
        ("alpha by SPH viscosity and noise", "gas.particles=10_000", 2.0),  # h, most of it
        ("energy error of the whole run", "run.courant=0.3", 0.5**2.4),
        ("largest error of self-gravity", "space.cells=256", 4.0),
    ],
)
def test_estimates_follow_the_settings(name, change, factor):
    plain, changed = number(load_scene(TWIN), name), number(load_scene(TWIN, [change]), name)
    # Rows have one or two digits.
    assert changed / plain == pytest.approx(factor, rel=0.35)


@pytest.mark.parametrize("change", ["run.courant=0.45", "run.until=900 yr"])
def test_energy_that_steps_change_is_by_orbits(change):
    """3e-3 (C / .8)^2.4 in three orbits of the gas in the middle."""
    scene = load_scene(TWIN, [change])
    orbits = sorted(map(float, dict(derived_rows(scene))["number of orbits"].split(", ")))[1]
    wanted = 3e-3 * (scene.run.courant / 0.8) ** 2.4 * orbits / 3.0
    assert number(scene, "energy error of the whole run") == pytest.approx(wanted, rel=0.35)  # it has one digit


def test_single_precision_is_told_where_it_is():
    name = "error of gas forces"
    assert number(load_scene(TWIN, ["gas.precision=single"]), name) == 3e-7
    assert name not in dict(accuracy.accuracy_rows(load_scene(TWIN)))


def test_drag_is_told_of_the_usual_scheme_by_its_cells():
    name = "error of the dust drift"
    narrow, wide = (number(load_scene(TWIN, [f"drag.cell={cell}"]), name) for cell in (0.7, 2))
    assert narrow < 0.02 < 0.2 < wide
    assert name not in dict(accuracy.accuracy_rows(load_scene(TWIN, ["drag.scheme=mk"])))


def test_what_is_not_known_is_said():
    text = report(load_scene("setups/star_dust.toml"))
    assert "accuracy, estimated\n  no estimate" in text and "discsim cost SCENE --error 1%" in text
    assert "exact solution" in report(load_scene("setups/dusty_wave.toml"))


def test_errors_of_runs_are_those_of_the_same_settings():
    scene = load_scene(TWIN)
    accuracy.store_error(scene, "dust-profile", 0.0153, 85.0)
    row = re.search(r"measured error \(dust-profile\)\s+(.*)", report(scene))
    assert row and row[1] == "1.5%, in 85 s of CPU"
    # Titles, threads, seeds and snapshots change no error; settings and the time do.
    same = ['title="x"', "run.threads=1", "run.seed=3", "run.snapshots=2"]
    assert "measured error" in report(load_scene(TWIN, same))
    for other in ("run.courant=0.7", 'run.until="1000 yr"', "gas.particles=40_001"):
        assert "measured error" not in report(load_scene(TWIN, [other]))
    accuracy.store_error(scene, "dust-profile", 0.02, 80.0)  # later runs take the place of earlier ones
    assert report(scene).count("measured error") == 1 and "2%, in 80 s" in report(scene)


def test_a_broken_store_is_no_store(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    scene = load_scene(TWIN)
    for text in ("", "{", '{"runs": 3}', '{"runs": [{}]}', "[]"):
        (tmp_path / "discsim").mkdir(exist_ok=True)
        (tmp_path / "discsim" / "errors.json").write_text(text)
        assert "measured error" not in report(scene)
    accuracy.store_error(scene, "gas-modes", 0.1, 1.0)
    assert "measured error (gas-modes)" in report(scene)
    monkeypatch.setenv("XDG_CACHE_HOME", "/dev/null")
    accuracy.store_error(scene, "gas-modes", 0.1, 1.0)  # nothing can be kept there
