"""Output of several ranks: particles in the order of output files, and files in one or several parts.

Rank 0 writes a small state to one file. Of a larger state each rank writes a part, and rank 0 writes a master file that
refers to the parts (`output/parts.py`). Each part has consecutive particles in the order of output, so that the master
file has the same rows as a single file. All functions are collective.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Collection
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from mpi4py import MPI

from discsim.output import hdf5, parts
from discsim.ranks.comm import Comm, Route

if TYPE_CHECKING:
    from discsim.numerics.state import Particles, State

Array = np.ndarray
# Bytes of the particles of all ranks, from which on a file is in parts. Below that one file takes about a second, and
# the memory that it needs on one rank is small compared with that of kernels and libraries on each rank.
MIN_BYTES_IN_PARTS = 1 << 28
SAMPLES_PER_RANK = 256  # ends of ranges are accurate to 1 / SAMPLES_PER_RANK of a rank's particles


def needs_parts(comm: Comm, state: State) -> bool:
    """Return whether files with this state are written in parts."""
    size = sum(array.nbytes for p in state.species.values() for array in p.arrays().values())
    return bool(comm.allreduce(size, MPI.SUM) >= MIN_BYTES_IN_PARTS)


def write(comm: Comm, path: Path, in_parts: bool, fill: Callable[[Any], None], before: Path | None = None) -> None:
    """Write a file at `path` by calling `fill(create)`, where `create` makes a file as `hdf5.create` does.

    in_parts: whether each rank writes a part of the file; if False, rank 0 writes all. before: new name of the previous
    file at `path`. An exception on one rank is raised on all ranks, and the previous file is kept.
    """
    if not in_parts:
        comm.on_root(lambda: fill(hdf5.create))
        return
    stem, made = comm.on_root(lambda: (parts.create_stem(path, before), os.urandom(8).hex()))
    part = parts.Part(path, stem, comm.rank, made)
    try:
        comm.raise_on_all(lambda: fill(part.create))
        lengths = comm.mpi.gather(part.lengths)
        comm.on_root(lambda: part.write_master(path, before, lengths))
    except Exception:
        part.discard()
        raise


class RowsToWrite:
    """Selection of the rows of a species that this rank writes, and the route that brings them here.

    by: attribute of the particles that orders the rows of a file: "global_index", the order in memory in a serial run,
    or "ids". in_parts: whether each rank writes a range of the rows; if False, rank 0 writes all.
    """

    def __init__(self, comm: Comm, particles: Particles, by: str, in_parts: bool) -> None:
        key = getattr(particles, by)
        writer = np.zeros(len(key), np.int64)
        if in_parts:
            writer = np.searchsorted(_keys_between_ranks(comm, key), key, side="right")
        self._route = Route(comm, [np.flatnonzero(writer == rank) for rank in range(comm.size)])
        self._order = np.argsort(self._route.send(key))

    def gather(self, array: Array) -> Array:
        """Return the rows that this rank writes of an array; `array` (n, ...) has the rows of local particles."""
        return self._route.send(array)[self._order]


def _keys_between_ranks(comm: Comm, key: Array) -> Array:
    """Return keys (ranks - 1,) that divide the keys of all ranks into ranges with about equal numbers of particles.

    key (n,): keys of the particles on this rank.
    """
    some = np.sort(key)[np.linspace(0, max(len(key) - 1, 0), SAMPLES_PER_RANK if len(key) else 0).astype(np.int64)]
    found = comm.mpi.allgather((some, len(key)))
    keys = np.concatenate([sample for sample, _ in found])
    if len(keys) == 0:
        return np.zeros(comm.size - 1, key.dtype)
    order = np.argsort(keys, kind="stable")
    weights = np.concatenate([np.full(len(sample), count / SAMPLES_PER_RANK) for sample, count in found])
    until = np.cumsum(weights[order])
    at = np.searchsorted(until, until[-1] * np.arange(1, comm.size) / comm.size)
    return keys[order][at]


def gather_state(
    comm: Comm, state: State, by: str = "global_index", in_parts: bool = False, names: Collection[str] | None = None
) -> State:
    """Return a state with the particles that this rank writes.

    by, in_parts: as in `RowsToWrite`. names: names of the arrays that are needed; all others have no entries, and
    `acc_unshared` is empty. None: all arrays, and `acc_unshared`.
    """
    species: dict[str, Any] = {}
    acc_unshared = {}
    for name, p in state.species.items():
        rows = RowsToWrite(comm, p, by, in_parts)
        arrays = {key: array for key, array in p.arrays().items() if key != "global_index"}
        species[name] = type(p)(
            **{key: rows.gather(a) if names is None or key in names else a[:0] for key, a in arrays.items()}
        )
        if name in state.acc_unshared and names is None:
            acc = state.acc_unshared[name]
            empty = comm.mpi.allreduce(len(acc)) == 0
            acc_unshared[name] = acc[:0] if empty else rows.gather(acc)
    return replace(state, acc_unshared=acc_unshared, **species)


def gather_columns(
    comm: Comm, state: State, extra: dict[str, dict[str, Any]], by: str = "global_index", in_parts: bool = False
) -> dict[str, dict[str, Any]]:
    """Return the rows that this rank writes of additional snapshot arrays, by species and name.

    extra: arrays or `Column`s of effects, by species and name. by, in_parts: as in `RowsToWrite`.
    """
    out: dict[str, dict[str, Any]] = {}
    for species, columns in extra.items():
        rows = RowsToWrite(comm, state.species[species], by, in_parts)
        out[species] = {
            name: rows.gather(column)
            if isinstance(column, np.ndarray)
            else column._replace(values=rows.gather(column.values))
            for name, column in columns.items()
        }
    return out
