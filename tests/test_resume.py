"""Runs that are killed at any moment go on to the files of one that never stopped."""

import os
import shutil

import pytest
from deaths import forked, left_by_kills, status_of
from test_runner import SHOCK, WAVE, assert_same_run, at_step, rows, scene_of

from discsim import read_snapshot
from discsim.checkpoint import read_checkpoint
from discsim.runner import _Run, run_scene

ALWAYS = "run.checkpoint_every=1e-9 s"


@pytest.fixture(autouse=True)
def no_figure(monkeypatch):
    """Drawing takes longer than these runs."""
    monkeypatch.setattr("discsim.figure.last_state_figure", lambda snapshot, figure: None)


def assert_same_files(one, other):
    """Snapshots, rows, and the state that the runs could go on from; seconds of CPU differ."""
    assert_same_run(one, other)
    groups, values = read_checkpoint(one / "checkpoint.h5")
    found, found_values = read_checkpoint(other / "checkpoint.h5")
    assert values == found_values
    for group in set(groups) - {"costs"}:
        assert {name: a.tobytes() for name, a in groups[group].items()} == {
            name: a.tobytes() for name, a in found[group].items()
        }
    assert sorted(os.listdir(one)) == sorted(os.listdir(other))


def finish(scene, out):
    """Go on with a run as a person would: --resume where that is told, else from the start."""
    resume = (out / "scene.toml").exists()
    assert run_scene(scene, out, resume=resume, quiet=True) == 0


def test_killed_before_any_file_operation(tmp_path):
    # Three steps, the last two of which land on outputs, and a checkpoint at every one.
    text = SHOCK.replace("snapshots = 4", "every = 0.004").replace("particles = 200", "particles = 100")
    scene = scene_of(tmp_path, text, "run.until=0.006", "run.timestep=0.002", ALWAYS)
    straight, whole = tmp_path / "straight", tmp_path / "whole"
    assert run_scene(scene, straight, quiet=True) == 0
    left = left_by_kills(lambda: run_scene(scene, whole, quiet=True), whole, tmp_path / "left")
    assert len(left) > 40 and [row["step"] for row in rows(straight)] == list("0123")
    for out in left:
        finish(scene, out)
        assert_same_files(straight, out)


@pytest.mark.parametrize("rows_every", [1, 16])
def test_a_snapshot_that_was_due_at_the_checkpoint_is_made(tmp_path, monkeypatch, rows_every):
    # Killed after the checkpoint of the step that lands on an output, before the output.
    scene = scene_of(tmp_path, WAVE, "run.snapshots=4", ALWAYS)
    monkeypatch.setattr("discsim.runner.SMALL", 20_000 if rows_every == 1 else 100)
    assert run_scene(scene, tmp_path / "straight", quiet=True) == 0
    landing = [int(row["step"]) for row in rows(tmp_path / "straight") if float(row["time"]) in (0.05, 0.1)]
    for step in landing:
        out = tmp_path / str(step)

        def die(sim):
            monkeypatch.setattr("discsim.runner._Run._output", lambda run: os._exit(9))

        def run():
            at_step(monkeypatch, step, die)  # noqa: B023
            return run_scene(scene, out, quiet=True)  # noqa: B023

        assert status_of(forked(run)) == 9
        assert read_checkpoint(out / "checkpoint.h5")[1]["step"] == step
        assert run_scene(scene, out, resume=True, quiet=True) == 0
        assert_same_files(tmp_path / "straight", out)


def test_a_due_snapshot_with_another_schedule(tmp_path, monkeypatch):
    # Killed with the snapshot of t = .05 due: it keeps its number, and the new times follow.
    scene = scene_of(tmp_path, WAVE, ALWAYS)
    out = tmp_path / "out"

    def die(run):
        if run.sim.time == 0.05:
            os._exit(9)
        real(run)

    real = _Run._output
    with monkeypatch.context() as patch:
        patch.setattr(_Run, "_output", die)
        assert status_of(forked(lambda: run_scene(scene, out, quiet=True))) == 9
    for until, every, expected in (
        (0.1, 0.05, [0, 0.05, 0.1]),
        (0.14, 0.02, [0, 0.06, 0.08, 0.1, 0.12, 0.14]),  # .02 and .04 were never due, .05 is no longer
        (0.05, 0.05, [0, 0.05]),
    ):
        copy = tmp_path / f"until {until}"
        shutil.copytree(out, copy)
        again = scene_of(tmp_path, WAVE.replace("snapshots = 2", f"every = {every}"), f"run.until={until}")
        assert run_scene(again, copy, resume=True, quiet=True) == 0
        found = [read_snapshot(path).time for path in sorted((copy / "snapshots").iterdir())]
        assert found == expected
