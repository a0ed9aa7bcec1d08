"""Processes that an MPI launcher starts together."""

import os
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

BESIDE = Path(sys.executable).with_name("mpiexec")
MPIEXEC = str(BESIDE) if BESIDE.exists() else shutil.which("mpiexec")
ENVIRONMENT = os.environ | {"NUMBA_NUM_THREADS": "1"}
RANKED = Path(__file__).with_name("ranked.py")
LONGEST = 600  # seconds, after which a run hangs
needs_mpi = pytest.mark.skipif(
    find_spec("mpi4py") is None or not MPIEXEC, reason="needs mpi4py: pip install -e '.[mpi]'"
)
MARKS = [pytest.mark.ranks, needs_mpi]


def command_of(number, scene, folder, settings=()):
    """The command that runs a scene file with `number` ranks."""
    command = [MPIEXEC, "-n", str(number), sys.executable, "-m", "discsim", "run", str(scene), "-o", str(folder)]
    for setting in settings:
        command += ["--set", setting]
    return command


def lines_of(number, *command, threads=1, longest=LONGEST):
    """What `python command` prints on a number of ranks, line by line; it has to succeed."""
    done = subprocess.run(
        [MPIEXEC, "-n", str(number), sys.executable, *map(str, command)],
        capture_output=True, text=True, env=os.environ | {"NUMBA_NUM_THREADS": str(threads)}, timeout=longest,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-1000:] + done.stderr
    return done.stdout.splitlines()


def differing(number, names, threads=1, longest=LONGEST):
    """What `ranked.py` says of scenes on ranks that is not the same as on one."""
    lines = lines_of(number, RANKED, *names, threads=threads, longest=longest)
    assert len(lines) >= len(names)
    return [line for line in lines if ": the same; " not in line]
