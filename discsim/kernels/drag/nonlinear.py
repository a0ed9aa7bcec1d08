"""Relaxation of the coupled velocities in a cell over any dt, if stopping times depend on the slip.

    dV_s/dt of `kernels/drag/cells.py`, eq. (1), with t_j = t_j(|V_j - V_g|)

The solution takes sub-steps. Each is computed three times, in 1, 2 and 4 parts. A part is an exact linear solution
with the stopping times at the slip half-way through the part (exponential midpoint). Richardson extrapolation in the
length of the parts gives fourth order. TOLERANCE determines the length of a sub-step, at any drag rate. Momentum is
conserved exactly. If the drag is linear for all slips that can arise, the exponential scheme uses the exact linear
solution.
"""

import math
from typing import NamedTuple

import numpy as np

from discsim.jit.decorators import jit, jit_alloc, jit_subroutine
from discsim.kernels.drag.laws import drag_factor, drag_speed_terms, is_linear_up_to
from discsim.kernels.drag.relax import relax_means

TOLERANCE = 1e-8  # tolerated difference between the last two extrapolations, relative to the largest slip
ROUNDING = 1e-5  # slips below this fraction of the velocities are rounding, and would need endless sub-steps
MOST = 10_000  # number of sub-steps after which errors are accepted


class CoupledSpecies(NamedTuple):
    """Gas (row 0) and dust populations whose velocities relax, as arguments of `relax_means`.

    mass (n,). linear_time (n,): stopping times at zero slip. speed_terms (n, 2): results of `drag_speed_terms`. b
    (n, d): sources. two_way, exponential, several: as in `DragLaw` of `drag/base.py`.
    """

    mass: np.ndarray
    linear_time: np.ndarray
    speed_terms: np.ndarray
    b: np.ndarray
    two_way: bool
    exponential: bool
    several: bool | None


class Scratch(NamedTuple):
    """Scratch arrays of a sub-step, for n species in d dimensions.

    time (n,): stopping times. change (n, d): velocity changes. half (n, d): velocities half-way through a part. stage
    (3, n, d): velocities after 1, 2 and 4 parts. best (n, d): extrapolated velocities. steps_over_time (n,): length of
    the sub-step over the stopping time, summed over its parts. relaxation: scratch of `relax_coupled`.
    """

    time: np.ndarray
    change: np.ndarray
    half: np.ndarray
    stage: np.ndarray
    best: np.ndarray
    steps_over_time: np.ndarray
    relaxation: np.ndarray


@jit_subroutine
def squared_slip(y, s):
    """Return the squared slip of population s.

    y (n, d): velocities of the gas (row 0) and of the populations.
    """
    total = 0.0
    for c in range(y.shape[1]):
        total += (y[s, c] - y[0, c]) ** 2
    return total


@jit
def advance_part(species, arrays, y, at, dt, out):
    """Write to `out` (n, d) the velocities `y` after dt, with stopping times at the slips of the velocities `at`."""
    (n, dim), terms = y.shape, species.speed_terms
    for s in range(1, n):
        if species.mass[s] > 0.0:
            factor = drag_factor(terms[s, 0], terms[s, 1], squared_slip(at, s))
            arrays.time[s] = species.linear_time[s] / factor
    relax_means(
        species.mass, arrays.time, y, species.b, species.two_way, dt, species.exponential, species.several,
        arrays.relaxation, arrays.change,
    )  # fmt: skip
    for s in range(n):
        for c in range(dim):
            out[s, c] = y[s, c] + dt * species.b[s, c] + arrays.change[s, c]


@jit
def step_ratio(error):
    """Return the length of the next sub-step divided by that of the last one.

    error: error of the last sub-step over the tolerance, which grows with the fourth power of its length.
    """
    return min(4.0, max(0.1, 0.9 * (error + 1e-30) ** -0.25))


@jit_subroutine
def sub_step(species, arrays, now, step):
    """Write the velocities `now` (n, d) after a sub-step to `arrays.best`, and return the error over the tolerance."""
    # Loops copy arrays: assignments of slices would cost seconds of compilation.
    n, dim = now.shape
    stage, best = arrays.stage, arrays.best
    for level in range(3):
        part = step / 2.0**level
        for s in range(n):
            arrays.steps_over_time[s] = 0.0
            for c in range(dim):
                stage[level, s, c] = now[s, c]
        for _ in range(2**level):
            at = stage[level]
            advance_part(species, arrays, at, at, 0.5 * part, arrays.half)
            advance_part(species, arrays, at, arrays.half, part, at)
            for s in range(1, n):
                arrays.steps_over_time[s] += part / arrays.time[s]
    error, scale = 0.0, 0.0
    for s in range(n):
        if species.mass[s] > 0.0:
            scale = max(scale, math.sqrt(squared_slip(now, s)), math.sqrt(squared_slip(stage[2], s)))
            for c in range(dim):
                first = stage[1, s, c] + (stage[1, s, c] - stage[0, s, c]) / 3.0
                second = stage[2, s, c] + (stage[2, s, c] - stage[1, s, c]) / 3.0
                best[s, c] = second + (second - first) / 7.0
                scale = max(scale, ROUNDING * abs(now[s, c]), ROUNDING * abs(best[s, c]))
                error = max(error, abs(best[s, c] - second))
    return error / scale / TOLERANCE if scale > 0.0 else 0.0


@jit_subroutine
def stays_linear(species, y, dt):
    """Return whether the drag is linear for all slips that can arise during dt.

    Drag alone never increases the largest velocity difference, so the sources limit it.
    """
    reach = 0.0
    for s in range(1, len(y)):
        if species.mass[s] > 0.0:
            reach = max(reach, math.sqrt(squared_slip(y, s)) + dt * math.sqrt(squared_slip(species.b, s)))
    reach2 = 4.0 * reach * reach
    for s in range(1, len(y)):
        if species.mass[s] > 0.0 and not is_linear_up_to(species.speed_terms[s, 0], species.speed_terms[s, 1], reach2):
            return False
    return True


@jit_alloc
def relax_nonlinear(
    mass, time, law, grains, density, sound, omega, y, b, two_way, dt, exponential, several, scratch, change
):
    """Write to `change` (n, d) the velocity changes of `relax_means`, for drag that depends on the slip.

    time (n,): on input the stopping times at zero slip, on output their means over the kick. law, grains: form and
    parameters of the drag law. density, sound, omega: density, thermal speed and orbital frequency of the gas. The
    other arguments are those of `relax_means`.
    """
    n, dim = y.shape
    linear_time, speed_terms, rate = np.empty(n), np.zeros((n, 2)), np.zeros(n)
    for s in range(n):
        linear_time[s] = time[s]
        if s > 0 and mass[s] > 0.0:
            speed_terms[s, 0], speed_terms[s, 1] = drag_speed_terms(law, grains[s - 1], density, sound, omega)
    species = CoupledSpecies(mass, linear_time, speed_terms, b, two_way, exponential, several)
    if exponential and stays_linear(species, y, dt):  # backward Euler is extrapolated too
        relax_means(mass, time, y, b, two_way, dt, exponential, several, scratch, change)
        return
    start, now = np.empty((n, dim)), np.empty((n, dim))
    for s in range(n):
        for c in range(dim):
            start[s, c] = y[s, c] - y[0, c] if mass[s] > 0.0 else 0.0  # relative to the gas: small numbers in any frame
            now[s, c] = start[s, c]
    arrays = Scratch(time, change, np.empty((n, dim)), np.empty((3, n, dim)), np.empty((n, dim)), np.empty(n), scratch)
    done, step, count = 0.0, dt, 0
    while done < dt:
        count += 1
        step = min(step, dt - done)
        error = sub_step(species, arrays, now, step)
        if error <= 1.0 or count > MOST:
            for s in range(n):
                rate[s] += arrays.steps_over_time[s]
                for c in range(dim):
                    now[s, c] = arrays.best[s, c]
            done = done + step if done + step < dt * (1.0 - 1e-15) else dt
        step *= step_ratio(error)
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
            time[s] = linear_time[s] / drag_factor(speed_terms[s, 0], speed_terms[s, 1], squared_slip(start, s))
