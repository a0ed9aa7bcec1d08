"""Snapshots and checkpoints of several ranks: of small states one file, which the rank that leads writes of all; of
larger ones a part by each rank, and a master (`output/parts.py`).

A part has the particles that are next in the order of the file, so that the master has the very rows of the one file.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

from discsim.output import hdf5, parts
from discsim.ranks.agreed import alike, led
from discsim.ranks.comm import Comm

if TYPE_CHECKING:
    from discsim.numerics.state import State

# Bytes of the particles of all ranks, from which on they go to parts. Below that one file takes about a second, and
# what one rank needs for it is little beside the kernels and libraries that each has.
LEAST = 1 << 28


def to_divide(comm: Comm, state: State) -> bool:
    """Whether a file of the state is to be one in parts."""
    held = sum(array.nbytes for p in state.species.values() for array in p.arrays().values())
    return bool(comm.reduced(held, MPI.SUM) >= LEAST)


def write(comm: Comm, path: Path, divided: bool, fill: Callable[[Any], None], before: Path | None = None) -> None:
    """Have `fill(into)` write to `path`, where `into` makes the file, as `hdf5.create`; on all ranks if `divided`.

    before: where what was there stays. Raises on all ranks what one of them raises, and leaves what was there.
    """
    if not divided:
        led(comm, lambda: fill(hdf5.create))
        return
    stem, made = led(comm, lambda: (parts.stem_of(path, before), os.urandom(8).hex()))
    part = parts.Part(path, stem, comm.rank, made)
    try:
        alike(comm, lambda: fill(part.create))
        lengths = comm.mpi.gather(part.lengths)
        led(comm, lambda: part.join(path, before, lengths))
    except Exception:
        part.discard()
        raise
