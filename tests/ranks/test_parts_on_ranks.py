"""What several ranks leave: files in parts, also where something goes wrong, and runs that go on from them."""

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import pytest
from launched import LONGEST, MARKS, MPIEXEC
from runs import DISC, assert_same_arrays, assert_same_content, assert_same_run

from discsim import load_scene, read_snapshot
from discsim.output.checkpoint import read_checkpoint
from discsim.run.runner import run_scene

pytestmark = MARKS
FAILING = Path(__file__).parents[1] / "helpers" / "failing.py"
SOON = 10.0  # seconds in which all ranks end once one has failed
# Of MPI_Abort(1): mpiexec gives the bits of all statuses, and at times has killed others before the 1 reaches it.
ABORTED = {1, 1 | signal.SIGKILL}
# What is known of the start and of all particles: damping, and the pull of the disc.
KNOWN = DISC + "[damping]\ninner = [0.5, 0.7]\nouter = [1.8, 2.0]\n"


def command(number, scene, out, until, *more, how="parts"):
    program = [MPIEXEC, "-n", str(number), sys.executable, str(FAILING), how]
    return [*program, "run", str(scene), "-o", str(out), "--set", f"run.until={until}", *more]


def on_ranks(number, scene, out, until, *more, how="parts", threads=1):
    """Exit status of a run with files in parts, and what is on stderr."""
    environment = os.environ | {"NUMBA_NUM_THREADS": str(threads)}
    words = command(number, scene, out, until, *more, how=how)
    done = subprocess.run(words, capture_output=True, text=True, env=environment, timeout=LONGEST)
    return done.returncode, done.stderr


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    path = tmp_path_factory.mktemp("scene") / "disc.toml"
    path.write_text(KNOWN)
    return path


@pytest.fixture(scope="module")
def one(scene, tmp_path_factory):
    """The run of one process: four steps, three snapshots."""
    folder = tmp_path_factory.mktemp("one") / "run"
    assert run_scene(load_scene(scene, ["run.until=0.5"]), folder, quiet=True) == 0
    return folder


@pytest.fixture(scope="module")
def half(scene, tmp_path_factory):
    """Half of it on three ranks."""
    folder = tmp_path_factory.mktemp("half") / "run"
    assert on_ranks(3, scene, folder, 0.25) == (0, "")
    return folder


def assert_same(one, other):
    """Snapshots for readers of ours and others, rows, and checkpoints."""
    for path in sorted((one / "snapshots").glob("*.h5")):
        with h5py.File(path) as mine, h5py.File(other / "snapshots" / path.name) as theirs:
            assert_same_content(mine, theirs, ("parts", "made", "command", "Scene"))
    assert_same_run(one, other)
    (groups, values), (found, found_values) = (read_checkpoint(folder / "checkpoint.h5") for folder in (one, other))
    assert values == found_values and groups.keys() == found.keys()
    for name in groups.keys() - {"costs"}:
        assert_same_arrays(groups[name], found[name])


def parts_of(folder):
    return sorted(path.name for path in (folder / "parts").iterdir())


def test_files_in_parts_hold_what_one_process_writes(scene, one, tmp_path):
    out = tmp_path / "run"
    assert on_ranks(3, scene, out, 0.5) == (0, "")
    assert_same(one, out)
    assert parts_of(out / "snapshots") == [f"000{k}.{rank}.h5" for k in range(3) for rank in range(3)]
    assert parts_of(out) == [f"checkpoint-{k}.{rank}.h5" for k in (1, 2) for rank in range(3)]


def test_small_states_are_in_one_file(scene, one, tmp_path):
    out = tmp_path / "run"
    assert on_ranks(2, scene, out, 0.5, how="one") == (0, "")
    assert_same(one, out)
    assert not [*out.rglob("parts")]


@pytest.mark.parametrize(("number", "threads"), [(1, 1), (2, 2), (5, 1)])
def test_another_number_of_ranks_goes_on(scene, one, half, tmp_path, number, threads):
    """Of them the parts that a run made before are removed with the files that name them."""
    out = tmp_path / "run"
    shutil.copytree(half, out)
    if number == 1:
        assert run_scene(load_scene(scene, ["run.until=0.5"]), out, resume=True, quiet=True) == 0
    else:
        assert on_ranks(number, scene, out, 0.5, "--resume", threads=threads) == (0, "")
    assert_same(one, out)
    before, last = ([name for name in parts_of(out) if name.startswith(f"checkpoint-{k}.")] for k in (2, 3))
    assert len(before) == 3 and len(last) == (number if number > 1 else 0) and len(parts_of(out)) == 3 + len(last)


def test_later_snapshots_go_with_their_parts(scene, one, half, tmp_path):
    """Of a run that was killed after it had written one that its checkpoint does not know."""
    out = tmp_path / "run"
    shutil.copytree(half, out)
    shutil.copy(one / "snapshots" / "0002.h5", out / "snapshots" / "0007.h5")
    (out / "snapshots" / "parts" / "0007.0.h5").write_bytes(b"")
    assert on_ranks(2, scene, out, 0.5, "--resume") == (0, "")
    assert_same(one, out)


@pytest.mark.parametrize(
    ("what", "rank", "status"),
    [("kill", 2, {}), ("raise", 2, ABORTED), ("full", 2, {1}), ("full", 0, {1}), ("spoil", 1, {3})],
)
def test_a_rank_that_fails_ends_all(scene, one, tmp_path, what, rank, status):
    """At the end of the fourth step, before its snapshot; what is saved goes on to the bits of one run."""
    out = tmp_path / "run"
    always = "--set", "run.checkpoint_every=1e-9 s"
    found, said = on_ranks(3, scene, out, 0.5, *always, how=f"parts:{what}@{rank}@4")
    assert time.time() - float((tmp_path / what).read_text()) < SOON
    assert found in status if status else found != 0
    told = {"raise": "RuntimeError: a rank that fails", "full": "No space left on device", "spoil": "is not finite"}
    if what in told:
        assert said.count(told[what]) == 1 and said.count("Traceback") == (what == "raise")
    if what in ("full", "spoil"):
        assert said.count("is a checkpoint at t = 0.375; resume with") == 1
        assert len([line for line in said.splitlines() if not line.startswith("Abort(")]) <= 2
    assert not [*out.rglob(".*.part*")] or what == "kill"
    assert read_checkpoint(out / "checkpoint.h5")[1]["step"] == 3
    assert on_ranks(2, scene, out, 0.5, "--resume") == (0, "")
    assert_same(one, out)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_all_ranks_with_a_checkpoint(scene, tmp_path, number):
    out = tmp_path / "run"
    words = command(3, scene, out, 1000, "--set", "run.every=500")
    environment = os.environ | {"NUMBA_NUM_THREADS": "1"}
    with subprocess.Popen(
        words, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True, env=environment, start_new_session=True
    ) as run:
        while run.poll() is None and not (out / "checkpoint.h5").exists():
            time.sleep(0.1)
        before, sent = (out / "checkpoint.h5").stat().st_mtime_ns, time.monotonic()
        run.send_signal(number)
        said = run.communicate(timeout=LONGEST)[1]
    assert time.monotonic() - sent < SOON
    assert run.returncode == 128 + number
    assert said.startswith(f"interrupted by {number.name}") and said.count("\n") == 1
    assert (out / "checkpoint.h5").stat().st_mtime_ns > before and read_checkpoint(out / "checkpoint.h5")
    assert read_snapshot(out / "snapshots" / "0000.h5").time == 0.0
