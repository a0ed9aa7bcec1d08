"""A thin ring that a constant viscosity spreads (Lynden-Bell & Pringle 1974; Pringle 1981, eq. 2.13).

With x = r / R and tau = 12 nu t / R^2, of a ring of mass M that was at R at tau = 0, about a point mass, cold:

    Sigma = M / (pi R^2 tau x^(1/4)) exp(-(1 + x^2) / tau) I_1/4(2 x / tau)                      (1)
    v_r   = -(3 nu / r) (1/2 - 2 x^2 / tau + z I_5/4(z) / I_1/4(z)),  z = 2 x / tau               (2)

I scaled by exp(-z) keeps both within floats. Right but for the pressure: by about 2 (H / R)^2 / tau of itself.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def surface_density(r: Array, tau: float, mass: float = 1.0, radius: float = 1.0) -> Array:
    """Sigma at `r` > 0 at viscous time `tau`, of a ring of this mass that was at `radius`."""
    from scipy.special import ive  # slow to import

    x = r / radius
    bessel = ive(0.25, 2.0 * x / tau)
    return mass / (np.pi * radius**2 * tau * x**0.25) * np.exp(-((1.0 - x) ** 2) / tau) * bessel  # eq. (1)


def radial_velocity(r: Array, tau: float, nu: Array | float, radius: float = 1.0) -> Array:
    """v_r at `r` > 0 at viscous time `tau`."""
    from scipy.special import ive

    x = r / radius
    z = 2.0 * x / tau
    return -3.0 * nu / r * (0.5 - 2.0 * x**2 / tau + z * ive(1.25, z) / ive(0.25, z))  # eq. (2)
