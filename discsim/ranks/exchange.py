"""Particles of other ranks that sums here need, beside this rank's own, in the order of all."""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from discsim.kernels.move import put_back, take_of_both
from discsim.numerics.threads import share
from discsim.numerics.world import Needed
from discsim.ranks.comm import Comm, Route

if TYPE_CHECKING:
    from discsim.numerics.state import Particles

Array = np.ndarray


class Wide:
    """Own particles of a species and `ghosts`, those that a route brings: arrays of both in the order of all.

    own, ghosts: where in them each is.
    """

    def __init__(self, particles: Particles, route: Route) -> None:
        assert particles.place is not None
        self.route, self._held = route, particles.count
        # Nearly in order, which a stable sort makes use of.
        self._order = np.argsort(np.concatenate([particles.place, route.send(particles.place)]), kind="stable")

    @cached_property
    def _at(self) -> Array:
        at = np.empty_like(self._order)
        at[self._order] = np.arange(len(at))
        return at

    @property
    def own(self) -> Array:
        return self._at[: self._held]

    @property
    def ghosts(self) -> Array:
        return self._at[self._held :]

    @property
    def count(self) -> int:
        return len(self._order)

    def of(self, array: Array) -> Array:
        """An array (n, ...) of own particles, with the same of ghosts."""
        others = self.route.send(array)
        out = np.empty((self.count, *array.shape[1:]), array.dtype)
        source, others, to = (_rows(each) for each in (array, others, out))
        share(take_of_both, self.count, source, others, self._order, to)
        return out

    def put_back(self, array: Array, out: Array) -> None:
        """Own particles' entries of an array of both, into one of these (n, ...)."""
        source, to = _rows(array), _rows(out)
        share(put_back, self.count, source, self._order, to)

    def refresh(self, array: Array) -> None:
        """Take the ghosts' entries of an array of both, in place, from those whose own they are."""
        array[self.ghosts] = self.route.pass_on(array[self._at[self.route.rows]])


def _rows(array: Array) -> Array:
    """The same as whole numbers (n, d), for which kernels are compiled, whatever they are."""
    return array.reshape(len(array), math.prod(array.shape[1:])).view(f"i{array.itemsize}")


def in_cells(comm: Comm, particles: Particles, key: Array, needed: Needed) -> Wide:
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
