"""SPH sums on several ranks: the sums of `numerics/sph.py`, for the cells that contain local particles.

The grids of neighbour cells (box, size classes, sides) are the same on every rank. Each rank has only the cells near
its local particles, and fetches ghosts in all cells within reach of local particles (`kernels/mpi/halo.py`). It
fetches whole cells, so that candidate lists are the same as on one rank. After each density pass it fetches the h of
ghosts from their owners, and after the last pass all data that forces need. If an h becomes too large for the halo,
the density is computed again with a wider halo, which is kept for the next steps.
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
from discsim.numerics.world import NeededCells
from discsim.ranks.comm import Comm
from discsim.ranks.exchange import REMEMBERED_STEPS, FetchedGhosts, exchange_requests, route_to_requesters
from discsim.scene import Scene

Array = np.ndarray
HALO = 1.35  # smallest width of the halo over the largest support of a class: outgrown cells search to 1.2 h
HALO_MARGIN = 1.1  # factor by which the halo is wider than needed


class DividedSph(Sph):
    """`Sph` of one rank of several.

    halo: width of the halo over the largest support of a size class.
    """

    def __init__(self, scene: Scene, comm: Comm):
        super().__init__(scene)
        self.comm, self.halo = comm, HALO
        self._needed_halo = 0.0  # width of the halo that this density pass needs
        self._recent_halos = deque[float](maxlen=REMEMBERED_STEPS)  # widths needed in recent steps
        self._ghosts = np.empty(0, np.int64)  # indices of ghosts in cell order
        self._without_ghosts = np.empty(0, bool)  # (cells,): whether a cell is in the halo and has no ghosts
        self._outgrown_locally = np.empty(0, np.int64)  # cells that their local particles have outgrown

    def find_h_and_density(self, gas: Points, vel: Array, h_least: float) -> bool:
        start, self._needed_halo = gas.h.copy(), 0.0
        while not super().find_h_and_density(gas, vel, h_least):
            gas.h[:], self.halo = start, HALO_MARGIN * self._needed_halo
        self._recent_halos.append(self._needed_halo)
        self.halo = max(HALO, HALO_MARGIN * max(self._recent_halos))
        return True

    def forces(self, gas: Gas, acc: Array, vel: Array, u: Array | None, pressure: Array) -> float:
        """Compute forces as `Sph.forces`, and free the neighbour data: a kick needs the memory."""
        found = super().forces(gas, acc, vel, u, pressure)
        del self.both, self.cells, self.lists, self.found, self.marked
        self.columns = self.columns[:0].copy()
        return found

    def with_ghosts(self, points: Points) -> PointsWithGhosts:
        """Return local particles combined with ghosts, in a halo of `halo` times the largest support. Collective."""
        grids, classes = self.grids_of(points)
        held = [k for k in range(len(grids.table)) if np.any(classes == k)]
        reach = np.maximum(grids.table[:, REACH], grids.table[held, REACH].max(initial=0.0))
        grids = self.grids = grids.near(*corners_of_cells(grids, classes, points.pos), self.halo * reach)
        key = keys_in(grids, classes, points.pos)
        filled, table = np.zeros(grids.cells, bool), grids.table
        filled[key] = True
        mine = np.flatnonzero(filled)
        needed = mark_cells(mine, table, np.zeros(2), table, EITHER, self.halo, self.dim == 1, self.periodic)
        numbers = grids.indices_in_whole()
        requests = exchange_requests(self.comm, NeededCells(needed, numbers, numbers + 1))
        both = FetchedGhosts(points, route_to_requesters(self.comm, key, requests))
        pos, h, mass, classes = both.all_with_ghosts([points.pos, points.h, points.mass, classes])
        key = np.concatenate([key, keys_in(grids, classes[points.count :], pos[points.count :])])
        cells = cells_in(grids, classes, pos, h, both.global_index, key)
        self._ghosts = np.flatnonzero(cells.order >= points.count)
        self._without_ghosts = needed
        self._without_ghosts[cells.key[cells.order[self._ghosts]]] = False
        return PointsWithGhosts(both, h, mass, cells._replace(filled=mine))

    def outgrown_cells(self, own: Array) -> Array:
        """Return all outgrown cells, in which the support of a particle has become larger than allowed for the cell.

        own: cells that local particles have outgrown; cells that ghosts have outgrown are added.
        """
        cells, ghosts = self.cells, self.cells.order[self._ghosts]
        beyond = self.support * self.found.h[ghosts] > cells.radius[self._ghosts]
        self._outgrown_locally = own
        return np.union1d(own, cells.key[ghosts[beyond]])

    def halo_suffices(self, outgrown: Array) -> bool:
        """Return whether the halo contains all particles within reach of outgrown cells, on all ranks. Collective.

        Each rank tests the cells that its local particles have outgrown. A cell needs no test if all cells that it
        reaches are in the halo and have no ghosts.
        """
        some = self._outgrown_locally
        some = some[~cells_within_halo(some, self.cells, self._without_ghosts)]
        # Reach of each cell over the largest support in its grid before.
        level = np.searchsorted(self.grids.table[:, FIRST], some, side="right") - 1
        growth = (self.cells.bounds[some, 4] / self.grids.table[level, REACH]).max(initial=0.0)
        self._needed_halo = max(self._needed_halo, world.processes.max(float(growth)))
        return self._needed_halo <= self.halo
