"""Attraction of a softened point mass at the origin."""

import math

import numpy as np
from numba import njit

ONE, TWO = np.uint64(1), np.uint64(2)


@njit(nogil=True, cache=True, error_model="numpy")
def attract(begin, end, pos, acc, mass, softening):
    """acc -= G M r / (r^2 + s^2)^(3/2), arrays (n, 2)."""
    flat, out = pos.reshape(-1), acc.reshape(-1)  # steps of two and unsigned numbers: vectorised
    for i in range(np.uint64(begin), np.uint64(end)):
        x, y = flat[TWO * i], flat[TWO * i + ONE]
        d2 = x * x + y * y + softening * softening
        f = mass / (d2 * math.sqrt(d2))
        out[TWO * i] -= f * x
        out[TWO * i + ONE] -= f * y


@njit(nogil=True, cache=True, error_model="numpy", fastmath={"nnan", "nsz"})
def nearest(begin, end, pos):
    """Least squared distance of positions (n, 2) from the origin, inf where there are none; they must be numbers."""
    least = np.inf
    flat = pos.reshape(-1)
    for i in range(np.uint64(begin), np.uint64(end)):
        x, y = flat[TWO * i], flat[TWO * i + ONE]
        least = min(least, x * x + y * y)
    return least


@njit(nogil=True, cache=True, error_model="numpy", fastmath={"nnan", "nsz"})
def divide(begin, end, pos, squared, inside):
    """Note which positions (n, 2) are nearer to the origin than a distance that is given squared; returns the least
    squared distance of the others.
    """
    least = np.inf
    flat = pos.reshape(-1)
    for i in range(np.uint64(begin), np.uint64(end)):
        x, y = flat[TWO * i], flat[TWO * i + ONE]
        d2 = x * x + y * y
        inside[i] = d2 < squared
        least = min(least, d2 if d2 >= squared else np.inf)
    return least
