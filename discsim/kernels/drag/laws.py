"""Compiled laws of the stopping time (`formulas/laws.py`)."""

import numpy as np
from numba.extending import register_jitable

from discsim.formulas import laws
from discsim.jit.decorators import inline_jit, jit

for formula in laws.volume_density, laws.quickening, laws.hastened:  # called by the other formulas
    register_jitable(nogil=True, error_model="numpy")(formula)
stopping_time = jit(laws.stopping_time)
hastening = jit(laws.hastening)
quickening = inline_jit(laws.quickening)
hastened = inline_jit(laws.hastened)
steepness = inline_jit(laws.steepness)
unhastened = inline_jit(laws.unhastened)


@jit
def stopping_times(law, grain, mass_ratio, density, sound, omega):
    """Return stopping times (n,) for arrays of density, sound speed and Omega (n,)."""
    out = np.empty(len(density))
    for i in range(len(density)):
        out[i] = stopping_time(law, grain, mass_ratio, density[i], sound[i], omega[i])
    return out
