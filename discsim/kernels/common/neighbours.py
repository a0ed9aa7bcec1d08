"""Neighbour search on cell-sorted grids, one grid for each size class of support radii.

Particles whose support radius R lies in (s/2, s] share a grid with cells of side >= CELL_OVER_REACH s. Strongly
varying smoothing lengths therefore never make a cell with many small particles search far. The surroundings of a cell
are searched on every grid, column by column: the cells of a column are adjacent in memory, and so are their
particles. On periodic axes the search covers every image of the box within reach.
"""

from typing import NamedTuple

import numpy as np

from discsim.jit.decorators import inline_jit, jit
from discsim.jit.index import index

# Columns of the table of grids: first cell, cells along x and y, side of a cell along x and y, largest R in the grid. A
# table may hold only the part of a grid near some of the particles: FROM_X and FROM_Y are the first column and row of
# the part in the whole grid, ALL_X and ALL_Y the numbers of columns and rows of the whole grid.
FIRST, NX, NY, SIDE_X, SIDE_Y, REACH, FROM_X, FROM_Y, ALL_X, ALL_Y = range(10)
MAX_CLASSES = 24
WIDE = index(32)  # accumulators: four independent vectors overlap their latencies
LANES = 8  # candidates are padded with massless ones to whole vectors: loop remainders are slow

# Side of a cell over the largest support radius: smaller cells waste fewer pairs, larger ones share packing more.
CELL_OVER_REACH = 1.0


class Cells(NamedTuple):
    """Particles sorted by cell. `x`, `y` and `radius` are in cell order: index k holds particle `order[k]`."""

    filled: np.ndarray  # cells that hold particles
    key: np.ndarray  # cell of each particle
    grids: np.ndarray
    order: np.ndarray
    start: np.ndarray  # index in `order` at which each cell begins
    x: np.ndarray
    y: np.ndarray
    radius: np.ndarray
    bounds: np.ndarray  # centre and half widths of each cell's tight box, largest support radius (cells, 5)
    low: np.ndarray
    width: np.ndarray
    periodic: bool


@jit
def extremes(first, last, values):
    """Return the least and largest values (2, columns) of one or two columns of `values` (n, columns), ignoring NaN."""
    columns, some = values.shape[1], values[first:last].reshape(-1)
    out, least, most = np.empty((2, columns)), np.full(WIDE, np.inf), np.full(WIDE, -np.inf)  # of every WIDE-th entry
    count = index(len(some))
    whole = count // WIDE * WIDE
    for begin in range(index(0), count, WIDE):
        for k in range(WIDE if begin < whole else count - whole):
            value = some[begin + k]
            least[k], most[k] = value if value < least[k] else least[k], value if value > most[k] else most[k]
    for column in range(columns):
        out[0, column], out[1, column] = np.inf, -np.inf
        for k in range(column, np.int64(WIDE), columns):
            out[0, column], out[1, column] = min(out[0, column], least[k]), max(out[1, column], most[k])
    return out


@jit
def size_classes(first, last, h, extent, edges, out):
    """Write the size class of each support radius, `extent` times h, to `out` (n,).

    `edges` (MAX_CLASSES,) are the largest radii of the classes. Returns (2, MAX_CLASSES): the number of particles in
    each class, and its largest radius.
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
    """Write the cell of each particle to `out` (n,); per_side (grids, 2): cells per length along x and y."""
    for i in range(index(first), index(last)):
        g = classes[i]
        x, y = (pos[i, 0] - low[0]) * per_side[g, 0] - grids[g, FROM_X], 0.0
        if pos.shape[1] == 2:
            y = (pos[i, 1] - low[1]) * per_side[g, 1] - grids[g, FROM_Y]
        x = min(x if x > 0.0 else 0.0, grids[g, NX] - 1.0)  # 0 also for NaN
        y = min(y if y > 0.0 else 0.0, grids[g, NY] - 1.0)
        out[i] = int(grids[g, FIRST]) + int(x) * int(grids[g, NY]) + int(y)


@jit
def lay_out(first, last, pos, h, extent, order, start, x, y, radius, bounds):
    """Write positions and support radii in cell order, and the bounds of each cell."""
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
def widen(some, extent, h, cells):
    """Set the support radii of the particles in the cells `some` to `extent` h (n,), in place."""
    for cell in some:
        reach = 0.0
        for k in range(cells.start[cell], cells.start[cell + 1]):
            cells.radius[k] = extent * h[cells.order[k]]
            reach = max(reach, cells.radius[k])
        cells.bounds[cell, 4] = reach
        for level in range(len(cells.grids)):
            if cells.grids[level, FIRST] <= cell:
                mine = level
        cells.grids[mine, REACH] = max(cells.grids[mine, REACH], reach)


@inline_jit
def whole(n):
    """Return the number n of candidates, rounded up to whole vectors."""
    return (n + LANES - 1) & -LANES
