"""Exact relaxation of coupled velocities with accelerations included: eq. (1) of `kernels/drag/cells.py` over any dt.

The slip y of two velocities obeys dy/dt = b - rate y. Gas and several populations, which are coupled only through the
gas, obey the equations of `kernels/drag/coupled.py`. The velocity changes that these functions compute are those by
drag: free motion, b dt, is not included. Sources are accelerations that act on one species only.
"""

import math

from discsim.jit.decorators import jit, jit_no_alloc, jit_subroutine
from discsim.kernels.drag.coupled import relax_coupled


@jit
def response(rate, dt, exponential):
    """Return (f, g) such that y(dt) = y + b dt + f y + g b solves dy/dt = b - rate y.

    exponential: whether the solution is exact; False for backward Euler.
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
    """Return the changes of two coupled velocities y0 and y1 by drag over dt, without the free motion b0 dt and b1 dt.

    w0, w1: masses of the two. rate: rate at which y0 - y1 decays. b0, b1: accelerations.
    """
    f, g = response(rate, dt, exponential)
    change = f * (y0 - y1) + g * (b0 - b1)
    return w1 / (w0 + w1) * change, -w0 / (w0 + w1) * change


@jit_no_alloc
def relax_separately(mass, time, y, b, two_way, dt, exponential, scratch, slip, drive):
    """Write the velocity changes by drag over dt: those due to initial slips to `slip`, due to sources to `drive`.

    Row 0 of the arrays (n, d) is the gas, the other rows are populations; populations without mass do not change,
    and with one-way drag the gas does not change. mass, time (n,): masses and stopping times. y, b (n, d):
    velocities and sources. scratch: overwritten, as in `relax_coupled`.
    """
    n, dim = y.shape
    for s in range(n):
        for c in range(dim):
            slip[s, c], drive[s, c] = 0.0, 0.0
    if two_way:
        relax_coupled(mass, time, y, b, dt, exponential, scratch, slip, drive)
        return
    for s in range(1, n):
        if mass[s] > 0.0:
            f, g = response(1.0 / time[s], dt, exponential)
            for c in range(dim):
                slip[s, c], drive[s, c] = f * (y[s, c] - y[0, c]), g * (b[s, c] - b[0, c])


@jit_subroutine
def relax_means(mass, time, y, b, two_way, dt, exponential, several, scratch, change):
    """Write the velocity changes (n, d) of gas (row 0) and populations by drag over dt to `change`.

    `change` is the sum of `slip` and `drive` of `relax_separately`, which has the same arguments. several: None if
    there is one population; numba then leaves out the code for several, which saves seconds of compilation.
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
        relax_coupled(mass, time, y, b, dt, exponential, scratch, change, change)
