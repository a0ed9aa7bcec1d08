"""SPH sums on several ranks: those of `numerics/sph.py` over the cells that hold own particles.

Neighbour cells are those of all the gas: the box, size classes and sides are the same on every rank, which has the
part of the cells about its own. It fetches the ghosts in all cells within reach of its own (`kernels/mpi/halo.py`), as
whole cells, so that candidate lists are those of one rank. After each density pass the h of ghosts are fetched from
their owners, and after the last one all data that forces read. Where an h outgrows the halo, the density is computed
again with a wider halo, which the next steps keep.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from discsim.kernels.common.neighbours import FIRST, REACH
from discsim.kernels.mpi.halo import EITHER, cells_within_halo, mark_cells
from discsim.numerics import world
from discsim.numerics.neighbours import cells_in, corners_of_cells, keys_in
from discsim.numerics.sph import Around, Points, Sph
from discsim.numerics.state import Gas
from discsim.numerics.world import Needed
from discsim.ranks.comm import Comm
from discsim.ranks.exchange import REMEMBERED, asked_of, in_cells
from discsim.scene import Scene

Array = np.ndarray
HALO = 1.35  # width of the halo over the largest support of a class: outgrown cells search to 1.2 h
MORE = 1.1  # margin over the width that was needed


class DividedSph(Sph):
    """`Sph` of a rank."""

    def __init__(self, scene: Scene, comm: Comm):
        super().__init__(scene)
        self.comm = comm
        self.room = HALO
        self._found = deque[float](maxlen=REMEMBERED)  # widths needed in recent steps
        self.needed = 0.0  # width needed in this step, in units of `room`
        self.again = 0  # how often the halo was too narrow
        self.alone = self.ghosts = self.left = np.empty(0, np.int64)

    def settle(self, gas: Points, vel: Array, h_least: float) -> bool:
        begun, self.needed = gas.h.copy(), 0.0
        while not super().settle(gas, vel, h_least):
            gas.h[:], self.room = begun, MORE * self.needed
            self.again += 1
        self._found.append(self.needed)
        self.room = max(HALO, MORE * max(self._found))
        return True

    def forces(self, gas: Gas, acc: Array, vel: Array, u: Array | None, pressure: Array) -> float:
        """Compute forces as `Sph.forces`, and free the neighbour data: a kick needs the memory."""
        found = super().forces(gas, acc, vel, u, pressure)
        del self.both, self.cells, self.lists, self.found, self.met
        self.columns = self.columns[:0].copy()
        return found

    def around(self, points: Points) -> Around:
        """Return own particles and ghosts, for a halo of `room` times the largest support."""
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
        return Around(wide, h, mass, cells._replace(filled=mine))

    def outgrown(self, own: Array) -> Array:
        """Return the outgrown cells: those with own particles, `own`, and those that only ghosts outgrew."""
        cells, ghosts = self.cells, self.cells.order[self.ghosts]
        beyond = self.support * self.found.h[ghosts] > cells.radius[self.ghosts]
        self.left = own
        return np.union1d(own, cells.key[ghosts[beyond]])

    def meets_all(self, outgrown: Array) -> bool:
        """Return whether the halo has all that own outgrown cells reach.

        Each rank tests its own cells. Cells that reach only cells without ghosts may be wider than the halo.
        """
        some = self.left[~cells_within_halo(self.left, self.cells, self.alone)]
        self.needed = max(self.needed, world.processes.most(self._widest(some)))
        return self.needed <= self.room

    def _widest(self, some: Array) -> float:
        """Return the largest support in the cells `some` over the former largest one in their grids."""
        if len(some) == 0:
            return 0.0
        level = np.searchsorted(self.grids.table[:, FIRST], some, side="right") - 1
        return float((self.cells.bounds[some, 4] / self.grids.table[level, REACH]).max())
