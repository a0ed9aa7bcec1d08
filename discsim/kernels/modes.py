"""Modes of gas and several populations that it drags: how their slips decay together.

With e_j = M_j / M_g and x_j = 1 / t_j, eq. (1) of `kernels/drag.py` leaves the barycentre at rest, and has for each x_j
a mode that decays at a rate lambda of which

    F(lambda) = 1 + sum_j e_j x_j / (x_j - lambda) = 0,                                                   (1)

one above each x_j and below the next. In it populations have v_j = x_j / (x_j - lambda) where the gas has 1, and of
slips Y_j from the gas there is sum_j e_j v_j Y_j / (1 + sum_j e_j v_j^2) of it. Populations of one stopping time are
one to all others; what they differ by among themselves decays at their own x. A root is sought as its distance from
the nearer of the two x about it, so that it keeps its digits, by steps that take the sums on both sides of it for one
pole each, in value and slope (Bunch, Nielsen & Sorensen 1978, Numer. Math. 31, 31).
"""

import math

import numpy as np
from numba import njit

ROUNDING = 4.0 * np.finfo(float).eps
MOST = 80  # steps; two to four are usual
# Of populations of one stopping time: rate, mass over the gas's, slip (2) and source (2) from the gas's, e_j x_j, and
# 1 / (x_j - lambda).
RATE, MASS, SLIP, SOURCE, STRENGTH, INVERSE, ROWS = 0, 1, 2, 4, 6, 7, 8


@njit(nogil=True, cache=True, error_model="numpy")
def sort_present(mass, time, who):
    """Numbers of the populations that have mass and drag, the slowest first, in `who`; returns how many."""
    count = 0
    for s in range(1, len(mass)):
        if mass[s] > 0.0 and time[s] < math.inf:
            k = count
            while k > 0 and time[who[k - 1]] < time[s]:
                who[k] = who[k - 1]
                k -= 1
            who[k] = s
            count += 1
    return count


@njit(nogil=True, cache=True, error_model="numpy")
def group(mass, time, y, b, count, who, column, work):
    """Populations of one stopping time as one: the `column` of `work` of each; returns how many there are."""
    number = 0
    for k in range(count):
        s = who[k]
        e, rate = mass[s] / mass[0], 1.0 / time[s]
        if number == 0 or rate != work[RATE, number - 1]:
            for row in range(ROWS):
                work[row, number] = 0.0
            work[RATE, number] = rate
            number += 1
        at = number - 1
        column[k] = at
        work[MASS, at] += e
        part = e / work[MASS, at]
        for c in range(y.shape[1]):
            work[SLIP + c, at] += part * (y[s, c] - y[0, c] - work[SLIP + c, at])
            work[SOURCE + c, at] += part * (b[s, c] - b[0, c] - work[SOURCE + c, at])
    for i in range(number):
        work[STRENGTH, i] = work[MASS, i] * work[RATE, i]
    return number


@njit(nogil=True, cache=True, error_model="numpy")
def sums_at(origin, distance, k, number, work):
    """At a `distance` from one of the rates: the sums of (1) over the rates up to k and over those beyond, and the
    derivatives of both. Leaves 1 / (x_j - lambda) in `work`.
    """
    middle = work[RATE, origin]
    for i in range(np.uint64(number)):
        work[INVERSE, i] = 1.0 / ((work[RATE, i] - middle) - distance)
    low, high, low_slope, high_slope = 0.0, 0.0, 0.0, 0.0
    for i in range(np.uint64(k + 1)):
        term = work[STRENGTH, i] * work[INVERSE, i]
        low, low_slope = low + term, low_slope + term * work[INVERSE, i]
    for i in range(np.uint64(k + 1), np.uint64(number)):
        term = work[STRENGTH, i] * work[INVERSE, i]
        high, high_slope = high + term, high_slope + term * work[INVERSE, i]
    return low, high, low_slope, high_slope


@njit(nogil=True, cache=True, error_model="numpy")
def between_poles(c, q, s, width):
    """The root 0 < d < width of c - q / d + s / (width - d) = 0, with q, s > 0; d = q / c where the width is inf."""
    if width == math.inf:
        return q / c
    linear = c * width + q + s
    root = math.sqrt(max(0.0, linear * linear - 4.0 * c * q * width))
    return 2.0 * q * width / (linear + root) if linear > 0.0 else (linear - root) / (2.0 * c)


@njit(nogil=True, cache=True, error_model="numpy")
def find_root(k, number, work):
    """The root of (1) above rate k; leaves 1 / (x_j - lambda) in `work`."""
    last = k == number - 1
    origin, sign, high = k, 1.0, 0.0
    if last:
        width, distance = math.inf, work[STRENGTH, k]
        for i in range(number):
            high += work[STRENGTH, i]
    else:
        width = work[RATE, k + 1] - work[RATE, k]
        high = 0.5 * width
        below, above, _, _ = sums_at(k, high, k, number, work)
        q, s = work[STRENGTH, k], work[STRENGTH, k + 1]
        c = 1.0 + (below + q / high) + (above - s / high)
        if 1.0 + below + above < 0.0:  # nearer to the next rate; from there all is seen in a mirror
            origin, sign, c, q, s = k + 1, -1.0, -c, s, q
        distance = between_poles(c, q, s, width)
    low = 0.0
    if not 0.0 < distance <= high:
        distance = 0.5 * high
    for _ in range(MOST):
        below, above, below_slope, above_slope = sums_at(origin, sign * distance, k, number, work)
        value = sign * (1.0 + below + above)
        if abs(value) <= ROUNDING * (1.0 + above - below):
            return work[RATE, origin] + sign * distance
        if value > 0.0:
            high = distance
        else:
            low = distance
        if sign < 0.0:
            below, above, below_slope, above_slope = -above, -below, above_slope, below_slope
        rest = width - distance
        c, q = sign + below + below_slope * distance, below_slope * distance * distance
        s = 0.0
        if not last:
            c, s = c + above - above_slope * rest, above_slope * rest * rest
        after = between_poles(c, q, s, width)
        if not low < after < high:
            after = 0.5 * (low + high)
        done = abs(after - distance) <= ROUNDING * distance
        distance = after
        if done:
            break
    sums_at(origin, sign * distance, k, number, work)
    return work[RATE, origin] + sign * distance
