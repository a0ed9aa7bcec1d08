"""Halo of an MPI rank: the neighbour cells and drag blocks of other ranks that sums of local particles need."""

import math

import numpy as np
from numba import njit

from discsim.jit.decorators import inline_jit, jit, jit_subroutine
from discsim.jit.index import index
from discsim.kernels.common.filling import MARGIN, ensure_capacity
from discsim.kernels.common.neighbours import ALL_X, ALL_Y, FIRST, FROM_X, FROM_Y, NX, NY, REACH, SIDE_X
from discsim.kernels.common.zcurve import z_index
from discsim.kernels.drag.blocks import LEVELS
from discsim.kernels.mpi import batches

THEIRS, OWN, EITHER = range(3)
ONE, BATCH = index(1), index(batches.BATCH)
FAR = 64  # a batch that spans at least this many top-level blocks is kept without a test of each
EDGE = 1e-6  # largest rounding error of a position, in sides of a cell


@jit
def mark_cells(filled, grids, away, others, reach_of, room, flat, periodic):
    """Return whether each cell (cells,) of the grids `others` may have particles within reach of the cells `filled`.

    filled: indices of cells of the grids `grids`. away (2,): lower corner of `others` minus that of `grids`. reach_of:
    whose support radius is the reach, that of particles in `others` (THEIRS), in `filled` (OWN), or the larger one
    (EITHER). room: factor by which support radii may exceed the largest one of their grid. flat: whether space is
    one-dimensional.
    """
    last = others[-1]
    out = np.zeros(int(last[FIRST] + last[NX] * last[NX + 1]), np.bool_)
    for level in range(len(others)):
        other, nx, ny = others[level], int(others[level, NX]), int(others[level, NX + 1])
        corners = np.zeros((nx + 1, ny + 1), np.int32)  # of marked boxes, which prefix sums fill
        mine, k = 0, 0
        while k < len(filled):
            cell = filled[k]
            while mine + 1 < len(grids) and grids[mine + 1, FIRST] <= cell:
                mine += 1
            place, rows = cell - int(grids[mine, FIRST]), int(grids[mine, NX + 1])
            ix, iy = place // rows + int(grids[mine, FROM_X]), place % rows + int(grids[mine, FROM_X + 1])
            count, left = 1, rows - place % rows  # consecutive cells of a row are marked together
            while count < left and k + count < len(filled) and filled[k + count] == cell + count:
                count += 1
            k += count
            reach = 0.0
            if reach_of != THEIRS:
                reach = room * grids[mine, REACH]
            if reach_of != OWN:
                reach = max(reach, room * other[REACH])
            x0, x1 = _cells_in_reach(ix, grids[mine, SIDE_X], away[0], other[SIDE_X], reach)
            y0, y1 = (0, 0) if flat else _cells_in_reach(iy, grids[mine, SIDE_X + 1], away[1], other[SIDE_X + 1], reach)
            if count > 1:
                y1 = _cells_in_reach(iy + count - 1, grids[mine, SIDE_X + 1], away[1], other[SIDE_X + 1], reach)[1]
            _mark_cells_in_box(x0, x1, y0, y1, other, periodic, corners)
        _fill_marked_boxes(corners, int(other[FIRST]), out)
    return out


@jit_subroutine
def _fill_marked_boxes(corners, begin, out):
    """Write to `out`, from cell `begin` on, whether each cell is in a marked box, by prefix sums of `corners`."""
    nx, ny = corners.shape[0] - 1, corners.shape[1] - 1
    for i in range(nx):
        along = 0
        for j in range(ny):
            along += corners[i, j]
            corners[i, j] = along + (corners[i - 1, j] if i > 0 else 0)
            out[begin + i * ny + j] = corners[i, j] > 0


@jit_subroutine
def _mark_cells_in_box(x0, x1, y0, y1, grid, periodic, corners):
    """Mark a box of cells of a whole grid, and its periodic images, in the part of the grid that `grid` describes.

    The box has the cells x0 to x1 and y0 to y1. The marks are added at the four corners of the box in `corners` (nx
    + 1, ny + 1), from which `_fill_marked_boxes` fills the box.
    """
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


@jit
def _cells_in_reach(i, side, away, per, reach):
    """Return the first and the last cell within `reach` of another cell, along one axis.

    The other cell is cell i of a grid with cells of side `side`. The results are cells of a second grid, with cells
    of side `per`, which begins at the position `away` relative to the first grid.
    """
    low, high = (i - EDGE) * side - away - reach, (i + 1 + EDGE) * side - away + reach
    return math.floor(low / per), math.floor(high / per)


@jit
def mark_blocks(own, centre_node, stencil, node_cells, rings, out):
    """Mark in `out` (blocks,) the blocks on which the kick of the blocks `own` depends.

    Marked are the blocks about the nine nodes of each block, and about `rings` rings of nodes around the nine.
    centre_node, stencil, node_cells: as in `NodeCells` of `drag/nodes.py`.
    """
    marked = np.zeros(len(stencil), np.bool_)
    for block in own:
        marked[centre_node[block]] = True
    for _ in range(rings + 1):
        before = marked.copy()
        for node in range(len(stencil)):
            if before[node]:
                for k in range(9):
                    if stencil[node, k] >= 0:
                        marked[stencil[node, k]] = True
    for node in range(len(stencil)):
        if marked[node]:
            for k in range(9):
                if node_cells[node, k] >= 0:
                    out[node_cells[node, k]] = True


@jit
def number_runs(first, last, out):
    """Write to `out` (cells + 1,) how many cells before each cell are in the given runs; `out` must be 0 on input.

    A run has the cells from `first` up to, but not including, `last` (runs,).
    """
    for run in range(len(first)):
        for cell in range(first[run], last[run]):
            out[cell] = 1
    count = 0
    for cell in range(len(out)):
        here, out[cell] = out[cell], count
        count += here


@jit
def particles_in_runs(first, last, some, key, of, number):
    """Return (particles, numbers) for the particles whose cells are in the runs.

    particles (m,): indices of the particles. numbers (m,): index of the cell of each particle among the cells in the
    runs. number: result of `number_runs`. key (n,): cell of each particle; if `of` is not None, the cell is of[key].
    Only the batches some[first:last] are searched.
    """
    out, numbers, count = np.empty(MARGIN, np.int64), np.empty(MARGIN, np.uint32), index(0)
    for k in range(first, last):
        begin = index(some[k]) * BATCH
        out, numbers = ensure_capacity(out, count), ensure_capacity(numbers, count)
        for i in range(begin, min(begin + BATCH, index(len(key)))):
            cell = index(key[i] if of is None else of[key[i]])  # `of` is tested once, when this is compiled
            out[count], numbers[count] = i, number[cell]
            count += index(number[cell + ONE] > number[cell])
    return out[: np.int64(count)], numbers[: np.int64(count)]


@jit
def mark_blocks_of_leaves(first, last, held, number, out):
    """Mark in `out` (blocks,) the blocks of the leaves from `first` to `last` that are `held` (leaves,).

    number (leaves,): block of each leaf.
    """
    for leaf in range(index(first), index(last)):
        if held[leaf]:
            out[index(number[leaf])] = True


@jit
def batches_near(first, last, bounds, origin, side, lattice, rows, marked):
    """Return the batches `first` to `last` that may have a particle in one of the top-level blocks `marked` (x, y).

    bounds (batches, 4): bounds of each batch. origin (2,): position of the lattice. side: side of a leaf. lattice:
    first leaf of this rank's part along x and y, then number of leaves in a period along x and y, 0 in open space.
    rows: leaves along the side of a top-level block.
    """
    out, count = np.empty(last - first, np.int64), 0
    for batch in range(first, last):
        out[count] = batch
        x0, x1 = _leaves_between(bounds[batch, 0], bounds[batch, 1], origin[0], side, lattice[0], lattice[2])
        y0, y1 = _leaves_between(bounds[batch, 2], bounds[batch, 3], origin[1], side, lattice[1], lattice[3])
        if not (x1 - x0) * (y1 - y0) < FAR * rows * rows:
            count += 1
            continue
        near = False
        for x in range(int(max(x0, 0.0)) // rows, int(min(x1 // rows + 1.0, marked.shape[0]))):
            for y in range(int(max(y0, 0.0)) // rows, int(min(y1 // rows + 1.0, marked.shape[1]))):
                near |= marked[x, y]
        count += near
    return out[:count]


@inline_jit
def _leaves_between(low, high, origin, side, first, period):
    """Return the first and last leaf of a part between two positions along an axis, one leaf wider for rounding.

    The range is infinite if the positions are in different periods, or NaN.
    """
    if not low <= high:
        return -np.inf, np.inf
    low, high = np.floor((low - origin) / side) - 1.0, np.floor((high - origin) / side) + 1.0
    if period > 0.0:
        turn = np.floor(low / period)
        if np.floor(high / period) != turn:
            return -np.inf, np.inf
        low, high = low - turn * period, high - turn * period
    return low - first, high - first


@jit
def renumber(first, last, number, anew):
    """Replace each entry i of `number` (n,), in place, by anew[i]; the last entry of `anew` is for i = -1."""
    for i in range(first, last):
        number[i] = anew[number[i]]


@jit
def mark_top_blocks(leaf, own, out):
    """Mark in out[0] the top-level blocks that contain own blocks, and in out[1] those that contain other blocks.

    out (2, x, y). leaf (blocks, 2): first leaf of each block. own (blocks,): whether a block is an own block.
    """
    for block in range(len(own)):
        out[0 if own[block] else 1, leaf[block, 0] >> LEVELS, leaf[block, 1] >> LEVELS] = True


@jit
def blocks_in(leaf, marked):
    """Return the indices of the blocks in the top-level blocks that are `marked` (x, y).

    leaf (blocks, 2): first leaf of each block.
    """
    out, count = np.empty(len(leaf), np.int64), 0
    for block in range(len(leaf)):
        out[count] = block
        count += marked[leaf[block, 0] >> LEVELS, leaf[block, 1] >> LEVELS]
    return out[:count]


@jit
def block_number_ranges(leaf, level, first, rows, begin, end):
    """Write the first index, `begin`, and one more than the last, `end` (blocks,), of the leaves of each block.

    The indices are those in the whole lattice. Leaves are numbered by top-level blocks, of which there are `rows` along
    y, and in a top-level block along a Z-curve. leaf (blocks, 2), level (blocks,): first leaf and level of each block,
    in a part that begins at the leaf `first` (2,).
    """
    x0, y0, mask = first[0], first[1], (1 << LEVELS) - 1
    for block in range(len(level)):
        x, y = np.int64(leaf[block, 0]) + x0, np.int64(leaf[block, 1]) + y0
        number = (x >> LEVELS) * rows + (y >> LEVELS)
        begin[block] = (number << 2 * LEVELS) + z_index(x & mask, y & mask)
        end[block] = begin[block] + (np.int64(1) << 2 * np.int64(level[block]))


@jit
def cells_within_halo(some, cells, there):
    """Return whether each of the cells `some` reaches only cells that this rank has.

    The result is False for a cell that reaches a cell that is not `there` (cells,), or the outside of this rank's
    grids.
    """
    grids, bounds, low = cells.grids, cells.bounds, cells.low
    out = np.ones(len(some), np.bool_)
    for k in range(len(some)):
        x, y, wide, high, reach = bounds[some[k]]
        for level in range(len(grids)):
            grid = grids[level]
            x0, x1 = _cells_under(x - low[0], wide + reach, grid[SIDE_X])
            y0, y1 = _cells_under(y - low[1], high + reach, grid[SIDE_X + 1]) if cells.width[1] > 0.0 else (0, 0)
            if cells.periodic and (x0 < 0 or y0 < 0 or x1 >= grid[ALL_X] or y1 >= grid[ALL_Y]):
                out[k] = False  # in a periodic image: taken as absent
            # There is nothing beyond the whole grid; positions on its upper edge are in its last cells.
            x0, x1 = _clamped(x0, grid[ALL_X]) - int(grid[FROM_X]), _clamped(x1, grid[ALL_X]) - int(grid[FROM_X])
            y0, y1 = _clamped(y0, grid[ALL_Y]) - int(grid[FROM_Y]), _clamped(y1, grid[ALL_Y]) - int(grid[FROM_Y])
            if x0 < 0 or y0 < 0 or x1 >= grid[NX] or y1 >= grid[NY]:
                out[k] = False
                break
            for ix in range(x0, x1 + 1):
                for iy in range(y0, y1 + 1):
                    out[k] &= there[int(grid[FIRST]) + ix * int(grid[NY]) + iy]
    return out


@njit(inline="always")
def _cells_under(middle, half, side):
    """Return the first and last cell of side `side` under the interval middle - half to middle + half."""
    return math.floor((middle - half) / side - EDGE), math.floor((middle + half) / side + EDGE)


@njit(inline="always")
def _clamped(index, count):
    """Return `index` limited to the range from 0 to count - 1."""
    return min(max(index, 0), int(count) - 1)


@jit
def mark_leaves(first, last, gas, dust, side, leaves, out):
    """Mark in `leaves` (nx, ny) the leaves with particles, and in `out` (x, y) the blocks of leaves with particles.

    A block has `side` by `side` leaves.

    gas, dust (nx, ny): numbers of gas and dust particles in each leaf. first, last: rows of blocks to mark.
    """
    nx, ny = gas.shape
    for x in range(first, last):
        for ix in range(x * side, min((x + 1) * side, nx)):
            for y in range(out.shape[1]):
                begin, end = y * side, min((y + 1) * side, ny)
                some, here, there, held = leaves[ix, begin:end], gas[ix, begin:end], dust[ix, begin:end], 0
                for k in range(index(end - begin)):  # vectorised
                    some[k] = (here[k] | there[k]) > 0
                    held |= here[k] | there[k]
                out[x, y] |= held > 0


@jit
def cut_blocks(blocks, leaves, k, out):
    """Copy the k-th table of leaves, block by block, to out[:, k]; `out` has the shape (n, tables, side, side).

    blocks (n, 2): indices of the blocks along x and y. leaves (nx, ny): the table.
    """
    side = out.shape[2]
    for n in range(len(blocks)):
        x, y = blocks[n, 0] * side, blocks[n, 1] * side
        for i in range(min(side, leaves.shape[0] - x)):
            here, there = leaves[x + i, y : y + side], out[n, k, i]
            for j in range(index(len(here))):  # vectorised
                there[j] = here[j]


@jit
def add_blocks(blocks, given, k, leaves):
    """Add given[:, k], block by block, to the k-th table of leaves, in place; the reverse of `cut_blocks`.

    blocks (n, 2): indices of the blocks along x and y. given (n, tables, side, side). leaves (nx, ny): the table.
    """
    side = given.shape[2]
    for n in range(len(blocks)):
        x, y = blocks[n, 0] * side, blocks[n, 1] * side
        for i in range(min(side, leaves.shape[0] - x)):
            here, come = leaves[x + i, y : y + side], given[n, k, i]
            for j in range(index(len(here))):
                here[j] += come[j]
