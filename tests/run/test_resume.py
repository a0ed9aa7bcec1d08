"""Runs that are killed at any moment go on to the files of one that never stopped."""

import errno
import os
import shutil
import signal
import warnings

import h5py
import numpy as np
import pytest
from deaths import forked, left_by_kills, status_of
from runs import DISC, SHOCK, WAVE, assert_same_files, at_step, contents, errors_of, rows, scene_of, state_bits

import discsim
from discsim import Simulation, __version__, read_snapshot
from discsim.output import hdf5
from discsim.output.checkpoint import REMEDY, OtherVersionWarning, read_checkpoint
from discsim.output.files import command_line
from discsim.output.history import history_row
from discsim.run.runner import Run, run_scene
from discsim.run.simulation import PhysicsError
from discsim.scene import SceneError, load_scene

ALWAYS = "run.checkpoint_every=1e-9 s"


@pytest.fixture(autouse=True)
def no_figure(monkeypatch):
    """Drawing takes longer than these runs."""
    monkeypatch.setattr("discsim.output.figure.last_state_figure", lambda snapshot, figure: figure.touch())


def finish(scene, out):
    """Go on with a run as a person would: --resume where that is told, else from the start."""
    resume = (out / "scene.toml").exists()
    assert run_scene(scene, out, resume=resume, quiet=True) == 0


def test_killed_before_any_file_operation(tmp_path):
    # Two steps, the second of which lands on the output, and a checkpoint at both.
    given = ("gas.particles=50", "run.until=0.004", "run.timestep=0.002", "run.snapshots=1", ALWAYS)
    scene = scene_of(tmp_path, WAVE, *given, without=("dust", "drag"))
    straight, whole = tmp_path / "straight", tmp_path / "whole"
    assert run_scene(scene, straight, quiet=True) == 0
    left = left_by_kills(lambda: run_scene(scene, whole, quiet=True), whole, tmp_path / "left")
    assert len(left) > 12 and [row["step"] for row in rows(straight)] == list("012")
    for out in left:
        finish(scene, out)
        assert_same_files(straight, out)


@pytest.mark.parametrize("rows_every", [1, 16])
def test_a_snapshot_that_was_due_at_the_checkpoint_is_made(tmp_path, monkeypatch, rows_every):
    # Killed after the checkpoint of the step that lands on an output, before the output.
    scene = scene_of(tmp_path, WAVE, "run.until=0.02", "run.timestep=0.005", ALWAYS)
    monkeypatch.setattr("discsim.run.runner.FEW_PARTICLES", 20_000 if rows_every == 1 else 100)
    assert run_scene(scene, tmp_path / "straight", quiet=True) == 0
    landing = [int(row["step"]) for row in rows(tmp_path / "straight") if float(row["time"]) in (0.01, 0.02)]
    assert len(landing) == 2
    for step in landing:
        out = tmp_path / str(step)

        def die(sim):
            monkeypatch.setattr("discsim.run.runner.Run._write_output", lambda run: os._exit(9))

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

    real = Run._write_output
    with monkeypatch.context() as patch:
        patch.setattr(Run, "_write_output", die)
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


def test_the_figure_of_a_run_that_was_killed_before_it(tmp_path, monkeypatch):
    scene, out = scene_of(tmp_path, SHOCK, "run.until=0.01"), tmp_path / "out"
    with monkeypatch.context() as patch:
        patch.setattr("discsim.output.figure.last_state_figure", lambda snapshot, figure: figure.touch() or os._exit(9))
        assert status_of(forked(lambda: run_scene(scene, out, quiet=True))) == 9
    assert not (out / "last_state.png").exists()
    assert run_scene(scene, out, resume=True, quiet=True) == 0
    assert (out / "last_state.png").exists() and not [*out.glob(".*.part*")]
    for path in (out / "last_state.png", *(out / "snapshots").iterdir()):
        path.unlink()  # by somebody who needs the room
    assert run_scene(scene, out, resume=True, quiet=True) == 0


@pytest.fixture
def stopped(tmp_path, monkeypatch):
    """A scene, and the directory of its run stopped after three steps."""
    scene = scene_of(tmp_path, SHOCK)
    with monkeypatch.context() as patch:
        at_step(patch, 3, lambda sim: signal.raise_signal(signal.SIGINT))
        assert run_scene(scene, tmp_path / "out", quiet=True) == 130
    return scene, tmp_path / "out"


def refused(scene, out, capsys):
    """The one message of a run that cannot be resumed and changes nothing."""
    capsys.readouterr()
    before = contents(out)
    assert run_scene(scene, out, resume=True, quiet=True) == 2
    said = capsys.readouterr()
    assert said.out == "" and len(errors_of(said.err)) == 1 and contents(out) == before
    return said.err.strip()


@pytest.mark.parametrize(
    "name", ["arrays/gas", "arrays/gas/pos", "arrays/ledger/accreted_gas", "arrays/costs/calls", "arrays/scene/text"]
    + [f"values@{value}" for value in ("time", "step", "lag", "limited_by", "snapshots", "put_out", "rows", "dt")],
)  # fmt: skip
def test_a_checkpoint_that_lacks_something_is_one_message(stopped, name, capsys):
    scene, out = stopped
    with h5py.File(out / "checkpoint.h5", "a") as file:
        group, _, value = name.partition("@")
        if value:
            del file[group].attrs[value]
        else:
            del file[name]
    message = refused(scene, out, capsys)
    last = name.replace("@", "/").split("/")[-1]
    lacks = f"the checkpoint has no '{last}'; it is damaged, or was written by another version of discsim; {REMEDY}"
    assert message in (f"{out}/checkpoint.h5: {lacks}", f"{out}/checkpoint.h5: does not hold the gas of this scene")


@pytest.mark.parametrize(
    "damage, words",
    [
        (lambda text: text.replace(b"\n1,", b"\n\xff,"), "history.csv:3: not a row of history.csv"),
        (lambda text: text.replace(b"step,time", b"time,step"), "history.csv:1: not the header of history.csv"),
        (lambda text: text.decode().encode("utf-16"), "history.csv:1: not the header of history.csv"),
        (lambda text: text.replace(b"\n2,", b"\n2,,"), "history.csv:4: not a row of history.csv"),
    ],
)
def test_a_damaged_history_is_one_message(stopped, damage, words, capsys):
    scene, out = stopped
    (out / "history.csv").write_bytes(damage((out / "history.csv").read_bytes()))
    assert words in refused(scene, out, capsys)


@pytest.mark.parametrize("lost", [1, 2, 4, 5])
def test_lost_rows_are_told(stopped, lost, capsys):
    scene, out = stopped
    lines = (out / "history.csv").read_bytes().splitlines(keepends=True)
    (out / "history.csv").write_bytes(b"".join(lines[:-lost]))
    assert len(lines) == 5  # the header, the start, and three steps
    assert run_scene(scene, out, resume=True) == 0
    warning = f"warning: {out}/history.csv has {max(4 - lost, 0)} rows up to step 3, but the run wrote 4 rows"
    assert warning in capsys.readouterr().out.splitlines()
    assert run_scene(scene_of(scene.path.parent, SHOCK, "run.until=0.11"), out, resume=True) == 0
    assert "warning: " + str(out) not in capsys.readouterr().out  # once is enough


@pytest.mark.parametrize("damage", ["cut", "gone"])
def test_a_run_goes_on_from_the_checkpoint_before_the_last(tmp_path, monkeypatch, damage, capsys):
    """And keeps that one until there is another."""
    scene, out = scene_of(tmp_path, SHOCK, "run.until=0.02", ALWAYS), tmp_path / "out"
    assert run_scene(scene, tmp_path / "straight", quiet=True) == 0
    with monkeypatch.context() as patch:
        at_step(patch, 5, lambda sim: os._exit(9))
        assert status_of(forked(lambda: run_scene(scene, out, quiet=True))) == 9
    last, before = out / "checkpoint.h5", out / "checkpoint_before.h5"
    kept = before.read_bytes()
    assert [read_checkpoint(path)[1]["step"] for path in (before, last)] == [3, 4]
    last.write_bytes(last.read_bytes()[:-99])
    if damage == "gone":
        last.unlink()
    with monkeypatch.context() as patch:  # a fault before the first step
        patch.setattr("discsim.run.runner.Run._after_step", lambda run: os._exit(9))
        assert status_of(forked(lambda: run_scene(scene, out, resume=True, quiet=True))) == 9
    assert last.read_bytes() == kept and not before.exists()
    before.write_bytes(kept)
    last.unlink()
    assert run_scene(scene, out, resume=True) == 0
    told = [line for line in capsys.readouterr().out.splitlines() if str(before) in line]
    assert len(told) == 1 and told[0].startswith(f"warning: {last}: file not found; ")
    assert f"the run resumes from {before}, at t = 0.00" in told[0]
    assert_same_files(tmp_path / "straight", out)


def test_a_changed_history_is_one_message(stopped, capsys):
    """One digit of a row that is a row still: its checkpoint knows the digest."""
    scene, out = stopped
    lines = (out / "history.csv").read_text().splitlines()
    cells = lines[2].split(",")
    cells[4] = repr(float(cells[4]) * (1.0 + 1e-15))
    (out / "history.csv").write_text("\n".join([*lines[:2], ",".join(cells), *lines[3:]]))
    assert f"{out}/history.csv:2: the 4 rows from this line on differ from the rows that the run wrote" in refused(
        scene, out, capsys
    )


def test_a_broken_row_later_than_the_checkpoint_is_told(stopped, capsys):
    scene, out = stopped
    with (out / "history.csv").open("a") as file:
        file.write("4,0.00")
    assert run_scene(scene, out, resume=True) == 0
    told = [line for line in capsys.readouterr().out.splitlines() if "incomplete row" in line]
    assert told == [
        f"warning: {out}/history.csv:6: an incomplete row after the checkpoint is removed; the run writes it again"
    ]
    assert run_scene(scene, out.with_name("straight"), quiet=True) == 0
    assert_same_files(out.with_name("straight"), out)


def test_no_checkpoint_of_numbers_that_are_not_finite(stopped):
    scene, out = stopped
    before = contents(out)
    sim = Simulation(scene, to_restore=True)
    sim.restore(out / "checkpoint.h5")
    sim.gas.mass[7] = np.nan
    with pytest.raises(PhysicsError, match=r"gas particle \d+ is not finite in its mass"):
        sim.save(out / "checkpoint.h5")
    assert contents(out) == before


def test_a_row_that_is_due_at_the_checkpoint_is_the_same_once_resumed(tmp_path):
    """Its potential is that of the checkpoint, not of the start that has settled in its own."""
    scene, found = scene_of(tmp_path, DISC), []
    one, other = Simulation(scene), Simulation(scene, to_restore=True)
    one.evolve(0.15)
    one.save(tmp_path / "checkpoint.h5")
    other.restore(tmp_path / "checkpoint.h5")
    for sim in (one, other):
        with sim.synchronised() as state:
            found.append(history_row(state, sim.effects, 0.1, "gas"))
    assert found[0] == found[1]


def test_files_say_what_made_them(stopped, monkeypatch):
    _, out = stopped
    for path in (out / "checkpoint.h5", out / "snapshots" / "0000.h5"):
        with h5py.File(path) as file:
            assert file.attrs["version"].decode() == __version__ and file.attrs["command"].decode() == command_line()
    snap = read_snapshot(out / "snapshots" / "0000.h5")
    assert (snap.version, snap.command) == (__version__, command_line())
    assert f"command: {command_line()}" in (out / "run.log").read_text().splitlines()
    for given in ("/usr/bin/discsim", discsim.__file__.replace("__init__", "__main__")):
        monkeypatch.setattr("sys.argv", [given, "run", "a b.toml"])
        assert command_line() == "discsim run 'a b.toml'"


def test_another_scene_is_not_begun_anew(stopped, tmp_path, capsys):
    # Without a checkpoint as with one.
    _, out = stopped
    for path in out.glob("checkpoint*.h5"):
        path.unlink()
    for snapshot in list((out / "snapshots").iterdir()):
        if snapshot.name != "0000.h5":
            snapshot.unlink()
    message = refused(scene_of(tmp_path, SHOCK, "gas.particles=201"), out, capsys)
    assert message.startswith(
        f"{out}/scene.toml: the scene differs from the scene of the run in gas.particles; change only"
    )


def test_a_lost_checkpoint_is_not_begun_anew(stopped, capsys):
    # Snapshots would be lost.
    scene, out = stopped
    for path in out.glob("checkpoint*.h5"):
        path.unlink()
    (out / "snapshots" / "0001.h5").touch()
    assert "there is no checkpoint.h5 to resume from" in refused(scene, out, capsys)


def test_compiling_is_no_cost_of_a_run_that_was_killed(tmp_path, monkeypatch):
    # A checkpoint after the first step has its calls no more than one that is made later.
    scene, out = scene_of(tmp_path, SHOCK, ALWAYS), tmp_path / "out"
    with monkeypatch.context() as patch:
        at_step(patch, 2, lambda sim: os._exit(9))
        assert status_of(forked(lambda: run_scene(scene, out, quiet=True))) == 9
    groups, values = read_checkpoint(out / "checkpoint.h5")
    assert values["step"] == 1 and not groups["costs"]["calls"].any()


def test_a_checkpoint_of_another_version_is_told(tmp_path, monkeypatch, capsys):
    scene, out = scene_of(tmp_path, WAVE), tmp_path / "out"
    with monkeypatch.context() as patch:
        patch.setattr("discsim.output.hdf5.__version__", "0.0.7")
        at_step(patch, 4, lambda sim: signal.raise_signal(signal.SIGTERM))
        assert run_scene(scene, out, quiet=True) == 143
    words = (
        f"{out / 'checkpoint.h5'} was written by discsim 0.0.7, and this is discsim {__version__}: the "
        f"run continues, but"
    )
    sim = Simulation(scene, to_restore=True)
    with pytest.warns(OtherVersionWarning) as told:
        sim.restore(out / "checkpoint.h5")
    assert str(told[0].message).startswith(words) and len(told) == 1
    careful = Simulation(scene, to_restore=True)
    before = state_bits(careful)
    with warnings.catch_warnings(), pytest.raises(OtherVersionWarning):
        warnings.simplefilter("error")
        careful.restore(out / "checkpoint.h5")
    assert state_bits(careful) == before and careful.time == careful.state.step == 0
    capsys.readouterr()
    assert run_scene(scene, out, resume=True) == 0
    said = capsys.readouterr()
    assert said.out.count(f"warning: {words}") == 1 and said.err == ""
    assert (out / "run.log").read_text().count(words) == 1
    again = Simulation(scene, to_restore=True)
    again.restore(out / "checkpoint.h5")  # that of this version is taken without a word


def test_a_checkpoint_is_read_to_be_checked_and_to_be_taken(tmp_path, monkeypatch):
    scene, out = scene_of(tmp_path, WAVE), tmp_path / "out"
    assert run_scene(scene, out, quiet=True) == 0
    read, opened = [], hdf5.open_checked

    def noted(path):
        read.append(path)
        return opened(path)

    monkeypatch.setattr("discsim.output.hdf5.open_checked", noted)
    assert run_scene(scene_of(tmp_path, WAVE, "run.until=0.11"), out, resume=True, quiet=True) == 0
    assert read.count(out / "checkpoint.h5") == 2


def test_what_is_read_to_go_on_is_not_said_to_be_written(tmp_path, capsys):
    scene, out = scene_of(tmp_path, WAVE), tmp_path / "out"
    assert run_scene(scene, out, quiet=True) == 0
    further = scene_of(tmp_path, WAVE, "run.until=0.11")
    (out / "history.csv").unlink()
    os.mkfifo(out / "history.csv")
    capsys.readouterr()
    assert run_scene(further, out, resume=True, quiet=True) == 2
    cure = "repair the file, or move it away to continue without its rows"
    assert capsys.readouterr().err == f"{out}/history.csv: cannot be read: is a FIFO, not a plain file; {cure}\n"
    for path in (*out.glob("checkpoint*.h5"), *out.glob("snapshots/000[1-9].h5"), out / "scene.toml"):
        path.unlink()
    os.mkfifo(out / "scene.toml")  # of a run that was killed before its first checkpoint
    assert run_scene(further, out, resume=True, quiet=True) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"{out}/scene.toml: cannot be read: is a FIFO, not a plain file; restore")
    assert said.count("\n") == 1


TABLE = 'kind = "table"\nfile = "disc.txt"\n'


def from_a_table(tmp_path):
    """A disc that begins with a table beside its scene."""
    (tmp_path / "disc.txt").write_text("# r  Sigma\n0.7 0.02\n1.9 0.01\n")
    return scene_of(tmp_path, DISC.replace('kind = "disc"\nmass = 0.05\ninner = 0.5\nouter = 2\n', TABLE))


def test_a_start_that_is_gone_is_not_said_to_be_written(tmp_path, capsys):
    scene = from_a_table(tmp_path)
    (tmp_path / "disc.txt").unlink()
    assert run_scene(scene, tmp_path / "new/out", quiet=True) == 2
    (said,) = errors_of(capsys.readouterr().err)
    assert said == f"{tmp_path}/disc.txt: cannot be read: No such file or directory"
    assert not (tmp_path / "new").exists()


def test_a_scene_that_a_run_has_left_has_its_start(tmp_path, monkeypatch, capsys):
    scene, out = from_a_table(tmp_path), tmp_path / "out"
    out.mkdir()
    os.mkfifo(out / "run.log")
    assert run_scene(scene, out, quiet=True) == 1
    assert (
        "run.log: cannot be written: is a FIFO; choose the name of a plain file or of a new file"
        in capsys.readouterr().err
    )
    assert load_scene(out / "scene.toml").initial.file.path == out / "initial.txt"


def test_a_start_that_is_refused_leaves_nothing(tmp_path, monkeypatch, capsys):
    """Neither a directory nor the table that the run would have had there."""
    scene = from_a_table(tmp_path)

    def refused(*given, **more):
        raise SceneError(["scene: gas: falls in"])

    monkeypatch.setattr("discsim.run.runner.Simulation", refused)
    before = sorted(os.listdir(tmp_path))
    assert run_scene(scene, tmp_path / "new/out", quiet=True) == 2
    assert errors_of(capsys.readouterr().err) == ["scene: gas: falls in"]
    assert sorted(os.listdir(tmp_path)) == before
    (tmp_path / "here").mkdir()  # one that is there stays as it is
    (tmp_path / "here/initial.txt").write_text("a diary")
    assert run_scene(scene, tmp_path / "here", quiet=True) == 2
    assert os.listdir(tmp_path / "here") == ["initial.txt"]


def test_too_few_file_handles_are_not_blamed_on_the_directory(tmp_path, monkeypatch, capsys):
    def full(*given, **more):
        raise OSError(errno.EMFILE, os.strerror(errno.EMFILE), "some.csv")

    monkeypatch.setattr("discsim.run.outputs.write_snapshot", full)
    assert run_scene(scene_of(tmp_path, WAVE), tmp_path / "out", quiet=True) == 1
    said = capsys.readouterr().err
    assert said.startswith("too many open files in this process; raise the limit") and "written" not in said


def test_a_damaged_last_snapshot_is_one_message_where_the_figure_is_missing(tmp_path, monkeypatch, capsys):
    scene, out = scene_of(tmp_path, WAVE), tmp_path / "out"
    assert run_scene(scene, out, quiet=True) == 0
    (out / "last_state.png").unlink()
    (out / "snapshots/0002.h5").write_bytes(b"damaged")
    monkeypatch.undo()
    capsys.readouterr()
    assert run_scene(scene, out, resume=True, quiet=True) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"{out / 'snapshots/0002.h5'}: not a snapshot") and said.count("\n") == 1
