"""Part of the lattice of drag cells near a rank's own particles (`drag/cells.py`), with sums over the ranks in leaves.

Drag cells are blocks of leaves, made by merging within largest blocks, squares of MOST by MOST leaves. If the sums over
the leaves of a largest block include the particles of all ranks, its blocks are the same as on one rank. Each rank has
the largest blocks that contain own particles, and neighbouring ones that its own blocks may depend on.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

import numpy as np
from scipy.ndimage import maximum_filter1d

from discsim.drag.cells import Lattice, OneRank
from discsim.kernels.drag.blocks import MOST
from discsim.kernels.mpi.halo import add_blocks, cut_blocks, mark_leaves
from discsim.numerics import world
from discsim.numerics.neighbours import corners
from discsim.numerics.threads import parallel_for
from discsim.numerics.world import Needed
from discsim.ranks.comm import Comm
from discsim.ranks.exchange import REMEMBERED_STEPS, asked_of, route_to

Array = np.ndarray
LEAST = 4  # columns of largest blocks in a chunk of a loop


class Leaves(OneRank):
    """Parts of drag lattices on a rank.

    reach: distance from own particles up to which the rank has the lattice, in largest blocks.
    """

    def __init__(self, comm: Comm) -> None:
        self.comm, self.reach = comm, 0
        self._held: Array | None = None  # leaves of the last part that hold own particles
        self._wanted = deque[int](maxlen=REMEMBERED_STEPS)

    def suffices(self, wanted: int) -> bool:
        """Return whether `reach` is at least `wanted`, and set `reach` to the largest one needed in recent kicks.

        Blocks change in each kick, and repeating the kick's first pass costs more than a wider part.
        """
        enough = wanted <= self.reach
        self._wanted.append(wanted)
        self.reach = max(self._wanted)
        return enough

    def part_of(self, lattice: Lattice, shift: Array, positions: Sequence[Array]) -> Lattice:
        self._held, some = None, [pos for pos in positions if len(pos) > 0]
        held = [world.processes.corners(pos, corners) for pos in some] or [(np.zeros(2), np.zeros(2))]
        low, high = np.min([low for low, _ in held], axis=0), np.max([high for _, high in held], axis=0)
        ends = np.floor((np.stack([low, high]) - lattice.origin) / lattice.side + shift)
        ends = np.where(np.isfinite(ends), ends, 0.0) + np.array([[-1.0], [1.0]])  # with a margin for rounding
        spans = [self._span(lattice, axis, *ends[:, axis].tolist()) for axis in range(2)]
        (first_x, along_x), (first_y, along_y) = spans
        return lattice._replace(first=(first_x, first_y), shape=(along_x, along_y))

    def _span(self, lattice: Lattice, axis: int, low: float, high: float) -> tuple[int, int]:
        """Return the first leaf and the number of leaves, along one axis, of the largest blocks near own leaves.

        low, high: first and last leaf with own particles along the axis.
        """
        count, reach = lattice.whole[axis], _reach(lattice, axis, self.reach)
        last, turns = (count - 1) // MOST, low // count if lattice.periodic else 0.0
        begin, end = (int((leaf - turns * count) // MOST) for leaf in (low, high))
        begin, end = begin - reach, end + reach
        if lattice.periodic and (begin < 0 or end > last or high - turns * count >= count):
            begin, end = 0, last
        begin, end = (min(max(each, 0), last) for each in (begin, end))
        return begin * MOST, min((end + 1) * MOST, count) - begin * MOST

    def summed(self, lattice: Lattice, *held: Array) -> Sequence[Array]:
        """Return arrays over leaves summed over ranks, in largest blocks within reach of own particles. Collective.

        held: arrays of this rank, one entry for each leaf and a last one; they are changed in place.
        """
        tables = [array[:-1].reshape(lattice.shape) for array in held]
        x, y = (np.arange(0, n, MOST) for n in lattice.shape)
        own, leaves = np.zeros((len(x), len(y)), bool), np.empty(lattice.shape, bool)
        parallel_for(mark_leaves, len(x), tables[0], tables[1], MOST, leaves, own, least=LEAST)
        mask = widened(own, lattice, self.reach)
        along, first = -(-lattice.whole[1] // MOST), np.array(lattice.first) // MOST
        begin = ((first[0] + np.arange(len(x)))[:, None] * along + first[1] + np.arange(len(y))).ravel()
        some = np.flatnonzero(own)
        route = route_to(self.comm, some, asked_of(self.comm, Needed(mask.ravel(), begin, begin + 1)))
        rows = np.zeros((len(route.rows), len(held), MOST, MOST))
        cut = np.column_stack(np.divmod(some[route.rows], len(y)))
        for k, table in enumerate(tables):
            cut_blocks(cut, table, k, rows)
        places = np.column_stack(np.divmod(route.send(begin[some]), along)) - first
        found = route.send_rows(rows)
        for k, table in enumerate(tables):
            add_blocks(places, found, k, table)
        self._held = leaves.ravel()
        return held

    def held(self, lattice: Lattice, leaves: Sequence[Array]) -> Array:
        """Return the mask of the leaves of a part that contain own particles.

        leaves: leaf of each own particle, one array for each species; used only if `summed` was not called.
        """
        if self._held is not None:
            return self._held
        held = np.zeros(math.prod(lattice.shape) + 1, bool)
        for leaf in leaves:
            held[leaf] = True
        return held[:-1]


def _reach(lattice: Lattice, axis: int, away: int) -> int:
    """Return the distance `away` in largest blocks, plus 1 if the last one of a periodic axis is incomplete."""
    return away + (lattice.periodic and away > 0 and lattice.whole[axis] % MOST > 0)


def widened(mask: Array, lattice: Lattice, away: int) -> Array:
    """Return the mask (x, y) of the largest blocks within a distance of `away` largest blocks from any in `mask`."""
    for axis in range(2):
        reach = min(_reach(lattice, axis, away), mask.shape[axis])
        mode = "wrap" if lattice.joined[axis] else "constant"
        mask = maximum_filter1d(mask, 2 * reach + 1, axis=axis, mode=mode)
    return mask
