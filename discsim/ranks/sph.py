"""SPH sums on several ranks: those of `numerics/sph.py`, for the cells that contain own particles.

The grids of neighbour cells (box, size classes, sides) are the same on every rank. Each rank has only the cells near
its own particles. It fetches ghosts in all cells within reach of these (`kernels/mpi/halo.py`), as whole cells, so that
candidate lists are the same as on one rank. After each density pass it fetches the h of ghosts from their owners, and
after the last pass all data that forces need. If an h becomes too large for the halo, the density is computed again
with a wider halo, which is kept for the next steps.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from discsim.kernels.common.neighbours import FIRST, REACH
from discsim.kernels.mpi.halo import EITHER, cells_within_halo, mark_cells
from discsim.numerics import world
from discsim.numerics.neighbours import cells_in, corners_of_cells, keys_in
from discsim.numerics.sph import Points, PointsWithGhosts, Sph
from discsim.numerics.state import Gas
from discsim.numerics.world import Needed
from discsim.ranks.comm import Comm
from discsim.ranks.exchange import REMEMBERED_STEPS, asked_of, in_cells
from discsim.scene import Scene

Array = np.ndarray
HALO = 1.35  # width of the halo over the largest support of a class: outgrown cells search to 1.2 h
HALO_MARGIN = 1.1  # margin over the width that was needed


class DividedSph(Sph):
    """`Sph` of one rank.

    room: width of the halo over the largest support of a size class. needed: width that this step needs, in the same
    unit. again: how often the density was computed again. alone (cells,): mask of needed cells without ghosts. ghosts:
    indices of ghosts in cell order. left: cells whose own particles have outgrown them.
    """

    def __init__(self, scene: Scene, comm: Comm):
        super().__init__(scene)
        self.comm = comm
        self.room = HALO
        self._found = deque[float](maxlen=REMEMBERED_STEPS)  # widths needed in recent steps
        self.needed = 0.0  # width needed in this step, in units of `room`
        self.again = 0  # how often the halo was too narrow
        self.alone = self.ghosts = self.left = np.empty(0, np.int64)

    def find_h_and_density(self, gas: Points, vel: Array, h_least: float) -> bool:
        begun, self.needed = gas.h.copy(), 0.0
        while not super().find_h_and_density(gas, vel, h_least):
            gas.h[:], self.room = begun, HALO_MARGIN * self.needed
            self.again += 1
        self._found.append(self.needed)
        self.room = max(HALO, HALO_MARGIN * max(self._found))
        return True

    def forces(self, gas: Gas, acc: Array, vel: Array, u: Array | None, pressure: Array) -> float:
        """Compute forces as `Sph.forces`, and free the neighbour data, as a kick needs the memory."""
        found = super().forces(gas, acc, vel, u, pressure)
        del self.both, self.cells, self.lists, self.found, self.marked
        self.columns = self.columns[:0].copy()
        return found

    def with_ghosts(self, points: Points) -> PointsWithGhosts:
        """Return own particles combined with ghosts, in a halo of `room` times the largest support. Collective."""
        grids, classes = self.grids_of(points)
        held = [k for k in range(len(grids.table)) if np.any(classes == k)]
        reach = np.maximum(grids.table[:, REACH], grids.table[held, REACH].max(initial=0.0))
        grids = self.grids = grids.near(*corners_of_cells(grids, classes, points.pos), self.room * reach)
        key = keys_in(grids, classes, points.pos)
        filled, table = np.zeros(grids.cells, bool), grids.table
        filled[key] = True
        mine = np.flatnonzero(filled)
        needed = mark_cells(mine, table, np.zeros(2), table, EITHER, self.room, self.dim == 1, self.periodic)
        numbers = grids.numbers()
        wide = in_cells(self.comm, points, key, asked_of(self.comm, Needed(needed, numbers, numbers + 1)))
        pos, h, mass, classes = wide.of_all([points.pos, points.h, points.mass, classes])
        key = np.concatenate([key, keys_in(grids, classes[points.count :], pos[points.count :])])
        cells = cells_in(grids, classes, pos, h, wide.global_index, key)
        self.ghosts = np.flatnonzero(cells.order >= points.count)  # their indices in cell order
        self.alone = needed
        self.alone[cells.key[cells.order[self.ghosts]]] = False
        return PointsWithGhosts(wide, h, mass, cells._replace(filled=mine))

    def outgrown_cells(self, own: Array) -> Array:
        """Return all outgrown cells, in which the support of a particle has become larger than allowed for the cell.

        own: cells outgrown by own particles. Cells outgrown by ghosts are added.
        """
        cells, ghosts = self.cells, self.cells.order[self.ghosts]
        beyond = self.support * self.found.h[ghosts] > cells.radius[self.ghosts]
        self.left = own
        return np.union1d(own, cells.key[ghosts[beyond]])

    def halo_suffices(self, outgrown: Array) -> bool:
        """Return whether the halo contains all particles within reach of outgrown cells, on all ranks. Collective.

        Each rank tests its own cells. A cell may reach beyond the halo if it reaches only cells without ghosts.
        """
        some = self.left[~cells_within_halo(self.left, self.cells, self.alone)]
        self.needed = max(self.needed, world.processes.most(self._largest_growth(some)))
        return self.needed <= self.room

    def _largest_growth(self, some: Array) -> float:
        """Return the largest support in the cells `some`, relative to the former largest one in the cell's grid."""
        if len(some) == 0:
            return 0.0
        level = np.searchsorted(self.grids.table[:, FIRST], some, side="right") - 1
        return float((self.cells.bounds[some, 4] / self.grids.table[level, REACH]).max())
