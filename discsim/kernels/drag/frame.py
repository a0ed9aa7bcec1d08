"""Circular orbits about the star, relative to which drag cells take velocities: eq. (1) of `drag/frame.py`."""

import math
from typing import NamedTuple

import numpy as np

from discsim.jit.decorators import jit, jit_subroutine
from discsim.jit.index import index
from discsim.kernels.common.simd import sqrt


class Frame(NamedTuple):
    """Sense of rotation about the star: `sense` has one entry if it is the same everywhere, else one per ring.

    The first ring begins at ln r^2 = `low`, and `per_ring` rings lie in a unit of ln r^2.
    """

    star: float
    softening: float
    low: float
    per_ring: float
    sense: np.ndarray


@jit
def multiples_of(ids, every):
    """Return the rows of `ids` (n,) that hold whole multiples of `every`, a power of two."""
    mask, count = every - 1, 0
    out = np.empty(len(ids), np.int64)  # few rows qualify, so most of its memory stays untouched
    for i in range(index(len(ids))):
        if (ids[i] & mask) == 0:
            out[count] = i
            count += 1
    return out[:count].copy()


@jit
def kepler(r2, star, softening):
    """Return Omega about a softened star at squared radius r2, a number or a row of `kernels/common/simd.py`."""
    d2 = r2 + softening * softening
    return sqrt(star / (d2 * sqrt(d2)))


@jit_subroutine
def sense_at(r2, frame):
    """Return sigma at squared radius r2, interpolated between ring centres."""
    sense = frame.sense
    if len(sense) == 1:
        return sense[0]
    at = min(max((math.log(r2) - frame.low) * frame.per_ring - 0.5, 0.0), len(sense) - 1.0)
    ring = min(int(at), len(sense) - 2)
    return sense[ring] + (at - ring) * (sense[ring + 1] - sense[ring])
