"""Particles of other ranks that sums here need, beside this rank's own, in the order of all."""

from __future__ import annotations

from functools import cached_property
from typing import Protocol

import numpy as np

from discsim.numerics.room import longer
from discsim.numerics.state import Particles
from discsim.numerics.world import Needed
from discsim.ranks.comm import Comm, Route

Array = np.ndarray
REMEMBERED = 16  # steps, in which what some of them needed of others is fetched at once: to do all anew costs more
SPARE = 8  # room for ghosts: a SPARE-th more than there are


class Placed(Protocol):
    """Particles that have their places in the order of all."""

    place: Array | None

    @property
    def count(self) -> int: ...


class Wide:
    """`world.Fetched`: own particles of a species and then ghosts, those that a route brings.

    Arrays of both are own ones with ghosts in the room behind these, where they have it: what another one writes there
    takes its place. `lasting` ones are copies.
    """

    def __init__(self, particles: Placed, route: Route, lasting: bool = False) -> None:
        self.route, self._held, self._lasting = route, particles.count, lasting
        self.count = self._held + route.count
        if isinstance(particles, Particles) and not lasting:
            particles.spare = max(particles.spare, route.count + route.count // SPARE)
        self.place = self.of(particles.place)

    @property
    def own(self) -> slice:
        return slice(0, self._held)

    def of(self, array: Array) -> Array:
        both = self.beside(array)
        self.refresh(both)
        return both

    def of_all(self, arrays: list[Array]) -> list[Array]:
        out = [self.beside(array) for array in arrays]
        for both, others in zip(out, self.route.send_all(arrays), strict=True):
            both[self._held :] = others
        return out

    def beside(self, array: Array) -> Array:
        both = None if self._lasting else longer(array, self.count)
        if both is None:
            both = np.empty((self.count, *array.shape[1:]), array.dtype)
            both[self.own] = array
        return both

    def refresh(self, array: Array) -> None:
        array[self._held :] = self.route.send(array)

    def keep(self, array: Array, both: Array) -> None:
        if not np.may_share_memory(array, both):
            array[:] = both[self.own]


class Ordered:
    """`world.Joined`: the same with arrays in the order of all. own (n,): where in them own particles are."""

    place = None

    def __init__(self, particles: Placed, route: Route, lasting: bool = False) -> None:
        self._wide = Wide(particles, route, lasting)
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
        return np.take(self._wide.of(array), self._order, axis=0)

    def of_all(self, arrays: list[Array]) -> list[Array]:
        """Several of them at once."""
        return [np.take(array, self._order, axis=0) for array in self._wide.of_all(arrays)]

    def keep(self, array: Array, both: Array) -> None:
        array[:] = both[self.own]


def in_cells(comm: Comm, particles: Placed, key: Array, needed: Needed, lasting: bool = False) -> Wide:
    """Own particles, whose cells are `key` (n,), with those of others in the cells that are needed here."""
    return Wide(particles, route_to(comm, key, needed), lasting)


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
