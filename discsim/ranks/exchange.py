"""Particles of other ranks that sums here need, beside this rank's own, in the order of all."""

from __future__ import annotations

from functools import cached_property
from typing import Protocol

import numpy as np

from discsim.numerics.world import Needed
from discsim.ranks.comm import Comm, Route

Array = np.ndarray


class Placed(Protocol):
    """Particles that have their places in the order of all."""

    place: Array | None

    @property
    def count(self) -> int: ...


class Wide:
    """`world.Fetched`: own particles of a species and then ghosts, those that a route brings."""

    def __init__(self, particles: Placed, route: Route) -> None:
        self.route, self._held = route, particles.count
        self.place = self.of(particles.place)

    @property
    def own(self) -> slice:
        return slice(0, self._held)

    @property
    def count(self) -> int:
        return len(self.place)

    def of(self, array: Array) -> Array:
        """An array (n, ...) of own particles, with the same of ghosts."""
        return np.concatenate([array, self.route.send(array)])

    def of_all(self, arrays: list[Array]) -> list[Array]:
        """The same of several arrays, in one exchange."""
        rows = self.route.rows
        given = np.column_stack([array[rows] for array in arrays])
        found, out, at = self.route.pass_on(given), [], 0
        for array in arrays:
            wide = array.shape[1] if array.ndim == 2 else 1
            out.append(np.concatenate([array, found[:, at : at + wide].reshape(-1, *array.shape[1:])]))
            at += wide
        return out

    def beside(self, array: Array) -> Array:
        both = np.empty((self.count, *array.shape[1:]), array.dtype)
        both[self.own] = array
        return both

    def refresh(self, array: Array) -> None:
        array[self._held :] = self.route.send(array)

    def keep(self, array: Array, both: Array) -> None:
        array[:] = both[self.own]


class Ordered:
    """`world.Joined`: the same with arrays in the order of all. own (n,): where in them own particles are."""

    place = None

    def __init__(self, particles: Placed, route: Route) -> None:
        self._wide = Wide(particles, route)
        # Nearly in order, which a stable sort makes use of.
        self._order = np.argsort(self._wide.place, kind="stable")

    @cached_property
    def own(self) -> Array:
        at = np.empty_like(self._order)
        at[self._order] = np.arange(len(at))
        return at[self._wide.own]

    @property
    def count(self) -> int:
        return len(self._order)

    def of(self, array: Array) -> Array:
        """An array (n, ...) of own particles, with the same of ghosts."""
        return np.take(self._wide.of(array), self._order, axis=0)


def in_cells(comm: Comm, particles: Placed, key: Array, needed: Needed) -> Wide:
    """Own particles, whose cells are `key` (n,), with those of others in the cells that are needed here."""
    return Wide(particles, route_to(comm, key, needed))


def route_to(comm: Comm, key: Array, needed: Needed) -> Route:
    """What brings rows, whose cells are `key` (n,), to the ranks that need these cells."""
    runs = comm.listed(runs_of(needed).ravel())
    runs[comm.rank] = runs[comm.rank][:0]
    of_rank = np.repeat(np.arange(comm.size), [len(each) // 2 for each in runs])
    first, last = np.concatenate(runs).reshape(-1, 2).T
    # Own cells that have numbers in each run.
    first, last = np.searchsorted(needed.end, first, "right"), np.searchsorted(needed.begin, last, "left")
    met = first < last
    of_rank, first, last = of_rank[met], first[met], last[met]
    count = len(needed.mask)
    wanted = np.cumsum(np.bincount(first, minlength=count + 1) - np.bincount(last, minlength=count + 1))[:-1] > 0
    some = np.flatnonzero(wanted[key])  # few of all
    some = some[np.argsort(key[some], kind="stable")]
    cells = key[some].astype(np.int64)
    cuts = np.column_stack([np.searchsorted(cells, first), np.searchsorted(cells, last)])
    return Route(comm, [_members(some, cuts[of_rank == rank]) for rank in range(comm.size)])


def runs_of(needed: Needed) -> Array:
    """Where runs of the numbers of what is needed begin and end (runs, 2)."""
    some = np.flatnonzero(needed.mask)
    begin, end = needed.begin[some], needed.end[some]
    breaks = np.flatnonzero(begin[1:] != end[:-1])
    return np.column_stack([begin[np.append(0, breaks + 1)], end[np.append(breaks, -1)]]) if len(some) else begin[:0]


def _members(some: Array, cuts: Array) -> Array:
    """Of an array its parts between `cuts` (runs, 2)."""
    parts = [some[first:last] for first, last in cuts.tolist() if last > first]
    return np.concatenate(parts) if parts else some[:0]
