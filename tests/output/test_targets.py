"""Commands that are to write where something other than a plain file is: it is left as it is."""

import os
import stat
from pathlib import Path

import numpy as np
import pytest
from runs import SHOCK, errors_of, scene_of
from typer.testing import CliRunner

import discsim
from discsim import Simulation
from discsim.cli import app
from discsim.output.checkpoint import write_checkpoint
from discsim.output.files import open_to_append, replace_atomically
from discsim.run.runner import run_scene

KINDS = {"a FIFO": os.mkfifo, "a symbolic link": lambda path: path.symlink_to(path.parent / "kept"),
         "a directory": Path.mkdir}  # fmt: skip


@pytest.fixture(params=KINDS)
def target(request, tmp_path):
    """A path at which there is no plain file, and the word for what is there."""
    (tmp_path / "kept").write_text("kept")
    path = tmp_path / "target.h5"
    KINDS[request.param](path)
    return path, request.param


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("discsim.output.figure.last_state_figure", lambda snapshot, figure: figure.touch())
        assert run_scene(scene_of(folder, SHOCK, "run.until=0.01"), folder / "out", quiet=True) == 0
    return folder / "out"


def mode_of(path):
    return stat.S_IFMT(os.lstat(path).st_mode)


def assert_untouched(path, mode):
    assert mode_of(path) == mode and (path.parent / "kept").read_text() == "kept"
    assert not [*path.parent.glob(".*")]


def test_a_checkpoint_does_not_replace_what_is_no_plain_file(target, tmp_path):
    path, kind = target
    mode, other = mode_of(path), tmp_path / "other.h5"
    sim = Simulation({"units": {"system": "code"}, "run": {"until": 0.1}, "space": {"size": 8.0}, "star": {"mass": 0.7},
                      "dust": {"ratio": 0.3}}, particles={"dust": {"pos": np.array([[1.3, 0.2]]),
                      "vel": np.array([[0.1, 0.7]]), "mass": np.array([0.02])}})  # fmt: skip
    for save in (lambda: sim.save(path), lambda: write_checkpoint(other, {}, {"n": 1}, backup=path)):
        other.write_text("before")
        with pytest.raises(OSError, match=f"is {kind}; choose the name of a plain file or of a new file") as caught:
            save()
        assert caught.value.filename == str(path) and other.read_text() == "before"
    assert_untouched(path, mode)


def test_what_becomes_no_plain_file_meanwhile_is_not_replaced(tmp_path):
    path = tmp_path / "a.txt"
    with pytest.raises(OSError, match="is a FIFO"), replace_atomically(path) as temporary:
        temporary.write_text("new")
        os.mkfifo(path)
    assert mode_of(path) == stat.S_IFIFO and [*tmp_path.iterdir()] == [path]


def test_nothing_is_appended_to_what_is_no_plain_file(target):
    path, kind = target
    mode = mode_of(path)
    with pytest.raises(OSError, match=f"is {kind}"):
        open_to_append(path)
    assert_untouched(path, mode)


@pytest.mark.parametrize(
    "command, ending",
    [(["report", "RUN", "-o"], ".html"), (["plot", "RUN", "--profile", "-o"], ".png"), (["movie", "RUN", "-o"], ".gif"),
     (["new", "dusty_wave"], ".toml")],
)  # fmt: skip
def test_a_command_does_not_replace_what_is_no_plain_file(run, tmp_path, target, command, ending):
    path, kind = target
    path = path.rename(path.with_suffix(ending)) if kind != "a symbolic link" else path
    if kind == "a symbolic link":
        path.unlink()
        path = path.with_suffix(ending)
        KINDS[kind](path)
    mode = mode_of(path)
    given = [str(run) if word == "RUN" else word for word in command]
    done = CliRunner().invoke(app, [*given, str(path)])
    assert done.exit_code in (1, 2) and len(done.stderr.splitlines()) == 1 and str(path) in done.stderr
    if command[0] != "new":  # which takes no name that is there, of whatever kind
        assert done.stderr.startswith(f"{path}: ")
        assert f"is {kind}; choose the name of a plain file or of a new file" in done.stderr
    assert_untouched(path, mode)


@pytest.mark.parametrize("name", ["run.log", "history.csv", "scene.toml", "checkpoint.h5", "snapshots/0000.h5"])
def test_a_run_does_not_replace_what_is_no_plain_file(tmp_path, name, capfd):
    out = tmp_path / "out"
    (out / "snapshots").mkdir(parents=True)
    os.mkfifo(out / name)
    (out / "snapshots" / "x").touch()
    for path in [out / "snapshots"] if name != "snapshots/0000.h5" else []:
        (path / "x").unlink()
        path.rmdir()
    scene = scene_of(tmp_path, SHOCK, "run.until=0.003")
    status = run_scene(scene, out, quiet=True)
    said = capfd.readouterr()
    assert status in (1, 2) and errors_of(said.err)[0].startswith(str(out)) and "Traceback" not in said.err
    assert mode_of(out / name) == stat.S_IFIFO


def test_only_the_owner_of_targets_replaces_or_appends():
    home = Path(discsim.__file__).parent
    found = {word: set() for word in ("os.replace", '.open("a', ".open('a")}
    for file in home.rglob("*.py"):
        for word, names in found.items():
            if word in file.read_text():
                names.add(file.relative_to(home).as_posix())
    assert found == {
        "os.replace": {"output/files.py"},
        '.open("a': {"output/files.py", "run/progress.py"},
        ".open('a": set(),
    }
