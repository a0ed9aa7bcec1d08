"""sios-ppm: gas and dust as fluids on a fixed 1D grid; semi-implicit drag after the fluxes; momentum not conserved.

A step of the fluids without drag (`discsim/numerics/ppm.py`) gives v* and u*. In every cell the drag is then implicit
in the velocity of the species itself, and explicit in that of the other species:

    v = (v* + eps dt/t_stop u*) / (1 + eps dt/t_stop),   u = (u* + dt/t_stop v*) / (1 + dt/t_stop)

First order, and stable at any step. The total momentum of a cell changes by

    eps rho_g x (u* - v*) [1 / (1 + eps x) - 1 / (1 + x)],   x = dt/t_stop

which vanishes only for eps = 1. At dt >> t_stop the species exchange their velocities, and the slip, instead of
decaying, changes sign in each step. This is the semi-implicit operator splitting in the comparison of Stoyanovskaya et
al. 2018 (arXiv:1811.06522), as far as its abstract describes it. Frictional heat is the energy that the slip loses.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from discsim.drag.base import NO_CELLS, NO_KERNEL, OWN_INTEGRATION, Array, DragLaw, Scheme
from discsim.drag.published.fixed_grid import RULES
from discsim.parts import Lazy

if TYPE_CHECKING:
    from discsim.numerics.ppm import Tube

kernels, ppm = Lazy("discsim.kernels.fluid1d.drag"), Lazy("discsim.numerics.ppm")


def advance(law: DragLaw, tube: Tube, cells: Array, dt: float, heating: bool) -> Array:
    """Return the fluids after dt, as `Scheme.advance`."""
    now = cells
    for part in ppm.STAGES:
        now = tube.add_fluxes(cells, now, part * dt)
    kernels.relax_towards_old(law.code, law.grains[0], tube.thermal_speed(now), now, dt, tube.adiabatic, heating)
    return now


UNUSED = NO_CELLS | NO_KERNEL | OWN_INTEGRATION
SCHEME = Scheme(advance=advance, conserves=False, unused=UNUSED, rules=RULES)
