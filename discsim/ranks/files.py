"""Snapshots and checkpoints of several ranks.

A small state is written to one file, by the leading rank. Of a larger one each rank writes a part, and the leading
rank a master file (`output/parts.py`). The parts have consecutive particles in the order of the file, so that the
master has exactly the rows of the one file.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

from discsim.output import hdf5, parts
from discsim.ranks.agreed import led, raise_together
from discsim.ranks.comm import Comm

if TYPE_CHECKING:
    from discsim.numerics.state import State

# Bytes of the particles of all ranks, from which on a file is in parts. Below that one file takes about a second, and
# the memory that it needs on one rank is small compared with that of kernels and libraries on each rank.
LEAST = 1 << 28


def to_divide(comm: Comm, state: State) -> bool:
    """Return whether a file of the state is to be written in parts."""
    held = sum(array.nbytes for p in state.species.values() for array in p.arrays().values())
    return bool(comm.reduced(held, MPI.SUM) >= LEAST)


def write(comm: Comm, path: Path, divided: bool, fill: Callable[[Any], None], before: Path | None = None) -> None:
    """Write a file at `path` by `fill(into)`, where `into` creates it, as `hdf5.create`; on all ranks if `divided`.

    before: path that keeps the previous file. Raises an exception of one rank on all ranks, and keeps the previous
    file.
    """
    if not divided:
        led(comm, lambda: fill(hdf5.create))
        return
    stem, made = led(comm, lambda: (parts.stem_of(path, before), os.urandom(8).hex()))
    part = parts.Part(path, stem, comm.rank, made)
    try:
        raise_together(comm, lambda: fill(part.create))
        lengths = comm.mpi.gather(part.lengths)
        led(comm, lambda: part.join(path, before, lengths))
    except Exception:
        part.discard()
        raise
