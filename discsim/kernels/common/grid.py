"""Particles on a uniform grid: sort keys, cloud-in-cell deposit and gather (Hockney & Eastwood 1988, ch. 5).

`origin` is the lower corner of the grid, `inverse` is one over the side of a cell, and `shape` (nx, ny) is the number
of cells. Node i is the middle of cell i, at origin + (i + 1/2) cell along each axis. `periodic` tells whether the grid
wraps. The first node of a particle is the lower of the two adjacent nodes along each axis.

A field may cover only part of the grid, but must have all nodes next to the particles. `part` is then (nx, ny, x, y):
the shape of the whole grid, and the index of the field's first node along x and y. In periodic space, a field wraps
along an axis on which it has all nodes of the grid.

The order of every sum is independent of the number of threads. Kernels process the particles `begin` to `end`, for
`discsim.numerics.threads.parallel_for`, if not said otherwise.
"""

import numpy as np

from discsim.jit.decorators import INLINE, cached_njit, inline_jit, jit, jit_subroutine
from discsim.jit.index import index
from discsim.kernels.common.simd import LINE, extract, load, prefetch
from discsim.kernels.common.zcurve import z_index
from discsim.kernels.mpi.batches import BATCH as ROWS

ONE, TWO = index(1), index(2)
STRIPS = 64  # largest number of strips of rows in a deposit; it does not depend on the number of threads
BATCH = 128  # particles whose nodes are computed together, by vectorised code
CHUNK = 4096  # particles per chunk in `subtract_interpolated`
BAND = 32  # rows of nodes per band in `node_ranges`
TILE = 6  # tiles of the sort keys are 2^TILE cells wide


@jit_subroutine
def _wrapped_coordinate(s, count):
    """Return the coordinate s, in cells, wrapped to [0, count)."""
    if not 0.0 <= s < count:
        s -= count * np.floor(s / count)
        if s == count:  # a tiny negative s rounds up to the far edge
            s = 0.0
    return s


@jit
def cell_of(x, origin, inverse, count, periodic):
    """Return the index of the cell that contains x, along an axis of `count` cells.

    The result is -1 if x is not finite, or beyond the ends of an open axis.
    """
    s = (x - origin) * inverse
    if periodic:
        s = _wrapped_coordinate(s, count)
    return int(s) if 0.0 <= s < count else -1


@jit
def sort_keys(begin, end, pos, origin, inverse, shape, periodic, out):
    """Write to `out` (n,) the sort key of each particle, so that particles near in space become near in memory.

    The key numbers the cells by rows of square tiles, and within a tile along a Z-curve. The key of particles off
    the grid is one more than the largest key on the grid.
    """
    plane = pos.shape[1] == 2
    bits = TILE if plane else 0
    along_x, along_y = (shape[0] - 1 >> bits) + 1, (shape[1] - 1 >> bits) + 1
    for i in range(begin, end):
        ix = cell_of(pos[i, 0], origin[0], inverse, shape[0], periodic)
        iy = cell_of(pos[i, 1], origin[1], inverse, shape[1], periodic) if plane else 0
        key = (ix >> bits) * along_y + (iy >> bits) << 2 * bits
        if plane:
            key |= z_index(ix & (1 << TILE) - 1, iy & (1 << TILE) - 1)
        out[i] = key if ix >= 0 and iy >= 0 else along_x * along_y << 2 * bits


@jit_subroutine
def stencil(x, origin, inverse, count, periodic):
    """Return the indices of the two nodes next to x along an axis of `count` nodes, and the weight of the second.

    The result is (-1, -1, 0) if either node is off the grid.
    """
    s = (x - origin) * inverse - 0.5
    if periodic:
        s = _wrapped_coordinate(s, count)
    if not 0.0 <= s < (count if periodic else count - 1):
        return -1, -1, 0.0
    low = int(s)
    return low, low + 1 if low + 1 < count else 0, s - low


@jit_subroutine
def _stencil_y(pos, p, origin, inverse, count, periodic):
    """Return `stencil` of particle p along y. In 1D there is a single row of nodes, with weight 1."""
    if pos.shape[1] == 1:
        return 0, 0, 0.0
    return stencil(pos[p, 1], origin[1], inverse, count, periodic)


@jit
def strip_keys(begin, end, pos, origin, inverse, shape, periodic, shift, key):
    """Write to `key` (n,) the strip of rows that contains the first node of each particle; STRIPS off the grid.

    A strip has 2^shift rows of the grid.
    """
    if pos.shape[1] == 2 and not periodic:
        flat, ox, oy = pos.reshape(-1), origin[0], origin[1]  # a flat array and unsigned indices: vectorised
        for p in range(index(begin), index(end)):
            x, y = (flat[TWO * p] - ox) * inverse - 0.5, (flat[TWO * p + ONE] - oy) * inverse - 0.5
            inside = (x >= 0.0) & (x < shape[0] - 1) & (y >= 0.0) & (y < shape[1] - 1)
            key[p] = np.uint8(np.int32(x) >> np.int32(shift)) if inside else np.uint8(STRIPS)
        return
    for p in range(begin, end):
        low = stencil(pos[p, 0], origin[0], inverse, shape[0], periodic)[0]
        inside = low >= 0 and _stencil_y(pos, p, origin, inverse, shape[1], periodic)[0] >= 0
        key[p] = low >> shift if inside else STRIPS  # a shift: a division took longer than all the rest


@jit
def strip_runs(key, first, last):
    """Return ((begin, end), strip), arrays (runs,) with the runs of consecutive particles in one strip.

    key (n,): strip of each particle, by `strip_keys`. first, last (chunks,): the particles first[i] to last[i] form
    chunk i; no run extends over two chunks, and no chunk is empty. Particles near in space are near in memory, so
    runs are few, and sorting the runs replaces sorting the particles.
    """
    count = len(first)
    for piece in range(len(first)):
        for p in range(index(first[piece]) + ONE, index(last[piece])):
            count += key[p] != key[p - ONE]
    begin, end, strip = np.empty(count, np.int64), np.empty(count, np.int64), np.empty(count, np.uint32)
    run = 0
    for piece in range(len(first)):
        begin[run], strip[run] = first[piece], key[first[piece]]
        for p in range(index(first[piece]) + ONE, index(last[piece])):
            if key[p] != key[p - ONE]:
                end[run] = p
                run += 1
                begin[run], strip[run] = p, key[p]
        end[run] = last[piece]
        run += 1
    return (begin, end), strip


@inline_jit
def _spread_batch(flat, dim, value, p, number, filled, place, shares, origin, inverse, scale, grid, corner):
    """Write the contributions of `number` particles, from the p-th on, to a batch, after its first `filled` entries.

    place: flat index, in the strip, of the first node of each particle. The rows of the strip begin at the node
    `corner` of the grid. shares: contributions to the four nodes. The contribution of a particle is value * scale.
    grid: (nx, ny, periodic, length); a row of the strip has `length` nodes.
    """
    (nx, ny, periodic, length), ox, oy = grid, origin[0], origin[1]
    where = np.int32(corner[0]), np.int32(corner[1]), np.int32(length)
    if dim == TWO and not periodic:  # this loop is vectorised
        for j in range(index(number)):
            x, y = (flat[TWO * (p + j)] - ox) * inverse - 0.5, (flat[TWO * (p + j) + ONE] - oy) * inverse - 0.5
            _spread_particle(filled + j, x, y, value[p + j] * scale, where, place, shares)
        return
    for j in range(index(number)):
        x, y = (flat[dim * (p + j)] - ox) * inverse - 0.5, 0.0
        if dim == TWO:
            y = (flat[TWO * (p + j) + ONE] - oy) * inverse - 0.5
        if periodic:
            x, y = _wrapped_coordinate(x, nx), _wrapped_coordinate(y, ny)
        _spread_particle(filled + j, x, y, value[p + j] * scale, where, place, shares)


@inline_jit
def _spread_particle(j, x, y, v, where, place, shares):
    """Write entry j of a batch: a particle at (x, y), in cells from the first node of the grid, that contributes v.

    where: first node along x and along y of the strip, and the length of its rows.
    """
    (s00, s01, s10, s11), (first, first_y, width) = shares, where
    ix, iy = np.int32(x), np.int32(y)
    place[j] = (ix - first) * width + (iy - first_y)
    v1 = v * (x - ix)
    v0 = v - v1
    s01[j], s11[j] = v0 * (y - iy), v1 * (y - iy)
    s00[j], s10[j] = v0 - s01[j], v1 - s11[j]


@inline_jit
def _add_batch(number, place, shares, length, flat):
    """Add the first `number` entries of a batch to a strip, `flat`, whose rows have `length` nodes."""
    s00, s01, s10, s11 = shares
    for j in range(index(number)):
        low = index(place[j])
        high = low + length
        flat[low] += s00[j]
        flat[low + ONE] += s01[j]
        flat[high] += s10[j]
        flat[high + ONE] += s11[j]


@jit
def deposit_strips(
    begin, end, pos, value, scale, runs, order, start, origin, inverse, periodic, part, shift, out, beyond
):
    """Add `scale` times `value` (n,) of the particles to the field `out`, a `part` of the grid, by cloud in cell.

    The strips `begin` to `end` are processed. runs: (begin, end) of each run, as in `strip_runs`. The runs of strip
    s are order[start[s]:start[s + 1]]. A strip of 2^shift rows adds to its own rows of `out`. Its contribution to
    the row after its last row is written to `beyond` (strips, columns), which must be 0 before; `join_strips` adds
    `beyond` to the field.
    """
    nx, ny, first_x, first_y = part
    (held, wide), (run_begin, run_end) = out.shape, runs
    rows, length = 1 << shift, index(wide + 1)
    sums = np.empty((rows + 1, wide + 1))  # the extra column is the first one in periodic space
    flat, grid = sums.reshape(-1), (nx, ny, periodic, length)
    # Separate arrays, as rows of one array would be compiled as strided. `pos` is flattened once and not for each
    # batch, as this takes as long as the work on several particles.
    at, dim = pos.reshape(-1), index(pos.shape[1])
    place, shares = np.empty(BATCH, np.int32), (np.empty(BATCH), np.empty(BATCH), np.empty(BATCH), np.empty(BATCH))
    for s in range(begin, end):
        if start[s] == start[s + 1]:
            continue
        first, filled = s * rows, 0
        flat[:] = 0.0
        for k in range(start[s], start[s + 1]):
            p, last = run_begin[order[k]], run_end[order[k]]
            while p < last:
                number = min(last - p, BATCH - filled)
                behind = index(p), number, index(filled)
                _spread_batch(at, dim, value, *behind, place, shares, origin, inverse, scale, grid, (first, first_y))
                p, filled = p + number, filled + number
                if filled == BATCH:
                    _add_batch(filled, place, shares, length, flat)
                    filled = 0
        _add_batch(filled, place, shares, length, flat)
        own = max(0, min(rows, nx - first))
        for r in range(own + 1):
            sums[r, 0] += sums[r, wide]
        for r in range(max(0, first_x - first), min(own, first_x + held - first)):
            row = out[first + r - first_x]
            for j in range(wide):
                row[j] += sums[r, j]
        for j in range(wide):
            beyond[s, j] = sums[own, j]


@jit
def join_strips(shift, part, beyond, out):
    """Add the results `beyond` (strips, columns) of `deposit_strips` to the field `out`, strip by strip."""
    nx = part[0]
    for s in range(len(beyond)):
        row = min((s + 1) << shift, nx) % nx - part[2]
        if s << shift < nx and 0 <= row < len(out):
            for j in range(out.shape[1]):
                out[row, j] += beyond[s, j]


@jit
def gather(begin, end, field, pos, origin, inverse, periodic, part, out):
    """Write to `out` (n, c) the field at each particle, with the weights of the deposit; 0 off the grid.

    field (x, y, c): a `part` of the grid.
    """
    nx, ny, first_x, first_y = part
    for p in range(begin, end):
        ix, jx, wx = stencil(pos[p, 0], origin[0], inverse, nx, periodic)
        iy, jy, wy = _stencil_y(pos, p, origin, inverse, ny, periodic)
        w00, w01, w10, w11 = (1.0 - wx) * (1.0 - wy), (1.0 - wx) * wy, wx * (1.0 - wy), wx * wy
        inside = ix >= 0 and iy >= 0
        ix, jx, iy, jy = ix - first_x, jx - first_x, iy - first_y, jy - first_y
        for c in range(out.shape[1]):
            out[p, c] = 0.0
            if inside:
                low = w00 * field[ix, iy, c] + w01 * field[ix, jy, c]
                out[p, c] = low + w10 * field[jx, iy, c] + w11 * field[jx, jy, c]


@cached_njit(**INLINE, fastmath={"contract"})
def _interpolate(flat, low, along_x, along_y, wx, wy):
    """Return the field, stored in `flat`, between four nodes, with the weights wx and wy of the upper nodes.

    low: index of the lower node in `flat`; along_x, along_y: steps of the index to the next node along each axis.
    """
    high = low + along_x
    first = flat[low] + wx * (flat[high] - flat[low])
    second = flat[low + along_y] + wx * (flat[high + along_y] - flat[low + along_y])
    return first + wy * (second - first)


@cached_njit(**INLINE, fastmath={"contract"})
def _interpolate_both(flat, low, along_x, wx, wy):
    """Return `_interpolate` of two components at once, where the next node along y is the next in memory."""
    left = load(flat, low)
    both = left + wx * (load(flat, low + along_x) - left)
    x, y = extract(both, 0), extract(both, 1)
    return x + wy * (extract(both, 2) - x), y + wy * (extract(both, 3) - y)


@inline_jit
def _write_grid_positions(flat, dim, p, number, origin, inverse, nx, ny, periodic, xs, ys):
    """Write the positions of `number` particles, from the p-th on, to `xs` and `ys`, in cells from the first node."""
    ox, oy = origin[0], origin[1]
    if dim == TWO:
        for j in range(number):
            xs[j] = (flat[TWO * (p + j)] - ox) * inverse - 0.5
            ys[j] = (flat[TWO * (p + j) + ONE] - oy) * inverse - 0.5
    else:
        for j in range(number):
            xs[j], ys[j] = (flat[p + j] - ox) * inverse - 0.5, 0.0
    if periodic:
        for j in range(number):
            xs[j], ys[j] = _wrapped_coordinate(xs[j], nx), _wrapped_coordinate(ys[j], ny)


@jit
def subtract_interpolated(chunk_from, chunk_to, field, pos, origin, inverse, periodic, part, acc, largest, missing):
    """Subtract the field at each particle from `acc` (n, d), in place, for the chunks `chunk_from` to `chunk_to`.

    field (x, y, 2): a vector field on a `part` of the grid. A chunk has CHUNK particles. Written for each chunk:
    `largest`, the largest squared length of the subtracted vectors, and `missing`, the number of particles off the
    grid.
    """
    nx, ny, first_x, first_y = part
    wide, plane = field.shape[1], pos.shape[1] == 2
    end_x, end_y = (float(nx), float(ny)) if periodic else (nx - 1.0, ny - 1.0 if plane else 1.0)
    flat, pulls, places, dim = field.reshape(-1), acc.reshape(-1), pos.reshape(-1), index(pos.shape[1])
    ixs, iys, xs, ys = np.empty(BATCH, np.int32), np.empty(BATCH, np.int32), np.empty(BATCH), np.empty(BATCH)
    for chunk in range(chunk_from, chunk_to):
        most, lost = 0.0, 0
        end = index(min((chunk + 1) * CHUNK, len(pos)))
        for p in range(index(chunk * CHUNK), end, index(BATCH)):
            number = min(index(BATCH), end - p)
            _write_grid_positions(places, dim, p, number, origin, inverse, nx, ny, periodic, xs, ys)
            for j in range(number):
                inside = (xs[j] >= 0.0) & (xs[j] < end_x) & (ys[j] >= 0.0) & (ys[j] < end_y)
                x, y = xs[j] if inside else -1.0, ys[j] if inside else 0.0
                ixs[j], iys[j] = np.int32(x), np.int32(y)
                xs[j], ys[j] = x - np.int32(x), y - np.int32(y)
            # Prefetch the next batch: hardware prefetchers miss it, as the arrays are read in short bursts.
            for ahead in range(dim * (p + index(BATCH)), dim * (p + index(2 * BATCH)), LINE):
                prefetch(pos, ahead)
                prefetch(pulls, ahead)
            for j in range(number):
                ix, iy = int(ixs[j]), int(iys[j])
                if ix < 0:
                    lost += 1
                    continue
                low = index(2 * ((ix - first_x) * wide + iy - first_y))  # unsigned: no wrapped index
                along_x = index(2 * wide if ix + 1 < nx else -2 * wide * ix)
                along_y = index(2 if iy + 1 < ny else -2 * iy)
                q = dim * (p + j)
                if iy + 1 < ny:
                    x, y = _interpolate_both(flat, low, along_x, xs[j], ys[j])
                else:
                    x = _interpolate(flat, low, along_x, along_y, xs[j], ys[j])
                    y = _interpolate(flat, low + ONE, along_x, along_y, xs[j], ys[j]) if plane else 0.0
                pulls[q] -= x
                if plane:
                    pulls[q + ONE] -= y
                most = max(most, x * x + y * y)
        largest[chunk], missing[chunk] = most, lost


@jit
def mark_outside(begin, end, pos, origin, inverse, shape, periodic, outside):
    """Write to `outside` (n,) whether any node next to a particle is off the grid."""
    for p in range(begin, end):
        x = stencil(pos[p, 0], origin[0], inverse, shape[0], periodic)[0]
        y = _stencil_y(pos, p, origin, inverse, shape[1], periodic)[0]
        outside[p] = x < 0 or y < 0


@jit
def node_ranges(begin, end, pos, bounds, origin, inverse, shape, periodic):
    """Return the ranges of the first nodes of all particles in the batches `begin` to `end`.

    bounds (batches, 4): smallest and largest x and y of the particles of a batch (`kernels/mpi/batches.py`).

    Returns the smallest and the largest first node along y, for each band of BAND rows (bands,); the smallest and
    the largest first node along x; and the number of particles off the grid. In an empty range the smallest exceeds
    the largest.
    """
    count = (shape[0] - 1) // BAND + 1
    least, most, low, high, off = np.full(count, shape[1]), np.full(count, -1), shape[0], -1, 0
    for batch in range(begin, end):
        x0, x1, y0, y1 = _nodes_between(bounds[batch], pos.shape[1], origin, inverse, shape)
        if x0 >= 0:
            low, high = min(low, x0), max(high, x1)
            band, last = x0 // BAND, x1 // BAND
            if band == last:  # as for most batches
                least[band], most[band] = min(least[band], y0), max(most[band], y1)
                continue
            is_covered = True  # most other batches lie within the ranges so far
            for each in range(band, last + 1):
                is_covered &= least[each] <= y0 and y1 <= most[each]
            if is_covered:
                continue
        for p in range(batch * ROWS, min((batch + 1) * ROWS, len(pos))):
            if x0 >= 0:
                ix = int((pos[p, 0] - origin[0]) * inverse - 0.5)
                iy = int((pos[p, 1] - origin[1]) * inverse - 0.5)
            else:
                ix = stencil(pos[p, 0], origin[0], inverse, shape[0], periodic)[0]
                iy = _stencil_y(pos, p, origin, inverse, shape[1], periodic)[0]
            if ix >= 0 and iy >= 0:
                band = ix // BAND
                least[band], most[band] = min(least[band], iy), max(most[band], iy)
                low, high = min(low, ix), max(high, ix)
            else:
                off += 1
    return least, most, low, high, off


@inline_jit
def _nodes_between(bounds, dim, origin, inverse, shape):
    """Return the smallest and largest first node along x, and along y, of positions within `bounds` (4,).

    All four are -1 if the bounds reach the edges of the grid, and in 1D.
    """
    x0, x1 = (bounds[0] - origin[0]) * inverse - 0.5, (bounds[1] - origin[0]) * inverse - 0.5
    y0, y1 = (bounds[2] - origin[1]) * inverse - 0.5, (bounds[3] - origin[1]) * inverse - 0.5
    if dim == 1 or not (x0 >= 0.0 and x1 < shape[0] - 1 and y0 >= 0.0 and y1 < shape[1] - 1):
        return -1, -1, -1, -1
    return int(x0), int(x1), int(y0), int(y1)
