"""Snapshots and checkpoints that hold something else than was written: each is refused with one message, at once."""

import shutil

import pytest
from mangled import OF_CHECKPOINTS, WAYS, mangle, odd_files
from runs import DISC, contents, errors_of, scene_of
from typer.testing import CliRunner

from discsim import read_snapshot
from discsim.cli import app
from discsim.output.snapshot import SnapshotError
from discsim.run.runner import run_scene

SNAPSHOTS = CHECKPOINTS = 60


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A scene with several populations, and the directory of its run."""
    folder = tmp_path_factory.mktemp("run")
    changes = [
        ("particles = 1000", "particles = 300"), ("until = 2.5", "until = 0.02"), ("every = 0.25", "snapshots = 2"),
        ("[dust]\nparticles = 1100", "[[dust]]\nparticles = 90"),
        ("[star]", "[[dust]]\nparticles = 70\nratio = 0.05\n[star]"),
    ]  # fmt: skip
    text = DISC
    for old, new in changes:
        text = text.replace(old, new)
    scene = scene_of(folder, text)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("discsim.output.figure.last_state_figure", lambda snapshot, figure: figure.touch())
        assert run_scene(scene, folder / "out", quiet=True) == 0
    (folder / "out" / "checkpoint_before.h5").unlink()
    return scene_of(folder, scene.text, "run.until=0.03"), folder / "out"


def one_line(text, path):
    assert len(text.splitlines()) == 1 and str(path) in text and len(text) < 600, text
    return True


@pytest.mark.parametrize("seed", range(SNAPSHOTS))
def test_a_mangled_snapshot_is_one_message(run, tmp_path, seed):
    path = tmp_path / "0001.h5"
    shutil.copy(run[1] / "snapshots" / "0001.h5", path)
    done = mangle(path, WAYS, seed)
    with pytest.raises(SnapshotError) as caught:
        read_snapshot(path)
        pytest.fail(f"taken: {done}")
    print(f"{done}: {caught.value}")
    assert one_line(str(caught.value), path)


@pytest.mark.parametrize("seed", range(CHECKPOINTS))
def test_a_mangled_checkpoint_is_one_message(run, tmp_path, seed, capsys):
    scene, whole = run
    out = tmp_path / "out"
    shutil.copytree(whole, out)
    done = mangle(out / "checkpoint.h5", OF_CHECKPOINTS, seed)
    before = contents(out)
    capsys.readouterr()
    assert run_scene(scene, out, resume=True, quiet=True) == 2, done
    said = capsys.readouterr()
    print(f"{done}: {said.err}")
    assert said.out == "" and one_line("\n".join(errors_of(said.err)), out / "checkpoint.h5")
    assert contents(out) == before


def test_what_is_no_file_of_ours_is_one_message(run, tmp_path, capsys):
    scene, whole = run
    for path in odd_files(tmp_path, (whole / "snapshots" / "0001.h5").read_bytes()):
        with pytest.raises(SnapshotError) as caught:
            read_snapshot(path)
        assert one_line(str(caught.value), path)
        for command in (["plot", str(path)], ["plot", str(path), "--profile"]):
            done = CliRunner().invoke(app, command)
            assert done.exit_code == 2 and one_line(done.stderr, path)
        if path.name == "folder.h5":
            continue
        out = tmp_path / f"{path.stem}-out"
        shutil.copytree(whole, out)
        (out / "checkpoint.h5").unlink()
        if path.exists():
            path.rename(out / "checkpoint.h5")
        assert run_scene(scene, out, resume=True, quiet=True) == 2
        assert one_line(capsys.readouterr().err, out)
