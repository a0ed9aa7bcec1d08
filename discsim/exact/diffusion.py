"""Dust that diffuses through gas: where drift and turbulence balance, and how a line spreads.

    d rho_d/dt = div [D rho_g grad(rho_d / rho_g) - rho_d v]                                              (1)

has no flux where rho_d ~ rho_g exp(int v dx / D). With D = alpha c_s H / (1 + St^2) and the drift of a pressure P,
v = St c_s H / (1 + St^2) d ln P/dx, in a ring (Dullemond et al. 2018, eqs. 44 to 46) and, of grains that fall to the
midplane of a layer with Omega z t_stop, by the moments of its equation of motion (Dubrulle et al. 1995; Youdin &
Lithwick 2007, with c_s H the gas's own):

    ring     Sigma_d ~ Sigma_g P^(St / alpha)                                                             (2)
    layer    H_d = H sqrt(alpha / (alpha + St))                                                           (3)
    line     a Gaussian of variance 2 D t                                                                 (4)

in gas that is even, about the line.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

Array = np.ndarray


def ring(gas: ArrayLike, pressure: ArrayLike, alpha: float, stokes: float) -> Array:
    """Surface density (n,), up to a factor, of dust where gas and pressure (n,) are so; eq. (2), of one St."""
    pressure = np.asarray(pressure, dtype=float)
    found: Array = np.asarray(gas, dtype=float) * (pressure / pressure.max()) ** (stokes / alpha)
    return found


def layer_height(height: float, alpha: float, stokes: float) -> float:
    """Height of a dust layer in gas of scale height `height`; eq. (3), but for terms of alpha St."""
    return height * float(np.sqrt(alpha / (alpha + stokes)))


def line(x: ArrayLike, time: float, diffusivity: float) -> Array:
    """Density (n,) at distances `x` (n,) from where a line of mass 1 was at time 0; eq. (4)."""
    variance = 2.0 * diffusivity * time
    found: Array = np.exp(-0.5 * np.asarray(x, dtype=float) ** 2 / variance) / np.sqrt(2.0 * np.pi * variance)
    return found
