"""Detection of an MPI launcher from environment variables, without importing mpi4py."""

from __future__ import annotations

import os

from discsim.printable import UserError

# Names of the variables with the number of ranks, and with the rank, by launcher.
LAUNCHERS = (
    ("PMI_SIZE", "PMI_RANK"),  # MPICH, Intel MPI and Slurm's pmi2
    ("OMPI_COMM_WORLD_SIZE", "OMPI_COMM_WORLD_RANK"),  # Open MPI
    ("MV2_COMM_WORLD_SIZE", "MV2_COMM_WORLD_RANK"),  # MVAPICH
)


class LaunchError(UserError):
    """Error for environment variables of an MPI launcher with invalid values; the message names them."""


def size_and_rank() -> tuple[int, int]:
    """Return the number of MPI ranks, and the rank of this process; (1, 0) without a launcher.

    Raises LaunchError if the variables of a launcher have no valid values.
    """
    for names in LAUNCHERS:
        texts = [os.environ[name] for name in names if name in os.environ]
        if len(texts) == len(names):
            if not all(text.isdecimal() for text in texts) or int(texts[1]) >= int(texts[0]):
                given = " and ".join(f'{name}="{text}"' for name, text in zip(names, texts, strict=True))
                raise LaunchError(
                    f"{given} in the environment: no MPI launcher sets these values, as a rank is below the number of "
                    "processes; start the run with mpiexec, or unset the two variables"
                )
            return int(texts[0]), int(texts[1])
    return 1, 0
