"""For mpiexec: the command line of discsim with files in parts, however small, and where wanted a rank that fails.

mpiexec -n 3 python tests/helpers/failing.py parts:kill@1:4 run scene.toml -o out
kill, raise, full (its files find no room) or spoil (a number of its particles) at the end of step 4 on rank 1.
"""

import os
import signal
import sys
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

sys.path.insert(0, str(Path(__file__).parent))

from deaths import in_pieces
from disks import Limited
from runs import at_step

from discsim.cli import main
from discsim.ranks import files


def kill(sim):
    os.kill(os.getpid(), signal.SIGKILL)


def fail(sim):
    raise RuntimeError("a rank that fails")


def full(sim):
    folder = Path(sys.argv[sys.argv.index("-o") + 1])
    in_pieces(pytest.MonkeyPatch(), lambda file: Limited(file, folder, 0))


def spoil(sim):
    sim.state.gas.pos[0] = np.nan


FAULTS = {"kill": kill, "raise": fail, "full": full, "spoil": spoil}

if __name__ == "__main__":
    how, *faults = sys.argv.pop(1).split(":", 1)
    if how == "parts":
        files.LEAST = 0
    for fault in faults:
        what, rank, step = fault.replace(":", "@").split("@")
        if MPI.COMM_WORLD.rank == int(rank):
            at_step(pytest.MonkeyPatch(), int(step), FAULTS[what])
    sys.exit(main())
