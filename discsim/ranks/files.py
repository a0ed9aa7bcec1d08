"""Snapshots and checkpoints of several ranks.

Rank 0 writes a small state to one file. Of a larger state each rank writes a part, and rank 0 a master file that refers
to the parts (`output/parts.py`). Each part has consecutive particles in the order of output, so that the master file
has the same rows as a single file.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

from discsim.output import hdf5, parts
from discsim.ranks.agreed import on_root, raise_together
from discsim.ranks.comm import Comm

if TYPE_CHECKING:
    from discsim.numerics.state import State

# Bytes of the particles of all ranks, from which on a file is in parts. Below that one file takes about a second, and
# the memory that it needs on one rank is small compared with that of kernels and libraries on each rank.
MIN_BYTES_IN_PARTS = 1 << 28


def write_in_parts(comm: Comm, state: State) -> bool:
    """Return whether a file of the state is to be written in parts. Collective."""
    held = sum(array.nbytes for p in state.species.values() for array in p.arrays().values())
    return bool(comm.reduced(held, MPI.SUM) >= MIN_BYTES_IN_PARTS)


def write(comm: Comm, path: Path, divided: bool, fill: Callable[[Any], None], before: Path | None = None) -> None:
    """Write a file at `path` by calling `fill(into)`. Collective.

    divided: whether each rank writes a part of the file; if False, rank 0 writes all. into: creates a file, as
    `hdf5.create`. before: new name of the previous file at `path`. An exception on one rank is raised on all ranks, and
    the previous file is kept.
    """
    if not divided:
        on_root(comm, lambda: fill(hdf5.create))
        return
    stem, made = on_root(comm, lambda: (parts.create_stem(path, before), os.urandom(8).hex()))
    part = parts.Part(path, stem, comm.rank, made)
    try:
        raise_together(comm, lambda: fill(part.create))
        lengths = comm.mpi.gather(part.lengths)
        on_root(comm, lambda: part.write_master(path, before, lengths))
    except Exception:
        part.discard()
        raise
