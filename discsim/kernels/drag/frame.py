"""Kepler frame: circular motion about the star that drag cells subtract from velocities, eq. (1) of `drag/frame.py`."""

import math
from typing import NamedTuple

import numpy as np

from discsim.jit.decorators import jit, jit_subroutine
from discsim.jit.index import index
from discsim.kernels.common.simd import sqrt


class Frame(NamedTuple):
    """Circular motion about the star, which is subtracted from velocities.

    star, softening: mass and softening length of the star; without a star the mass is 0. sense: sense of rotation
    sigma, one number if it is the same everywhere, else one number per ring. low, rings_per_unit: ring i extends in
    ln r^2 from low + i / rings_per_unit to low + (i + 1) / rings_per_unit.
    """

    star: float
    softening: float
    low: float
    rings_per_unit: float
    sense: np.ndarray


@jit
def multiples_of(ids, every):
    """Return the indices at which `ids` (n,) is a multiple of `every`, a power of two."""
    mask, count = every - 1, 0
    out = np.empty(len(ids), np.int64)  # few entries are written, so most of this memory is never touched
    for i in range(index(len(ids))):
        if (ids[i] & mask) == 0:
            out[count] = i
            count += 1
    return out[:count].copy()


@jit
def orbital_frequency(r2, star, softening):
    """Return the Keplerian Omega about a softened star at squared radius r2, a number or a vector of simd.py."""
    d2 = r2 + softening * softening
    return sqrt(star / (d2 * sqrt(d2)))


@jit_subroutine
def rotation_sign(r2, frame):
    """Return the sense of rotation sigma at squared radius r2, interpolated between the centres of rings."""
    sense = frame.sense
    if len(sense) == 1:
        return sense[0]
    place = min(max((math.log(r2) - frame.low) * frame.rings_per_unit - 0.5, 0.0), len(sense) - 1.0)
    ring = min(int(place), len(sense) - 2)
    return sense[ring] + (place - ring) * (sense[ring + 1] - sense[ring])
