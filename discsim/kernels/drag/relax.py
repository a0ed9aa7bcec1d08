"""Exact relaxation of coupled velocities with the accelerations inside: eq. (1) of `kernels/drag/cells.py` over any dt.

The slip y of two velocities obeys dy/dt = b - rate y. Gas and several populations, coupled through the gas alone,
obey the equations of `kernels/drag/coupled.py`. Increments are those beyond free motion, and vanish with the drag.
"""

import math

from discsim.jit.decorators import jit, jit_no_alloc, jit_subroutine
from discsim.kernels.drag.coupled import relax_coupled


@jit
def response(rate, dt, exponential):
    """Return (f, g) of y' = y + b dt + f y + g b, the solution of dy/dt = b - rate y over dt.

    The solution is exact (`exponential`) or by backward Euler.
    """
    x = rate * dt
    if not exponential:
        low = 1.0 / (1.0 + x)
        return -x * low, -x * dt * low
    f = math.expm1(-x)
    if x > 1e-2:
        return f, -f / rate - dt
    return f, -dt * x * (0.5 - x * (1.0 / 6.0 - x * (1.0 / 24.0 - x * (1.0 / 120.0 - x / 720.0))))


@jit
def relax_pair(w0, w1, rate, y0, y1, b0, b1, dt, exponential):
    """Return the increments of two coupled velocities of weights w0, w1 beyond their free motion."""
    f, g = response(rate, dt, exponential)
    change = f * (y0 - y1) + g * (b0 - b1)
    return w1 / (w0 + w1) * change, -w0 / (w0 + w1) * change


@jit_no_alloc
def relax_apart(mass, time, y, b, two_way, dt, exponential, room, slip, drive):
    """Write the velocity changes (n, d) of gas (entry 0) and several populations by slips and by sources, apart.

    The changes are those beyond free motion, and 0 for populations of no mass. One-way drag changes the populations
    alone. `room` is as in `relax_coupled`.
    """
    n, dim = y.shape
    for s in range(n):
        for c in range(dim):
            slip[s, c], drive[s, c] = 0.0, 0.0
    if two_way:
        relax_coupled(mass, time, y, b, dt, exponential, room, slip, drive)
        return
    for s in range(1, n):
        if mass[s] > 0.0:
            f, g = response(1.0 / time[s], dt, exponential)
            for c in range(dim):
                slip[s, c], drive[s, c] = f * (y[s, c] - y[0, c]), g * (b[s, c] - b[0, c])


@jit_subroutine
def relax_means(mass, time, y, b, two_way, dt, exponential, several, room, change):
    """Write the sum of the changes by slips and by sources of `relax_apart`.

    `several` is None where there is one population: numba then leaves out the coupling of many, which saves seconds
    of compilation.
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
        relax_coupled(mass, time, y, b, dt, exponential, room, change, change)
