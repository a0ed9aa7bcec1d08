"""Ghosts: copies of particles of other ranks, for sums on this rank in the global order.

Combined arrays have the entries of local particles first, then those of ghosts.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from discsim.kernels.mpi.batches import BATCH
from discsim.kernels.mpi.halo import number_runs, particles_in_runs
from discsim.kernels.mpi.tiles import copy_spans
from discsim.numerics.alloc import grow
from discsim.numerics.batches import LEAST
from discsim.numerics.sorting import counting_sort
from discsim.numerics.threads import parallel_for
from discsim.numerics.world import CombinedParticles, NeededCells, ParticlesWithGhosts
from discsim.ranks.comm import Comm, Route

Array = np.ndarray
# Number of recent steps whose widest halo is fetched at once: a repeated step costs more than a wide halo.
REMEMBERED_STEPS = 16
GHOST_RESERVE = 8  # spare capacity for ghosts is 1 / GHOST_RESERVE more than their present number


class KeyedParticles(Protocol):
    """Protocol of particles with `global_index` (n,), the keys that define the global order of all particles."""

    global_index: Array | None

    @property
    def count(self) -> int: ...


class FetchedGhosts(ParticlesWithGhosts):
    """Local particles of a species combined with the ghosts received by a route.

    If a local array has spare memory behind it, ghost entries are written there, and later ghosts overwrite them.
    lasting: True if combined arrays must remain valid; combined arrays are then copies. local_count: number of local
    particles. count: number of local particles and ghosts.
    """

    def __init__(self, particles: KeyedParticles, route: Route, lasting: bool = False) -> None:
        self.route, self.local_count, self._lasting = route, particles.count, lasting
        self.count, self.local_rows = particles.count + route.count, slice(0, particles.count)
        self._local_index = particles.global_index
        self._combined_index: Array | None = None
        # Only `Particles` have this attribute; drag and SPH also combine other points.
        self._local_unsorted_rows = getattr(particles, "unsorted_rows", None)
        if hasattr(particles, "spare") and not lasting:
            particles.spare = max(particles.spare, route.count + route.count // GHOST_RESERVE)

    @property
    def unsorted_rows(self) -> Array:
        """Rows of combined arrays without which `global_index` ascends."""
        assert self._local_unsorted_rows is not None
        ghosts = np.arange(self.local_count, self.count)
        return np.concatenate([self.local_among(self._local_unsorted_rows), ghosts])

    def local_among(self, rows: Array) -> Array:
        """Return the rows of local particles among some `rows` of combined arrays."""
        return rows[rows < self.local_count]

    @property
    def global_index(self) -> Array:
        """Keys (n,) of local particles and ghosts; collective at first access, unless `all_with_ghosts` was called."""
        if self._combined_index is None:
            self._combined_index = self.with_ghosts(self._local_index)
        return self._combined_index

    def with_ghosts(self, array: Array) -> Array:
        combined = self.with_empty_ghosts(array)
        self.update_ghosts(combined)
        return combined

    def all_with_ghosts(self, arrays: list[Array]) -> list[Array]:
        """Return `with_ghosts` of each array, in one exchange, which also fetches `global_index` if it is unknown."""
        sent = [*arrays, self._local_index] if self._combined_index is None else arrays
        out = [self.with_empty_ghosts(array) for array in sent]
        self.route.send_all(sent, [combined[self.local_count :] for combined in out])
        if self._combined_index is None:
            *out, self._combined_index = out
        return out

    def with_empty_ghosts(self, array: Array) -> Array:
        combined = None if self._lasting else grow(array, self.count)
        if combined is None:
            combined = np.empty((self.count, *array.shape[1:]), array.dtype)
            combined[self.local_rows] = array
        return combined

    def update_ghosts(self, combined: Array) -> None:
        self.route.send_all([combined[self.local_rows]], [combined[self.local_count :]])

    def set_local(self, array: Array, combined: Array) -> None:
        if not np.may_share_memory(array, combined):
            array[:] = combined[self.local_rows]


class GatheredParticles(CombinedParticles):
    """Particles of all ranks; combined arrays are in the global order. `ghosts`: the particles of all other ranks."""

    unsorted_rows = np.empty(0, np.int64)

    def __init__(self, ghosts: FetchedGhosts) -> None:
        self._ghosts, self.count = ghosts, ghosts.count
        self.local_count = ghosts.count  # each rank computes the kick of all particles
        # Keys are nearly in order, which makes a stable sort fast.
        self._order = np.argsort(ghosts.global_index, kind="stable")
        place = np.empty_like(self._order)
        place[self._order] = np.arange(self.count)
        self.local_rows = place[ghosts.local_rows]

    def local_among(self, rows: Array) -> Array:
        """Return the rows of local particles among some `rows` of combined arrays, as rows of local arrays."""
        return self._ghosts.local_among(self._order[rows])

    def with_ghosts(self, array: Array) -> Array:
        return self._in_order(self._ghosts.with_ghosts(array))

    def all_with_ghosts(self, arrays: list[Array]) -> list[Array]:
        """Return `with_ghosts` of each array, in one exchange."""
        return [self._in_order(combined) for combined in self._ghosts.all_with_ghosts(arrays)]

    def _in_order(self, combined: Array) -> Array:
        return np.take(combined, self._order, axis=0)

    def set_local(self, array: Array, combined: Array) -> None:
        array[:] = combined[self.local_rows]


class CellRequests(NamedTuple):
    """Requests of other ranks for the particles in ranges of the cells of this rank.

    ranks (requests,): rank that requests each range, ascending. first, end (requests,): first cell of each range, and
    the cell after its last one. requested_before (cells + 1,): number of cells before each cell that any rank requests.
    """

    ranks: Array
    first: Array
    end: Array
    requested_before: Array


def exchange_requests(comm: Comm, needed: NeededCells) -> CellRequests:
    """Request the cells needed on this rank from all ranks, and return the requests of other ranks. Collective."""
    ranges = comm.allgatherv(needed_ranges(needed).ravel())
    ranges[comm.rank] = ranges[comm.rank][:0]
    ranks = np.repeat(np.arange(comm.size), [len(each) // 2 for each in ranges])
    first, end = np.concatenate(ranges).reshape(-1, 2).T
    # Cells of this rank whose numbers are in each range.
    first, end = np.searchsorted(needed.end, first, "right"), np.searchsorted(needed.begin, end, "left")
    some = first < end
    ranks, first, end = ranks[some], first[some], end[some]
    requested_before = np.zeros(len(needed.mask) + 1, np.uint32)
    number_runs(first, end, requested_before)
    return CellRequests(ranks, first, end, requested_before)


def needed_ranges(needed: NeededCells) -> Array:
    """Return the ranges (ranges, 2) that needed cells cover in the numbering of `NeededCells`.

    A range is its first number, and one more than its last number.
    """
    some = np.flatnonzero(needed.mask)
    begin, end = needed.begin[some], needed.end[some]
    breaks = np.flatnonzero(begin[1:] != end[:-1])
    return np.column_stack([begin[np.append(0, breaks + 1)], end[np.append(breaks, -1)]]) if len(some) else begin[:0]


def route_to_requesters(
    comm: Comm, key: Array, requests: CellRequests, cell_of_key: Array | None = None, batches: Array | None = None
) -> Route:
    """Return the route that sends local particles to the ranks that requested their cells. Collective.

    key (n,): cell of each particle; if `cell_of_key` is given, cell_of_key[key] is the cell. batches: indices of the
    batches of particles that may be in requested cells; None: all.
    """
    before = requests.requested_before
    batches = np.arange(-(-len(key) // BATCH)) if batches is None else batches
    found = parallel_for(particles_in_runs, len(batches), batches, key, cell_of_key, before, least=LEAST)
    some, numbers = (concatenate([each[k] for each in found]) for k in range(2))
    order, start = counting_sort(numbers, int(before[-1]))
    first, end = start[before[requests.first]], start[before[requests.end]]
    until = np.append(0, np.cumsum(end - first))
    rows = np.empty(until[-1], some.dtype)
    copy_spans(0, len(first), some[order][None], np.zeros(len(first), np.int64), first, end, until, rows)
    return Route(comm, np.split(rows, until[np.searchsorted(requests.ranks, np.arange(1, comm.size))]))


def sorted_distinct(rows: Array) -> Array:
    """Return the distinct entries of `rows` in ascending order."""
    rows = np.sort(rows, kind="stable")  # 10 times as fast for nearly sorted rows; np.unique is far slower
    return rows[np.append(True, rows[1:] != rows[:-1])[: len(rows)]]


def concatenate(parts: list[Array]) -> Array:
    """Return the concatenation of arrays; a single array is not copied."""
    return parts[0] if len(parts) == 1 else np.concatenate(parts)
