"""Particles on a uniform grid: sorting, cloud-in-cell weights (Hockney & Eastwood 1988, ch. 5), gradient.

Every sum has an order that does not depend on the number of threads. `origin` is the grid's lower corner,
`inverse` one over the cell; node i is at origin + (i + 1/2) cell. Kernels from `begin` to `end` are for
`discsim.threads.share`.
"""

import numpy as np
from numba import njit

STRIPS = 64  # strips of rows that a deposit is cut into; fixed, whatever the number of threads
BLOCK = 256  # particles of a strip that are copied at once

# Weights of f at five nodes for 12 cell f' at the first, ..., the last of them: fourth order (Fornberg 1988).
_STENCILS = np.array(
    [
        [-25.0, 48.0, -36.0, 16.0, -3.0],
        [-3.0, -10.0, 18.0, -6.0, 1.0],
        [1.0, -8.0, 0.0, 8.0, -1.0],
        [-1.0, 6.0, -18.0, 10.0, 3.0],
        [3.0, -16.0, 36.0, -48.0, 25.0],
    ]
)


@njit(cache=True)
def counting_sort(key, count):
    """Stable order (n,) by `key` (n,) in [0, count), and where in it each key starts (count + 1,)."""
    order = np.empty(key.size, np.int64)
    start = np.zeros(count + 1, np.int64)
    for i in range(key.size):
        start[key[i] + 1] += 1
    for k in range(count):
        start[k + 1] += start[k]
    cursor = start[:-1].copy()
    for i in range(key.size):
        k = key[i]
        order[cursor[k]] = i
        cursor[k] += 1
    return order, start


@njit(cache=True)
def cell_of(x, origin, inverse, count, periodic):
    """Index of the cell that holds x; outside an open axis, or where x is not finite, -1."""
    s = (x - origin) * inverse
    if periodic and not 0.0 <= s < count:
        s -= count * np.floor(s / count)
        if s == count:  # a tiny negative s rounds up to the far edge
            s = 0.0
    return int(s) if 0.0 <= s < count else -1


@njit(cache=True, nogil=True)
def cells_of(begin, end, pos, origin, inverse, shape, periodic, out):
    """Row-major index of the cell that holds each particle (n,), the number of cells where it is off the grid."""
    for i in range(begin, end):
        ix = cell_of(pos[i, 0], origin[0], inverse, shape[0], periodic)
        iy = cell_of(pos[i, 1], origin[1], inverse, shape[1], periodic) if pos.shape[1] == 2 else 0
        out[i] = ix * shape[1] + iy if ix >= 0 and iy >= 0 else shape[0] * shape[1]


@njit(cache=True)
def stencil(x, origin, inverse, count, periodic):
    """The two nodes about x and the weight of the second; (-1, -1, 0) where they are not on the grid."""
    s = (x - origin) * inverse - 0.5
    if periodic and not 0.0 <= s < count:
        s -= count * np.floor(s / count)
        if s == count:
            s = 0.0
    if not 0.0 <= s < (count if periodic else count - 1):
        return -1, -1, 0.0
    low = int(s)
    return low, low + 1 if low + 1 < count else 0, s - low


@njit(cache=True)
def _stencil_y(pos, p, origin, inverse, count, periodic):
    # A run of one dimension has one row of nodes along y, and no weight beyond it.
    if pos.shape[1] == 1:
        return 0, 0, 0.0
    return stencil(pos[p, 1], origin[1], inverse, count, periodic)


@njit(cache=True, nogil=True)
def strip_of(begin, end, pos, origin, inverse, shape, periodic, shift, key):
    """Strip of 2^shift rows that holds each particle's first node (n,); STRIPS for particles off the grid."""
    for p in range(begin, end):
        low = stencil(pos[p, 0], origin[0], inverse, shape[0], periodic)[0]
        inside = low >= 0 and _stencil_y(pos, p, origin, inverse, shape[1], periodic)[0] >= 0
        key[p] = low >> shift if inside else STRIPS  # a shift: dividing took longer than all the rest


@njit(cache=True)
def _deposit_strip(pos, value, members, origin, inverse, shape, periodic, first, out):
    # Blocks are copied first: those reads wait for memory together, and the sums then wait for none.
    x, y, v = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK)
    plane = pos.shape[1] == 2
    for begin in range(0, members.size, BLOCK):
        count = min(BLOCK, members.size - begin)
        for k in range(count):
            p = members[begin + k]
            x[k], y[k], v[k] = pos[p, 0], pos[p, -1], value[p]
        for k in range(count):
            ix, _, wx = stencil(x[k], origin[0], inverse, shape[0], periodic)
            iy, jy, wy = stencil(y[k], origin[1], inverse, shape[1], periodic) if plane else (0, 0, 0.0)
            row, low, high = ix - first, v[k] * (1.0 - wx), v[k] * wx
            out[row, iy] += low * (1.0 - wy)
            out[row, jy] += low * wy
            out[row + 1, iy] += high * (1.0 - wy)
            out[row + 1, jy] += high * wy


@njit(cache=True, nogil=True)
def deposit_strips(begin, end, pos, value, order, start, origin, inverse, periodic, shift, out, beyond):
    """Add `value` (n,) to the nodes of `out` (nx, ny), cloud in cell; order and start sort by strip.

    A strip sums its own rows and, apart, the one after them: `beyond` (strips, ny), for `join_strips`.
    """
    nx, ny = out.shape
    rows = 1 << shift
    for s in range(begin, end):
        first = s * rows
        sums = np.zeros((rows + 1, ny))
        members = order[start[s] : start[s + 1]]
        _deposit_strip(pos, value, members, origin, inverse, out.shape, periodic, first, sums)
        held = max(0, min(rows, nx - first))
        for j in range(ny):
            for r in range(held):
                out[first + r, j] += sums[r, j]
            beyond[s, j] = sums[held, j]


@njit(cache=True)
def join_strips(shift, beyond, out):
    """Add each strip's last row to the next strip, in a fixed order."""
    nx, ny = out.shape
    for s in range(len(beyond)):
        if s << shift < nx:
            row = min((s + 1) << shift, nx) % nx
            for j in range(ny):
                out[row, j] += beyond[s, j]


@njit(cache=True)
def _weighted(field, c, ix, jx, iy, jy, w00, w01, w10, w11):
    low = w00 * field[ix, iy, c] + w01 * field[ix, jy, c]
    return low + w10 * field[jx, iy, c] + w11 * field[jx, jy, c]


@njit(cache=True, nogil=True)
def gather(begin, end, field, pos, origin, inverse, periodic, out):
    """Field (nx, ny, c <= 2) at the particles into out (n, c) with the deposit's weights; 0 off the grid."""
    nx, ny = field.shape[0], field.shape[1]
    for p in range(begin, end):
        ix, jx, wx = stencil(pos[p, 0], origin[0], inverse, nx, periodic)
        iy, jy, wy = _stencil_y(pos, p, origin, inverse, ny, periodic)
        w00, w01, w10, w11 = (1.0 - wx) * (1.0 - wy), (1.0 - wx) * wy, wx * (1.0 - wy), wx * wy
        for c in range(out.shape[1]):
            out[p, c] = 0.0
        if ix >= 0 and iy >= 0:
            out[p, 0] = _weighted(field, 0, ix, jx, iy, jy, w00, w01, w10, w11)
            if out.shape[1] == 2:
                out[p, 1] = _weighted(field, 1, ix, jx, iy, jy, w00, w01, w10, w11)


@njit(cache=True, nogil=True)
def is_outside(begin, end, pos, origin, inverse, shape, periodic, outside):
    """True (n,) for particles whose nodes are not all on the grid."""
    for p in range(begin, end):
        x = stencil(pos[p, 0], origin[0], inverse, shape[0], periodic)[0]
        y = _stencil_y(pos, p, origin, inverse, shape[1], periodic)[0]
        outside[p] = x < 0 or y < 0


@njit(nogil=True, cache=True, error_model="numpy")
def _place(i, count, periodic):
    # Where the five nodes about node i begin, and which of them i is.
    first = i - 2
    if not periodic:
        first = max(0, min(first, count - 5))
    return first, i - first


@njit(nogil=True, cache=True, error_model="numpy")
def gradient(begin, end, potential, cell, periodic, out):
    """Gradient (nx, ny, 2) of `potential` (nx, ny): five nodes, centred but at open edges."""
    nx, ny = potential.shape
    scale = 1.0 / (12.0 * cell)
    a, b = 8.0 * scale, scale
    for i in range(begin, end):
        first, place = _place(i, nx, periodic)
        w = _STENCILS[place]
        w0, w1, w2, w3, w4 = scale * w[0], scale * w[1], scale * w[2], scale * w[3], scale * w[4]
        r0, r1, r2 = potential[first % nx], potential[(first + 1) % nx], potential[(first + 2) % nx]
        r3, r4 = potential[(first + 3) % nx], potential[(first + 4) % nx]
        line, row = potential[i], out[i]
        for j in range(ny - 4):  # both components in one loop, of which no index is negative: it is vectorised
            row[j + 2, 0] = w0 * r0[j + 2] + w1 * r1[j + 2] + w2 * r2[j + 2] + w3 * r3[j + 2] + w4 * r4[j + 2]
            row[j + 2, 1] = a * (line[j + 3] - line[j + 1]) - b * (line[j + 4] - line[j])
        for edge in range(min(4, ny)):
            j = edge if edge < 2 else ny + 1 - edge
            first, place = _place(j, ny, periodic)
            row[j, 0] = w0 * r0[j] + w1 * r1[j] + w2 * r2[j] + w3 * r3[j] + w4 * r4[j]
            row[j, 1] = 0.0
            for k in range(5):
                row[j, 1] += scale * _STENCILS[place, k] * line[(first + k) % ny]


@njit(cache=True)
def largest_norm(vectors):
    """The largest length of the vectors (n, c); 0 without any."""
    largest = 0.0
    for p in range(len(vectors)):
        square = 0.0
        for c in range(vectors.shape[1]):
            square += vectors[p, c] ** 2
        largest = max(largest, square)
    return np.sqrt(largest)
