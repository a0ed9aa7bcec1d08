"""Spreading of a thin ring by a constant viscosity (Lynden-Bell & Pringle 1974; Pringle 1981, eq. 2.13).

A cold ring of mass M about a point mass is at radius R at tau = 0. With x = r / R and tau = 12 nu t / R^2,

    Sigma = M / (pi R^2 tau x^(1/4)) exp(-(1 + x^2) / tau) I_1/4(2 x / tau)                      (1)
    v_r   = -(3 nu / r) (1/2 - 2 x^2 / tau + z I_5/4(z) / I_1/4(z)),  z = 2 x / tau               (2)

Both are evaluated with I scaled by exp(-z), which avoids overflow. The solution neglects pressure, a relative error of
about 2 (H / R)^2 / tau.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def surface_density(r: Array, tau: float, mass: float = 1.0, radius: float = 1.0) -> Array:
    """Return the surface density of the ring, eq. (1).

    Parameters
    ----------
    r : ndarray
        Radius, above 0.
    tau : float
        Viscous time 12 nu t / R^2, above 0.
    mass : float
        Mass M of the ring.
    radius : float
        Radius R of the ring at tau = 0.

    Returns
    -------
    ndarray
        Surface density, of the shape of `r`.
    """
    from scipy.special import ive  # slow to import

    x = r / radius
    bessel = ive(0.25, 2.0 * x / tau)
    return mass / (np.pi * radius**2 * tau * x**0.25) * np.exp(-((1.0 - x) ** 2) / tau) * bessel  # eq. (1)


def radial_velocity(r: Array, tau: float, nu: Array | float, radius: float = 1.0) -> Array:
    """Return the radial velocity of the ring, eq. (2).

    Parameters
    ----------
    r : ndarray
        Radius, above 0.
    tau : float
        Viscous time 12 nu t / R^2, above 0.
    nu : float or ndarray
        Kinematic viscosity.
    radius : float
        Radius R of the ring at tau = 0.

    Returns
    -------
    ndarray
        Radial velocity, of the shape of `r`, negative inwards.
    """
    from scipy.special import ive

    x = r / radius
    z = 2.0 * x / tau
    return -3.0 * nu / r * (0.5 - 2.0 * x**2 / tau + z * ive(1.25, z) / ive(0.25, z))  # eq. (2)
