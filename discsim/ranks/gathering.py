"""The whole state of a run on the rank that leads, for what is written: in the order of all, as on one rank."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.ranks.comm import Comm, Route

if TYPE_CHECKING:
    from discsim.numerics.state import Particles, State

Array = np.ndarray


class Gathering:
    """Arrays of a species, brought to the rank that leads."""

    def __init__(self, comm: Comm, particles: Particles) -> None:
        assert particles.place is not None
        nobody = np.empty(0, np.int64)
        self.route = Route(comm, [np.arange(particles.count)] + [nobody] * (comm.size - 1))
        self.order = np.argsort(self.route.send(particles.place))

    def array(self, array: Array) -> Array:
        """All of an array (n, ...); elsewhere one of no entries."""
        return self.route.send(array)[self.order]

    def particles(self, particles: Any) -> Any:
        arrays = {name: self.array(array) for name, array in particles.arrays().items() if name != "place"}
        return type(particles)(**arrays)


def gathered(comm: Comm, state: State) -> State:
    """The whole of a state on the rank that leads, elsewhere one of no particles."""
    found: dict[str, Any] = {}
    own_acc = {}
    for name, p in state.species.items():
        gathering = Gathering(comm, p)
        found[name] = gathering.particles(p)
        if name in state.own_acc:
            acc = state.own_acc[name]
            empty = comm.mpi.allreduce(len(acc)) == 0
            own_acc[name] = acc[:0] if empty else gathering.array(acc)
    return replace(state, own_acc=own_acc, **found)


def gathered_columns(comm: Comm, state: State, extra: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Columns of effects, by species and name, as snapshots take them."""
    out: dict[str, dict[str, Any]] = {}
    for species, columns in extra.items():
        gathering = Gathering(comm, state.species[species])
        out[species] = {
            name: gathering.array(column)
            if isinstance(column, np.ndarray)
            else column._replace(values=gathering.array(column.values))
            for name, column in columns.items()
        }
    return out
