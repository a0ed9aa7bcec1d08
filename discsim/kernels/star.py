"""Softened point masses: the pull of the star and of companions on particles, and what the particles pull with.

Sums over particles are made in blocks of BLOCK of them, and added in order: the same bits on any number of threads.
"""

import math

import numpy as np
from numba import njit

ONE, TWO = np.uint64(1), np.uint64(2)
BLOCK = 4096


@njit(nogil=True, cache=True, error_model="numpy")
def attract(begin, end, pos, acc, mass, softening, x0, y0):
    """acc -= G M d / (d^2 + s^2)^(3/2), arrays (n, 2), d the way from (x0, y0)."""
    flat, out = pos.reshape(-1), acc.reshape(-1)  # steps of two and unsigned numbers: vectorised
    for i in range(np.uint64(begin), np.uint64(end)):
        x, y = flat[TWO * i] - x0, flat[TWO * i + ONE] - y0
        d2 = x * x + y * y + softening * softening
        f = mass / (d2 * math.sqrt(d2))
        out[TWO * i] -= f * x
        out[TWO * i + ONE] -= f * y


@njit(nogil=True, cache=True, error_model="numpy")
def add(begin, end, vectors, x, y):
    """Add (x, y) to vectors (n, 2)."""
    out = vectors.reshape(-1)
    for i in range(np.uint64(begin), np.uint64(end)):
        out[TWO * i] += x
        out[TWO * i + ONE] += y


@njit(nogil=True, cache=True, error_model="numpy")
def pull_of(block_begin, block_end, pos, mass, softening, x0, y0, sums):
    """What particles give to a point at (x0, y0): sum m d / (d^2 + s^2)^(3/2) into the sums (blocks, 2)."""
    for block in range(block_begin, block_end):
        ax = ay = 0.0
        for i in range(block * BLOCK, min((block + 1) * BLOCK, len(mass))):
            x, y = pos[i, 0] - x0, pos[i, 1] - y0
            d2 = x * x + y * y + softening * softening
            f = mass[i] / (d2 * math.sqrt(d2))
            ax += f * x
            ay += f * y
        sums[block, 0], sums[block, 1] = ax, ay


@njit(nogil=True, cache=True, error_model="numpy")
def attract_both(block_begin, block_end, pos, vel, acc, mass, pull, softening, x0, y0, vx0, vy0, sums):
    """`attract` by a mass `pull` that moves with (vx0, vy0), and `pull_of`, at once.

    The sums (blocks, 4) get the least d^2, and the least (d^2 + s^2) / v^2, v the relative velocity, too.
    """
    for block in range(block_begin, block_end):
        ax = ay = 0.0
        nearest2 = crossing2 = np.inf
        for i in range(block * BLOCK, min((block + 1) * BLOCK, len(mass))):
            x, y = pos[i, 0] - x0, pos[i, 1] - y0
            vx, vy = vel[i, 0] - vx0, vel[i, 1] - vy0
            square, v2 = x * x + y * y, vx * vx + vy * vy
            d2 = square + softening * softening
            f = 1.0 / (d2 * math.sqrt(d2))
            ax += mass[i] * f * x
            ay += mass[i] * f * y
            acc[i, 0] -= pull * f * x
            acc[i, 1] -= pull * f * y
            nearest2 = min(nearest2, square)
            if d2 < crossing2 * v2:
                crossing2 = d2 / v2
        sums[block, 0], sums[block, 1], sums[block, 2], sums[block, 3] = ax, ay, nearest2, crossing2


@njit(nogil=True, cache=True, error_model="numpy", fastmath={"nnan", "nsz"})
def nearest(begin, end, pos, x0, y0):
    """Least squared distance of positions (n, 2) from (x0, y0), inf where there are none; they must be numbers."""
    least = np.inf
    flat = pos.reshape(-1)
    for i in range(np.uint64(begin), np.uint64(end)):
        x, y = flat[TWO * i] - x0, flat[TWO * i + ONE] - y0
        least = min(least, x * x + y * y)
    return least


@njit(nogil=True, cache=True, error_model="numpy", fastmath={"nnan", "nsz"})
def divide(begin, end, pos, squared, inside, x0, y0):
    """Note which positions (n, 2) are nearer to (x0, y0) than a distance that is given squared; returns the least
    squared distance of the others.
    """
    least = np.inf
    flat = pos.reshape(-1)
    for i in range(np.uint64(begin), np.uint64(end)):
        x, y = flat[TWO * i] - x0, flat[TWO * i + ONE] - y0
        d2 = x * x + y * y
        inside[i] = d2 < squared
        least = min(least, d2 if d2 >= squared else np.inf)
    return least
