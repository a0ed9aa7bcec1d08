"""Softened point masses: the gravity of the star and companions on particles, and of particles on these bodies.

Sums over particles are exact (`kernels/common/totals.py`), and therefore bitwise the same on any number of threads.
Kernels return the sums as `limbs`. Kernels process the particles `begin` to `end`.
"""

import math

import numpy as np

from discsim.jit.decorators import INLINE, KERNEL, cached_njit, inline_jit, jit
from discsim.jit.index import index
from discsim.kernels.common.filling import MARGIN, ensure_capacity
from discsim.kernels.common.totals import LIMBS, MAX_TERMS, add_terms

ONE, TWO, THREE, FOUR = index(1), index(2), index(3), index(4)


@inline_jit
def _set_to_zero(begin, end, out):
    """Set the entries `begin` to `end` of `out` (n,) to 0."""
    for i in range(begin, end):
        out[i] = 0.0


@jit
def attract(begin, end, pos, acc, first, mass, softening, x0, y0):
    """Subtract mass d / (d^2 + s^2)^(3/2) from `acc` (n, 2): the gravity of a body at (x0, y0).

    d: offset of a particle from the body; s: softening; mass: G M. With `first`, `acc` is uninitialised on input.
    `acc` is then set to 0 block by block, so that memory is read once.
    """
    flat, out = pos.reshape(-1), acc.reshape(-1)  # strides of two and unsigned indices: vectorised
    for block in range(begin, end, MAX_TERMS):
        number, start = index(min(MAX_TERMS, end - block)), index(block)
        if first:
            _set_to_zero(TWO * start, TWO * (start + number), out)
        for k in range(number):
            i = start + k
            x, y = flat[TWO * i] - x0, flat[TWO * i + ONE] - y0
            d2 = x * x + y * y + softening * softening
            f = mass / (d2 * math.sqrt(d2))
            out[TWO * i] -= f * x
            out[TWO * i + ONE] -= f * y


@jit
def add_to_each(begin, end, vectors, x, y):
    """Add (x, y) to each of the `vectors` (n, 2), in place."""
    out = vectors.reshape(-1)
    for i in range(index(begin), index(end)):
        out[TWO * i] += x
        out[TWO * i + ONE] += y


@jit
def attract_mutually(begin, end, pos, acc, first, mass, pull, softening, x0, y0):
    """Add the gravity of a body as `attract` does, and return the gravity of particles on the body, limbs (2, LIMBS).

    mass (n,): masses of the particles; their gravity on the body is the sum of m d / (d^2 + s^2)^(3/2). pull: G M of
    the body.
    """
    limbs, terms, spare = np.zeros((2, LIMBS), np.int64), np.empty((2, MAX_TERMS)), np.empty((2, MAX_TERMS))
    flat, out = pos.reshape(-1), acc.reshape(-1)
    for block in range(begin, end, MAX_TERMS):
        number, start = min(MAX_TERMS, end - block), index(block)
        if first:
            _set_to_zero(TWO * start, TWO * (start + index(number)), out)
        for k in range(index(number)):
            i = start + k
            x, y = flat[TWO * i] - x0, flat[TWO * i + ONE] - y0
            d2 = x * x + y * y + softening * softening
            d3 = d2 * math.sqrt(d2)
            f, g = pull / d3, mass[i] / d3
            terms[0, k], terms[1, k] = g * x, g * y
            out[TWO * i] -= f * x
            out[TWO * i + ONE] -= f * y
        for column in range(2):
            add_terms(number, terms[column], spare, limbs[column])
    return limbs


@jit
def attract_moving(begin, end, pos, vel, acc, mass, pull, softening, x0, y0, vx0, vy0):
    """Add the gravity of a body as `attract_mutually` does, for a body that moves with velocity (vx0, vy0).

    Returns (limbs, (nearest2, crossing2)): the gravity of the particles on the body, the smallest d^2, and the smallest
    (d^2 + s^2) / v^2, with v the velocity relative to the body.
    """
    limbs, terms, spare = np.zeros((2, LIMBS), np.int64), np.empty((2, MAX_TERMS)), np.empty((2, MAX_TERMS))
    nearest2 = crossing2 = np.inf
    places, motions, out = pos.reshape(-1), vel.reshape(-1), acc.reshape(-1)
    for block in range(begin, end, MAX_TERMS):
        number, start = min(MAX_TERMS, end - block), index(block)
        for k in range(index(number)):
            i = start + k
            x, y = places[TWO * i] - x0, places[TWO * i + ONE] - y0
            vx, vy = motions[TWO * i] - vx0, motions[TWO * i + ONE] - vy0
            square, v2 = x * x + y * y, vx * vx + vy * vy
            d2 = square + softening * softening
            f = 1.0 / (d2 * math.sqrt(d2))
            terms[0, k], terms[1, k] = mass[i] * f * x, mass[i] * f * y
            out[TWO * i] -= pull * f * x
            out[TWO * i + ONE] -= pull * f * y
            nearest2 = min(nearest2, square)
            if d2 < crossing2 * v2:
                crossing2 = d2 / v2
        for column in range(2):
            add_terms(number, terms[column], spare, limbs[column])
    return limbs, (nearest2, crossing2)


@inline_jit
def squared_distance(i, flat, x0, y0):
    """Return the squared distance of position i from (x0, y0); flat: positions (n, 2) as one axis."""
    x, y = flat[TWO * i] - x0, flat[TWO * i + ONE] - y0
    return x * x + y * y


@cached_njit(**INLINE, fastmath={"nnan", "nsz"})
def least_squared_distance(first, last, flat, x0, y0):
    """Return the smallest squared distance of the positions `first` to `last` from (x0, y0); flat: positions, one axis.

    Four minima are computed independently, because each comparison for a single minimum would wait for the
    comparison before.
    """
    one = two = three = four = np.inf
    whole = first + (last - first) // FOUR * FOUR
    for i in range(first, whole, FOUR):
        one = min(one, squared_distance(i, flat, x0, y0))
        two = min(two, squared_distance(i + ONE, flat, x0, y0))
        three = min(three, squared_distance(i + TWO, flat, x0, y0))
        four = min(four, squared_distance(i + THREE, flat, x0, y0))
    for i in range(whole, last):
        one = min(one, squared_distance(i, flat, x0, y0))
    return min(min(one, two), min(three, four))


@jit
def nearest_squared(begin, end, pos, x0, y0):
    """Return the smallest squared distance of positions (n, 2) from (x0, y0); inf if there are none.

    No position may be NaN.
    """
    return least_squared_distance(index(begin), index(end), pos.reshape(-1), x0, y0)


@cached_njit(**KERNEL, fastmath={"nnan", "nsz"})
def split_by_radius(begin, end, pos, squared_radius, x0, y0):
    """Split particles at `pos` (n, 2) by their squared distance from (x0, y0) into those inside and outside a radius.

    Returns the smallest squared distance of the particles outside, and the indices of the particles inside.
    """
    least, inside, count = np.inf, np.empty(MARGIN, np.int64), index(0)
    flat = pos.reshape(-1)
    for block in range(begin, end, MAX_TERMS):
        first, last = index(block), index(min(block + MAX_TERMS, end))
        nearest = least_squared_distance(first, last, flat, x0, y0)
        if nearest < squared_radius:  # in few blocks
            nearest, inside = np.inf, ensure_capacity(inside, count)
            for i in range(first, last):
                d2 = squared_distance(i, flat, x0, y0)
                if d2 < squared_radius:
                    inside[count] = i
                    count += ONE
                else:
                    nearest = min(nearest, d2)
        least = min(least, nearest)
    return least, inside[: np.int64(count)]
