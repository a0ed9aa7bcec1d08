"""Packs: what SPH sums read of a cell's candidates, packed once, relative to the cell's centre, for all its particles.

A pack holds what sums read of up to CHUNK candidates, and what their loops hand on to each other: a long chain of
instructions keeps a processor waiting, where some short loops over the same candidates do not. Its rows are of one
array, and the distance between them is known when it is compiled: so loops that write are vectorised too.

A pack may be of single precision, and the sums over its chunk with it: twice as many candidates fit in a register. It
holds places and velocities from the cell's own, and all else in units of the gas (`Scale`), so that no number is too
large or small. Sums over chunks, and all that is done with them, are of double precision.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from discsim.kernels.neighbours import LANES

NEAREST2 = 1e-30  # least square of a distance, in units of the cell's reach: single precision has to hold it
CHUNK = 256
SINGLES = 8  # numbers of single precision in a vector of 256 bits, as compilers choose it
STRIDE = CHUNK + 2 * LANES  # no power of two: rows would push each other out of the cache
# Columns of `force_columns` too: the first eight are of one cache line.
MASS, INV_H, PRESS, INV_RHO, VX, VY, SOUND, SWITCH, ENERGY, P, FLUIDITY, SXX, SXY, SYY = range(14)
NORM_H, X, Y, INV_R, R, OWN, OTHER = range(SYY + 1, SYY + 8)
ROWS = OTHER + 1


class Scale(NamedTuple):
    """Units of packs: powers of two, by which nothing is rounded."""

    mass: float
    length: float
    speed: float


@njit(inline="always")
def all_of(n):
    """n candidates in single precision, filled up to whole vectors: half of one left over would be added apart, slowly.

    At most whole(n) + LANES: so far a pack is filled up with candidates of no mass.
    """
    return (n + SINGLES - 1) & -SINGLES


@njit(inline="always")
def inverse_root(single, x):
    """1 / sqrt(x) to rounding: a guess in single precision, for which there is an instruction, and one step."""
    if single:
        return np.float32(1.0) / np.sqrt(x)
    y = np.float64(np.float32(1.0) / np.sqrt(np.float32(x)))
    e = 1.0 - x * y * y
    return y + y * e * (0.5 + 0.375 * e)


@njit(inline="always")
def relative(dim, vector, i, ox, oy, factor):
    """The vector (n, d) of particle i, less (ox, oy) and times a factor; y is 0 in one dimension."""
    return (vector[i, 0] - ox) * factor, (vector[i, 1] - oy) * factor if dim == 2 else 0.0


@njit(inline="always")
def clear(sums, members):
    """Let the sums (members, n) of a cell's particles begin at 0."""
    for p in range(members):
        for k in range(sums.shape[1]):
            sums[p, k] = 0.0
