"""Neighbour search on cell-sorted grids, one grid a size class of support radii.

Particles whose support radius R lies in (s/2, s] share a grid with cells of side >= s, so that strongly varying
smoothing lengths never make a cell with many small particles search far. A search box is looked up on every
grid; on periodic axes cell indices run on past the edge and the images' shift follows from them, so images need no
special case.
"""

import math

import numpy as np
from numba import njit

from discsim.kernels.grid import counting_sort
from discsim.threads import share

# Columns of the table of grids: first cell, cells along x and y, side of a cell along x and y, largest R held.
FIRST, NX, NY, SIDE_X, SIDE_Y, REACH = range(6)
MAX_CLASSES = 24

# Side of a cell over the largest support radius held: smaller wastes fewer pairs, larger shares more packing.
CELL_OVER_REACH = 1.4


@njit(nogil=True, cache=True, error_model="numpy")
def size_classes(radius):
    """Class of each support radius, in factors of two above the smallest."""
    smallest, largest = np.inf, 0.0
    for r in radius:
        smallest, largest = min(smallest, r), max(largest, r)
    s0 = max(smallest, largest * 2.0 ** (1 - MAX_CLASSES))
    out = np.empty(len(radius), np.int64)
    for i in range(len(radius)):
        out[i] = max(0, math.ceil(math.log2(radius[i] / s0) - 1e-12))
    return out


@njit(nogil=True, cache=True, error_model="numpy")
def lay_grids(radius, classes, low, width, periodic):
    """The table of grids over the box [low, low + width], with at most some cells a particle."""
    count = 1
    for k in classes:
        count = max(count, k + 1)
    grids = np.zeros((count, 6))
    members = np.zeros(count, np.int64)
    for i in range(len(radius)):
        k = classes[i]
        members[k] += 1
        grids[k, REACH] = max(grids[k, REACH], radius[i])
    first = 0
    for k in range(count):
        # A class may be empty where h jumps: then one cell that holds nobody.
        side = CELL_OVER_REACH * grids[k, REACH] if members[k] > 0 else max(width[0], width[1])
        most = 16.0 * members[k] + 64.0
        # Few particles far apart: coarser cells rather than an array of empty ones.
        if (width[0] / side + 1.0) * (width[1] / side + 1.0) > most:
            area = max(width[0], side) * max(width[1], side)
            side = max(side, math.sqrt(area / most), width[0] / most, width[1] / most)
        grids[k, FIRST] = first
        for axis in range(2):
            n = max(1.0, math.floor(width[axis] / side))
            grids[k, NX + axis] = n
            grids[k, SIDE_X + axis] = max(width[axis] / n, 1e-300) if periodic or n > 1.0 else max(width[axis], side)
        first += int(grids[k, NX] * grids[k, NY])
    return grids, first


@njit(nogil=True, cache=True, error_model="numpy")
def cell_keys(first, last, pos, classes, grids, low, out):
    """Write the cell of each particle to `out` (n,)."""
    dim = pos.shape[1]
    for i in range(first, last):
        g = grids[classes[i]]
        ix = min(max(int((pos[i, 0] - low[0]) / g[SIDE_X]), 0), int(g[NX]) - 1)
        iy = 0
        if dim == 2:
            iy = min(max(int((pos[i, 1] - low[1]) / g[SIDE_Y]), 0), int(g[NY]) - 1)
        out[i] = int(g[FIRST]) + ix * int(g[NY]) + iy


@njit(nogil=True, cache=True, error_model="numpy")
def bounds_of(first, last, pos, radius, order, start, out):
    """Write tight box and largest support radius of the particles in each cell: (x0, x1, y0, y1, R)."""
    dim = pos.shape[1]
    for c in range(first, last):
        x0, x1, y0, y1, reach = np.inf, -np.inf, np.inf, -np.inf, 0.0
        for k in range(start[c], start[c + 1]):
            i = order[k]
            x0, x1 = min(x0, pos[i, 0]), max(x1, pos[i, 0])
            y = pos[i, 1] if dim == 2 else 0.0
            y0, y1 = min(y0, y), max(y1, y)
            reach = max(reach, radius[i])
        out[c, 0], out[c, 1], out[c, 2], out[c, 3], out[c, 4] = x0, x1, y0, y1, reach


def cell_bounds(pos, radius, order, start):
    """Tight box and largest support radius of the particles in each cell (cells, 5)."""
    out = np.empty((len(start) - 1, 5))
    share(bounds_of, len(out), pos, radius, order, start, out)
    return out


def sort_into_cells(pos, radius, low, width, periodic):
    """Cells of all particles: (grids, order, start, bounds, filled), with `filled` the cells that hold any.

    `low` and `width` (2,) are the box; in one dimension its second width is 0.
    """
    classes = size_classes(radius)
    grids, count = lay_grids(radius, classes, low, width, periodic)
    key = np.empty(len(pos), np.int64)
    share(cell_keys, len(pos), pos, classes, grids, low, key)
    order, start = counting_sort(key, count)
    bounds = cell_bounds(pos, radius, order, start)
    return grids, order, start, bounds, np.flatnonzero(np.diff(start))


@njit(inline="always")
def gap(a0, a1, b0, b1):
    """Distance between two intervals."""
    return max(0.0, max(b0 - a1, a0 - b1))


@njit(nogil=True, cache=True, error_model="numpy")
def find_candidates(box, reach, mutual, pos, radius, grids, order, start, bounds, low, width, periodic):
    """Particles that may lie within `reach` of a particle in `box` (x0, x1, y0, y1, ...): (index, shifts).

    With `mutual` also those whose own support may reach the box. Shifts are those of periodic images.
    """
    x0, x1, y0, y1 = box[0], box[1], box[2], box[3]
    size = 256
    index = np.empty(size, np.int64)
    shift = np.empty((size, 2))
    found = 0
    for level in range(len(grids)):
        g = grids[level]
        nx, ny = int(g[NX]), int(g[NY])
        r = max(reach, g[REACH]) if mutual else reach
        ix0, ix1 = math.floor((x0 - r - low[0]) / g[SIDE_X]), math.floor((x1 + r - low[0]) / g[SIDE_X])
        iy0, iy1 = 0, 0
        if width[1] > 0.0:
            iy0, iy1 = math.floor((y0 - r - low[1]) / g[SIDE_Y]), math.floor((y1 + r - low[1]) / g[SIDE_Y])
        if not periodic:
            ix0, ix1, iy0, iy1 = max(ix0, 0), min(ix1, nx - 1), max(iy0, 0), min(iy1, ny - 1)
        for ix in range(ix0, ix1 + 1):
            wx = ix % nx if periodic else ix
            sx = (ix - wx) // nx * width[0]
            for iy in range(iy0, iy1 + 1):
                wy = iy % ny if periodic else iy
                sy = (iy - wy) // ny * width[1]
                c = int(g[FIRST]) + wx * ny + wy
                n = start[c + 1] - start[c]
                if n == 0:
                    continue
                near = max(reach, bounds[c, 4]) if mutual else reach
                dx = gap(x0, x1, bounds[c, 0] + sx, bounds[c, 1] + sx)
                dy = gap(y0, y1, bounds[c, 2] + sy, bounds[c, 3] + sy)
                if dx * dx + dy * dy > near * near:
                    continue
                if found + n > size:
                    size = 2 * (found + n)
                    more, more_shift = np.empty(size, np.int64), np.empty((size, 2))
                    for k in range(found):  # a slice's assignment takes seconds to compile
                        more[k] = index[k]
                        more_shift[k, 0], more_shift[k, 1] = shift[k, 0], shift[k, 1]
                    index, shift = more, more_shift
                for k in range(start[c], start[c + 1]):
                    j = order[k]
                    px = pos[j, 0] + sx
                    dx = gap(x0, x1, px, px)
                    dy = 0.0
                    if pos.shape[1] == 2:
                        py = pos[j, 1] + sy
                        dy = gap(y0, y1, py, py)
                    near = max(reach, radius[j]) if mutual else reach
                    if dx * dx + dy * dy <= near * near:
                        index[found] = j
                        shift[found, 0] = sx
                        shift[found, 1] = sy
                        found += 1
    return index[:found], shift[:found]
