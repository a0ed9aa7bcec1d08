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
def mark_cells(first, last, filled, grids, away, others, reach_of, room, flat, periodic, out):
    """Mark in `out` (cells,) the cells of the grids `others`, whose lower corner is `away` (2,) from that of `grids`,
    that may hold anybody within reach of the cells `filled` of these; `flat` in one dimension.

    reach_of: whose reach counts: THEIRS, of the others; OWN, of those in `filled`; EITHER. Supports are at most `room`
    times the largest in the grid of each.
    """
    for c in range(first, last):
        cell, mine = filled[c], 0
        for level in range(len(grids)):
            if grids[level, FIRST] <= cell:
                mine = level
        place, rows = cell - int(grids[mine, FIRST]), int(grids[mine, NX + 1])
        ix, iy = place // rows + int(grids[mine, FROM_X]), place % rows + int(grids[mine, FROM_X + 1])
        for level in range(len(others)):
            reach = 0.0
            if reach_of != THEIRS:
                reach = room * grids[mine, REACH]
            if reach_of != OWN:
                reach = max(reach, room * others[level, REACH])
            x0, x1 = _span(ix, grids[mine, SIDE_X], away[0], others[level, SIDE_X], reach)
            y0, y1 = (0, 0) if flat else _span(iy, grids[mine, SIDE_X + 1], away[1], others[level, SIDE_X + 1], reach)
            _mark(x0, x1, y0, y1, others[level], periodic, out)


@njit(nogil=True, cache=True, error_model="numpy")
def _mark(x0, x1, y0, y1, grid, periodic, out):
    # Cells x0 to x1 and y0 to y1 of the whole of a grid, those that its part has.
    begin, nx, ny, all_x, all_y = (
        int(grid[FIRST]),
        int(grid[NX]),
        int(grid[NX + 1]),
        int(grid[ALL_X]),
        int(grid[ALL_X + 1]),
    )
    from_x, from_y = int(grid[FROM_X]), int(grid[FROM_X + 1])
    if periodic:
        x1, y1 = min(x1, x0 + all_x - 1), min(y1, y0 + all_y - 1)
    else:
        x0, x1, y0, y1 = max(x0, from_x), min(x1, from_x + nx - 1), max(y0, from_y), min(y1, from_y + ny - 1)
    for jx in range(x0, x1 + 1):
        kx = jx % all_x - from_x
        for jy in range(y0, y1 + 1):
            ky = jy % all_y - from_y
            if 0 <= kx < nx and 0 <= ky < ny:
                out[begin + kx * ny + ky] = True


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


@njit(nogil=True, cache=True, error_model="numpy")
def near_others(first, last, pos, origin, inverse, periodic, tiles, owner, rank, out):
    """Mark in `out` (n,) the particles of whose nodes about them any has another `owner` than `rank`: that of its tile
    (along x, along y), which is that of `tiles`, (nx,) and (ny,).
    """
    (at_x, at_y), plane = tiles, pos.shape[1] == 2
    nx, ny = len(at_x), len(at_y)
    for p in range(first, last):
        ix, jx, _ = stencil(pos[p, 0], origin[0], inverse, nx, periodic)
        iy, jy = 0, 0
        if plane:
            iy, jy, _ = stencil(pos[p, 1], origin[1], inverse, ny, periodic)
        out[p] = False
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
