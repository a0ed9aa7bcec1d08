"""What a rank of several needs of others: cells of neighbours and blocks of drag that sums over own particles look at,
and particles that give mass to other ranks' nodes of the grid.
"""

import math

import numpy as np
from numba import njit

from discsim.kernels.grid import stencil
from discsim.kernels.neighbours import ALL_X, FIRST, FROM_X, NX, REACH, SIDE_X

THEIRS, OWN, EITHER = range(3)
EDGE = 1e-6  # of a cell, beyond which rounding puts nobody


@njit(nogil=True, cache=True, error_model="numpy")
def mark_cells(filled, grids, away, others, reach_of, room, flat, periodic):
    """The cells (cells,) of the grids `others`, whose lower corner is `away` (2,) from that of `grids`, that may hold
    anybody within reach of the cells `filled` of these; `flat` in one dimension.

    reach_of: whose reach counts: THEIRS, of the others; OWN, of those in `filled`; EITHER. Supports are at most `room`
    times the largest in the grid of each.
    """
    last = others[-1]
    out = np.zeros(int(last[FIRST] + last[NX] * last[NX + 1]), np.bool_)
    for level in range(len(others)):
        other, nx, ny = others[level], int(others[level, NX]), int(others[level, NX + 1])
        corners = np.zeros((nx + 1, ny + 1), np.int32)  # of the boxes that are marked, which are summed up
        mine = 0
        for cell in filled:
            while mine + 1 < len(grids) and grids[mine + 1, FIRST] <= cell:
                mine += 1
            place, rows = cell - int(grids[mine, FIRST]), int(grids[mine, NX + 1])
            ix, iy = place // rows + int(grids[mine, FROM_X]), place % rows + int(grids[mine, FROM_X + 1])
            reach = 0.0
            if reach_of != THEIRS:
                reach = room * grids[mine, REACH]
            if reach_of != OWN:
                reach = max(reach, room * other[REACH])
            x0, x1 = _span(ix, grids[mine, SIDE_X], away[0], other[SIDE_X], reach)
            y0, y1 = (0, 0) if flat else _span(iy, grids[mine, SIDE_X + 1], away[1], other[SIDE_X + 1], reach)
            _mark(x0, x1, y0, y1, other, periodic, corners)
        _sum_up(corners, int(other[FIRST]), out)
    return out


@njit(nogil=True, cache=True, error_model="numpy")
def _sum_up(corners, begin, out):
    nx, ny = corners.shape[0] - 1, corners.shape[1] - 1
    for i in range(nx):
        along = 0
        for j in range(ny):
            along += corners[i, j]
            corners[i, j] = along + (corners[i - 1, j] if i > 0 else 0)
            out[begin + i * ny + j] = corners[i, j] > 0


@njit(nogil=True, cache=True, error_model="numpy")
def _mark(x0, x1, y0, y1, grid, periodic, corners):
    # Cells x0 to x1 and y0 to y1 of the whole of a grid, those that its part has: in each turn of a periodic box.
    nx, ny, all_x, all_y = int(grid[NX]), int(grid[NX + 1]), int(grid[ALL_X]), int(grid[ALL_X + 1])
    from_x, from_y, turns = int(grid[FROM_X]), int(grid[FROM_X + 1]), 1 if periodic else 0
    if periodic:
        x1, y1 = min(x1, x0 + all_x - 1), min(y1, y0 + all_y - 1)
    for tx in range(turns * (x0 // all_x), turns * (x1 // all_x) + 1):
        for ty in range(turns * (y0 // all_y), turns * (y1 // all_y) + 1):
            left, right = max(x0 - tx * all_x - from_x, 0), min(x1 - tx * all_x - from_x, nx - 1) + 1
            low, high = max(y0 - ty * all_y - from_y, 0), min(y1 - ty * all_y - from_y, ny - 1) + 1
            if left < right and low < high:
                corners[left, low] += 1
                corners[right, low] -= 1
                corners[left, high] -= 1
                corners[right, high] += 1


@njit(nogil=True, cache=True, error_model="numpy")
def _span(i, side, away, per, reach):
    # Cells of side `per` along an axis, the first of them `away`, within reach of the i-th of a `side`.
    low, high = (i - EDGE) * side - away - reach, (i + 1 + EDGE) * side - away + reach
    return math.floor(low / per), math.floor(high / per)


@njit(nogil=True, cache=True, error_model="numpy")
def mark_blocks(own, home, about, near, rings, out):
    """Mark in `out` (blocks,) those that the nodes about the blocks `own` hang on, `rings` of nodes beyond these.
    `home`, `about` and `near` as `kernels/levels.py` has them.
    """
    marked = np.zeros(len(about), np.bool_)
    for block in own:
        marked[home[block]] = True
    for _ in range(rings + 1):
        before = marked.copy()
        for node in range(len(about)):
            if before[node]:
                for k in range(9):
                    if about[node, k] >= 0:
                        marked[about[node, k]] = True
    for node in range(len(about)):
        if marked[node]:
            for k in range(9):
                if near[node, k] >= 0:
                    out[near[node, k]] = True


@njit(nogil=True, cache=True, error_model="numpy", inline="always")
def _tile_of(pos, i, tiles):
    low, per_tile, along = tiles
    tile = 0
    for k in range(pos.shape[1]):
        at = (pos[i, k] - low[k]) * per_tile
        tile = tile * along + (int(min(at, along - 1.0)) if at > 0.0 else 0)  # also of what is no number
    return tile


@njit(nogil=True, cache=True, error_model="numpy")
def tiles_of(first, last, pos, tiles, out):
    """The tile (n,) of each place (n, d), or the nearest: `tiles` begin at `low`, are 1 / `per_tile` wide, and `along`
    many along each axis.
    """
    for i in range(first, last):
        out[i] = _tile_of(pos, i, tiles)


@njit(nogil=True, cache=True, error_model="numpy")
def near_others(first, last, pos, origin, inverse, periodic, at, owner, rank, tiles, inside, out):
    """Mark in `out` (n,) the particles of whose nodes about them any has another `owner` than `rank`: that of its tile
    (along x, along y), which is that of `at`, (nx,) and (ny,). Those in tiles that are `inside` (tiles,) have none.
    """
    (at_x, at_y), plane = at, pos.shape[1] == 2
    nx, ny = len(at_x), len(at_y)
    for p in range(first, last):
        out[p] = False
        if inside[_tile_of(pos, p, tiles)]:
            continue
        ix, jx, _ = stencil(pos[p, 0], origin[0], inverse, nx, periodic)
        iy, jy = 0, 0
        if plane:
            iy, jy, _ = stencil(pos[p, 1], origin[1], inverse, ny, periodic)
        if ix >= 0 and iy >= 0:
            ix, jx, iy, jy = at_x[ix], at_x[jx], at_y[iy], at_y[jy]
            same = owner[ix, iy] == rank and owner[jx, iy] == rank
            out[p] = not (same and owner[ix, jy] == rank and owner[jx, jy] == rank)


@njit(nogil=True, cache=True, error_model="numpy")
def owners_about(some, pos, origin, inverse, periodic, tiles, owner, out):
    """Mark in `out` (ranks, some) who owns a node about each of `some` particles, which are on the grid."""
    (at_x, at_y), plane = tiles, pos.shape[1] == 2
    nx, ny = len(at_x), len(at_y)
    for k in range(len(some)):
        p = some[k]
        ix, jx, _ = stencil(pos[p, 0], origin[0], inverse, nx, periodic)
        iy, jy = 0, 0
        if plane:
            iy, jy, _ = stencil(pos[p, 1], origin[1], inverse, ny, periodic)
        ix, jx, iy, jy = at_x[ix], at_x[jx], at_y[iy], at_y[jy]
        out[owner[ix, iy], k] = out[owner[jx, iy], k] = True
        out[owner[ix, jy], k] = out[owner[jx, jy], k] = True
