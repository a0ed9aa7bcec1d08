"""Runs on several MPI ranks, more than there are cores too: the same bits as on one."""

import os
import shutil
import signal
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from runs import DISC

from discsim import load_scene, read_snapshot
from discsim.run.runner import run_scene

BESIDE = Path(sys.executable).with_name("mpiexec")
MPIEXEC = str(BESIDE) if BESIDE.exists() else shutil.which("mpiexec")
pytestmark = [
    pytest.mark.ranks,
    pytest.mark.skipif(find_spec("mpi4py") is None or not MPIEXEC, reason="needs mpi4py: pip install 'discsim[mpi]'"),
]
LONGEST = 600  # seconds, after which a run hangs
UNTIL = ["run.until=0.5"]  # five steps, of which the first sorts; the star takes gas and dust in each


ENVIRONMENT = os.environ | {"NUMBA_NUM_THREADS": "1"}
RANKED = Path(__file__).parents[1] / "helpers" / "ranked.py"
NAMES = ("long", "idic", "linear", "one-way", "off the grid", "eaten", "all gone", "bodies")


def on_ranks(number, scene, folder, *more, settings=UNTIL):
    """Run a scene file with `number` ranks of one thread each; status and what is on stderr."""
    command = command_of(number, scene, folder, settings)
    done = subprocess.run([*command, *more], capture_output=True, text=True, env=ENVIRONMENT, timeout=LONGEST)
    return done.returncode, done.stderr


def command_of(number, scene, folder, settings):
    command = [MPIEXEC, "-n", str(number), sys.executable, "-m", "discsim", "run", str(scene), "-o", str(folder)]
    for setting in settings:
        command += ["--set", setting]
    return command


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    path = tmp_path_factory.mktemp("scene") / "disc.toml"
    path.write_text(DISC)
    return path


@pytest.fixture(scope="module")
def one(scene, tmp_path_factory):
    """The run on one rank."""
    folder = tmp_path_factory.mktemp("one") / "run"
    assert run_scene(load_scene(scene, UNTIL), folder, quiet=True) == 0
    return folder


def assert_same(one, other):
    """Histories, and all that the last snapshots hold, bit for bit."""
    assert (one / "history.csv").read_text() == (other / "history.csv").read_text()
    names = sorted(path.name for path in (one / "snapshots").iterdir())
    assert names == sorted(path.name for path in (other / "snapshots").iterdir())
    mine, theirs = (read_snapshot(folder / "snapshots" / names[-1]) for folder in (one, other))
    assert mine.time == theirs.time and mine.gas.count < 1000 and mine.dust.count < 1100
    for name, species in mine.species.items():
        for key, array in vars(species).items():
            if isinstance(array, np.ndarray):
                np.testing.assert_array_equal(array, getattr(theirs.species[name], key), err_msg=f"{name}.{key}")
    for name, arrays in mine.open_step.arrays.items():
        for key, array in arrays.items():
            np.testing.assert_array_equal(array, theirs.open_step.arrays[name][key], err_msg=f"{name}.{key}")


def test_ranks_have_the_bits_of_one(scene, one, tmp_path):
    """A disc with self-gravity, two-way drag, viscosity and a star that takes gas and dust."""
    assert on_ranks(3, scene, tmp_path / "run") == (0, "")
    assert_same(one, tmp_path / "run")


def test_another_number_of_ranks_goes_on(scene, one, tmp_path):
    assert on_ranks(3, scene, tmp_path / "run", settings=["run.until=0.25"]) == (0, "")
    assert on_ranks(2, scene, tmp_path / "run", "--resume") == (0, "")
    assert_same(one, tmp_path / "run")


@pytest.mark.parametrize(
    ("setting", "told"),
    [
        ("dust_diffusion.D=1e-5", "dust_diffusion: runs on one MPI rank only; expected no table [dust_diffusion], or"),
        ("drag.scheme=mk", 'drag.scheme: "mk" runs on one MPI rank only; expected "idic", "idic-linear", "tsc", or no'),
        ("star.mas=1", "star.mas: unknown key"),
    ],
)
def test_what_cannot_run_is_refused_once(scene, tmp_path, setting, told):
    status, said = on_ranks(2, scene, tmp_path / "run", settings=[setting])
    assert status == 2 and told in said and said.count("\n") == 1
    assert not (tmp_path / "run").exists()


def test_a_stop_by_the_physics_is_told_once(scene, tmp_path):
    """On all ranks at a time."""
    status, said = on_ranks(2, scene, tmp_path / "run", settings=["run.timestep=3", "run.until=6", "run.every=6"])
    assert status == 3 and said.count("stopped by the physics") == 1
    assert (tmp_path / "run" / "checkpoint.h5").exists()


def test_a_directory_that_holds_a_run_is_refused_once(scene, one):
    status, said = on_ranks(2, scene, one)
    assert status == 2 and said.count("\n") == 1 and "holds a run already" in said


@pytest.mark.parametrize("number", [2, 4])
def test_many_scenes_have_the_bits_of_one(number):
    """Other schemes and directions of drag, companions, particles off the grid, few gas that is left, and none."""
    command = [MPIEXEC, "-n", str(number), sys.executable, str(RANKED), *NAMES]
    done = subprocess.run(command, capture_output=True, text=True, env=ENVIRONMENT, timeout=2 * LONGEST)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert [line.partition(";")[0] for line in lines] == [f"{name}: the same" for name in NAMES]


def test_a_signal_ends_all_ranks_with_a_checkpoint(scene, tmp_path):
    folder = tmp_path / "run"
    command = command_of(2, scene, folder, ["run.until=1000", "run.every=500"])
    with subprocess.Popen(
        command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True, env=ENVIRONMENT
    ) as run:
        while run.poll() is None and not (folder / "checkpoint.h5").exists():
            time.sleep(0.1)
        before = (folder / "checkpoint.h5").stat().st_mtime_ns
        run.send_signal(signal.SIGTERM)
        said = run.communicate(timeout=LONGEST)[1]
    assert run.returncode == 128 + signal.SIGTERM
    assert said.startswith("interrupted by SIGTERM") and said.count("\n") == 1
    assert (folder / "checkpoint.h5").stat().st_mtime_ns > before
