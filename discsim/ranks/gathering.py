"""Collection of particles in the order of output files: all on rank 0, or a range of rows on each rank."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.ranks.comm import Comm, Route

if TYPE_CHECKING:
    from discsim.numerics.state import Particles, State

Array = np.ndarray
SAMPLES_PER_RANK = 256  # ends of ranges are accurate to 1 / SAMPLES_PER_RANK of a rank's particles


class Gathering:
    """Route of the arrays of a species to the ranks that write them.

    by: order of the rows: "global_index", the order in memory on one process, or "ids". divided: whether each rank gets
    a range of the rows; if False, rank 0 gets all.
    """

    def __init__(self, comm: Comm, particles: Particles, by: str = "global_index", divided: bool = False) -> None:
        key = getattr(particles, by)
        owner = (
            np.searchsorted(_keys_between_ranks(comm, key), key, side="right")
            if divided
            else np.zeros(len(key), np.int64)
        )
        self.route = Route(comm, [np.flatnonzero(owner == rank) for rank in range(comm.size)])
        self.order = np.argsort(self.route.send(key))

    def array(self, array: Array) -> Array:
        """Return the rows of an array (n, ...) that this rank is to write. Collective."""
        return self.route.send(array)[self.order]

    def particles(self, particles: Any, wanted: Collection[str] | None = None) -> Any:
        """Return the particles that this rank is to write. Collective.

        wanted: names of arrays; all others have no entries. None: all arrays.
        """
        held = {name: array for name, array in particles.arrays().items() if name != "global_index"}
        every = wanted is None
        return type(particles)(
            **{name: self.array(a) if every or name in wanted else a[:0] for name, a in held.items()}
        )


def _keys_between_ranks(comm: Comm, key: Array) -> Array:
    """Return keys (ranks - 1,) that divide the keys of all ranks into ranges with about equal numbers of particles.

    key (n,): keys on this rank. Collective.
    """
    some = np.sort(key)[np.linspace(0, max(len(key) - 1, 0), SAMPLES_PER_RANK if len(key) else 0).astype(np.int64)]
    found = comm.mpi.allgather((some, len(key)))
    keys = np.concatenate([sample for sample, _ in found])
    if len(keys) == 0:
        return np.zeros(comm.size - 1, key.dtype)
    order = np.argsort(keys, kind="stable")
    until = np.cumsum(
        np.concatenate([np.full(len(sample), count / SAMPLES_PER_RANK) for sample, count in found])[order]
    )
    at = np.searchsorted(until, until[-1] * np.arange(1, comm.size) / comm.size)
    return keys[order][at]


def gathered(
    comm: Comm, state: State, by: str = "global_index", divided: bool = False, wanted: Collection[str] | None = None
) -> State:
    """Return a state with the particles that this rank is to write. Collective.

    by, divided: as in `Gathering`. wanted: names of arrays; all others have no entries, and `acc_unshared` is empty.
    None: all arrays, and `acc_unshared`.
    """
    found: dict[str, Any] = {}
    acc_unshared = {}
    for name, p in state.species.items():
        gathering = Gathering(comm, p, by, divided)
        found[name] = gathering.particles(p, wanted)
        if name in state.acc_unshared and wanted is None:
            acc = state.acc_unshared[name]
            empty = comm.mpi.allreduce(len(acc)) == 0
            acc_unshared[name] = acc[:0] if empty else gathering.array(acc)
    return replace(state, acc_unshared=acc_unshared, **found)


def gathered_columns(
    comm: Comm, state: State, extra: dict[str, dict[str, Any]], by: str = "global_index", divided: bool = False
) -> dict[str, dict[str, Any]]:
    """Return the rows that this rank is to write of additional snapshot arrays, by species and name. Collective.

    extra: arrays or `Column`s of effects, by species and name. by, divided: as in `Gathering`.
    """
    out: dict[str, dict[str, Any]] = {}
    for species, columns in extra.items():
        gathering = Gathering(comm, state.species[species], by, divided)
        out[species] = {
            name: gathering.array(column)
            if isinstance(column, np.ndarray)
            else column._replace(values=gathering.array(column.values))
            for name, column in columns.items()
        }
    return out
