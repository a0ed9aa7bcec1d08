"""Sweeps: a run for every combination, in directories that can be gone on with, and a table of what they came to."""

import csv
import os
import shutil
import signal
import subprocess
import sys

import numpy as np
import pytest
from runs import assert_same_run, at_step, contents
from scenes import DISC
from typer.testing import CliRunner

from discsim import load_scene, read_snapshot
from discsim.cli import app
from discsim.output.history import COLUMNS
from discsim.run.runner import run_scene
from discsim.run.simulation import Simulation
from discsim.scene import SceneError, tomltext
from discsim.study import sweep as sweeps
from discsim.study.outcomes import outcomes_of, quantile_radii, read_results, select_outcomes
from discsim.study.points import StudyError

SCENE = {
    "title": "grains that drift",
    "units": {"system": "code"},
    "run": {"until": 0.3, "snapshots": 1, "courant": 0.1},
    "space": {"size": 8.0, "cells": 32},
    "initial": {"kind": "disc", "mass": 0.05, "inner": 1.0, "outer": 2.0},
    "gas": {"particles": 600, "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.1}, "viscosity": {}},
    "dust": {"particles": 200, "ratio": 0.1},
    "drag": {"law": "stokes-number", "stokes": 0.1},
    "star": {"mass": 1.0, "accretion_radius": 1.02},
}
STOKES = ["--vary", "drag.stokes=0.1,1,10"]


@pytest.fixture(autouse=True)
def no_figures_of_runs(monkeypatch):
    monkeypatch.setattr("discsim.output.figure.last_state_figure", lambda snapshot, figure: figure.touch())


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    path = tmp_path_factory.mktemp("scene") / "drift.toml"
    path.write_text(tomltext.dump(SCENE))
    return path


@pytest.fixture(scope="module")
def made(scene, tmp_path_factory):
    """A finished sweep of the Stokes number, and what the command said."""
    directory = tmp_path_factory.mktemp("sweep") / "a"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("discsim.output.figure.last_state_figure", lambda snapshot, figure: figure.touch())
        done = command(scene, *STOKES, "-o", directory)
    assert done.exit_code == 0, done.stderr
    return directory, done.stdout


def command(*arguments):
    return CliRunner().invoke(app, ["sweep", *map(str, arguments)])


def table(directory):
    with (directory / "sweep.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def half_mass_radius(directory):
    """By hand: 200 grains of one mass, of which 100 are within."""
    dust = read_snapshot(directory / "snapshots/0001.h5").dust
    return np.sort(np.hypot(*dust.pos.T))[(dust.count + 1) // 2 - 1]


def test_the_table_has_what_the_runs_came_to(made):
    directory, said = made
    rows = table(directory)
    assert [row["drag.stokes"] for row in rows] == ["0.1", "1", "10"] and {row["status"] for row in rows} == {"done"}
    found = [float(row["dust-r50"]) for row in rows]
    assert found[1] < min(found[0], found[2])  # grains of St = 1 drift fastest
    for row in rows:
        run = directory / row["directory"]
        assert row["directory"] == f"stokes={row['drag.stokes']}"
        assert float(row["dust-r50"]) == pytest.approx(half_mass_radius(run), rel=1e-14)
        with (run / "history.csv").open(newline="") as file:
            last = list(csv.DictReader(file))[-1]
        assert [row["accreted_gas"], row["accreted_dust"]] == [last["accreted_gas"], last["accreted_dust"]]
        assert f"{found[0]:.4g}" in said
    assert (directory / "sweep.png").read_bytes()[:4] == b"\x89PNG"


def test_its_runs_are_those_of_the_command_run(made, scene, tmp_path):
    assert run_scene(load_scene(scene, ["drag.stokes=10"]), tmp_path / "b", quiet=True) == 0
    assert_same_run(made[0] / "stokes=10", tmp_path / "b")


def test_what_was_stopped_goes_on_and_what_is_there_stays(made, scene, tmp_path, monkeypatch):
    directory = tmp_path / "b"
    shutil.copytree(made[0] / "stokes=0.1", directory / "stokes=0.1")
    before = contents(directory)
    with monkeypatch.context() as patch:
        at_step(patch, 2, lambda sim: signal.raise_signal(signal.SIGINT))
        stopped = command(scene, *STOKES, "-o", directory)
    assert stopped.exit_code == 130 and "repeat the command to continue" in stopped.stderr
    assert [row["status"] for row in table(directory)] == ["done", "not run", "not run"]
    assert command(scene, *STOKES, "-o", directory).exit_code == 0
    for row, other in zip(table(directory), table(made[0]), strict=True):
        assert row == other
        assert_same_run(directory / row["directory"], made[0] / row["directory"])
    assert {path: content for path, content in contents(directory).items() if path in before} == before


def test_measures_are_chosen_by_name_without_new_runs(made, scene, monkeypatch):
    directory = made[0]
    before = {path: path.stat().st_mtime_ns for path in directory.glob("*/*.csv")}
    measures = ["gas-peak", "gas-peak-radius", "dust-r90", "gas-modes", "dust-clumps", "kinetic_gas", "cpu", "step"]
    done = command(scene, *STOKES, "-o", directory, *(word for name in measures for word in ("--measure", name)))
    assert done.exit_code == 0, done.stderr
    assert {path: path.stat().st_mtime_ns for path in directory.glob("*/*.csv")} == before
    row = {name.split(" ")[0]: value for name, value in table(directory)[0].items()}
    # 0.05 on a disc that falls from 1 to 2 is 0.0053 in the mean; rows of particles make rings of their own.
    assert 0.004 < float(row["gas-peak"]) < 0.02 and 1.0 < float(row["gas-peak-radius"]) < 2.0
    assert 1.6 < float(row["dust-r90"]) < 2.0 and float(row["gas-modes"]) < 0.2 and row["dust-clumps"] == "0.0"


def test_of_two_keys_each_pair_is_run_and_one_that_fails_is_told(scene, tmp_path, monkeypatch):
    made, run_or_resume = [], sweeps.run_or_resume

    def run(path, overrides, without, directory):
        made.append(overrides)
        return 3 if "drag.stokes=1" in overrides else run_or_resume(path, overrides, without, directory)

    monkeypatch.setattr(sweeps, "run_or_resume", run)
    done = command(
        scene, "--vary", "drag.stokes=1,10", "--vary", "drag.direction=one-way,two-way", "-o", tmp_path / "b",
        "--set", "run.until=0.02",
    )  # fmt: skip
    assert done.exit_code == 0 and len(made) == 4
    rows = table(tmp_path / "b")
    assert [row["status"] for row in rows] == ["stopped by a numerical failure"] * 2 + ["done"] * 2
    assert rows[0]["dust-r50"] == "" and rows[3]["directory"] == "stokes=10,direction=two-way"


@pytest.mark.parametrize(
    ("fault", "status"),
    [(SceneError(["no balance"]), "could not start"), (TypeError("no number"), "ended by an error of discsim")],
)
def test_a_run_that_cannot_start_or_fails_is_told(scene, tmp_path, monkeypatch, fault, status, capfd):
    own, refused = Simulation.__init__, [0.1]

    def begin(sim, scene, *arguments, **named):
        if scene.drag.stokes in refused:
            raise fault
        own(sim, scene, *arguments, **named)

    monkeypatch.setattr(Simulation, "__init__", begin)
    short = [*STOKES, "-o", tmp_path / "b", "--set", "run.until=0.02"]
    done = command(scene, *short)
    assert done.exit_code == 0, done.output
    assert [row["status"] for row in table(tmp_path / "b")] == [status, "done", "done"]
    refused += [1.0, 10.0]
    none = command(scene, *STOKES, "-o", tmp_path / "c")
    assert none.exit_code in (2, 70) and "Traceback" not in none.output
    assert str(fault) in none.stderr + capfd.readouterr().err and not (tmp_path / "c" / "sweep.png").exists()


def test_several_at_a_time_are_the_same(scene, tmp_path):
    """In processes of their own, of grains alone, which need few kernels."""
    grains = ["--without", "drag", "--without", "gas", "--vary", "dust.ratio=0.1,0.2", "--measure", "kinetic_dust"]
    for name, more in (("one", []), ("two", ["--parallel", 2])):
        assert command(scene, *grains, *more, "-o", tmp_path / name).exit_code == 0
    assert table(tmp_path / "one") == table(tmp_path / "two")
    assert_same_run(tmp_path / "one/ratio=0.2", tmp_path / "two/ratio=0.2")


@pytest.mark.parametrize(
    "arguments, words",
    [
        ([], "nothing to vary; add --vary"),
        (["--vary", "drag.stokes"], "not a key with values"),
        (["--vary", "drag.stoeks=1,2"], 'did you mean "stokes"?'),
        ([*STOKES, "--vary", "drag.stokes=3"], "occurs twice"),
        ([*STOKES, "--measure", "dust-r5"], 'did you mean "dust-r50"?'),
        (["--vary", "title=a b,ab"], "two combinations of values have"),
    ],
)
def test_what_cannot_be_is_told(scene, tmp_path, arguments, words):
    done = command(scene, *arguments, "-o", tmp_path / "b")
    assert done.exit_code == 2 and words in done.stderr and "Traceback" not in done.stderr
    assert not (tmp_path / "b").exists()


def test_runs_of_another_scene_are_left_alone(made, scene):
    before = contents(made[0])
    done = command(scene, *STOKES, "-o", made[0], "--set", "gas.particles=500")
    assert done.exit_code == 2 and "the scene differs from the scene of the run in gas.particles" in done.stderr
    assert contents(made[0]) == before


def test_a_fifo_in_place_of_a_scene_is_not_waited_for(scene, made, tmp_path):
    folder = tmp_path / "a" / table(made[0])[1]["directory"]
    folder.mkdir(parents=True)
    os.mkfifo(folder / "scene.toml")
    given = [sys.executable, "-m", "discsim", "sweep", str(scene), *STOKES, "-o", str(tmp_path / "a")]
    done = subprocess.run(given, capture_output=True, text=True, timeout=60)  # starting takes a few seconds
    assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert f"{folder}/scene.toml: cannot be read: is a FIFO, not a plain file; restore" in done.stderr
    assert os.listdir(tmp_path / "a") == [folder.name]


def test_measures_have_units(tmp_path):
    disc = tomltext.tomllib.loads(DISC)
    far = load_scene(disc | {"units": {"length": "10 au"}})
    found = outcomes_of(far)
    assert found["dust-r50"].head == "dust-r50 [au]" and found["dust-r50"].factor == pytest.approx(10.0, rel=1e-12)
    assert found["accreted_gas"].head == "accreted_gas [Msun]" and found["step"].head == "step"
    # 1 Msun / (10 au)^2 in g/cm2
    assert found["gas-peak"].factor == pytest.approx(1.98841e33 / (10 * 1.495978707e13) ** 2, rel=1e-5)
    assert [each.name for each in select_outcomes(far)] == ["dust-peak", "dust-r50"]  # no star that accretes
    row = dict.fromkeys(COLUMNS, "0") | {"step": "9", "dt_set_by": "gas", "mass_gas": "3", "mass_dust": "4"}
    (tmp_path / "history.csv").write_text(f"{','.join(COLUMNS)}\n{','.join(row.values())}\n")
    (tmp_path / "costs.csv").write_text("effect,calls,cpu_seconds,share\ngas,1,1.5,.75\ndust,1,0.5,.25\n")
    near = load_scene(disc | {"units": {"mass": "10 Msun"}})
    values = read_results(tmp_path, near, select_outcomes(near, ["mass_dust", "step", "cpu"])).values
    assert values == pytest.approx({"mass_dust": 40.0, "step": 9.0, "cpu": 2.0}, rel=1e-12)
    with pytest.raises(StudyError, match="--measure accreted_small: unknown"):
        select_outcomes(far, ["accreted_small"])  # nothing grows


def test_radii_hold_their_shares_of_unequal_masses():
    """Radii that hold .1, .5 and .9 of all mass, whatever the order of the particles."""
    radius, mass = np.array([3.1, 0.4, 2.2, 5.3, 1.7]), np.array([2.6, 0.9, 0.3, 0.8, 1.3])
    assert quantile_radii(radius, mass) == [0.4, 3.1, 5.3]  # within each: .9, 2.2, 2.5, 5.1, 5.9
