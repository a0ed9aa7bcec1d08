"""Tiles of space that ranks own: particles in given tiles, ghosts for grid nodes, and the order of sums.

A ghost for a node is a particle of another rank that deposits mass on the node.
"""

import numpy as np

from discsim.jit.decorators import inline_jit, jit
from discsim.jit.index import index
from discsim.kernels.common.filling import SOME, with_room
from discsim.kernels.common.grid import stencil
from discsim.kernels.mpi import batches

ONE, TWO, BATCH = index(1), index(2), index(batches.BATCH)
FEW = 4  # tiles along a side, up to which a batch is tested as a whole


@inline_jit
def _along(x, low, tiles):
    # The tile of a coordinate along an axis, or the nearest one; the first one for NaN.
    at = (x - low) * tiles[1]
    return int(min(at, tiles[2] - 1.0)) if at > 0.0 else 0


@inline_jit
def _tile_of(pos, i, tiles):
    tile = 0
    for k in range(pos.shape[1]):
        tile = tile * tiles[2] + _along(pos[i, k], tiles[0][k], tiles)
    return tile


@jit
def tiles_of(first, last, pos, tiles, out):
    """Write the tile (n,) of each position (n, d), or the nearest one.

    `tiles` is (low, per_tile, along): the lower corner, tiles per length, and tiles along each axis.
    """
    for i in range(first, last):
        out[i] = _tile_of(pos, i, tiles)


@jit
def in_marked(first, last, pos, bounds, tiles, marked):
    """Return the indices of positions (n, d) whose tile, or the nearest one, is `marked` (tiles,).

    Positions are those of the batches from `first` to `last`, with `bounds` (batches, 4).
    """
    out, count, tile = np.empty(SOME, np.int64), index(0), np.empty(BATCH, np.uint32)
    for batch in range(index(first), index(last)):
        x0, x1, y0, y1 = bounds[batch, 0], bounds[batch, 1], bounds[batch, 2], bounds[batch, 3]
        if not _marked_about(x0, x1, y0, y1, pos.shape[1], tiles, marked, BATCH):  # beyond BATCH tiles: row by row
            continue
        begin = batch * BATCH
        n = min(BATCH, index(len(pos)) - begin)
        _tiles_of_some(pos, begin, n, tiles, tile)
        out = with_room(out, count)
        for i in range(n):
            out[count] = begin + i
            count += index(marked[index(tile[i])])
    return out[: np.int64(count)]


@inline_jit
def _marked_about(x0, x1, y0, y1, dim, tiles, marked, most):
    """Return whether any tile in a box is marked, or the box has more than `most` tiles or is NaN."""
    low, _, along = tiles
    if not x0 <= x1:
        return True
    left, right, bottom, top, rows = _along(x0, low[0], tiles), _along(x1, low[0], tiles), 0, 0, 1
    if dim == 2:
        bottom, top, rows = _along(y0, low[-1], tiles), _along(y1, low[-1], tiles), along
    if (right - left + 1) * (top - bottom + 1) > most:
        return True
    for column in range(left, right + 1):
        for row in range(bottom, top + 1):
            if marked[column * rows + row]:
                return True
    return False


@inline_jit
def _is_near(x0, x1, y0, y1, dim, margin, ends, tiles, marked):
    inside = x0 >= ends[0, 0] and x1 <= ends[1, 0]
    if dim == 2:
        inside = inside and y0 >= ends[0, 1] and y1 <= ends[1, 1]
    return not inside or _marked_about(
        x0 - margin, x1 + margin, y0 - margin, y1 + margin, dim, tiles, marked, FEW * FEW
    )


@jit
def near_marked(first, last, pos, bounds, margin, ends, tiles, marked):
    """Return the indices of positions (n, d) near `marked` tiles (tiles,) or outside the `ends` (2, d).

    Near is within `margin`. Other positions of the same batches, from `first` to `last`, are included. Wide batches,
    as after the arrival of particles, are tested row by row.
    """
    out, count, dim = np.empty(SOME, np.int64), index(0), pos.shape[1]
    wide = FEW / tiles[1]
    for batch in range(index(first), index(last)):
        x0, x1, y0, y1 = bounds[batch, 0], bounds[batch, 1], bounds[batch, 2], bounds[batch, 3]
        if not _is_near(x0, x1, y0, y1, dim, margin, ends, tiles, marked):
            continue
        out, one_by_one = with_room(out, count), x1 - x0 > wide or y1 - y0 > wide
        for i in range(batch * BATCH, min((batch + ONE) * BATCH, index(len(pos)))):
            x, y = pos[i, 0], pos[i, dim - 1]
            out[count] = i
            count += index(not one_by_one or _is_near(x, x, y, y, dim, margin, ends, tiles, marked))
    return out[: np.int64(count)]


@inline_jit
def _tiles_of_some(pos, begin, n, tiles, out):
    """Write the tiles of `n` positions from `begin` on to `out`."""
    low, per_tile, along = tiles
    if pos.shape[1] == 1:
        for i in range(n):
            out[i] = _tile_of(pos, begin + i, tiles)
        return
    # No branches and unsigned indices: vectorised.
    flat, ox, oy, most = pos.reshape(-1)[TWO * begin : TWO * (begin + n)], low[0], low[-1], along - 1.0
    for i in range(n):
        x, y = (flat[TWO * i] - ox) * per_tile, (flat[TWO * i + ONE] - oy) * per_tile
        x, y = min(x, most) if x > 0.0 else 0.0, min(y, most) if y > 0.0 else 0.0
        out[i] = np.int32(x) * np.int32(along) + np.int32(y)


@jit
def rows_in_global_order(place, held, loose, others):
    """Return rows in the order of their `place` (n,), the index in the global order, as pieces of consecutive rows.

    Pieces go from `first` up to `last` (pieces,). The third result is whether the pieces have this order. `place`
    rises along the first `held` rows, except at the rows `loose`, which are sorted by row. `others` are the loose
    rows and all rows from `held` on, sorted by `place`.
    """
    most = 2 * len(others) + len(loose) + 1
    first, last, count = np.empty(most, np.int64), np.empty(most, np.int64), 0
    row, begin, skipped, before, rises = 0, 0, 0, index(0), True
    for k in range(len(others) + 1):
        while True:
            stop = loose[skipped] if skipped < len(loose) else held
            found = stop if k == len(others) else _first_not_below(place, row, stop, place[others[k]])
            if row < found:
                rises &= place[row] >= before and _rise(place, row, found)
                row, before = found, place[found - 1]
            if row < stop or stop == held:
                break
            if begin < row:
                first[count], last[count], count = begin, row, count + 1
            row, begin, skipped = row + 1, row + 1, skipped + 1
        if begin < row:
            first[count], last[count], count = begin, row, count + 1
            begin = row
        if k < len(others):
            first[count], last[count], count = others[k], others[k] + 1, count + 1
    return first[:count], last[:count], rises


@inline_jit
def _first_not_below(place, row, stop, least):
    """Return the first row from `row` on whose `place` is not below `least`, or `stop`; it is mostly near."""
    step = 1
    while row + step < stop and place[row + step] < least:
        row, step = row + step, 2 * step
    end = min(row + step, stop)
    while row < end:
        middle = (row + end) // 2
        if place[middle] < least:
            row = middle + 1
        else:
            end = middle
    return row


@inline_jit
def _rise(place, first, last):
    some, falls = place[first:last], 0
    for i in range(index(len(some) - 1)):
        falls += some[i + ONE] < some[i]
    return falls == 0


@jit
def others_about(first, last, some, pos, origin, inverse, periodic, tiles, owner, rank):
    """Return the particles of `some` near nodes of ranks other than `rank`, and these ranks, one entry each (m,).

    `tiles` (nx,) and (ny,): tile of each node along x and y. `owner` (along x, along y): rank of each tile.
    """
    (at_x, at_y), plane = tiles, pos.shape[1] == 2
    nx, ny, found = len(at_x), len(at_y), np.empty(4, np.int64)
    rows, whose, count = np.empty(4 * (last - first), np.int64), np.empty(4 * (last - first), np.int64), 0
    for k in range(first, last):
        p = some[k]
        ix, jx, _ = stencil(pos[p, 0], origin[0], inverse, nx, periodic)
        iy, jy = 0, 0
        if plane:
            iy, jy, _ = stencil(pos[p, 1], origin[1], inverse, ny, periodic)
        if ix < 0 or iy < 0:
            continue
        x, y, beside, above = at_x[ix], at_y[iy], at_x[jx], at_y[jy]
        found[0], found[1], found[2], found[3] = owner[x, y], owner[x, above], owner[beside, y], owner[beside, above]
        if found[0] == rank and found[1] == rank and found[2] == rank and found[3] == rank:
            continue
        for node in range(4):
            known = found[node] == rank
            for before in range(node):
                known |= found[before] == found[node]
            if not known:
                rows[count], whose[count] = p, found[node]
                count += 1
    return rows[:count], whose[:count]


@jit
def leave_own(first, last, x, y, owner, rank, begin, end, out):
    """Set `out` (nx, ny) to 0 at nodes of ranks other than `rank`, in each row from column `begin` up to `end` (nx,).

    `x` (nx,) and `y` (ny,): tiles of the nodes. `owner` (along x, along y): rank of each tile.
    """
    for i in range(first, last):
        row, whose = out[i], owner[x[i]]
        for j in range(begin[i], end[i]):
            if whose[y[j]] != rank:
                row[j] = 0.0


@jit
def take_spans(first, last, field, row, begin, end, start, out):
    """Copy spans of a field to `out` (m,), from `start` (n + 1,) on.

    A span has the columns from `begin` up to `end` (n,) of one of the rows `row` (n,).
    """
    for k in range(first, last):
        place, some = out[start[k] : start[k + 1]], field[row[k], begin[k] : end[k]]
        for i in range(len(some)):
            place[i] = some[i]


@jit
def put_spans(found, row, begin, end, start, add, field):
    """Copy spans from `found` (m,) to a field, the reverse of `take_spans`, or with `add` add them to it."""
    for k in range(len(row)):
        place, some = field[row[k], begin[k] : end[k]], found[start[k] : start[k + 1]]
        for i in range(len(some)):
            place[i] = place[i] + some[i] if add else some[i]
