"""Neighbour search by cells, with `kernels/common/neighbours.py` and `kernels/common/candidates.py`.

Particles are sorted into size classes by their support radius, `extent` times h. Each class has its own grid of cells.
The candidate list of a cell has all particles that may be neighbours of any particle in the cell; kernels then test
the distance of each pair. The reach of a class, of its grid and of its cells is the largest support radius in it.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from discsim.kernels.common import neighbours as kernels
from discsim.kernels.common.candidates import LANES, list_candidates
from discsim.kernels.common.neighbours import (
    ALL_X,
    CELL_OVER_REACH,
    FIRST,
    FROM_X,
    MAX_CLASSES,
    NX,
    REACH,
    SIDE_X,
    Cells,
)
from discsim.numerics import world
from discsim.numerics.sorting import counting_sort
from discsim.numerics.threads import parallel_for
from discsim.numerics.world import SerialComm

Array = np.ndarray
SERIAL = SerialComm()
LEAST = 64  # least number of cells in a chunk


class Grids(NamedTuple):
    """Grids of particles, one grid for each size class, or parts of such grids, which `near` returns.

    table (grids, 10): one row per grid, with the columns FIRST, NX, ... of `kernels/common/neighbours.py`. cells: total
    number of cells. edges (MAX_CLASSES,): upper limit of the support radius in each class. extent: support radius over
    h. low, width (2,): lower corner and widths of the box.
    """

    table: Array
    cells: int
    edges: Array
    extent: float
    low: Array
    width: Array
    periodic: bool

    def near(self, low: Array, high: Array, reach: Array) -> Grids:
        """Return the parts of the grids with all cells near the box from `low` (2,) to `high` (2,).

        reach (grids,): for each grid, the largest distance from the box at which cells are included. If a part
        crosses an edge of periodic space, the part is extended to the whole grid along that axis.
        """
        table = self.table.copy()
        for row, length in zip(table, reach, strict=True):
            for axis in range(2):
                count, away = int(row[ALL_X + axis]), self.low[axis] + length * np.array([1.0, -1.0])
                ends = (np.array([low[axis], high[axis]]) - away) / row[SIDE_X + axis]
                is_box = np.isfinite(ends).all() and ends[0] <= ends[1]  # NaN is reported by the next kick
                first, last = (math.floor(ends[0]) - 1, math.floor(ends[1]) + 1) if is_box else (0, 0)
                if self.periodic and (first < 0 or last >= count):
                    first, last = 0, count - 1
                row[FROM_X + axis] = first = min(max(first, 0), count - 1)
                row[NX + axis] = min(max(last, first), count - 1) - first + 1
        held = table[:, NX] * table[:, NX + 1]
        table[:, FIRST] = np.cumsum(held) - held
        return self._replace(table=table, cells=int(held.sum()))

    def indices_in_whole(self) -> Array:
        """Return, for each cell of these parts of grids, its index (cells,) in the whole grids."""
        found, first = [], 0
        columns = [NX, NX + 1, FROM_X, FROM_X + 1, ALL_X, ALL_X + 1]
        for nx, ny, from_x, from_y, all_x, all_y in self.table[:, columns].astype(np.int64):
            found.append(first + ((from_x + np.arange(nx))[:, None] * all_y + from_y + np.arange(ny)).ravel())
            first += all_x * all_y
        return np.concatenate(found)


def box_about(pos: Array, comm: Any = SERIAL) -> tuple[Array, Array]:
    """Return lower corner and widths (2,) of the bounding box of positions `pos` (n, d); in 1D the second width is 0.

    comm: communication of the processes whose particles are in the box (`numerics/world.py`).
    """
    least, most = comm.corners(pos, corners)
    low, width = comm.min(least), comm.max(most)
    width -= low
    width[0] = max(width[0], 1e-300)
    return low, width


def corners(pos: Array) -> tuple[Array, Array]:
    """Return the smallest and the largest coordinates, (2,) each, of positions `pos` (n, d); in 1D y is 0."""
    low, high = np.zeros(2), np.zeros(2)
    low[: pos.shape[1]], high[: pos.shape[1]] = _column_extremes(pos)
    return low, high


def corners_of_cells(grids: Grids, classes: Array, pos: Array) -> tuple[Array, Array]:
    """Return the lower and the upper corner, (2,) each, of a box that encloses all cells with local particles.

    classes (n,), pos (n, d): size class and position of each local particle.
    """
    low, high = world.processes.corners(pos, corners)
    held = [k for k in range(len(grids.table)) if np.any(classes == k)]
    side = grids.table[held, SIDE_X : SIDE_X + 2].max(axis=0, initial=0.0)
    return low - side, high + side


def sort_into_cells(pos: Array, h: Array, extent: float, low: Array, width: Array, periodic: bool) -> Cells:
    """Return cells with particles at positions `pos` (n, d) with smoothing lengths `h` (n,).

    extent: support radius over h. low, width (2,): lower corner and widths of the box; in 1D width[1] is 0.
    """
    return cells_in(*grids_of(pos, h, extent, low, width, periodic), pos, h)


def grids_of(
    pos: Array, h: Array, extent: float, low: Array, width: Array, periodic: bool, comm: Any = SERIAL,
    stretch: float = 1.0,
) -> tuple[Grids, Array]:  # fmt: skip
    """Return grids for particles, and the size class (n,) of each local particle.

    pos, h, extent, low, width: as in `sort_into_cells`. comm: communication of the processes that share the grids
    (`numerics/world.py`). stretch: factor by which cells are longer along x and shorter along y.
    """
    smallest, largest = _column_extremes(h[:, None])
    least, most = (extent * float(h[0]) for h in (comm.min(smallest), comm.max(largest)))
    edges = (1.0 + 1e-12) * max(2.0 * least, most * 2.0 ** (1 - MAX_CLASSES)) * 2.0 ** np.arange(MAX_CLASSES)
    classes = np.empty(len(pos), np.uint8)
    found = np.array(parallel_for(kernels.size_classes, len(pos), h, extent, edges, classes, light=True))
    members, reach = comm.sum(found[:, 0].sum(axis=0)), comm.max(found[:, 1].max(axis=0))
    table, count = _lay_grids(members, reach, width, periodic, stretch)
    return Grids(table, count, edges, extent, low, width, periodic), classes


def keys_in(grids: Grids, classes: Array, pos: Array) -> Array:
    """Return the cell index (n,) of particles with size classes `classes` (n,) and positions `pos` (n, d)."""
    key = np.empty(len(pos), np.uint32)
    per_side = 1.0 / grids.table[:, SIDE_X : SIDE_X + 2]
    parallel_for(kernels.cell_keys, len(pos), pos, classes, grids.table, per_side, grids.low, key, light=True)
    return key


def cells_in(
    grids: Grids, classes: Array, pos: Array, h: Array, global_index: Array | None = None, key: Array | None = None
) -> Cells:
    """Return the cells of `grids` with particles.

    classes, pos, h: size class (n,), position (n, d) and smoothing length (n,) of each particle. global_index (n,):
    sort keys of particles within a cell; None: the order of the arrays. key (n,): result of `keys_in`, if known.
    """
    key = keys_in(grids, classes, pos) if key is None else key
    order, start = counting_sort(key, grids.cells, global_index)
    x, y, radius = in_order = np.empty((3, len(pos) + LANES))  # padded for loops over whole vectors
    in_order[:, len(pos) :] = 0.0
    bounds = np.empty((grids.cells, 5))
    parallel_for(kernels.copy_in_cell_order, grids.cells, pos, h, grids.extent, order, start, x, y, radius, bounds)
    filled = np.flatnonzero(np.diff(start))
    table = grids.table.copy()  # `update_radii` changes the table of these cells
    return Cells(filled, key, table, order, start, x, y, radius, bounds, grids.low, grids.width, grids.periodic)


def candidates(points: Cells, among: Cells, mutual: bool, extent: float = 1.0, in_slabs: bool = False) -> list[Any]:
    """Return candidate lists of the cells of `points`, an entry for each chunk of `parallel_for`.

    The candidates of a cell are the particles of `among` within `extent` times the reach of the cell. mutual: whether
    particles whose own support reaches the cell are candidates too. in_slabs: whether to sort candidates by slabs along
    x, in which kernels search for neighbours.
    """
    given = points.filled, points.bounds, extent, mutual, in_slabs, among
    return parallel_for(list_candidates, len(points.filled), *given, least=LEAST)


def _column_extremes(values: Array) -> tuple[Array, Array]:
    """Return the smallest and the largest value in each column of `values` (n, columns), ignoring NaN."""
    found = np.array(parallel_for(kernels.extremes, len(values), np.ascontiguousarray(values), light=True))
    return found[:, 0].min(axis=0), found[:, 1].max(axis=0)


def _lay_grids(members: Array, reach: Array, width: Array, periodic: bool, stretch: float) -> tuple[Array, int]:
    """Return the table of `Grids` for a box with these widths (2,), and the total number of cells.

    members, reach (classes,): number of particles and largest support radius of each class. stretch: as in `grids_of`.
    The number of cells per particle is bounded.
    """
    count = int(np.flatnonzero(members)[-1]) + 1
    grids = np.zeros((count, 10))
    grids[:, REACH] = reach[:count]
    sides = width.tolist()  # floats of Python overflow without a warning
    first = 0
    for k, (held, widest) in enumerate(zip(members[:count].tolist(), reach[:count].tolist(), strict=True)):
        # A class may be empty if h jumps: it then has one empty cell.
        side = CELL_OVER_REACH * widest if held > 0 else max(sides)
        most = 16.0 * held + 64.0
        # For few particles far apart, coarser cells avoid a large array of empty ones.
        if (sides[0] / side + 1.0) * (sides[1] / side + 1.0) > most:
            area = max(sides[0], side) * max(sides[1], side)
            side = max(side, math.sqrt(area / most), sides[0] / most, sides[1] / most)
        grids[k, FIRST] = first
        for axis, own in enumerate((side * stretch, side / stretch)):
            along = sides[axis] / own
            n = math.floor(along) if along >= 1.0 else 1  # NaN positions too; the next kick reports them
            grids[k, NX + axis] = grids[k, ALL_X + axis] = n
            grids[k, SIDE_X + axis] = max(sides[axis] / n, 1e-300) if periodic or n > 1 else max(sides[axis], own)
        first += int(grids[k, NX] * grids[k, NX + 1])
    return grids, first
