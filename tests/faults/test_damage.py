"""Files with a wrong bit, or cut short: a reader refuses them with one message, or finds the same in them."""

import dataclasses
import shutil

import numpy as np
import pytest
from runs import assert_same_files, errors_of
from short import short

from discsim import read_snapshot
from discsim.output.checkpoint import CheckpointError, read_checkpoint
from discsim.output.history import HistoryError, rows_until
from discsim.output.snapshot import SnapshotError
from discsim.run.runner import run_scene
from setups import SETUPS

FLIPS, CUTS = 500, 30  # of each file, in each of two runs
NAMES = ("planet_dust", "dead_zone_sph")  # companions and their table; heat and growth


@pytest.fixture(scope="module", params=NAMES)
def run(request, tmp_path_factory):
    """A scene and the directory of its run."""
    (path,) = (path for path in SETUPS if path.stem == request.param)
    out = tmp_path_factory.mktemp("run") / "out"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("discsim.output.figure.last_state_figure", lambda snapshot, figure: figure.touch())
        assert run_scene(short(path), out, quiet=True) == 0
    return short(path), out


def bits(value):
    """All that a snapshot or a checkpoint holds, to the bit."""
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if dataclasses.is_dataclass(value):
        return {field.name: bits(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, dict):
        return {name: bits(entry) for name, entry in value.items()}
    if isinstance(value, tuple | list):
        return [bits(entry) for entry in value]
    return repr(value) if isinstance(value, float) else value


def damaged(content, stream, flips, cuts):
    """The content with one bit wrong, and cut short, so many times each."""
    for place in stream.integers(0, len(content), flips):
        wrong = bytearray(content)
        wrong[place] ^= 1 << int(stream.integers(8))
        yield bytes(wrong)
    for length in stream.integers(0, len(content), cuts):
        yield content[:length]


def outcomes(path, read, error, stream):
    """How many damaged copies are refused, and how many hold the same: there is no third way."""
    copy = path.with_name("damaged")
    content, whole, refused = path.read_bytes(), bits(read(path)), 0
    for wrong in damaged(content, stream, FLIPS, CUTS):
        copy.write_bytes(wrong)
        try:
            found = read(copy)
        except error as fault:
            refused += 1
            assert str(copy) in str(fault) and "\n" not in str(fault) and len(str(fault)) < 400
        else:
            assert bits(found) == whole
    copy.unlink()
    print(f"{path.name}: {FLIPS} flips and {CUTS} cuts, {refused} refused, the others the same")
    return refused


def test_snapshots(run, rng):
    assert outcomes(run[1] / "snapshots" / "0001.h5", read_snapshot, SnapshotError, rng) > FLIPS // 2 + CUTS


def test_checkpoints(run, rng):
    assert outcomes(run[1] / "checkpoint.h5", read_checkpoint, CheckpointError, rng) > FLIPS // 2 + CUTS


@pytest.fixture
def rng():
    return np.random.default_rng(15)


@pytest.mark.parametrize("name", ["history", "companions"])
def test_tables(run, rng, name):
    """A cut at the end of a row leaves fewer: that is told."""
    path, values = run[1] / f"{name}.csv", read_checkpoint(run[1] / "checkpoint.h5")[1]
    key = {"history": "rows", "companions": "companion_rows"}[name]
    if key not in values:
        pytest.skip("a scene without companions")
    columns = path.read_text().splitlines()[0].split(",")
    given = (values["step"], values[key], values[f"{key}_digest"], columns)
    copy, whole, refused, told = path.with_name("damaged.csv"), rows_until(path, *given).rows, 0, 0
    for wrong in damaged(path.read_bytes(), rng, FLIPS, CUTS):
        copy.write_bytes(wrong)
        try:
            found = rows_until(copy, *given)
        except HistoryError as fault:
            refused += 1
            assert str(fault).startswith(f"{copy}:") and "\n" not in str(fault)
        else:
            told += len(found.rows) < len(whole)
            assert found.rows == whole or (len(found.remarks) == 1 and found.rows == whole[: len(found.rows)])
    copy.unlink()
    print(f"{path.name}: {FLIPS} flips and {CUTS} cuts, {refused} refused, {told} told to be shorter, others the same")
    assert refused > 0.9 * FLIPS


@pytest.mark.parametrize("seed", range(10))
def test_a_run_goes_on_from_the_checkpoint_before_a_damaged_one(run, tmp_path, capsys, seed):
    scene, straight = run
    out, stream = tmp_path / "out", np.random.default_rng([15, seed])
    shutil.copytree(straight, out)
    content = (out / "checkpoint.h5").read_bytes()
    wrong = next(damaged(content, stream, 1, 0) if seed % 2 else damaged(content, stream, 0, 1))
    (out / "checkpoint.h5").write_bytes(wrong)
    capsys.readouterr()
    assert run_scene(scene, out, resume=True) == 0
    said = capsys.readouterr().out
    assert_same_files(straight, out)
    told = [line for line in said.splitlines() if f"; the run resumes from {out}/checkpoint_before.h5, at t = " in line]
    assert len(told) == 1 or "already finished" in said  # a bit that nobody needs


def test_two_damaged_checkpoints_are_one_message(run, tmp_path, capsys):
    scene, straight = run
    out = tmp_path / "out"
    shutil.copytree(straight, out)
    for path in out.glob("checkpoint*.h5"):
        path.write_bytes(path.read_bytes()[:5000])
    before = sorted(path.name for path in out.iterdir())
    capsys.readouterr()
    assert run_scene(scene, out, resume=True, quiet=True) == 2
    said = capsys.readouterr()
    assert said.out == "" and len(errors_of(said.err)) == 1 and said.err.count("or a damaged") == 2
    assert sorted(path.name for path in out.iterdir()) == before
