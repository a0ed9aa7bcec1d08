"""What `numerics/world.py` asks, answered by all ranks of a run."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from mpi4py import MPI

from discsim.effects.base import to_sort
from discsim.ranks.comm import Comm
from discsim.ranks.division import COST, Division

if TYPE_CHECKING:
    from discsim.numerics.state import State
    from discsim.scene import Scene

Array = np.ndarray


class Ranks:
    """All ranks of a run of a scene, each with its own particles."""

    many = True

    def __init__(self, scene: Scene, comm: Comm) -> None:
        self.comm, self.division = comm, Division(scene, comm)
        self.balance = 1.0  # the cost of the most loaded rank over the mean

    def least(self, values: Any) -> Any:
        # What is no number would be lost on the way: no limit, as what asks for the least takes it.
        known = np.where(np.isnan(values), -np.inf, values) if np.ndim(values) > 0 else values
        return self.comm.reduced(known, MPI.MIN)

    def most(self, values: Any) -> Any:
        return self.comm.reduced(values, MPI.MAX)

    def sum(self, values: Any) -> Any:
        return self.comm.reduced(values, MPI.SUM)

    def divide(self, state: State) -> None:
        """Of a state that each rank has the whole of, keep own particles."""
        self.division.cut(state.species, whole=True)
        self.division.keep_own(state)
        self._weigh(state)

    def settle(self, state: State) -> None:
        if to_sort(state.step):
            self.division.cut(state.species)
        for particles in state.species.values():
            self.division.migrate(particles)
        if to_sort(state.step):
            self._weigh(state)

    def _weigh(self, state: State) -> None:
        cost = sum(COST[name] * p.count for name, p in state.species.items())
        self.balance = self.most(cost) * self.comm.size / max(self.sum(cost), 1.0)

    def sample(self, columns: Array, place: Array | None, some: Array) -> Array:
        assert place is not None
        with self.comm.traffic.call((self.comm.size - 1) * columns.nbytes, self.comm.size - 1):
            found = self.comm.mpi.allgather((place[some], columns))
        return np.concatenate([rows for _, rows in found])[np.argsort(np.concatenate([at for at, _ in found]))]
