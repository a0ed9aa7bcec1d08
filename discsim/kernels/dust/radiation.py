"""Radiation pressure of the star on dust: acc += beta G M r / (r^2 + s^2)^(3/2)."""

import math

from discsim.jit.decorators import jit


@jit
def push(begin, end, pos, species, strength, softening, acc):
    """Add the radiation pressure to the accelerations (n, 2) of grains.

    strength (populations,): beta G M of each population.
    """
    for i in range(begin, end):
        x, y = pos[i, 0], pos[i, 1]
        d2 = x * x + y * y + softening * softening
        f = strength[species[i]] / (d2 * math.sqrt(d2))
        acc[i, 0] += f * x
        acc[i, 1] += f * y
