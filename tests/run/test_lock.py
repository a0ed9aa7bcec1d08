"""One process at a time writes to a directory; what it leaves when it is killed hinders nobody."""

import errno
import os
import re
import signal
import subprocess
import sys
import time

import pytest
from deaths import forked, status_of
from runs import WAVE, assert_same_run, contents, scene_of
from typer.testing import CliRunner

from discsim.cli import app
from discsim.run.directory import DirectoryError, locked_directory, remove_partial_files
from discsim.run.runner import run_scene


@pytest.fixture(autouse=True)
def no_figure(monkeypatch):
    """Drawing takes longer than these runs."""
    monkeypatch.setattr("discsim.output.figure.last_state_figure", lambda snapshot, figure: figure.touch())


@pytest.fixture
def going_on(tmp_path, monkeypatch):
    """The process id of a run in `tmp_path / "out"` that waits after its first step."""
    scene = scene_of(tmp_path, WAVE)

    def wait(run):
        (tmp_path / "waits").touch()
        time.sleep(100)

    with monkeypatch.context() as patch:
        patch.setattr("discsim.run.runner.Run._after_step", wait)
        child = forked(lambda: run_scene(scene, tmp_path / "out", quiet=True))
    while not (tmp_path / "waits").exists():
        time.sleep(0.01)
    yield child
    try:
        os.kill(child, signal.SIGKILL)
        status_of(child)
    except ProcessLookupError:
        pass


@pytest.mark.parametrize("resume", [False, True])
def test_a_second_run_is_refused_while_one_goes_on(tmp_path, going_on, resume, capsys):
    scene, out = scene_of(tmp_path, WAVE, "drag.t_stop=0.1"), tmp_path / "out"
    before = contents(out)
    assert run_scene(scene, out, resume=resume) == 2
    said = capsys.readouterr()
    when = r"\w+ \w+ +\d+ \d+:\d+:\d+ \d+"
    process = rf"process {going_on} on \S+ since {when}"
    holder = rf"{re.escape(str(out))}: another run uses this directory \({process}\); use another directory, or wait .*"
    assert said.out == "" and re.fullmatch(holder, said.err.strip())
    assert contents(out) == before


def test_the_lock_of_a_killed_run_holds_nobody_up(tmp_path, going_on):
    scene, out = scene_of(tmp_path, WAVE), tmp_path / "out"
    os.kill(going_on, signal.SIGKILL)
    assert status_of(going_on) == -signal.SIGKILL and (out / ".lock").exists()
    assert run_scene(scene, out, resume=True, quiet=True) == 0
    assert run_scene(scene, tmp_path / "straight", quiet=True) == 0
    assert_same_run(tmp_path / "straight", out)
    assert not (out / ".lock").exists()


def test_a_lock_that_was_removed_while_we_opened_it_is_none(tmp_path, monkeypatch):
    # Its holder ends between our open and our flock: what we then have locked is a file without a name.
    import discsim.run.directory as directory

    real, ends = directory.fcntl.flock, [lambda: (tmp_path / ".lock").unlink()]

    def flock(file, how):
        if ends:
            ends.pop()()
        real(file, how)

    monkeypatch.setattr(directory.fcntl, "flock", flock)
    with (
        locked_directory(tmp_path) as locked,
        pytest.raises(DirectoryError, match="another run uses"),
        locked_directory(tmp_path),
    ):
        pass
    assert locked


def test_a_file_system_without_locks_is_told(tmp_path, monkeypatch, capsys):
    def none(file, how):
        raise OSError(errno.ENOSYS, "Function not implemented")

    monkeypatch.setattr("discsim.run.directory.fcntl.flock", none)
    assert run_scene(scene_of(tmp_path, WAVE), tmp_path / "out") == 0
    assert f"warning: {tmp_path / 'out'} cannot be locked" in capsys.readouterr().out
    assert not (tmp_path / "out" / ".lock").exists()
    assert run_scene(scene_of(tmp_path, WAVE), tmp_path / "output", quiet=True) == 0
    said = capsys.readouterr()
    assert (
        said.out == ""
        and said.err.startswith(f"warning: {tmp_path / 'output'} cannot be locked")
        and said.err.count("\n") == 1
    )
    assert said.err in (tmp_path / "output" / "run.log").read_text()


@pytest.mark.faults
def test_two_commands_at_once(tmp_path):
    # One of them runs to its end, as if alone; the other is told of it, or of the run that it left.
    scene = scene_of(tmp_path, WAVE)
    out, commands = tmp_path / "out", []
    for k in range(2):
        changed = ["--set", f"drag.t_stop={(0.002, 0.05)[k]}", "--quiet"]
        arguments = [sys.executable, "-m", "discsim", "run", str(scene.path), "-o", str(out), *changed]
        commands.append(subprocess.Popen(arguments, stderr=subprocess.PIPE, text=True))
    said = [child.communicate(timeout=300)[1] for child in commands]
    winner = [child.returncode for child in commands].index(0)
    assert commands[1 - winner].returncode == 2 and len(said[1 - winner].splitlines()) == 1
    assert "another run uses this directory" in said[1 - winner] or "already contains a run" in said[1 - winner]
    alone = scene_of(tmp_path, WAVE, f"drag.t_stop={(0.002, 0.05)[winner]}")
    assert run_scene(alone, tmp_path / "alone", quiet=True) == 0
    assert_same_run(tmp_path / "alone", out)


def test_half_written_files_are_swept_up(tmp_path):
    scene, out = scene_of(tmp_path, WAVE, "run.walltime=1e-6 s"), tmp_path / "out"
    assert run_scene(scene, out, quiet=True) == 0
    names = (".checkpoint.h5.123.part", ".history.csv.part", "snapshots/.0001.h5.123.part", ".last_state.part.png")
    names = (".checkpoint.h5.123.part", ".history.csv.part", "snapshots/.0001.h5.123.part", ".last_state.part.png")
    parts = [out / name for name in names]
    for part in parts:
        part.write_text("half")
    assert run_scene(scene_of(tmp_path, WAVE), out, resume=True, quiet=True) == 0
    assert not any(part.exists() for part in parts)
    parts[0].write_text("half")  # and of a finished one
    assert run_scene(scene_of(tmp_path, WAVE), out, resume=True, quiet=True) == 0
    assert not parts[0].exists()
    remove_partial_files(tmp_path / "nowhere")


def test_a_child_does_not_keep_the_lock_of_its_killed_parent(tmp_path):
    # As the processes of a pool may, which wait for work that nobody gives them.
    def hold_and_have_a_child():
        with locked_directory(tmp_path / "out"):
            child = forked(lambda: time.sleep(100) or 0)
            (tmp_path / "child").write_text(str(child))
            time.sleep(100)
        return 0

    parent = forked(hold_and_have_a_child)
    while not (tmp_path / "child").exists() or not (tmp_path / "child").read_text():
        time.sleep(0.01)
    os.kill(parent, signal.SIGKILL)
    status_of(parent)
    try:
        with locked_directory(tmp_path / "out") as locked:
            assert locked
    finally:
        os.kill(int((tmp_path / "child").read_text()), signal.SIGKILL)


def test_a_second_study_is_refused_while_one_goes_on(tmp_path):
    scene, out = scene_of(tmp_path, WAVE), tmp_path / "out"
    with locked_directory(out):
        done = CliRunner().invoke(app, ["cost", str(scene.path), "--vary", "gas.particles=50,60", "-o", str(out)])
        assert done.exit_code == 2 and done.stderr.startswith(
            f"{out}: another run uses this directory (process {os.getpid()} "
        )
        assert os.listdir(out) == [".lock"]


@pytest.fixture
def as_of_another_user(monkeypatch):
    """Files named .lock cannot be written, as another user's; `unreadable`: nor read."""
    opened = os.open

    def refused(unreadable):
        def open_file(path, flags, *mode, **more):
            if os.fspath(path).endswith(".lock") and (unreadable or flags & os.O_RDWR):
                raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), os.fspath(path))
            return opened(path, flags, *mode, **more)

        monkeypatch.setattr(os, "open", open_file)

    return refused


def test_a_lock_that_another_users_run_has_left_is_held(tmp_path, as_of_another_user):
    (tmp_path / ".lock").write_text("process 1 on elsewhere")
    as_of_another_user(unreadable=False)
    with locked_directory(tmp_path) as locked:
        assert locked and (tmp_path / ".lock").read_text() == "process 1 on elsewhere"
        with pytest.raises(DirectoryError, match="another run uses this directory"), locked_directory(tmp_path):
            pass
    assert not (tmp_path / ".lock").exists()


def test_a_lock_that_cannot_be_opened_is_one_message(tmp_path, as_of_another_user, capsys):
    out = tmp_path / "out"
    out.mkdir()
    (out / ".lock").touch()
    as_of_another_user(unreadable=True)
    assert run_scene(scene_of(tmp_path, WAVE), out) == 2
    said = capsys.readouterr()
    assert (
        said.out == ""
        and said.err.startswith(f"{out / '.lock'}: this lock belongs to another user")
        and said.err.count("\n") == 1
    )
    assert os.listdir(out) == [".lock"]


@pytest.mark.parametrize("kind", ["link", "fifo", "directory"])
def test_what_is_no_lock_is_left_alone(tmp_path, kind, capsys):
    """A link would have what it leads to emptied."""
    out, own = tmp_path / "out", tmp_path / "own.txt"
    out.mkdir()
    own.write_text("a diary")
    {"link": lambda p: p.symlink_to(own), "fifo": os.mkfifo, "directory": os.mkdir}[kind](out / ".lock")
    assert run_scene(scene_of(tmp_path, WAVE), out) == 2
    assert capsys.readouterr().err.startswith(
        f"{out / '.lock'}: is not a plain file, but runs use the name for their lock file"
    )
    assert own.read_text() == "a diary" and os.listdir(out) == [".lock"]
