"""Packs: contiguous copies of the data of a cell's candidates, made once for the SPH sums of all its particles.

A pack holds the data of up to CHUNK candidates, and intermediate results that one loop over them passes to the next.
Several short loops over the same candidates are faster than one loop with a long chain of dependent instructions. A
pack is one array; its rows are STRIDE numbers apart, which is known at compile time, so that also loops that write are
vectorised.

A pack, and the sums over its candidates, may be of single precision: twice as many candidates then fit in a register.
Positions and velocities are relative to the cell, and all other data are in units of the gas (`Scale`), so that no
number is too large or too small. The results of all packs are added in double precision.
"""

from typing import NamedTuple

import numpy as np

from discsim.jit.decorators import inline_sums
from discsim.kernels.common.candidates import LANES

NEAREST2 = 1e-30  # least squared distance, in units of the cell's reach: representable in single precision
CHUNK = 256  # largest number of candidates in a pack
STRIDE = CHUNK + 2 * LANES  # not a power of two, or rows would evict each other from the cache
# Rows of a pack. The first ones are also the columns of `write_force_columns`, of which eight fill a cache line.
MASS, INV_H, PRESS, INV_RHO, VX, VY, SOUND, SWITCH, ENERGY, P, FLUIDITY, SXX, SXY, SYY = range(14)
NORM_H, X, Y, INV_R, R, OWN, OTHER = range(SYY + 1, SYY + 8)
ROWS = OTHER + 1


class Scale(NamedTuple):
    """Units of packs. The units are powers of two, so that a division by them is exact."""

    mass: float
    length: float
    speed: float


@inline_sums
def inverse_sqrt(single, x):
    """Return 1 / sqrt(x), accurate to rounding, for x in single precision if `single`, else in double precision.

    The value in double precision is that of single precision with one correction, which is faster.
    """
    if single:
        return np.float32(1.0) / np.sqrt(x)
    y = np.float64(np.float32(1.0) / np.sqrt(np.float32(x)))
    e = 1.0 - x * y * y
    return y + y * e * (0.5 + 0.375 * e)


@inline_sums
def relative(dim, vector, i, ox, oy, factor):
    """Return x and y of (vector[i] - (ox, oy)) * factor, for `vector` (n, d); y is 0 in 1D."""
    return (vector[i, 0] - ox) * factor, (vector[i, 1] - oy) * factor if dim == 2 else 0.0


@inline_sums
def clear(sums, members):
    """Set the first `members` rows of `sums` (>= members, k) to 0."""
    for p in range(members):
        for k in range(sums.shape[1]):
            sums[p, k] = 0.0
