"""For mpiexec: the command line of discsim with files in parts, however small, and where wanted a rank that fails.

mpiexec -n 3 python tests/helpers/failing.py parts run scene.toml -o out
mpiexec -n 3 python tests/helpers/failing.py parts:kill@1@4 run scene.toml -o out

kill, raise, full (its files find no room) or spoil (a number of its particles), at the end of step 4 on rank 1. When it
was, in seconds since the epoch, is in a file of that name beside OUT.
"""

import os
import signal
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

sys.path.insert(0, str(Path(__file__).parent))

from deaths import in_pieces
from disks import Limited
from runs import at_step

from discsim.cli import main
from discsim.ranks import output


def kill(folder):
    os.kill(os.getpid(), signal.SIGKILL)


def fail(folder):
    raise RuntimeError("a rank that fails")


def full(folder):
    in_pieces(pytest.MonkeyPatch(), lambda file: Limited(file, folder, 0))


FAULTS = {"kill": kill, "raise": fail, "full": full}


def prepare(what, rank, step):
    if MPI.COMM_WORLD.rank != int(rank):
        return
    folder = Path(sys.argv[sys.argv.index("-o") + 1])

    def act(sim):
        folder.with_name(what).write_text(str(time.time()))
        if what == "spoil":
            sim.state.gas.pos[0] = np.nan
        else:
            FAULTS[what](folder)

    at_step(pytest.MonkeyPatch(), int(step), act)


if __name__ == "__main__":
    how, *faults = sys.argv.pop(1).split(":")
    if how == "parts":
        output.MIN_BYTES_IN_PARTS = 0
    for fault in faults:
        prepare(*fault.split("@"))
    sys.exit(main())
