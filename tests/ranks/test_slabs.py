"""The potential by slabs on several MPI ranks, more than there are cores too: the same bits as on one."""

import os
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

BESIDE = Path(sys.executable).with_name("mpiexec")
MPIEXEC = str(BESIDE) if BESIDE.exists() else shutil.which("mpiexec")
pytestmark = [
    pytest.mark.ranks,
    pytest.mark.skipif(find_spec("mpi4py") is None or not MPIEXEC, reason="needs mpi4py: pip install 'discsim[mpi]'"),
]
SLABS = Path(__file__).parents[1] / "helpers" / "slabs.py"


@pytest.mark.parametrize(("number", "threads"), [(2, 1), (3, 2), (7, 1)])
def test_slabs_have_the_bits_of_one_rank(number, threads):
    """Open and periodic grids, both kernels, sheets, particles off the grid, ranks without rows or particles."""
    done = subprocess.run(
        [MPIEXEC, "-n", str(number), sys.executable, str(SLABS)],
        capture_output=True, text=True, env=os.environ | {"NUMBA_NUM_THREADS": str(threads)}, timeout=600,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert len(lines) == 11
    assert [line for line in lines if not line.endswith(": the same")] == []
