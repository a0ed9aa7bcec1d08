"""Drag whose stopping times depend on the slip: the coupled velocities of a cell, over any dt.

    dV_s/dt of `kernels/drag/cells.py`, eq. (1), with t_j = t_j(|V_j - V_g|)

The solution takes sub-steps. Each is computed three times, in 1, 2 and 4 parts. A part is an exact linear solution
with the stopping times at the slip half-way through it (exponential midpoint). Richardson extrapolation in the length
of the parts gives fourth order. TOLERANCE sets the length of a sub-step, whatever the rates. Momentum is exact. With
the exponential scheme the result is the exact linear solution where no slip that can arise changes the drag.
"""

import math
from typing import NamedTuple

import numpy as np

from discsim.jit.decorators import jit, jit_alloc, jit_subroutine
from discsim.kernels.drag.laws import hastened, quickening, unhastened
from discsim.kernels.drag.relax import relax_means

TOLERANCE = 1e-8  # relative to the largest slip: difference of the last two extrapolations
ROUNDING = 1e-5  # relative to velocities: smaller slips are rounding, and would shorten sub-steps without end
MOST = 10_000  # sub-steps, after which errors are accepted


class Coupled(NamedTuple):
    """Gas (entry 0) and populations (n,) that relax, as `relax_means` takes them."""

    mass: np.ndarray
    slow: np.ndarray  # stopping times at vanishing slip
    quick: np.ndarray  # (n, 2): `quickening` of each
    b: np.ndarray  # (n, d)
    two_way: bool
    exponential: bool
    several: bool | None


class Work(NamedTuple):
    """Scratch arrays of a sub-step.

    Stopping times; changes; velocities half-way, after 1, 2 and 4 parts (3, n, d), and extrapolated; and for each
    species the sum of sub-step over stopping time.
    """

    time: np.ndarray
    change: np.ndarray
    half: np.ndarray
    stage: np.ndarray
    best: np.ndarray
    mean: np.ndarray
    room: np.ndarray  # of `relax_coupled`


@jit_subroutine
def slip2_of(y, s):
    """Return the squared slip of species s."""
    total = 0.0
    for c in range(y.shape[1]):
        total += (y[s, c] - y[0, c]) ** 2
    return total


@jit
def advance(them, work, y, at, dt, out):
    """Write `y` after dt to `out`, with the stopping times at the slips of `at`."""
    n, dim = y.shape
    for s in range(1, n):
        if them.mass[s] > 0.0:
            work.time[s] = them.slow[s] / hastened(them.quick[s, 0], them.quick[s, 1], slip2_of(at, s))
    relax_means(
        them.mass, work.time, y, them.b, them.two_way, dt, them.exponential, them.several, work.room, work.change
    )
    for s in range(n):
        for c in range(dim):
            out[s, c] = y[s, c] + dt * them.b[s, c] + work.change[s, c]


@jit
def next_step(error):
    """Return the next sub-step over this one.

    `error` is in units of the tolerance, and grows with the fourth power of the sub-step.
    """
    return min(4.0, max(0.1, 0.9 * (error + 1e-30) ** -0.25))


@jit_subroutine
def sub_step(them, work, now, step):
    """Write the velocities `now` after a sub-step to `work.best`, and return the error in units of the tolerance."""
    # Loops copy arrays: assignments of slices would cost seconds of compilation.
    n, dim = now.shape
    stage, best = work.stage, work.best
    for level in range(3):
        part = step / 2.0**level
        for s in range(n):
            work.mean[s] = 0.0
            for c in range(dim):
                stage[level, s, c] = now[s, c]
        for _ in range(2**level):
            at = stage[level]
            advance(them, work, at, at, 0.5 * part, work.half)
            advance(them, work, at, work.half, part, at)
            for s in range(1, n):
                work.mean[s] += part / work.time[s]
    error, scale = 0.0, 0.0
    for s in range(n):
        if them.mass[s] > 0.0:
            scale = max(scale, math.sqrt(slip2_of(now, s)), math.sqrt(slip2_of(stage[2], s)))
            for c in range(dim):
                first = stage[1, s, c] + (stage[1, s, c] - stage[0, s, c]) / 3.0
                second = stage[2, s, c] + (stage[2, s, c] - stage[1, s, c]) / 3.0
                best[s, c] = second + (second - first) / 7.0
                scale = max(scale, ROUNDING * abs(now[s, c]), ROUNDING * abs(best[s, c]))
                error = max(error, abs(best[s, c] - second))
    return error / scale / TOLERANCE if scale > 0.0 else 0.0


@jit_subroutine
def is_linear(them, y, dt):
    """Return whether no slip during dt changes the drag: drag alone never widens the range of the velocities."""
    reach = 0.0
    for s in range(1, len(y)):
        if them.mass[s] > 0.0:
            reach = max(reach, math.sqrt(slip2_of(y, s)) + dt * math.sqrt(slip2_of(them.b, s)))
    reach2 = 4.0 * reach * reach
    for s in range(1, len(y)):
        if them.mass[s] > 0.0 and not unhastened(them.quick[s, 0], them.quick[s, 1], reach2):
            return False
    return True


@jit_alloc
def relax_by_speed(
    mass, time, law, grains, density, sound, omega, y, b, two_way, dt, exponential, several, room, change
):
    """Compute the changes of `relax_means` for slip-dependent drag.

    `time` (n,) holds the stopping times at vanishing slip before, and their means over the kick afterwards.
    """
    n, dim = y.shape
    slow, quick, rate = np.empty(n), np.zeros((n, 2)), np.zeros(n)
    for s in range(n):
        slow[s] = time[s]
        if s > 0 and mass[s] > 0.0:
            quick[s, 0], quick[s, 1] = quickening(law, grains[s - 1], density, sound, omega)
    them = Coupled(mass, slow, quick, b, two_way, exponential, several)
    if exponential and is_linear(them, y, dt):  # backward Euler is extrapolated too
        relax_means(mass, time, y, b, two_way, dt, exponential, several, room, change)
        return
    start, now = np.empty((n, dim)), np.empty((n, dim))
    for s in range(n):
        for c in range(dim):
            start[s, c] = y[s, c] - y[0, c] if mass[s] > 0.0 else 0.0  # relative to the gas: small numbers in any frame
            now[s, c] = start[s, c]
    work = Work(time, change, np.empty((n, dim)), np.empty((3, n, dim)), np.empty((n, dim)), np.empty(n), room)
    done, step, count = 0.0, dt, 0
    while done < dt:
        count += 1
        step = min(step, dt - done)
        error = sub_step(them, work, now, step)
        if error <= 1.0 or count > MOST:
            for s in range(n):
                rate[s] += work.mean[s]
                for c in range(dim):
                    now[s, c] = work.best[s, c]
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
            time[s] = slow[s] / hastened(quick[s, 0], quick[s, 1], slip2_of(start, s))
