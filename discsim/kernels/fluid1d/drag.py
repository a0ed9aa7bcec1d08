"""Drag in the cells of a fixed grid, in place; equations in `drag/published/` (`emsi_ppm.py`, `sios_ppm.py`).

Rows of `cells` (5, n) as in `kernels/fluid1d/ppm.py`. Cells without dust do not change.
"""

import numpy as np

from discsim.jit.decorators import jit
from discsim.kernels.drag.laws import stopping_time
from discsim.kernels.drag.relax import relax_pair
from discsim.kernels.fluid1d.ppm import DUST_MASS, DUST_MOMENTUM, ENERGY, MASS, MOMENTUM


@jit
def stopping_times(law, grain, density, dust_density, sound):
    """Return the stopping time of the dust in each cell (n,)."""
    out = np.empty(len(density))
    for i in range(len(density)):
        out[i] = stopping_time(law, grain, dust_density[i] / density[i], density[i], sound[i], 0.0)
    return out


@jit
def relax_together(law, grain, sound, start, middle, after, dt, exponential, adiabatic, heating):
    """Add drag to gas and dust of `after`, which have moved from `start` over dt without drag.

    The densities of the drag are those of `middle`; arrays (5, n).
    """
    for i in range(after.shape[1]):
        if min(start[DUST_MASS, i], middle[DUST_MASS, i], after[DUST_MASS, i]) <= 0.0:
            continue
        ratio = middle[DUST_MASS, i] / middle[MASS, i]
        rate = (1.0 + ratio) / stopping_time(law, grain, ratio, middle[MASS, i], sound[i], 0.0)
        gas, dust = after[MASS, i], after[DUST_MASS, i]
        v, u = start[MOMENTUM, i] / start[MASS, i], start[DUST_MOMENTUM, i] / start[DUST_MASS, i]
        free = after[DUST_MOMENTUM, i] / dust
        gas_acc, dust_acc = (after[MOMENTUM, i] / gas - v) / dt, (free - u) / dt
        _, gained = relax_pair(gas, dust, rate, v, u, gas_acc, dust_acc, dt, exponential)
        after[MOMENTUM, i] -= dust * gained
        after[DUST_MOMENTUM, i] += dust * gained
        if adiabatic:
            # The gas loses the energy that the dust gains. Its energy then includes frictional heat, which is
            # subtracted unless `heating`.
            after[ENERGY, i] -= dust * gained * (free + 0.5 * gained)
            if not heating:
                slip = 0.5 * (u - v + after[DUST_MOMENTUM, i] / dust - after[MOMENTUM, i] / gas)
                after[ENERGY, i] += dust * gained * slip


@jit
def relax_towards_old(law, grain, sound, cells, dt, adiabatic, heating):
    """Relax each species towards the old velocity of the other, by implicit Euler over dt."""
    for i in range(cells.shape[1]):
        gas, dust = cells[MASS, i], cells[DUST_MASS, i]
        if dust <= 0.0:
            continue
        steps = dt / stopping_time(law, grain, dust / gas, gas, sound[i], 0.0)
        v, u = cells[MOMENTUM, i] / gas, cells[DUST_MOMENTUM, i] / dust
        new_v, new_u = (gas * v + dust * steps * u) / (gas + dust * steps), (u + steps * v) / (1.0 + steps)
        cells[MOMENTUM, i], cells[DUST_MOMENTUM, i] = gas * new_v, dust * new_u
        if adiabatic:
            friction = 0.5 * gas * dust / (gas + dust) * ((u - v) ** 2 - (new_u - new_v) ** 2)
            cells[ENERGY, i] += 0.5 * gas * (new_v * new_v - v * v) + (friction if heating else 0.0)
