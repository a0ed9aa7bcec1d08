"""Packs for sums of gas particles over grains, and of grains over gas particles.

Like the packs of `kernels/sph/packs.py`, but of double precision and in code units. A kernel is 0 beyond its support,
so sums take all candidates: a loop that skips some is not vectorised.
"""

import math

from numba import njit

from discsim.jit.decorators import INLINE, kept
from discsim.jit.index import index
from discsim.kernels.common.candidates import pack_positions
from discsim.kernels.common.neighbours import whole
from discsim.kernels.sph.packs import STRIDE
from discsim.kernels.sph.smoothing import NORM, shape

# Rows of a pack: positions, and of gas particles 1/h and the norm of W; distances, W, and (dW/dr) / r; then the rows
# of each kind of sum, from BROUGHT on.
X, Y, INV_H, NORM_W, R, W, STEEP, BROUGHT = range(8)


@njit(inline="always")
def most_members(first, last, filled, start):
    """Return the largest number of particles in one of the cells filled[first:last]."""
    most = 0
    for c in range(first, last):
        most = max(most, start[filled[c] + 1] - start[filled[c]])
    return most


@njit(inline="always")
def pack_places(c, begin, end, lists, ox, oy, cells, pack):
    """Pack the positions of the candidates `begin` to `end` of the c-th cell, from (ox, oy); return their number with
    padding.
    """
    pack_positions(c, begin, end, lists, ox, oy, 1.0, cells, pack[X * STRIDE :], pack[Y * STRIDE :])
    return whole(end - begin)


@njit(inline="always")
def pack_column(begin, end, slots, order, values, row, pack):
    """Pack the `values` (n,) of candidates into a row; 0 for padding."""
    first, count = index(begin), index(end - begin)
    for k in range(count):
        pack[row * STRIDE + k] = values[order[slots[first + k]]]
    for k in range(count, index(whole(end - begin))):
        pack[row * STRIDE + k] = 0.0


@njit(inline="always")
def pack_kernels(kernel, dim, begin, end, slots, order, h, pack):
    """Pack 1/h and the norm of W of gas particles; the norm is 0 for padding."""
    first, count = index(begin), index(end - begin)
    for k in range(count):
        inverse = 1.0 / h[order[slots[first + k]]]
        pack[INV_H * STRIDE + k] = inverse
        pack[NORM_W * STRIDE + k] = NORM[dim - 1][kernel] * (inverse * inverse if dim == 2 else inverse)
    for k in range(count, index(whole(end - begin))):
        pack[NORM_W * STRIDE + k] = 0.0


@njit(inline="always")
def pack_weights(kernel, dim, x, y, n, pack):
    """Pack the distances of n gas particles from (x, y), and the W and (dW/dr) / r of each at (x, y)."""
    for k in range(n):
        dx, dy = x - pack[X * STRIDE + k], y - pack[Y * STRIDE + k]
        pack[R * STRIDE + k] = math.sqrt(dx * dx + dy * dy)
    for k in range(n):
        r, inverse, norm = pack[R * STRIDE + k], pack[INV_H * STRIDE + k], pack[NORM_W * STRIDE + k]
        w, dw = shape(kernel, dim, r * inverse)
        pack[W * STRIDE + k] = norm * w
        pack[STEEP * STRIDE + k] = norm * inverse * dw / max(r, 1e-300)


@njit(inline="always")
def pack_own_weights(kernel, x, y, inverse, n, pack):
    """Pack w(q), W without its norm, of a gas particle at (x, y) in two dimensions, at n grains; `inverse` is 1/h."""
    for k in range(n):
        dx, dy = x - pack[X * STRIDE + k], y - pack[Y * STRIDE + k]
        pack[W * STRIDE + k] = shape(kernel, 2, math.sqrt(dx * dx + dy * dy) * inverse)[0]


@njit(inline="always")
def weighed(n, row, pack):
    """Return the sum of a row over n candidates, weighted by the packed W."""
    total = 0.0
    for k in range(n):
        total += pack[W * STRIDE + k] * pack[row * STRIDE + k]
    return total


@kept(**INLINE, fastmath={"nnan", "nsz"})  # vectorised, as NaN is excluded
def farthest(n, pack):
    """Return the largest distance of the n packed gas particles with W > 0."""
    far = 0.0
    for k in range(index(n)):
        far = max(far, pack[R * STRIDE + k] if pack[W * STRIDE + k] > 0.0 else 0.0)
    return far
