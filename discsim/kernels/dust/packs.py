"""Packs for sums over the dust particles near gas particles, and over the gas particles near dust particles.

Dust particles are called grains. Packs are like those of `kernels/sph/packs.py`, but in double precision and in code
units. W = W(r, h) is the smoothing kernel of a gas particle; it is 0 beyond its support. Sums include all candidates of
a cell, as a loop that skips some of them would not be vectorised.
"""

import math

from numba import njit

from discsim.jit.decorators import INLINE, cached_njit
from discsim.jit.index import index
from discsim.kernels.common.candidates import pack_positions, padded_count
from discsim.kernels.sph.packs import STRIDE
from discsim.kernels.sph.smoothing import NORM, shape

# Rows of a pack: positions; 1/h and the norm of W of gas particles; distances, W, and (dW/dr) / r. Each kind of sum has
# more rows, from FIRST_FREE on.
X, Y, INV_H, NORM_W, R, W, STEEP, FIRST_FREE = range(8)


@njit(inline="always")
def max_members(first, last, cells):
    """Return the largest number of particles in one of the filled cells `first` to `last`."""
    most = 0
    for cell in cells.filled[first:last]:
        most = max(most, cells.start[cell + 1] - cells.start[cell])
    return most


@njit(inline="always")
def members_and_centre(c, cells):
    """Return the first particle of the c-th filled cell in cell order, the number of its particles, and its centre."""
    cell = cells.filled[c]
    own = cells.start[cell]
    return own, cells.start[cell + 1] - own, cells.bounds[cell, 0], cells.bounds[cell, 1]


@njit(inline="always")
def add_values(values, first, sums):
    """Add a tuple of numbers to the entries of `sums` (n,) from entry `first` on."""
    for k in range(len(values)):
        sums[first + k] += values[k]


@njit(inline="always")
def pack_padded_positions(c, begin, end, lists, ox, oy, cells, pack):
    """Write the positions, relative to (ox, oy), of the candidates `begin` to `end` of the c-th cell to `pack`.

    Returns the number of candidates, rounded up to whole vectors.
    """
    pack_positions(c, begin, end, lists, ox, oy, 1.0, cells, pack[X * STRIDE :], pack[Y * STRIDE :])
    return padded_count(end - begin)


@njit(inline="always")
def pack_column(begin, end, indices, order, values, row, pack):
    """Write `values` (n,) of the candidates `begin` to `end` to a row of `pack`; 0 for padding."""
    first, count = index(begin), index(end - begin)
    for k in range(count):
        pack[row * STRIDE + k] = values[order[indices[first + k]]]
    for k in range(count, index(padded_count(end - begin))):
        pack[row * STRIDE + k] = 0.0


@njit(inline="always")
def pack_kernels(kernel, dim, begin, end, indices, order, h, pack):
    """Write 1/h and the norm of W of gas particles to `pack`; the norm is 0 for padding, and then so is W."""
    first, count = index(begin), index(end - begin)
    for k in range(count):
        inverse = 1.0 / h[order[indices[first + k]]]
        pack[INV_H * STRIDE + k] = inverse
        pack[NORM_W * STRIDE + k] = NORM[dim - 1][kernel] * (inverse * inverse if dim == 2 else inverse)
    for k in range(count, index(padded_count(end - begin))):
        pack[NORM_W * STRIDE + k] = 0.0


@njit(inline="always")
def pack_weights(kernel, dim, x, y, n, pack):
    """Write to `pack` the distances of its n gas particles from (x, y), and the W and (dW/dr) / r of each at (x, y)."""
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
    """Write to `pack` w(q), W without its norm, of one gas particle at (x, y) in 2D, at each of n packed grains.

    inverse: 1/h of the gas particle.
    """
    for k in range(n):
        dx, dy = x - pack[X * STRIDE + k], y - pack[Y * STRIDE + k]
        pack[W * STRIDE + k] = shape(kernel, 2, math.sqrt(dx * dx + dy * dy) * inverse)[0]


@njit(inline="always")
def weighted_sum(n, row, pack):
    """Return the sum of a row of `pack` over its n candidates, weighted by the row W."""
    total = 0.0
    for k in range(n):
        total += pack[W * STRIDE + k] * pack[row * STRIDE + k]
    return total


@cached_njit(**INLINE, fastmath={"nnan", "nsz"})  # vectorised, as NaN is excluded
def largest_distance(n, pack):
    """Return the largest distance of a gas particle with W > 0, among n packed ones."""
    far = 0.0
    for k in range(index(n)):
        far = max(far, pack[R * STRIDE + k] if pack[W * STRIDE + k] > 0.0 else 0.0)
    return far
