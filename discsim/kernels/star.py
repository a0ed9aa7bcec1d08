"""Attraction of a softened point mass at the origin."""

import math

import numpy as np
from numba import njit


@njit(nogil=True, cache=True, error_model="numpy")
def attract(begin, end, pos, acc, mass, softening):
    """acc -= G M r / (r^2 + s^2)^(3/2), arrays (n, 2)."""
    for i in range(begin, end):
        x, y = pos[i, 0], pos[i, 1]
        d2 = x * x + y * y + softening * softening
        f = mass / (d2 * math.sqrt(d2))
        acc[i, 0] -= f * x
        acc[i, 1] -= f * y


@njit(nogil=True, cache=True, error_model="numpy")
def nearest(pos):
    """Least squared distance of positions (n, 2) from the origin, inf where there are none."""
    least = np.inf
    for i in range(len(pos)):
        least = min(least, pos[i, 0] * pos[i, 0] + pos[i, 1] * pos[i, 1])
    return least
