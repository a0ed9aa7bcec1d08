"""Circles about the star, which velocities in drag cells are relative to: eq. (1) of `drag/frame.py`."""

import math
from typing import NamedTuple

import numpy as np

from discsim.jit.decorators import compiled, subroutine
from discsim.kernels.rows import root


class Frame(NamedTuple):
    """`sense` has one entry where all turn alike, else one a ring, of which `per_ring` lie in a unit of ln r^2."""

    star: float
    softening: float
    low: float
    per_ring: float
    sense: np.ndarray


@compiled
def multiples_of(ids, every):
    """Rows of those of `ids` (n,) that are whole multiples of `every`, a power of two: few."""
    mask, count = every - 1, 0
    out = np.empty(len(ids), np.int64)  # of which little is touched
    for i in range(np.uint64(len(ids))):
        if (ids[i] & mask) == 0:
            out[count] = i
            count += 1
    return out[:count].copy()


@compiled
def kepler(r2, star, softening):
    """Omega about a softened star at squared radius r2, or a row of them."""
    d2 = r2 + softening * softening
    return root(star / (d2 * root(d2)))


@subroutine
def sense_at(r2, frame):
    """sigma at squared radius r2, between the middles of rings."""
    sense = frame.sense
    if len(sense) == 1:
        return sense[0]
    at = min(max((math.log(r2) - frame.low) * frame.per_ring - 0.5, 0.0), len(sense) - 1.0)
    ring = min(int(at), len(sense) - 2)
    return sense[ring] + (at - ring) * (sense[ring + 1] - sense[ring])
