"""Particles of other ranks that sums here need, beside this rank's own, in the order of all."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from discsim.kernels.move import take_rows
from discsim.numerics.threads import share
from discsim.numerics.world import Needed
from discsim.ranks.comm import Comm, Route

if TYPE_CHECKING:
    from discsim.numerics.state import Particles

Array = np.ndarray


def taken(array: Array, index: Array) -> Array:
    """The rows `index` (m,) of an array (n, ...)."""
    out = np.empty((len(index), *array.shape[1:]), array.dtype)
    wide = math.prod(array.shape[1:])
    rows, to = (a.reshape(len(a), wide).view(f"i{array.itemsize}") for a in (array, out))
    share(take_rows, len(index), rows, index, to)
    return out


class Wide:
    """Own particles of a species and `ghosts`, those that a route brings: arrays of both in the order of all.

    own, ghosts: where in them each is.
    """

    def __init__(self, particles: Particles, route: Route) -> None:
        assert particles.place is not None
        self.route = route
        place = np.concatenate([particles.place, route.send(particles.place)])
        self._order = np.argsort(place, kind="stable")
        at = np.empty_like(self._order)
        at[self._order] = np.arange(len(at))
        self.own, self.ghosts = at[: particles.count], at[particles.count :]

    @property
    def count(self) -> int:
        return len(self._order)

    def of(self, array: Array) -> Array:
        """An array (n, ...) of own particles, with the same of ghosts."""
        return taken(np.concatenate([array, self.route.send(array)]), self._order)

    def refresh(self, array: Array) -> None:
        """Take the ghosts' entries of an array of both, in place, from those whose own they are."""
        array[self.ghosts] = self.route.send(array[self.own])


def in_cells(comm: Comm, particles: Particles, key: Array, needed: Needed) -> Wide:
    """Own particles, whose cells are `key` (n,), with those of others in the cells that are needed here."""
    return Wide(particles, route_to(comm, key, needed))


def route_to(comm: Comm, key: Array, needed: Needed) -> Route:
    """What brings rows, whose cells are `key` (n,), to the ranks that need these cells."""
    runs = comm.listed(_runs(needed).ravel())
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


def _runs(needed: Needed) -> Array:
    """Where runs of the numbers of what is needed begin and end (runs, 2)."""
    some = np.flatnonzero(needed.mask)
    begin, end = needed.begin[some], needed.end[some]
    breaks = np.flatnonzero(begin[1:] != end[:-1])
    return np.column_stack([begin[np.append(0, breaks + 1)], end[np.append(breaks, -1)]]) if len(some) else begin[:0]


def _members(some: Array, cuts: Array) -> Array:
    """Of an array its parts between `cuts` (runs, 2)."""
    parts = [some[first:last] for first, last in cuts.tolist() if last > first]
    return np.concatenate(parts) if parts else some[:0]
