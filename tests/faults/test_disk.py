"""Disks that are full, read-only, gone, or lose their power: one message, and nothing is lost of what was saved."""

import errno
import os
import shutil

import numpy as np
import pytest
from deaths import in_pieces, watched
from disks import Flushed, Limited, Memory
from runs import DISC, WAVE, assert_same_files, at_step, errors_of, rows, scene_of
from short import ALWAYS

from discsim import read_snapshot
from discsim.output.checkpoint import read_checkpoint
from discsim.run.runner import run_scene

SIZES = 40
SMALL = ("gas.particles=50", "dust.particles=50", "run.until=0.012", "run.timestep=0.002", "run.snapshots=3", ALWAYS)


def whole_run(folder, *scene):
    """A scene and the directory of its run."""
    loaded = scene_of(folder, *scene)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("discsim.output.figure.last_state_figure", lambda snapshot, figure: figure.touch())
        assert run_scene(loaded, folder / "out", quiet=True) == 0
    return loaded, folder / "out"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A scene, the directory of its run, and how many bytes that has."""
    scene, out = whole_run(tmp_path_factory.mktemp("whole"), WAVE, *SMALL)
    return scene, out, sum(path.stat().st_size for path in out.rglob("*") if path.is_file())


@pytest.fixture(scope="module")
def disc(tmp_path_factory):
    """Six steps, two outputs."""
    steps = ("run.timestep=0.02", "run.until=0.12", "run.every=0.06", ALWAYS)
    return whole_run(tmp_path_factory.mktemp("disc"), DISC, *steps)


def fails(scene, out, capsys, words, resume=False):
    """Run into a fault of the disk: status 1 and one line, and every file that is there can be read."""
    capsys.readouterr()
    assert run_scene(scene, out, resume=resume, quiet=True) == 1
    said = capsys.readouterr()
    assert said.out == "" and len(errors_of(said.err)) == 1 and words in said.err
    for path in out.glob("snapshots/*.h5"):
        read_snapshot(path)
    for path in out.glob("checkpoint*.h5"):
        read_checkpoint(path)
    assert not [*out.rglob(".*.part*")]
    if (out / "history.csv").exists():
        assert all(None not in row.values() and float(row["radiated"]) == 0.0 for row in rows(out))


def go_on(scene, out):
    saved = (out / "scene.toml").exists()
    assert run_scene(scene, out, resume=saved, quiet=True) == 0
    return "resumed" if saved and any(out.glob("checkpoint*.h5")) else "began anew"


def test_a_disk_that_is_full(tmp_path, run, capsys):
    scene, straight, size = run
    ends, number = [], 0
    for pages in np.unique(np.linspace(1, -(-size // Memory.PAGE), SIZES).astype(int)):
        disk = Memory(tmp_path / str(pages), pages)
        try:
            out = disk.path / "out"
            fails(scene, out, capsys, "No space left on device")
            disk.grow(20 * size // Memory.PAGE)
            ends.append(go_on(scene, out))
            assert_same_files(straight, out)
        finally:
            disk.close()
        number += 1
    print(f"{number} sizes of a disk up to {size} bytes: {ends.count('resumed')} resumed, the others began anew")


def test_a_disk_that_is_full_without_root(tmp_path, run, monkeypatch, capsys):
    scene, straight, size = run
    ends = []
    for room in np.linspace(0, size, SIZES).astype(int):
        out = tmp_path / str(room)
        with monkeypatch.context() as patch:
            in_pieces(patch, lambda file: Limited(file, out, room))  # noqa: B023
            fails(scene, out, capsys, "No space left on device")
        ends.append(go_on(scene, out))
        assert_same_files(straight, out)
    assert ends.count("resumed") > SIZES // 2
    print(f"{SIZES} sizes up to {size} bytes: {ends.count('resumed')} resumed, the others began anew")


@pytest.mark.parametrize("names_too", [False, True])
def test_power_cuts(tmp_path, run, monkeypatch, names_too):
    """Before any file operation; names may be newer on the disk than contents, which is the harder case, or as old."""
    scene, straight, _ = run
    out, found = tmp_path / "out", {}
    flushed = Flushed(out, monkeypatch)

    def cut(number):
        if out.exists():
            left = flushed.left(tmp_path / "left" / str(number), names_too)
            content = str([(path.relative_to(left), path.read_bytes()) for path in sorted(left.rglob("*.*"))
                           if path.is_file() and path.suffix not in (".log", ".part")])  # fmt: skip
            if content in found:
                shutil.rmtree(left)
            found.setdefault(content, left)

    assert watched(lambda: run_scene(scene, out, quiet=True), cut) == 0
    flushed.close()
    monkeypatch.undo()
    monkeypatch.setattr("discsim.output.figure.last_state_figure", lambda snapshot, figure: figure.touch())
    ends = []
    for left in found.values():
        ends.append(go_on(scene, left))
        assert_same_files(straight, left)
    assert ends.count("resumed") > 20
    print(f"{len(ends)} states after a power cut: {ends.count('resumed')} resumed, the others began anew")


def test_a_disk_that_becomes_read_only(tmp_path, run, monkeypatch, capsys):
    """In the midst of a run, and between it and --resume."""
    scene, straight, size = run
    pages = 20 * size // Memory.PAGE
    disk = Memory(tmp_path / "disk", pages)
    out = disk.path / "out"

    def protected(file):
        file.close()
        raise OSError(errno.EROFS, os.strerror(errno.EROFS), file.name)

    try:
        with monkeypatch.context() as patch:
            at_step(patch, 3, lambda sim: in_pieces(patch, protected))
            fails(scene, out, capsys, "Read-only file system")
        disk.protect(pages, False)
        assert run_scene(scene, out, resume=True, quiet=True) in (1, 2)
        (said,) = errors_of(capsys.readouterr().err)
        assert "Read-only file system" in said or "is not writable" in said
        disk.protect(pages, True)
        assert go_on(scene, out) == "resumed"
        assert_same_files(straight, out)
    finally:
        disk.close()


@pytest.mark.parametrize("step", range(1, 7))
def test_a_directory_that_is_deleted(tmp_path, run, monkeypatch, capsys, step):
    scene, straight, _ = run
    out = tmp_path / "out"
    with monkeypatch.context() as patch:
        at_step(patch, step, lambda sim: shutil.rmtree(out))
        fails(scene, out, capsys, "cannot be written: No such file or directory")
    assert go_on(scene, out) == "began anew"
    assert_same_files(straight, out)


@pytest.mark.parametrize("seed", range(20))
def test_numbers_that_are_spoilt(tmp_path, disc, monkeypatch, capsys, seed):
    """NaN or infinity in some array of a disc at some step, before its checkpoint: that is never of a spoilt state."""
    stream = np.random.default_rng([15, seed])
    scene, straight, out = *disc, tmp_path / "out"

    def spoil(sim):
        particles = sim.state.species[stream.choice(["gas", "dust"])]
        array = getattr(particles, stream.choice(["pos", "vel", "mass"]))
        array[stream.integers(len(array))] = stream.choice([np.nan, np.inf, -np.inf])

    with monkeypatch.context() as patch:
        at_step(patch, int(stream.integers(1, 6)), spoil)
        assert run_scene(scene, out, quiet=True) == 3
    said = capsys.readouterr()
    assert said.out == "" and "is not finite" in said.err and "--resume" in said.err and "Traceback" not in said.err
    assert run_scene(scene, out, resume=True, quiet=True) == 0
    assert_same_files(straight, out)
