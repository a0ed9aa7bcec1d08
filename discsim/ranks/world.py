"""Collective operations of a run on several ranks, with the interface of `numerics/world.py`."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from mpi4py import MPI

from discsim.effects.base import is_sort_step
from discsim.numerics.world import Needed
from discsim.ranks.agreed import raise_together
from discsim.ranks.comm import Comm
from discsim.ranks.division import PARTICLE_COST, Division
from discsim.ranks.exchange import Ordered, Wide, asked_of, in_cells, rising, route_to
from discsim.ranks.sph import DividedSph

if TYPE_CHECKING:
    from discsim.numerics.state import Particles, State
    from discsim.scene import Scene

Array = np.ndarray


class Ranks:
    """Communication between the ranks of a run, with the interface of `world.SerialComm`.

    division: ownership of particles. forgets: functions that drop caches, called by `forget`.
    """

    many = True

    def __init__(self, scene: Scene, comm: Comm) -> None:
        self.comm, self.division = comm, Division(scene, comm)
        self.balance = 1.0  # the cost of the most loaded rank over the mean
        self.forgets: list[Callable[[], None]] = [self.division.forget]

    def least(self, values: Any) -> Any:
        # MPI.MIN may lose NaN. It becomes -inf, which no caller takes for a limit.
        known = np.where(np.isnan(values), -np.inf, values) if np.ndim(values) > 0 else values
        return self.comm.reduced(known, MPI.MIN)

    def most(self, values: Any) -> Any:
        return self.comm.reduced(values, MPI.MAX)

    def sum(self, values: Any) -> Any:
        return self.comm.reduced(values, MPI.SUM)

    def raise_together(self, do: Callable[[], Any]) -> Any:
        return raise_together(self.comm, do)

    def divide(self, state: State, alike: bool = True) -> None:
        """Send all particles to their owners, at the start of a run.

        alike: whether each rank starts with all particles. If False, each starts with a range of rows, in the order of
        ranks.
        """
        self.division.cut(state.species, whole=alike)
        (self.division.drop_others if alike else self.division.deal)(state)
        self._measure_balance(state)

    def forget(self) -> None:
        for each in self.forgets:
            each()

    def forget_positions(self) -> None:
        self.division.forget()

    def migrate(self, state: State) -> None:
        self.forget()
        if is_sort_step(state.step):
            self.division.cut(state.species)
        self.division.settle(state.species)
        if is_sort_step(state.step):
            self._measure_balance(state)

    def corners(self, pos: Array, find: Callable[[Array], tuple[Array, Array]]) -> tuple[Array, Array]:
        bounds = self.division.known_bounds(pos)
        if bounds is None or len(bounds) == 0 or np.isnan(bounds[:, 0]).any():
            return find(pos)
        columns = np.ascontiguousarray(bounds.T)  # 10 times as fast in numpy as four numbers a row
        return columns[0::2].min(axis=1), columns[1::2].max(axis=1)

    def reuse_removed_keys(self, global_index: Array, gone: Array, unsorted_rows: Array) -> Array:
        removed = np.concatenate(self.comm.listed(global_index[gone]))
        end = _rows_of_largest(global_index, len(removed), unsorted_rows)
        last, gone_too = (np.concatenate(self.comm.listed(each)) for each in (global_index[end], np.isin(end, gone)))
        order = np.argsort(last)[max(len(last) - len(removed), 0) :]
        movers = last[order][~gone_too[order]]
        holes = np.sort(removed)[: len(movers)]
        mine = end[np.isin(global_index[end], movers)]
        global_index[mine] = holes[np.searchsorted(movers, global_index[mine])]
        return mine

    def _measure_balance(self, state: State) -> None:
        cost = sum(PARTICLE_COST[name] * p.count for name, p in state.species.items())
        self.balance = self.most(cost) * self.comm.size / max(self.sum(cost), 1.0)

    def everyone(self, particles: Particles) -> Ordered:
        one = Needed(np.ones(1, bool), np.zeros(1, np.int64), np.ones(1, np.int64))
        route = route_to(self.comm, np.zeros(particles.count, np.uint32), asked_of(self.comm, one))
        return Ordered(Wide(particles, route, lasting=True))

    def in_cells(self, particles: Any, key: Array, needed: Callable[[], Needed]) -> Wide:
        return in_cells(self.comm, particles, key, asked_of(self.comm, needed()), lasting=True)

    def sph(self, kind: Any, scene: Scene) -> DividedSph:
        return DividedSph(scene, self.comm)

    def sample(self, columns: Array, global_index: Array | None, some: Array) -> Array:
        assert global_index is not None
        with self.comm.traffic.call((self.comm.size - 1) * columns.nbytes, self.comm.size - 1):
            found = self.comm.mpi.allgather((global_index[some], columns))
        return np.concatenate([rows for _, rows in found])[np.argsort(np.concatenate([at for at, _ in found]))]


def _rows_of_largest(values: Array, number: int, unsorted_rows: Array) -> Array:
    """Return the rows of the `number` largest of `values` (n,), in any order.

    The values ascend, except in the rows `unsorted_rows`.
    """
    if number == 0:
        return unsorted_rows[:0]
    count = len(values)
    unsorted_rows = rising(unsorted_rows[unsorted_rows < count])
    begin = max(0, count - number - len(unsorted_rows))  # the largest of the sorted rows are from there on
    rises = np.ones(count - begin, bool)
    rises[unsorted_rows[np.searchsorted(unsorted_rows, begin) :] - begin] = False
    some = np.concatenate([unsorted_rows, begin + np.flatnonzero(rises)[-number:]])
    return some if len(some) <= number else some[np.argpartition(values[some], -number)[-number:]]
