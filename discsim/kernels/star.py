"""Attraction of a softened point mass at the origin."""

import math

import numpy as np
from numba import njit


@njit(nogil=True, cache=True, error_model="numpy")
def attract(begin, end, pos, acc, mass, softening):
    """acc -= G M r / (r^2 + s^2)^(3/2), arrays (n, 2)."""
    flat, out = pos.reshape(-1), acc.reshape(-1)  # pairs at a known distance: vectorised
    for i in range(np.uint64(begin), np.uint64(end)):
        x, y = flat[2 * i], flat[2 * i + 1]
        d2 = x * x + y * y + softening * softening
        f = mass / (d2 * math.sqrt(d2))
        out[2 * i] -= f * x
        out[2 * i + 1] -= f * y


@njit(cache=True, error_model="numpy", fastmath={"nnan", "nsz"})
def nearest(pos):
    """Least squared distance of positions (n, 2) from the origin, inf where there are none; they must be numbers."""
    least = np.inf
    flat = pos.reshape(-1)
    for i in range(np.uint64(len(pos))):
        least = min(least, flat[2 * i] * flat[2 * i] + flat[2 * i + 1] * flat[2 * i + 1])
    return least


@njit(nogil=True, cache=True)
def within(begin, end, pos, squared, out):
    """Which positions (n, 2) are nearer to the origin than a distance that is given squared."""
    flat = pos.reshape(-1)
    for i in range(np.uint64(begin), np.uint64(end)):
        out[i] = flat[2 * i] * flat[2 * i] + flat[2 * i + 1] * flat[2 * i + 1] < squared
