"""Part of the lattice of drag cells that a rank has, and sums over the particles of all ranks in its leaves.

Drag cells are blocks of leaves (`drag/cells.py`). Leaves are merged within largest blocks, squares of MOST by MOST
leaves. If the sums over the leaves of a largest block include the particles of all ranks, its blocks are the same as on
one rank. Each rank has the largest blocks that contain local particles, and largest blocks near them.
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
from discsim.numerics.world import NeededCells
from discsim.ranks.comm import Comm
from discsim.ranks.exchange import REMEMBERED_STEPS, exchange_requests, route_to_requesters

Array = np.ndarray
LEAST = 4  # columns of largest blocks in a chunk of a loop


class DividedLeaves(OneRank):
    """Communication of a drag layout on several ranks.

    reach: how far beyond its local particles the rank has the lattice, in units of the side of a largest block.
    """

    def __init__(self, comm: Comm) -> None:
        self.comm, self.reach = comm, 0
        self._local_leaves: Array | None = None  # mask of the leaves with local particles, from the last `summed`
        self._needed_cells = deque[int](maxlen=REMEMBERED_STEPS)  # distances needed in recent kicks

    def update_reach(self, needed: int) -> bool:
        """Set `reach` to the largest distance needed in recent kicks.

        Returns whether `reach` was at least `needed` before. Blocks change in each kick, and to repeat the first pass
        of a kick costs more than a wider part.
        """
        enough = needed <= self.reach
        self._needed_cells.append(needed)
        self.reach = max(self._needed_cells)
        return enough

    def part_of(self, lattice: Lattice, shift: Array, positions: Sequence[Array]) -> Lattice:
        self._local_leaves, some = None, [pos for pos in positions if len(pos) > 0]
        ends = [world.processes.corners(pos, corners) for pos in some] or [(np.zeros(2), np.zeros(2))]
        low, high = np.min([low for low, _ in ends], axis=0), np.max([high for _, high in ends], axis=0)
        leaves = np.floor((np.stack([low, high]) - lattice.origin) / lattice.side + shift)
        leaves = np.where(np.isfinite(leaves), leaves, 0.0) + np.array([[-1.0], [1.0]])  # with a margin for rounding
        spans = [self._span(lattice, axis, *leaves[:, axis].tolist()) for axis in range(2)]
        (first_x, along_x), (first_y, along_y) = spans
        return lattice._replace(first=(first_x, first_y), shape=(along_x, along_y))

    def _span(self, lattice: Lattice, axis: int, low: float, high: float) -> tuple[int, int]:
        """Return the first leaf and the number of leaves, along one axis, of the largest blocks near local particles.

        low, high: first and last leaf with local particles along the axis.
        """
        count, reach = lattice.whole[axis], _reach_in_blocks(lattice, axis, self.reach)
        last, turns = (count - 1) // MOST, low // count if lattice.periodic else 0.0
        begin, end = (int((leaf - turns * count) // MOST) for leaf in (low, high))
        begin, end = begin - reach, end + reach
        if lattice.periodic and (begin < 0 or end > last or high - turns * count >= count):
            begin, end = 0, last
        begin, end = (min(max(each, 0), last) for each in (begin, end))
        return begin * MOST, min((end + 1) * MOST, count) - begin * MOST

    def summed(self, lattice: Lattice, *held: Array) -> Sequence[Array]:
        """Return sums over the particles of all ranks in each leaf. Collective.

        The sums are complete in largest blocks within `reach` of local particles. held: sums over local particles in
        each leaf, (leaves + 1,) each; these arrays are changed in place, and returned. The last entry, for particles
        outside the lattice, is not changed.
        """
        tables = [array[:-1].reshape(lattice.shape) for array in held]
        x, y = (np.arange(0, n, MOST) for n in lattice.shape)
        own, leaves = np.zeros((len(x), len(y)), bool), np.empty(lattice.shape, bool)
        parallel_for(mark_leaves, len(x), tables[0], tables[1], MOST, leaves, own, least=LEAST)
        mask = dilate(own, lattice, self.reach)
        along, first = -(-lattice.whole[1] // MOST), np.array(lattice.first) // MOST
        begin = ((first[0] + np.arange(len(x)))[:, None] * along + first[1] + np.arange(len(y))).ravel()
        some = np.flatnonzero(own)
        requests = exchange_requests(self.comm, NeededCells(mask.ravel(), begin, begin + 1))
        route = route_to_requesters(self.comm, some, requests)
        sent = np.zeros((len(route.rows), len(held), MOST, MOST))
        blocks = np.column_stack(np.divmod(some[route.rows], len(y)))
        for k, table in enumerate(tables):
            cut_blocks(blocks, table, k, sent)
        blocks = np.column_stack(np.divmod(route.send(begin[some]), along)) - first
        received = route.send_selected(sent)
        for k, table in enumerate(tables):
            add_blocks(blocks, received, k, table)
        self._local_leaves = leaves.ravel()
        return held

    def local_leaves(self, lattice: Lattice, leaves: Sequence[Array]) -> Array:
        """Return the mask (leaves,) of the leaves in this rank's part of the lattice that contain local particles.

        leaves: leaf of each local particle, one array for each species; used only if `summed` was not called.
        """
        if self._local_leaves is not None:
            return self._local_leaves
        mask = np.zeros(math.prod(lattice.shape) + 1, bool)
        for leaf in leaves:
            mask[leaf] = True
        return mask[:-1]


def _reach_in_blocks(lattice: Lattice, axis: int, distance: int) -> int:
    """Return `distance`, a number of largest blocks along an axis, extended for an incomplete last block.

    1 is added if `distance` is above 0 and a periodic axis has an incomplete last block.
    """
    return distance + (lattice.periodic and distance > 0 and lattice.whole[axis] % MOST > 0)


def dilate(mask: Array, lattice: Lattice, distance: int) -> Array:
    """Return the mask (x, y) of largest blocks that are within `distance` blocks, along each axis, of one in `mask`."""
    for axis in range(2):
        reach = min(_reach_in_blocks(lattice, axis, distance), mask.shape[axis])
        mode = "wrap" if lattice.joined[axis] else "constant"
        mask = maximum_filter1d(mask, 2 * reach + 1, axis=axis, mode=mode)
    return mask
