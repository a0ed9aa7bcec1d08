"""Drag between gas and dust in the cells of a fixed 1D grid. Cells without dust do not change.

The equations are in `drag/published/emsi_ppm.py` and `drag/published/sios_ppm.py`. Arrays (5, n) of conserved
quantities have the rows MASS to DUST_MOMENTUM of `kernels/fluid1d/ppm.py`.
"""

from discsim.jit.decorators import jit
from discsim.kernels.drag.laws import stopping_time
from discsim.kernels.drag.relax import relax_pair
from discsim.kernels.fluid1d.ppm import DUST_MASS, DUST_MOMENTUM, ENERGY, MASS, MOMENTUM


@jit
def relax_together(law, grain, sound, start, middle, after, dt, exponential, adiabatic, heating):
    """Add the drag over dt to `after` (5, n) in place, with the slip relaxed implicitly, as in emsi-ppm.

    start (5, n): the fluids before the step. after (5, n): on input, the fluids after dt without drag. middle (5, n):
    the fluids whose densities determine the stopping time, with the thermal speed `sound` (n,). adiabatic: whether the
    gas has an energy. heating: whether its energy includes the heat of friction.
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
    """Relax gas and dust in `cells` (5, n), in place, by implicit Euler over dt, as in sios-ppm.

    The velocity of each species relaxes towards the velocity that the other species had before. sound (n,): thermal
    speed. adiabatic: whether the gas has an energy. heating: whether its energy includes the heat of friction.
    """
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
