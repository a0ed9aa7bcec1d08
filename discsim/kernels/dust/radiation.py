"""Radiation pressure of the star on dust: an acceleration beta G M r / (r^2 + s^2)^(3/2)."""

import math

from discsim.jit.decorators import jit


@jit
def add_radiation_pressure(begin, end, pos, species, strength, softening, acc):
    """Add the radiation pressure to the accelerations `acc` (n, 2) of dust particles.

    pos (n, 2): positions relative to the star. species (n,): population of each particle. strength (populations,): beta
    G M of each population. softening: s.
    """
    for i in range(begin, end):
        x, y = pos[i, 0], pos[i, 1]
        d2 = x * x + y * y + softening * softening
        f = strength[species[i]] / (d2 * math.sqrt(d2))
        acc[i, 0] += f * x
        acc[i, 1] += f * y
