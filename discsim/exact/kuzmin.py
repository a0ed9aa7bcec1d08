"""Field of Kuzmin's disc, whole or cut off at a radius (Kuzmin 1956; Toomre 1963; Binney & Tremaine 2008, sec. 2.3.1).

    Sigma = M a / [2 pi (r^2 + a^2)^(3/2)],    M(r) = M [1 - a / sqrt(r^2 + a^2)]                      (1)
    a_r   = -M r / [r^2 + (a + |z|)^2]^(3/2)                                                           (2)

with G = 1. For a disc that ends at a radius, the pull of the rings beyond is subtracted. A Plummer softening e in the
plane is exactly equivalent to the unsoftened field at the height z = e.
"""

from __future__ import annotations

import numpy as np

from discsim.exact import ring

Array = np.ndarray


def surface_density(radius: Array, scale: float, mass: float) -> Array:
    """Return the surface density of the infinite disc, eq. (1).

    Parameters
    ----------
    radius : ndarray
        Radius r.
    scale : float
        Scale length a.
    mass : float
        Mass M of the infinite disc.

    Returns
    -------
    ndarray
        Surface density, of the shape of `radius`.
    """
    return mass * scale / (2 * np.pi * (radius**2 + scale**2) ** 1.5)


def enclosed_mass(radius: Array, scale: float, mass: float) -> Array:
    """Return the mass within a radius of the infinite disc, eq. (1).

    Parameters
    ----------
    radius : ndarray
        Radius r.
    scale : float
        Scale length a.
    mass : float
        Mass M of the infinite disc.

    Returns
    -------
    ndarray
        Mass, of the shape of `radius`.
    """
    return mass * (1 - scale / np.hypot(radius, scale))


def radial_acceleration(radius: Array, scale: float, mass: float, height: float = 0.0, cut: float = np.inf) -> Array:
    """Return the radial acceleration of the disc, whole or cut off at a radius, eq. (2); G = 1.

    Parameters
    ----------
    radius : ndarray, shape (n,)
        Radius r, above 0, and well within `cut` if that is finite.
    scale : float
        Scale length a.
    mass : float
        Mass M of the infinite disc.
    height : float
        Height z, or the Plummer softening in the plane.
    cut : float
        Radius at which the disc ends.

    Returns
    -------
    ndarray, shape (n,)
        Radial acceleration, negative inwards.
    """
    whole = -mass * radius / (radius**2 + (scale + abs(height)) ** 2) ** 1.5  # eq. (2)
    if np.isinf(cut):
        return whole
    return whole - ring.outer_disc_acceleration(radius, cut, lambda s: surface_density(s, scale, mass), height)
