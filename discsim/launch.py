"""Whether an MPI launcher has started this process beside others, from what it leaves in the environment: without one
mpi4py is never imported.
"""

from __future__ import annotations

import os

# Number of processes and of this one: MPICH, Intel MPI and Slurm's pmi2; Open MPI; MVAPICH.
LAUNCHERS = (
    ("PMI_SIZE", "PMI_RANK"),
    ("OMPI_COMM_WORLD_SIZE", "OMPI_COMM_WORLD_RANK"),
    ("MV2_COMM_WORLD_SIZE", "MV2_COMM_WORLD_RANK"),
)


def size_and_rank() -> tuple[int, int]:
    """How many processes were started together, and which of them this is; (1, 0) without a launcher."""
    for size, rank in LAUNCHERS:
        if size in os.environ and rank in os.environ:
            return int(os.environ[size]), int(os.environ[rank])
    return 1, 0
