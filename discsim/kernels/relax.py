"""Exact relaxation of coupled velocities with the accelerations inside: eq. (1) of `kernels/drag.py` over any dt.

Of two velocities the slip y obeys dy/dt = b - rate y; of gas and several populations, which meet through the gas
alone, each mode of the coupling does. Increments are those beyond free motion, so that they vanish with the drag.
"""

import math

import numpy as np
from numba import njit

from discsim.kernels.inner import making
from discsim.kernels.modes import INVERSE, MASS, RATE, ROWS, SLIP, SOURCE, find_root, group, sort_present


@njit(nogil=True, cache=True, error_model="numpy")
def response(rate, dt, exponential):
    """What dy/dt = b - rate y does beyond the free y + b dt: (f, g) of y' = y + b dt + f y + g b."""
    x = rate * dt
    if not exponential:
        low = 1.0 / (1.0 + x)
        return -x * low, -x * dt * low
    f = math.expm1(-x)
    if x > 1e-2:
        return f, -f / rate - dt
    return f, -dt * x * (0.5 - x * (1.0 / 6.0 - x * (1.0 / 24.0 - x * (1.0 / 120.0 - x / 720.0))))


@njit(nogil=True, cache=True, error_model="numpy")
def relax_pair(w0, w1, rate, y0, y1, b0, b1, dt, exponential):
    """Increments of two coupled velocities of weights w0, w1 beyond their free motion."""
    f, g = response(rate, dt, exponential)
    change = f * (y0 - y1) + g * (b0 - b1)
    return w1 / (w0 + w1) * change, -w0 / (w0 + w1) * change


@making
def relax_modes(mass, time, y, b, dt, exponential, slip, drive):
    """Increments (n, d) of gas (entry 0) and populations that have mass and drag, by their slips and by sources apart,
    from the modes of `kernels/modes.py`; those of others stay.
    """
    n, dim = y.shape
    numbers, work = np.empty((2, n), np.int64), np.empty((ROWS, n))
    who, column = numbers[0], numbers[1]
    count = sort_present(mass, time, who)
    groups = group(mass, time, y, b, count, who, column, work)
    for k in range(count):
        s, at = who[k], column[k]
        f, g = (0.0, 0.0) if groups == count else response(work[RATE, at], dt, exponential)
        for c in range(dim):
            slip[s, c] = f * (y[s, c] - y[0, c] - work[SLIP + c, at])
            drive[s, c] = g * (b[s, c] - b[0, c] - work[SOURCE + c, at])
    for root in range(groups):
        f, g = response(find_root(root, groups, work), dt, exponential)
        norm = 1.0
        for i in range(groups):
            v = work[RATE, i] * work[INVERSE, i]
            work[INVERSE, i] = v
            norm += work[MASS, i] * v * v
        for c in range(dim):
            of_slips, of_sources = 0.0, 0.0
            for i in range(groups):
                share = work[MASS, i] * work[INVERSE, i]
                of_slips += share * work[SLIP + c, i]
                of_sources += share * work[SOURCE + c, i]
            of_slips, of_sources = f * of_slips / norm, g * of_sources / norm
            for k in range(count):
                slip[who[k], c] += of_slips * work[INVERSE, column[k]]
                drive[who[k], c] += of_sources * work[INVERSE, column[k]]
    for k in range(count):
        e = mass[who[k]] / mass[0]
        for c in range(dim):
            slip[0, c] -= e * slip[who[k], c]
            drive[0, c] -= e * drive[who[k], c]


@making
def relax_apart(mass, time, y, b, two_way, dt, exponential, slip, drive):
    """Changes (n, d) beyond their free motion of the velocities of gas (entry 0) and several populations, those of no
    mass left out, by their slips and by sources apart; one-way: of the populations alone.
    """
    n, dim = y.shape
    for s in range(n):
        for c in range(dim):
            slip[s, c], drive[s, c] = 0.0, 0.0
    if two_way:
        relax_modes(mass, time, y, b, dt, exponential, slip, drive)
        return
    for s in range(1, n):
        if mass[s] > 0.0:
            f, g = response(1.0 / time[s], dt, exponential)
            for c in range(dim):
                slip[s, c], drive[s, c] = f * (y[s, c] - y[0, c]), g * (b[s, c] - b[0, c])


@njit(nogil=True, cache=True, error_model="numpy")
def relax_means(mass, time, y, b, two_way, dt, exponential, several, change):
    """Both changes together. `several` is None where there is one population: without it numba leaves out the modes of
    many, seconds of compilation.
    """
    n, dim = y.shape
    count, only = 0, 0
    for s in range(n):
        for c in range(dim):
            change[s, c] = 0.0
        if s > 0 and mass[s] > 0.0:
            count += 1
            only = s
            if not two_way:
                f, g = response(1.0 / time[s], dt, exponential)
                for c in range(dim):
                    change[s, c] = f * (y[s, c] - y[0, c]) + g * (b[s, c] - b[0, c])
    if not two_way or count == 0:
        return
    if count == 1:
        rate = (1.0 + mass[only] / mass[0]) / time[only]
        for c in range(dim):
            change[0, c], change[only, c] = relax_pair(
                mass[0], mass[only], rate, y[0, c], y[only, c], b[0, c], b[only, c], dt, exponential
            )
    elif several is not None:
        add_modes(mass, time, y, b, dt, exponential, change)


@making
def add_modes(mass, time, y, b, dt, exponential, change):
    slip, drive = np.zeros(y.shape), np.zeros(y.shape)
    relax_modes(mass, time, y, b, dt, exponential, slip, drive)
    for s in range(y.shape[0]):
        for c in range(y.shape[1]):
            change[s, c] = slip[s, c] + drive[s, c]
