"""A branch: a run from a snapshot of another whose time goes on, as it is and with other physics."""

import shutil

import h5py
import numpy as np
import pytest
from runs import assert_same_arrays, assert_same_run, put_out
from typer.testing import CliRunner

from discsim import Simulation, load_scene, read_snapshot
from discsim.cli import app
from discsim.initial import start_time
from discsim.preview.derived import derived_rows
from discsim.run.branch import branch
from discsim.run.runner import run_scene
from discsim.scene import SceneError, tomltext

SCENE = {
    "title": "a disc to branch from",
    "units": {"system": "code"},
    "run": {"until": 0.5, "snapshots": 5},
    "space": {"size": 8.0, "cells": 32},
    "initial": {"kind": "disc", "mass": 0.05, "inner": 1.0, "outer": 2.0, "reference_radius": 1.5},
    "gas": {"particles": 600, "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.1}, "viscosity": {}},
    "dust": {"particles": 200, "ratio": 0.1},
    "drag": {"law": "stokes-number", "stokes": 0.1},
    "star": {"mass": 1.0, "frame": "inertial"},
    "companion": [{"mass": 0.02, "semi_major_axis": 3.0, "softening": "0.2", "ramp": 1.0, "phase": 70.0}],
}  # fmt: skip


@pytest.fixture(autouse=True)
def no_figures(monkeypatch):
    monkeypatch.setattr("discsim.output.figure.last_state_figure", lambda snapshot, figure: figure.touch())


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A finished run with a companion whose mass still grows, in an inertial frame, from a file with comments."""
    folder = tmp_path_factory.mktemp("run")
    path = folder / "scene.toml"
    path.write_text("# A disc.\n" + tomltext.dump(SCENE).replace("\n[drag]", "\n# drag it is\n[drag]"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("discsim.output.figure.last_state_figure", lambda snapshot, figure: figure.touch())
        assert run_scene(load_scene(path), folder / "a", quiet=True) == 0
    return folder / "a"


def command(*arguments):
    return CliRunner().invoke(app, ["branch", *map(str, arguments)])


def last(directory):
    return read_snapshot(max((directory / "snapshots").iterdir()))


def test_as_it_is_it_goes_on_as_the_run(run, tmp_path):
    done = command(run, "--at", "0002", "-o", tmp_path / "b")
    assert done.exit_code == 0 and "at t = 0.2, with\n  nothing changed" in done.stdout
    for number in range(4):
        one, other = (read_snapshot(path / "snapshots" / f"{k:04d}.h5")
                      for path, k in ((run, number + 2), (tmp_path / "b", number)))  # fmt: skip
        assert one.time == other.time  # the same floats, so that both can be laid side by side
        for kind in ("gas", "dust", "bodies"):
            for name in ("pos", "vel", "mass"):  # those of the companion's way and its ramp among them
                ours, theirs = (getattr(getattr(snap, kind), name) for snap in (one, other))
                # Rounding of sums in another order over some steps, of speeds and radii of about 1.
                np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-12)
    header, *rows = (tmp_path / "b" / "companions.csv").read_text().splitlines()
    felt = float(rows[-1].split(",")[header.split(",").index("felt_mass")])
    assert felt == pytest.approx(0.02 * np.sin(0.25 * np.pi) ** 2, rel=1e-12)  # half of the ramp is over
    for name in ("history.csv", "companions.csv"):
        assert (tmp_path / "b" / name).read_text().splitlines()[1].split(",")[:2] == ["0", "0.2"]


def test_one_way_it_has_the_gas_of_a_branch_without_dust(run, tmp_path):
    one_way = command(run, "--at", "3", "--set", "drag.direction=one-way", "-o", tmp_path / "b", "--quiet")
    alone = command(run, "--at", "3", "--without", "drag", "--without", "dust", "-o", tmp_path / "c", "--quiet")
    assert (one_way.exit_code, alone.exit_code) == (0, 0) and one_way.stdout == ""
    gas, other = last(tmp_path / "b").gas, last(tmp_path / "c").gas
    assert_same_arrays(vars(gas), vars(other))
    assert np.abs(gas.vel - last(run).gas.vel).max() > 1e-6  # dust of a tenth has pushed in the run itself


def test_its_scene_says_what_changed_and_runs_again(run, tmp_path):
    given = ["--set", "drag.stokes=1", "--without", "companion", "--set", "drag.scheme=tsc", "--until", "0.6"]
    done = command(run, "--at", "4", *given, "-o", tmp_path / "b")
    assert done.exit_code == 0
    text = (tmp_path / "b/scene.toml").read_text()
    changes = ["drag.stokes = 1, was 0.1", "[companion] removed", "run.until = 0.6, was 0.5"]
    told = [line.removeprefix("#   ") for line in text.splitlines() if line.startswith("#   ")]
    assert sorted(told) == sorted(changes)  # and not the scheme, which is the usual one
    assert all(f"\n  {change}\n" in done.stdout for change in changes)
    assert "# A disc.\n" in text and "# drag it is\n[drag]" in text
    again = load_scene(tmp_path / "b/scene.toml")
    assert again.initial.reference_radius == 1.5 and start_time(again) == 0.4
    assert run_scene(again, tmp_path / "c", quiet=True) == 0
    assert_same_run(tmp_path / "b", tmp_path / "c")


def test_it_resumes_to_the_same_bits(run, tmp_path):
    made = branch(run, 1, ["drag.direction=one-way"])
    assert run_scene(made.scene, tmp_path / "straight", quiet=True) == 0
    until = branch(run, 1, ["drag.direction=one-way", "run.until=0.3", "run.snapshots=3"]).scene
    assert run_scene(until, tmp_path / "parts", quiet=True) == 0
    whole = load_scene(tmp_path / "parts/scene.toml", ["run.until=0.5", "run.snapshots=5"])
    assert run_scene(whole, tmp_path / "parts", resume=True, quiet=True) == 0
    assert_same_run(tmp_path / "straight", tmp_path / "parts")


def test_check_says_what_changes_and_writes_nothing(run, tmp_path):
    done = command(run, "--at", "2", "--check", "--set", "star.mass=2", "-o", tmp_path / "b")
    assert done.exit_code == 0 and not (tmp_path / "b").exists()
    assert "star.mass = 2, was 1.0" in done.stdout and "derived numbers" in done.stdout
    orbits = [dict(derived_rows(branch(run, number).scene))["number of orbits"] for number in (0, 3)]
    first, later = (float(text.split(",")[0]) for text in orbits)
    assert later == pytest.approx(0.4 * first, rel=0.1)  # .2 of .5 are left; the inner edge has spread by some percent


def test_time_is_kept_where_asked_in_any_units(tmp_path):
    grains = {
        "run": {"until": "2 yr"}, "space": {"size": "8 au"}, "star": {"mass": "1 Msun"},
        "initial": {"kind": "disc", "mass": "0.05 Msun", "inner": "1 au", "outer": "2 au"},
        "dust": {"particles": 100, "ratio": 0.1},
    }  # fmt: skip
    sim = Simulation(grains)
    sim.step()
    put_out(sim, tmp_path / "0.h5")
    table = {"kind": "snapshot", "file": str(tmp_path / "0.h5"), "keep_time": True}
    assert start_time(load_scene(grains | {"initial": table})) == sim.time > 0.0
    assert start_time(load_scene(grains | {"initial": table | {"keep_time": False}})) == 0.0
    other = load_scene(grains | {"initial": table, "units": {"length": "10 au"}})
    wanted = sim.units.quantity(sim.time, "time").to_value("yr")
    assert other.units.quantity(start_time(other), "time").to_value("yr") == pytest.approx(wanted, rel=1e-12)
    with pytest.raises(SceneError, match=r"the end time is not later than the snapshot"):
        load_scene(grains | {"initial": table, "run": {"until": f"{0.99 * wanted} yr"}})


@pytest.mark.parametrize(
    "arguments, words",
    [
        (["--at", "9"], "no snapshot 0009; choose a number from 0000 to 0005"),
        ([], "run.until: the end time is not later than the snapshot; choose a time after 0.5"),
        (["--at", "2", "--set", "drag.stoeks=1"], 'did you mean "stokes"?'),
        (["--at", "2", "--without", "stat"], 'did you mean "star"?'),
    ],
)
def test_what_cannot_be_is_told(run, tmp_path, arguments, words):
    done = command(run, *arguments, "-o", tmp_path / "b")
    assert done.exit_code == 2 and words in done.stderr and "Traceback" not in done.stderr
    assert not (tmp_path / "b").exists()


@pytest.mark.parametrize(
    "name, value, words",
    [
        ("gained", -1.0, "bodies.gained[1] is -1; expected 0 or a positive number"),
        ("begun", 1e300, "bodies.begun[1] is 1e+300; expected at most the time of the state, 0.2"),
        ("begun", np.nextafter(0.2, 1.0), "bodies.begun[1] is 0.2; expected at most the time of the state, 0.2"),
    ],
)
def test_damaged_values_of_companions_are_one_message(run, tmp_path, name, value, words):
    shutil.copytree(run, tmp_path / "a")
    path = tmp_path / "a/snapshots/0002.h5"
    with h5py.File(path, "r+") as file:
        file[f"discsim/OpenStep/bodies/{name}"][1] = value
    done = command(tmp_path / "a", "--at", "2", "-o", tmp_path / "b")
    assert done.exit_code == 2 and done.stderr.count("\n") == 1
    assert str(path) in done.stderr and words in done.stderr and not (tmp_path / "b").exists()


def test_no_run_there(tmp_path):
    done = command(tmp_path / "none")
    assert done.exit_code == 2 and "no snapshots found; give the directory of a run" in done.stderr


def test_temperatures_of_a_table_are_not_lost_in_silence(tmp_path):
    (tmp_path / "disc.txt").write_text("# r Sigma T\n1 0.01 0.01\n1.5 0.01 0.008\n2 0.01 0.006\n")
    given = {name: table for name, table in SCENE.items() if name not in ("companion", "dust", "drag")}
    given |= {"initial": {"kind": "table", "file": "disc.txt"}, "run": {"until": 0.02, "snapshots": 1}}
    assert run_scene(load_scene(given, folder=tmp_path), tmp_path / "a", quiet=True) == 0
    done = command(tmp_path / "a", "--at", "0", "-o", tmp_path / "b")
    assert (
        done.exit_code == 2
        and ("and snapshots do not contain it; set a temperature, for example: --set gas.eos") in done.stderr
    )
    assert branch(tmp_path / "a", 0, ["gas.eos.aspect_ratio=0.2"]).scene.gas.eos.aspect_ratio == 0.2
