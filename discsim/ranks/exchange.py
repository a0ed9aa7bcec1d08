"""Ghosts: copies of particles of other ranks, for sums on this rank in the global order.

Combined arrays have the entries of own particles first, then those of ghosts.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np

from discsim.kernels.mpi.batches import BATCH
from discsim.kernels.mpi.halo import number_runs, particles_in_runs
from discsim.kernels.mpi.tiles import copy_spans
from discsim.numerics.alloc import grow
from discsim.numerics.batches import LEAST
from discsim.numerics.sorting import counting_sort
from discsim.numerics.threads import parallel_for
from discsim.numerics.world import Needed
from discsim.ranks.comm import Comm, Route

Array = np.ndarray
# Number of recent steps whose widest halo is fetched at once: a repeated step costs more than a wide halo.
REMEMBERED_STEPS = 16
GHOST_RESERVE = 8  # spare capacity for ghosts is 1 / GHOST_RESERVE more than their present number


class Placed(Protocol):
    """Protocol of particles with keys in the global order, `global_index` (n,)."""

    global_index: Array | None

    @property
    def count(self) -> int: ...


class Wide:
    """Own particles of a species combined with the ghosts received by a route; with the interface of `world.NoGhosts`.

    If an array of own particles has spare memory behind it, ghost entries are written there, and a later `Wide`
    overwrites them. lasting: whether combined arrays are copies, which remain valid.
    """

    def __init__(self, particles: Placed, route: Route, lasting: bool = False) -> None:
        self.route, self._held, self._lasting = route, particles.count, lasting
        self.count = self._held + route.count
        self._own_index = particles.global_index
        self._combined_index: Array | None = None
        # Points that are not particles have no such rows.
        self._own_unsorted_rows = getattr(particles, "unsorted_rows", None)
        if hasattr(particles, "spare") and not lasting:
            particles.spare = max(particles.spare, route.count + route.count // GHOST_RESERVE)

    @property
    def own(self) -> slice:
        return slice(0, self._held)

    @property
    def local(self) -> int:
        return self._held

    @property
    def unsorted_rows(self) -> Array:
        """Rows of combined arrays without which `global_index` ascends."""
        assert self._own_unsorted_rows is not None
        own = self._own_unsorted_rows[self._own_unsorted_rows < self._held]
        return np.concatenate([own, np.arange(self._held, self.count)])

    def own_among(self, some: Array) -> Array:
        """Return the rows of own particles among the rows `some` of combined arrays."""
        return some[some < self._held]

    @property
    def global_index(self) -> Array:
        """Keys (n,) of own particles and ghosts in the global order. Collective, unless `of_all` was called before."""
        if self._combined_index is None:
            self._combined_index = self.of(self._own_index)
        return self._combined_index

    def of(self, array: Array) -> Array:
        both = self.beside(array)
        self.refresh(both)
        return both

    def of_all(self, arrays: list[Array]) -> list[Array]:
        given = [*arrays, self._own_index] if self._combined_index is None else arrays  # `global_index` comes with them
        out = [self.beside(array) for array in given]
        self.route.send_all(given, [both[self._held :] for both in out])
        if self._combined_index is None:
            *out, self._combined_index = out
        return out

    def beside(self, array: Array) -> Array:
        both = None if self._lasting else grow(array, self.count)
        if both is None:
            both = np.empty((self.count, *array.shape[1:]), array.dtype)
            both[self.own] = array
        return both

    def refresh(self, array: Array) -> None:
        self.route.send_all([array[self.own]], [array[self._held :]])

    def keep(self, array: Array, both: Array) -> None:
        if not np.may_share_memory(array, both):
            array[:] = both[self.own]


class Ordered:
    """Own particles and ghosts in the global order; interface of `world.NoGhosts` without `beside` and `refresh`.

    own (n,): rows of own particles in the combined arrays.
    """

    global_index, unsorted_rows = None, np.empty(0, np.int64)

    def __init__(self, wide: Wide) -> None:
        self._wide = wide
        # Nearly in order, which makes a stable sort fast.
        self._order = np.argsort(wide.global_index, kind="stable")

    @cached_property
    def own(self) -> Array:
        at = np.empty_like(self._order)
        at[self._order] = np.arange(len(at))
        return at[self._wide.own]

    @property
    def count(self) -> int:
        return len(self._order)

    local = count  # each rank has all particles

    def own_among(self, some: Array) -> Array:
        """Return the rows of own particles among the rows `some` of combined arrays, as rows of arrays of own ones."""
        return self._wide.own_among(self._order[some])

    def of(self, array: Array) -> Array:
        return self.sorted(self._wide.of(array))

    def of_all(self, arrays: list[Array]) -> list[Array]:
        return [self.sorted(both) for both in self._wide.of_all(arrays)]

    def sorted(self, both: Array) -> Array:
        """Return a combined array, own particles before ghosts, sorted to the global order."""
        return np.take(both, self._order, axis=0)

    def keep(self, array: Array, both: Array) -> None:
        array[:] = both[self.own]


class Asked(NamedTuple):
    """Requests of other ranks for ranges of cells, in the numbering of the cells of this rank.

    ranks (runs,): rank that requests each range, ascending. first, last (runs,): first cell and end of each range.
    number (cells + 1,): number of cells before each cell that are in any of the ranges.
    """

    ranks: Array
    first: Array
    last: Array
    number: Array


def in_cells(
    comm: Comm,
    particles: Placed,
    key: Array,
    asked: Asked,
    of: Array | None = None,
    batches: Array | None = None,
    lasting: bool = False,
) -> Wide:
    """Return own particles combined with ghosts from the cells needed on this rank.

    lasting: as in `Wide`. Other arguments are those of `route_to`.
    """
    return Wide(particles, route_to(comm, key, asked, of, batches), lasting)


def asked_of(comm: Comm, needed: Needed) -> Asked:
    """Send the cells needed on this rank to all ranks, and return the requests of other ranks. Collective."""
    runs = comm.listed(runs_of(needed).ravel())
    runs[comm.rank] = runs[comm.rank][:0]
    of_rank = np.repeat(np.arange(comm.size), [len(each) // 2 for each in runs])
    first, last = np.concatenate(runs).reshape(-1, 2).T
    # Own cells with numbers in each run.
    first, last = np.searchsorted(needed.end, first, "right"), np.searchsorted(needed.begin, last, "left")
    met = first < last
    of_rank, first, last = of_rank[met], first[met], last[met]
    number = np.zeros(len(needed.mask) + 1, np.uint32)
    number_runs(first, last, number)
    return Asked(of_rank, first, last, number)


def route_to(comm: Comm, key: Array, asked: Asked, of: Array | None = None, batches: Array | None = None) -> Route:
    """Return the route that sends own particles to the ranks that requested their cells.

    key (n,): cell of each particle, or its index in `of`, an array of cell numbers. batches: numbers of the batches of
    particles that may be in requested cells; None: all.
    """
    number = asked.number
    batches = np.arange(-(-len(key) // BATCH)) if batches is None else batches
    found = parallel_for(particles_in_runs, len(batches), batches, key, of, number, least=LEAST)  # few of all batches
    some, numbers = (joined([each[k] for each in found]) for k in range(2))
    order, start = counting_sort(numbers, int(number[-1]))
    first, last = start[number[asked.first]], start[number[asked.last]]
    until = np.append(0, np.cumsum(last - first))
    rows = np.empty(until[-1], some.dtype)
    copy_spans(0, len(first), some[order][None], np.zeros(len(first), np.int64), first, last, until, rows)
    return Route(comm, np.split(rows, until[np.searchsorted(asked.ranks, np.arange(1, comm.size))]))


def rising(rows: Array) -> Array:
    """Return the distinct entries of `rows` in ascending order."""
    rows = np.sort(rows, kind="stable")  # 10 times as fast for nearly sorted rows; np.unique is far slower
    return rows[np.append(True, rows[1:] != rows[:-1])[: len(rows)]]


def joined(parts: list[Array]) -> Array:
    """Return the concatenation of arrays, without a copy of a single one."""
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def runs_of(needed: Needed) -> Array:
    """Return the ranges (runs, 2) of cell numbers on the whole grids that are needed: first number and end of each."""
    some = np.flatnonzero(needed.mask)
    begin, end = needed.begin[some], needed.end[some]
    breaks = np.flatnonzero(begin[1:] != end[:-1])
    return np.column_stack([begin[np.append(0, breaks + 1)], end[np.append(breaks, -1)]]) if len(some) else begin[:0]
