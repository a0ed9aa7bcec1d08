"""Tiles of space, each owned by a rank: particles in given tiles, particles at nodes of other ranks, order of sums."""

import numpy as np

from discsim.jit.decorators import inline_jit, jit
from discsim.jit.index import index
from discsim.kernels.common.filling import MARGIN, ensure_capacity
from discsim.kernels.common.grid import stencil
from discsim.kernels.mpi import batches

ONE, TWO, BATCH = index(1), index(2), index(batches.BATCH)
FEW = 4  # a batch is tested as a whole if it spans at most this many tiles along a side


@inline_jit
def _tile_index(x, low, tiles):
    """Return the index of the tile at the coordinate x along one axis, or of the nearest tile; the first one for NaN.

    low: lower corner along this axis.
    """
    at = (x - low) * tiles[1]
    return int(min(at, tiles[2] - 1.0)) if at > 0.0 else 0


@inline_jit
def _tile_of(pos, i, tiles):
    """Return the tile of position i, or the nearest one."""
    tile = 0
    for k in range(pos.shape[1]):
        tile = tile * tiles[2] + _tile_index(pos[i, k], tiles[0][k], tiles)
    return tile


@jit
def tiles_of(first, last, pos, tiles, out):
    """Write to `out` (n,) the tile of each position (n, d), or the nearest tile if the position is outside all tiles.

    tiles: (low, per_tile, along), the lower corner (d,), the number of tiles per length, and the number along each
    axis.
    """
    for i in range(first, last):
        out[i] = _tile_of(pos, i, tiles)


@jit
def rows_in_marked_tiles(first, last, pos, bounds, tiles, marked):
    """Return the indices of the positions (n, d) whose tile, or nearest tile, is `marked` (tiles,).

    Only the batches from `first` to `last` are searched. bounds (batches, 4): bounds of each batch. tiles: as in
    `tiles_of`.
    """
    out, count, tile = np.empty(MARGIN, np.int64), index(0), np.empty(BATCH, np.uint32)
    for batch in range(index(first), index(last)):
        x0, x1, y0, y1 = bounds[batch, 0], bounds[batch, 1], bounds[batch, 2], bounds[batch, 3]
        if not _marked_about(x0, x1, y0, y1, pos.shape[1], tiles, marked, BATCH):  # beyond BATCH tiles: row by row
            continue
        begin = batch * BATCH
        n = min(BATCH, index(len(pos)) - begin)
        _write_tiles(pos, begin, n, tiles, tile)
        out = ensure_capacity(out, count)
        for i in range(n):
            out[count] = begin + i
            count += index(marked[index(tile[i])])
    return out[: np.int64(count)]


@inline_jit
def _marked_about(x0, x1, y0, y1, dim, tiles, marked, most):
    """Return whether the box x0 to x1, y0 to y1 has a marked tile, more than `most` tiles, or a bound that is NaN."""
    low, _, along = tiles
    if not x0 <= x1:
        return True
    left, right, bottom, top, rows = _tile_index(x0, low[0], tiles), _tile_index(x1, low[0], tiles), 0, 0, 1
    if dim == 2:
        bottom, top, rows = _tile_index(y0, low[-1], tiles), _tile_index(y1, low[-1], tiles), along
    if (right - left + 1) * (top - bottom + 1) > most:
        return True
    for column in range(left, right + 1):
        for row in range(bottom, top + 1):
            if marked[column * rows + row]:
                return True
    return False


@inline_jit
def _is_near(x0, x1, y0, y1, dim, margin, ends, tiles, marked):
    """Return whether the box x0 to x1, y0 to y1 is within `margin` of a marked tile, or not inside `ends` (2, d)."""
    inside = x0 >= ends[0, 0] and x1 <= ends[1, 0]
    if dim == 2:
        inside = inside and y0 >= ends[0, 1] and y1 <= ends[1, 1]
    return not inside or _marked_about(
        x0 - margin, x1 + margin, y0 - margin, y1 + margin, dim, tiles, marked, FEW * FEW
    )


@jit
def rows_near_marked_tiles(first, last, pos, bounds, margin, ends, tiles, marked):
    """Return the indices of the positions (n, d) within `margin` of `marked` tiles (tiles,), or outside `ends` (2, d).

    Only the batches from `first` to `last` are searched. If the bounds of a batch qualify, all its positions are
    returned. Only a wide batch, as after the arrival of particles, is tested row by row. bounds (batches, 4): bounds
    of each batch. tiles: as in `tiles_of`.
    """
    out, count, dim = np.empty(MARGIN, np.int64), index(0), pos.shape[1]
    wide = FEW / tiles[1]
    for batch in range(index(first), index(last)):
        x0, x1, y0, y1 = bounds[batch, 0], bounds[batch, 1], bounds[batch, 2], bounds[batch, 3]
        if not _is_near(x0, x1, y0, y1, dim, margin, ends, tiles, marked):
            continue
        out, one_by_one = ensure_capacity(out, count), x1 - x0 > wide or y1 - y0 > wide
        for i in range(batch * BATCH, min((batch + ONE) * BATCH, index(len(pos)))):
            x, y = pos[i, 0], pos[i, dim - 1]
            out[count] = i
            count += index(not one_by_one or _is_near(x, x, y, y, dim, margin, ends, tiles, marked))
    return out[: np.int64(count)]


@inline_jit
def _write_tiles(pos, begin, n, tiles, out):
    """Write the tiles of the `n` positions from `begin` on to `out`; tiles: as in `tiles_of`."""
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
    """Return (first, last, rises): rows sorted by their global index, as ranges of successive rows.

    Range i has the rows from first[i] up to last[i]. rises: whether the global index really rises along the ranges.
    place (n,): global index of each row. `place` rises along the first `held` rows, except at the rows `loose`,
    which are in ascending order. others: the rows `loose` and all rows from `held` on, sorted by `place`.
    """
    most = 2 * len(others) + len(loose) + 1
    first, last, count = np.empty(most, np.int64), np.empty(most, np.int64), 0
    row, begin, skipped, before, rises = 0, 0, 0, index(0), True
    for k in range(len(others) + 1):
        while True:
            stop = loose[skipped] if skipped < len(loose) else held
            found = stop if k == len(others) else _first_not_below(place, row, stop, place[others[k]])
            if row < found:
                rises &= place[row] >= before and _is_ascending(place, row, found)
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
    """Return the first row from `row` on whose `place` is at least `least`, or `stop`; the search begins near `row`."""
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
def _is_ascending(place, first, last):
    """Return whether `place` rises from row `first` to row `last`."""
    some, falls = place[first:last], 0
    for i in range(index(len(some) - 1)):
        falls += some[i + ONE] < some[i]
    return falls == 0


@jit
def particles_near_other_ranks(first, last, some, pos, origin, inverse, periodic, tiles, owner, rank):
    """Return (rows, ranks): particles of `some` that share a grid node with other ranks, one entry for each rank.

    tiles: two arrays, the tile of each node along x (nx,) and along y (ny,). owner (along x, along y): rank of each
    tile. rank: this rank. origin, inverse: position of the grid, and one over the side of its cells.
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
def zero_nodes_of_others(first, last, x, y, owner, rank, begin, end, out):
    """Set `out` (nx, ny) to 0 at the nodes of ranks other than `rank`.

    begin, end (nx,): only the columns begin[i] to end[i] - 1 of row i are changed. x (nx,), y (ny,): tiles of the nodes
    along x and y. owner (along x, along y): rank of each tile.
    """
    for i in range(first, last):
        row, whose = out[i], owner[x[i]]
        for j in range(begin[i], end[i]):
            if whose[y[j]] != rank:
                row[j] = 0.0


@jit
def copy_spans(first, last, field, row, begin, end, start, out):
    """Copy spans of a field to `out` (m,), span k to out[start[k] : start[k + 1]].

    Span k has the columns from begin[k] up to end[k] of the row row[k] of the field.
    """
    for k in range(first, last):
        place, some = out[start[k] : start[k + 1]], field[row[k], begin[k] : end[k]]
        for i in range(len(some)):
            place[i] = some[i]


@jit
def write_spans(found, row, begin, end, start, add, field):
    """Copy spans from `found` (m,) to a field, the reverse of `copy_spans`.

    add: whether to add the spans to the field instead.
    """
    for k in range(len(row)):
        place, some = field[row[k], begin[k] : end[k]], found[start[k] : start[k + 1]]
        for i in range(len(some)):
            place[i] = place[i] + some[i] if add else some[i]
