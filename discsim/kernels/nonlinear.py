"""Drag whose stopping times depend on the slip: the coupled velocities of a cell, over any dt.

    dV_s/dt of `kernels/drag.py`, eq. (1), with t_j = t_j(|V_j - V_g|)

by sub-steps. One is made of 1, 2 and 4 exact linear solutions with the stopping times at the slip half-way of each
(exponential midpoint), extrapolated in their length (Richardson) to fourth order, and is as short as TOLERANCE asks,
whatever the rates. Momentum is exact.
"""

import math

import numpy as np
from numba import njit

from discsim.kernels.laws import hastening
from discsim.kernels.relax import relax_means

TOLERANCE = 1e-8  # of the largest slip: the difference of the last two extrapolations
ROUNDING = 1e-5  # of the velocities, a slip below which their rounding would ask for ever shorter sub-steps
MOST = 10_000  # sub-steps


@njit(nogil=True, cache=True, error_model="numpy")
def slip_of(y, s):
    total = 0.0
    for c in range(y.shape[1]):
        total += (y[s, c] - y[0, c]) ** 2
    return math.sqrt(total)


@njit(nogil=True, cache=True, error_model="numpy")
def advance(mass, slow, law, grains, density, sound, omega, y, at, b, two_way, dt, exponential, several, time,
    change, out,
):  # fmt: skip
    """`y` over dt by the stopping times at the slips of `at`."""
    n, dim = y.shape
    for s in range(1, n):
        if mass[s] > 0.0:
            time[s] = slow[s] / hastening(law, grains[s - 1], density, sound, omega, slip_of(at, s))
    relax_means(mass, time, y, b, two_way, dt, exponential, several, change)
    for s in range(n):
        for c in range(dim):
            out[s, c] = y[s, c] + dt * b[s, c] + change[s, c]


@njit(nogil=True, cache=True, error_model="numpy")
def next_step(error):
    """The next sub-step over this one, whose `error` is in units of the tolerance; it grows with its fourth power."""
    return min(4.0, max(0.1, 0.9 * (error + 1e-30) ** -0.25))


@njit(nogil=True, cache=True, error_model="numpy")
def relax_by_speed(mass, time, law, grains, density, sound, omega, y, b, two_way, dt, exponential, several, change):
    """As `relax_means`, whose `time` (n,) is here that at vanishing slip, and afterwards the mean over the kick."""
    # Arrays are copied by loops: assigning slices would cost seconds of compilation.
    n, dim = y.shape
    slow, rate, mean = np.empty(n), np.zeros(n), np.empty(n)
    start, now, half, best = np.empty((n, dim)), np.empty((n, dim)), np.empty((n, dim)), np.empty((n, dim))
    stage = np.empty((3, n, dim))
    for s in range(n):
        slow[s] = time[s]
        for c in range(dim):
            start[s, c] = y[s, c] - y[0, c] if mass[s] > 0.0 else 0.0  # small numbers, whatever the frame
            now[s, c] = start[s, c]
    done, step, count = 0.0, dt, 0
    while done < dt:
        count += 1
        step = min(step, dt - done)
        for level in range(3):
            part = step / 2.0**level
            for s in range(n):
                mean[s] = 0.0
                for c in range(dim):
                    stage[level, s, c] = now[s, c]
            for _ in range(2**level):
                at = stage[level]
                advance(
                    mass, slow, law, grains, density, sound, omega, at, at, b, two_way, 0.5 * part, exponential,
                    several, time, change, half,
                )  # fmt: skip
                advance(
                    mass, slow, law, grains, density, sound, omega, at, half, b, two_way, part, exponential,
                    several, time, change, at,
                )  # fmt: skip
                for s in range(1, n):
                    mean[s] += part / time[s]
        error, scale = 0.0, 0.0
        for s in range(n):
            if mass[s] > 0.0:
                scale = max(scale, slip_of(now, s), slip_of(stage[2], s))
                for c in range(dim):
                    first = stage[1, s, c] + (stage[1, s, c] - stage[0, s, c]) / 3.0
                    second = stage[2, s, c] + (stage[2, s, c] - stage[1, s, c]) / 3.0
                    best[s, c] = second + (second - first) / 7.0
                    scale = max(scale, ROUNDING * abs(now[s, c]), ROUNDING * abs(best[s, c]))
                    error = max(error, abs(best[s, c] - second))
        error = error / scale / TOLERANCE if scale > 0.0 else 0.0
        if error <= 1.0 or count > MOST:
            for s in range(n):
                rate[s] += mean[s]
                for c in range(dim):
                    now[s, c] = best[s, c]
            done = done + step if done + step < dt * (1.0 - 1e-15) else dt
        step *= next_step(error)
    for c in range(dim):
        change[0, c] = 0.0
        for s in range(1, n):
            change[s, c] = now[s, c] - start[s, c] - dt * b[s, c] if mass[s] > 0.0 else 0.0
            if two_way:
                change[0, c] -= mass[s] / mass[0] * change[s, c]
    for s in range(1, n):
        if rate[s] > 0.0:
            time[s] = dt / rate[s]
        elif mass[s] > 0.0:
            time[s] = slow[s] / hastening(law, grains[s - 1], density, sound, omega, slip_of(start, s))
