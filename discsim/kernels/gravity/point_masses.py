"""Softened point masses: the pull of the star and of companions on particles, and the pull of particles on them.

Sums over particles are exact (`kernels/common/totals.py`): the same bits on any number of threads.
"""

import math

import numpy as np

from discsim.jit.decorators import INLINE, KERNEL, inline_jit, jit, kept
from discsim.jit.index import index
from discsim.kernels.common.filling import SOME as ROOM
from discsim.kernels.common.filling import with_room
from discsim.kernels.common.totals import LIMBS, SOME, add_some

ONE, TWO, THREE, FOUR = index(1), index(2), index(3), index(4)


@inline_jit
def blank(begin, end, out):
    for i in range(begin, end):
        out[i] = 0.0


@jit
def attract(begin, end, pos, acc, first, mass, softening, x0, y0):
    """Subtract G M d / (d^2 + s^2)^(3/2) from `acc` (n, 2), with d the offset from (x0, y0).

    With `first`, `acc` is uninitialised and is set to 0 before, block by block, so that memory is read once.
    """
    flat, out = pos.reshape(-1), acc.reshape(-1)  # strides of two and unsigned indices: vectorised
    for block in range(begin, end, SOME):
        number, start = index(min(SOME, end - block)), index(block)
        if first:
            blank(TWO * start, TWO * (start + number), out)
        for k in range(number):
            i = start + k
            x, y = flat[TWO * i] - x0, flat[TWO * i + ONE] - y0
            d2 = x * x + y * y + softening * softening
            f = mass / (d2 * math.sqrt(d2))
            out[TWO * i] -= f * x
            out[TWO * i + ONE] -= f * y


@jit
def add(begin, end, vectors, x, y):
    """Add (x, y) to vectors (n, 2)."""
    out = vectors.reshape(-1)
    for i in range(index(begin), index(end)):
        out[TWO * i] += x
        out[TWO * i + ONE] += y


@jit
def attract_mutually(begin, end, pos, acc, first, mass, pull, softening, x0, y0):
    """Apply `attract` by a mass `pull`, and return the limbs (2, LIMBS) of the pull back.

    The pull back is sum m d / (d^2 + s^2)^(3/2).
    """
    limbs, terms, spare = np.zeros((2, LIMBS), np.int64), np.empty((2, SOME)), np.empty((2, SOME))
    flat, out = pos.reshape(-1), acc.reshape(-1)
    for block in range(begin, end, SOME):
        number, start = min(SOME, end - block), index(block)
        if first:
            blank(TWO * start, TWO * (start + index(number)), out)
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
            add_some(number, terms[column], spare, limbs[column])
    return limbs


@jit
def attract_moving(begin, end, pos, vel, acc, mass, pull, softening, x0, y0, vx0, vy0):
    """Apply `attract_mutually` by a mass that moves with (vx0, vy0).

    Returns the limbs of the pull back, and the least d^2 and the least (d^2 + s^2) / v^2, v the relative velocity.
    """
    limbs, terms, spare = np.zeros((2, LIMBS), np.int64), np.empty((2, SOME)), np.empty((2, SOME))
    nearest2 = crossing2 = np.inf
    places, motions, out = pos.reshape(-1), vel.reshape(-1), acc.reshape(-1)
    for block in range(begin, end, SOME):
        number, start = min(SOME, end - block), index(block)
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
            add_some(number, terms[column], spare, limbs[column])
    return limbs, (nearest2, crossing2)


@inline_jit
def squared(i, flat, x0, y0):
    """Return the squared distance of position i from (x0, y0)."""
    x, y = flat[TWO * i] - x0, flat[TWO * i + ONE] - y0
    return x * x + y * y


@kept(**INLINE, fastmath={"nnan", "nsz"})
def least_squared(first, last, flat, x0, y0):
    """Return the least squared distance of positions `first` to `last`.

    Four minima at once avoid a chain of dependencies.
    """
    one = two = three = four = np.inf
    whole = first + (last - first) // FOUR * FOUR
    for i in range(first, whole, FOUR):
        one = min(one, squared(i, flat, x0, y0))
        two = min(two, squared(i + ONE, flat, x0, y0))
        three = min(three, squared(i + TWO, flat, x0, y0))
        four = min(four, squared(i + THREE, flat, x0, y0))
    for i in range(whole, last):
        one = min(one, squared(i, flat, x0, y0))
    return min(min(one, two), min(three, four))


@jit
def nearest(begin, end, pos, x0, y0):
    """Return the least squared distance of positions (n, 2) from (x0, y0), inf for none; they must not be NaN."""
    return least_squared(index(begin), index(end), pos.reshape(-1), x0, y0)


@kept(**KERNEL, fastmath={"nnan", "nsz"})
def split_by_radius(begin, end, pos, squared_radius, x0, y0):
    """Divide positions (n, 2) by a squared radius about (x0, y0).

    Returns the least squared distance of those outside, and the indices of those inside.
    """
    least, inside, count = np.inf, np.empty(ROOM, np.int64), index(0)
    flat = pos.reshape(-1)
    for block in range(begin, end, SOME):
        first, last = index(block), index(min(block + SOME, end))
        here = least_squared(first, last, flat, x0, y0)
        if here < squared_radius:  # in few blocks
            here, inside = np.inf, with_room(inside, count)
            for i in range(first, last):
                d2 = squared(i, flat, x0, y0)
                if d2 < squared_radius:
                    inside[count] = i
                    count += ONE
                else:
                    here = min(here, d2)
        least = min(least, here)
    return least, inside[: np.int64(count)]
