"""Collection of particles in the order of output: all on the leading rank, or a range of rows on each rank."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.ranks.comm import Comm, Route

if TYPE_CHECKING:
    from discsim.numerics.state import Particles, State

Array = np.ndarray
SAMPLES = 256  # keys of each rank, which set the ends of ranges to 1 / SAMPLES of a rank's particles


class Gathering:
    """Route of a species' arrays to the ranks that write them.

    by: "place", the order in memory of one process, or "ids". divided: each rank gets a range of the rows.
    """

    def __init__(self, comm: Comm, particles: Particles, by: str = "global_index", divided: bool = False) -> None:
        key = getattr(particles, by)
        owner = np.searchsorted(_cuts(comm, key), key, side="right") if divided else np.zeros(len(key), np.int64)
        self.route = Route(comm, [np.flatnonzero(owner == rank) for rank in range(comm.size)])
        self.order = np.argsort(self.route.send(key))

    def array(self, array: Array) -> Array:
        """Return the rows received of an array (n, ...)."""
        return self.route.send(array)[self.order]

    def particles(self, particles: Any, wanted: Collection[str] | None = None) -> Any:
        """Return the particles received; arrays not `wanted` have no entries."""
        held = {name: array for name, array in particles.arrays().items() if name != "global_index"}
        every = wanted is None
        return type(particles)(
            **{name: self.array(a) if every or name in wanted else a[:0] for name, a in held.items()}
        )


def _cuts(comm: Comm, key: Array) -> Array:
    """Return keys (size - 1,) that divide those of all ranks into ranges of about equal length."""
    some = np.sort(key)[np.linspace(0, max(len(key) - 1, 0), SAMPLES if len(key) else 0).astype(np.int64)]
    found = comm.mpi.allgather((some, len(key)))
    keys = np.concatenate([sample for sample, _ in found])
    if len(keys) == 0:
        return np.zeros(comm.size - 1, key.dtype)
    order = np.argsort(keys, kind="stable")
    until = np.cumsum(np.concatenate([np.full(len(sample), count / SAMPLES) for sample, count in found])[order])
    at = np.searchsorted(until, until[-1] * np.arange(1, comm.size) / comm.size)
    return keys[order][at]


def gathered(
    comm: Comm, state: State, by: str = "global_index", divided: bool = False, wanted: Collection[str] | None = None
) -> State:
    """Return a state with the particles received: all on the leading rank, or a range of rows on each rank.

    wanted: names of arrays. All others, and `acc_unshared`, the accelerations that gas and dust do not share, have no
    entries. None: all.
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
    """Return columns of effects in the order of output, by species and name, as snapshots take them."""
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
