"""Gresho's vortex (Gresho & Chan 1990; Liska & Wendroff 2003), a steady vortex with a triangular velocity profile.

With x = r/R the speed rises to v_0 at R and falls to 0 at 2R; the pressure gradient dP/dr = rho v^2/r keeps it steady:

    v / v_0             = x                              2 - x                                  0
    P / (rho v_0^2) - 5 = x^2/2                          x^2/2 - 4x + 4 ln x + 4                4 ln 2 - 2
                          within R                       within 2R                              beyond
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray
CENTRAL_PRESSURE = 5.0  # P / (rho v_0^2) in the middle, for a nearly incompressible flow


def speed(radius: Array, peak: float = 1.0, at: float = 0.2) -> Array:
    """Return the azimuthal velocity of the vortex.

    Parameters
    ----------
    radius : ndarray
        Distance r from the centre.
    peak : float
        Largest velocity v_0.
    at : float
        Radius R of the largest velocity.

    Returns
    -------
    ndarray
        Velocity, of the shape of `radius`.
    """
    x = np.asarray(radius, dtype=float) / at
    return peak * np.maximum(0.0, np.minimum(x, 2.0 - x))


def pressure(radius: Array, density: float = 1.0, peak: float = 1.0, at: float = 0.2) -> Array:
    """Return the pressure of the vortex.

    Parameters
    ----------
    radius : ndarray
        Distance r from the centre.
    density : float
        Uniform density rho.
    peak : float
        Largest velocity v_0.
    at : float
        Radius R of the largest velocity.

    Returns
    -------
    ndarray
        Pressure, of the shape of `radius`.
    """
    x = np.minimum(np.asarray(radius, dtype=float) / at, 2.0)
    outer = np.maximum(x, 1.0)
    above = np.where(x < 1.0, 0.5 * x**2, 0.5 * outer**2 - 4.0 * outer + 4.0 * np.log(outer) + 4.0)
    return density * peak**2 * (CENTRAL_PRESSURE + above)
