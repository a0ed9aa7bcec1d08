"""Neighbour search on cell-sorted grids, one grid for each size class of support radii.

Particles whose support radius R lies in (s/2, s] share a grid with cells of side >= CELL_OVER_REACH s. The cells of
particles with small R are therefore not searched to the distance of the largest R of all particles. The surroundings
of a cell are searched on every grid, column by column: the cells of a column are adjacent in memory, and so are
their particles. On periodic axes the search covers every image of the box within reach.
"""

from typing import NamedTuple

import numpy as np

from discsim.jit.decorators import jit
from discsim.jit.index import index

# Columns of the table of grids: first cell; numbers of cells along x and y; sides of a cell along x and y; largest R in
# the grid. The table may have only a part of each grid. FROM_X and FROM_Y are then the first column and row of the part
# in the whole grid; ALL_X and ALL_Y are the numbers of columns and rows of the whole grid.
FIRST, NX, NY, SIDE_X, SIDE_Y, REACH, FROM_X, FROM_Y, ALL_X, ALL_Y = range(10)
MAX_CLASSES = 24
ACCUMULATORS = index(32)  # partial results of a loop: four independent vectors overlap their latencies

# Side of a cell over the largest support radius. Sums of smaller cells have fewer pairs beyond the support; those of
# larger cells pack the same candidate for more particles.
CELL_OVER_REACH = 1.0


class Cells(NamedTuple):
    """Particles sorted by neighbour cell. In arrays in cell order, entry k belongs to particle order[k]."""

    filled: np.ndarray  # indices of the cells that hold particles
    key: np.ndarray  # (n,): cell of each particle
    grids: np.ndarray  # (grids, 10): table of the grids
    order: np.ndarray  # (n,): indices of the particles, sorted by cell
    start: np.ndarray  # (cells + 1,): where each cell begins in `order`
    x: np.ndarray  # (n,): positions in cell order
    y: np.ndarray
    radius: np.ndarray  # (n,): support radii in cell order
    bounds: np.ndarray  # (cells, 5): centre and half widths of the box around its particles, largest support radius
    low: np.ndarray  # (2,): lower corner of the box that the grids cover
    width: np.ndarray  # (2,): size of this box; width[1] is 0 in 1D
    periodic: bool


@jit
def extremes(first, last, values):
    """Return the least and the largest entry (2, columns) of each column in the rows `first` to `last` of `values`.

    `values` has one or two columns. NaN is ignored.
    """
    columns, flat = values.shape[1], values[first:last].reshape(-1)
    out = np.empty((2, columns))
    least, most = np.full(ACCUMULATORS, np.inf), np.full(ACCUMULATORS, -np.inf)  # of every 32nd number of `flat`
    count = index(len(flat))
    whole = count // ACCUMULATORS * ACCUMULATORS
    for begin in range(index(0), count, ACCUMULATORS):
        for k in range(ACCUMULATORS if begin < whole else count - whole):
            value = flat[begin + k]
            least[k], most[k] = value if value < least[k] else least[k], value if value > most[k] else most[k]
    for column in range(columns):
        out[0, column], out[1, column] = np.inf, -np.inf
        for k in range(column, np.int64(ACCUMULATORS), columns):
            out[0, column], out[1, column] = min(out[0, column], least[k]), max(out[1, column], most[k])
    return out


@jit
def size_classes(first, last, h, extent, edges, out):
    """Write to `out` (n,) the size class of each particle, by its support radius, `extent` times `h` (n,).

    edges (MAX_CLASSES,): upper limits of the radii of the classes. Returns (2, MAX_CLASSES): the number of particles in
    each class, and their largest radius.
    """
    found = np.zeros((2, MAX_CLASSES))
    for i in range(index(first), index(last)):
        radius, k = extent * h[i], 0
        while radius > edges[k] and k < MAX_CLASSES - 1:
            k += 1
        out[i] = k
        found[0, k] += 1.0
        found[1, k] = max(found[1, k], radius)
    return found


@jit
def cell_keys(first, last, pos, classes, grids, per_side, low, out):
    """Write the cell of each particle to `out` (n,), by its position and its size class in `classes` (n,).

    grids: table of the grids, as in `Cells`. per_side (grids, 2): cells per unit length along x and y.
    """
    for i in range(index(first), index(last)):
        g = classes[i]
        x, y = (pos[i, 0] - low[0]) * per_side[g, 0] - grids[g, FROM_X], 0.0
        if pos.shape[1] == 2:
            y = (pos[i, 1] - low[1]) * per_side[g, 1] - grids[g, FROM_Y]
        x = min(x if x > 0.0 else 0.0, grids[g, NX] - 1.0)  # 0 also for NaN
        y = min(y if y > 0.0 else 0.0, grids[g, NY] - 1.0)
        out[i] = int(grids[g, FIRST]) + int(x) * int(grids[g, NY]) + int(y)


@jit
def copy_in_cell_order(first, last, pos, h, extent, order, start, x, y, radius, bounds):
    """Write `x`, `y`, `radius` and `bounds` of `Cells` for the cells `first` to `last`.

    The support radius of a particle is `extent` times `h` (n,).
    """
    dim = pos.shape[1]
    for c in range(first, last):
        x0, x1, y0, y1, reach = np.inf, -np.inf, np.inf, -np.inf, 0.0
        for k in range(index(start[c]), index(start[c + 1])):
            i = order[k]
            x[k], y[k], radius[k] = pos[i, 0], pos[i, 1] if dim == 2 else 0.0, extent * h[i]
            x0, x1 = min(x0, x[k]), max(x1, x[k])
            y0, y1 = min(y0, y[k]), max(y1, y[k])
            reach = max(reach, radius[k])
        bounds[c, 0], bounds[c, 1] = 0.5 * (x0 + x1), 0.5 * (y0 + y1)
        bounds[c, 2], bounds[c, 3], bounds[c, 4] = 0.5 * (x1 - x0), 0.5 * (y1 - y0), reach


@jit
def update_radii(indices, extent, h, cells):
    """Set the support radii of the particles in some `cells` to `extent` times `h` (n,).

    indices: the cells to change. Changed in place: `radius`, `bounds` and `grids` of `cells`.
    """
    for cell in indices:
        reach = 0.0
        for k in range(cells.start[cell], cells.start[cell + 1]):
            cells.radius[k] = extent * h[cells.order[k]]
            reach = max(reach, cells.radius[k])
        cells.bounds[cell, 4] = reach
        for level in range(len(cells.grids)):
            if cells.grids[level, FIRST] <= cell:
                grid = level
        cells.grids[grid, REACH] = max(cells.grids[grid, REACH], reach)
