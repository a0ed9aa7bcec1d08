"""Packs: the data of a cell's candidates for SPH sums, packed once for all particles of the cell.

A pack holds the data of up to CHUNK candidates, and the results that one loop over them passes to the next. Several
short loops over the same candidates are faster than one with a long chain of dependent instructions. The rows of a
pack are parts of one array at a distance known at compile time, so that loops that write are vectorised too.

A pack may be of single precision, with the sums over its chunk: twice as many candidates fit in a register. Positions
and velocities are relative to the cell, and all else is in units of the gas (`Scale`): no number is too large or too
small. Sums over chunks, and all further steps, are of double precision.
"""

from typing import NamedTuple

import numpy as np

from discsim.jit.decorators import inline_sums
from discsim.kernels.common.neighbours import LANES

NEAREST2 = 1e-30  # least squared distance, in units of the cell's reach: representable in single precision
CHUNK = 256
SINGLES = 8  # numbers of single precision in a vector of 256 bits, the size that compilers choose
STRIDE = CHUNK + 2 * LANES  # not a power of two: rows would evict each other from the cache
# Also the columns of `force_columns`: the first eight fill one cache line.
MASS, INV_H, PRESS, INV_RHO, VX, VY, SOUND, SWITCH, ENERGY, P, FLUIDITY, SXX, SXY, SYY = range(14)
NORM_H, X, Y, INV_R, R, OWN, OTHER = range(SYY + 1, SYY + 8)
ROWS = OTHER + 1


class Scale(NamedTuple):
    """Units of packs: powers of two, which round nothing."""

    mass: float
    length: float
    speed: float


@inline_sums
def all_of(n):
    """Return n candidates in single precision, rounded up to whole vectors: a remainder of half a vector is slow.

    The result is at most whole(n) + LANES, to which packs are padded with candidates of no mass.
    """
    return (n + SINGLES - 1) & -SINGLES


@inline_sums
def inverse_root(single, x):
    """Return 1 / sqrt(x) to rounding.

    In double precision it is the processor's single-precision estimate with one correction.
    """
    if single:
        return np.float32(1.0) / np.sqrt(x)
    y = np.float64(np.float32(1.0) / np.sqrt(np.float32(x)))
    e = 1.0 - x * y * y
    return y + y * e * (0.5 + 0.375 * e)


@inline_sums
def relative(dim, vector, i, ox, oy, factor):
    """Return the vector (n, d) of particle i, less (ox, oy) and times a factor; y is 0 in one dimension."""
    return (vector[i, 0] - ox) * factor, (vector[i, 1] - oy) * factor if dim == 2 else 0.0


@inline_sums
def clear(sums, members):
    """Set the sums (members, n) of a cell's particles to 0."""
    for p in range(members):
        for k in range(sums.shape[1]):
            sums[p, k] = 0.0
