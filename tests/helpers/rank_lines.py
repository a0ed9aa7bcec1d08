"""Python on several MPI ranks of its own processes, and the marks of tests that want them."""

import os
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

BESIDE = Path(sys.executable).with_name("mpiexec")
MPIEXEC = str(BESIDE) if BESIDE.exists() else shutil.which("mpiexec")
MARKS = [
    pytest.mark.ranks,
    pytest.mark.skipif(find_spec("mpi4py") is None or not MPIEXEC, reason="needs mpi4py: pip install 'discsim[mpi]'"),
]
LONGEST = 600  # seconds, after which a run hangs


def lines_of(number, *command, threads=1):
    """What `python command` prints on a number of ranks, line by line; it has to succeed."""
    done = subprocess.run(
        [MPIEXEC, "-n", str(number), sys.executable, *map(str, command)],
        capture_output=True, text=True, env=os.environ | {"NUMBA_NUM_THREADS": str(threads)}, timeout=LONGEST,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()
