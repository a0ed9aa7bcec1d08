"""Compiled laws of the stopping time (`formulas/laws.py`)."""

import numpy as np
from numba.extending import register_jitable

from discsim.formulas import laws
from discsim.jit.decorators import inline_jit, jit

for formula in laws.volume_density, laws.drag_speed_terms, laws.drag_factor:  # called by the other formulas
    register_jitable(nogil=True, error_model="numpy")(formula)
stopping_time = jit(laws.stopping_time)
nonlinear_drag_factor = jit(laws.nonlinear_drag_factor)
drag_speed_terms = inline_jit(laws.drag_speed_terms)
drag_factor = inline_jit(laws.drag_factor)
drag_factor_slope = inline_jit(laws.drag_factor_slope)
is_linear_up_to = inline_jit(laws.is_linear_up_to)


@jit
def stopping_times(law, grain, mass_ratio, density, sound, omega):
    """Return the stopping times (n,) of a grain at zero slip in gas.

    mass_ratio, density, sound, omega (n,): dust-to-gas ratio, and density, thermal speed and orbital frequency of the
    gas.
    """
    out = np.empty(len(density))
    for i in range(len(density)):
        out[i] = stopping_time(law, grain, mass_ratio[i], density[i], sound[i], omega[i])
    return out
