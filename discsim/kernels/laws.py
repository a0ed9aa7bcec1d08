"""The laws of the stopping time (`formulas/laws.py`), compiled."""

import numpy as np
from numba import njit
from numba.extending import register_jitable

from discsim.formulas import laws

for formula in laws.volume_density, laws.quickening, laws.hastened:  # which the others call
    register_jitable(nogil=True, error_model="numpy")(formula)
stopping_time = njit(nogil=True, cache=True, error_model="numpy")(laws.stopping_time)
hastening = njit(nogil=True, cache=True, error_model="numpy")(laws.hastening)
quickening = njit(cache=True, error_model="numpy", forceinline=True)(laws.quickening)
hastened = njit(cache=True, error_model="numpy", forceinline=True)(laws.hastened)
steepness = njit(cache=True, error_model="numpy", forceinline=True)(laws.steepness)
unhastened = njit(cache=True, error_model="numpy", forceinline=True)(laws.unhastened)


@njit(nogil=True, cache=True, error_model="numpy")
def stopping_times(law, grain, mass_ratio, density, sound, omega):
    """`stopping_time` for arrays of density, sound speed and Omega (n,)."""
    out = np.empty(len(density))
    for i in range(len(density)):
        out[i] = stopping_time(law, grain, mass_ratio, density[i], sound[i], omega[i])
    return out
