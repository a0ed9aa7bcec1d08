"""Field of the Maclaurin disc Sigma = Sigma_0 sqrt(1 - r^2/a^2), in its plane or at a height above it.

The disc is the limit of a flattened homogeneous spheroid (Binney & Tremaine 2008, sec. 2.5). With
zeta >= 0 from r^2/(1 + zeta^2) + z^2/zeta^2 = a^2, M = (2 pi/3) Sigma_0 a^2 and G = 1,

    a_r = -(3 M r/2 a^3) f                       f = acot zeta - zeta/(1 + zeta^2)                    (1)
    Phi = -(3 M/4 a) [2 acot zeta - (r/a)^2 f - 2 W zeta (1 - zeta acot zeta)]                        (2)
    W   = 1 - (r/a)^2/(1 + zeta^2) = (z/a zeta)^2

A Plummer softening e, 1/sqrt(r^2 + e^2), in the plane is exactly equivalent to the unsoftened field at the height
z = e.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def surface_density(radius: ArrayLike, disc_radius: float, mass: float) -> np.ndarray:
    """Return the surface density of the disc.

    Parameters
    ----------
    radius : array_like
        Radius r.
    disc_radius : float
        Radius a of the edge.
    mass : float
        Mass M of the disc.

    Returns
    -------
    ndarray
        Surface density, of the shape of `radius`; 0 beyond the edge.
    """
    inside = np.maximum(1 - (np.asarray(radius, dtype=float) / disc_radius) ** 2, 0)
    return 3 * mass / (2 * np.pi * disc_radius**2) * np.sqrt(inside)


def enclosed_mass(radius: ArrayLike, disc_radius: float, mass: float) -> np.ndarray:
    """Return the mass within a radius.

    Parameters
    ----------
    radius : array_like
        Radius r.
    disc_radius : float
        Radius a of the edge.
    mass : float
        Mass M of the disc.

    Returns
    -------
    ndarray
        Mass, of the shape of `radius`.
    """
    inside = np.maximum(1 - (np.asarray(radius, dtype=float) / disc_radius) ** 2, 0)
    return mass * (1 - inside**1.5)


def radial_acceleration(radius: ArrayLike, disc_radius: float, mass: float, height: float = 0.0) -> np.ndarray:
    """Return the radial acceleration of the disc, eq. (1); G = 1.

    Parameters
    ----------
    radius : array_like
        Radius r.
    disc_radius : float
        Radius a of the edge.
    mass : float
        Mass M of the disc.
    height : float
        Height z, or the Plummer softening in the plane.

    Returns
    -------
    ndarray
        Radial acceleration, of the shape of `radius`, negative inwards.
    """
    radius = np.asarray(radius, dtype=float)
    zeta = _zeta(radius / disc_radius, height / disc_radius)
    return -1.5 * mass * radius / disc_radius**3 * (_acot(zeta) - zeta / (1 + zeta**2))  # eq. (1)


def potential(radius: ArrayLike, disc_radius: float, mass: float, height: float = 0.0) -> np.ndarray:
    """Return the potential of the disc, eq. (2), which is 0 at infinity; G = 1.

    Parameters
    ----------
    radius : array_like
        Radius r.
    disc_radius : float
        Radius a of the edge.
    mass : float
        Mass M of the disc.
    height : float
        Height z, or the Plummer softening in the plane.

    Returns
    -------
    ndarray
        Potential, of the shape of `radius`.
    """
    r = np.asarray(radius, dtype=float) / disc_radius
    zeta = _zeta(r, height / disc_radius)
    arc = _acot(zeta)
    vertical = 2 * (1 - r**2 / (1 + zeta**2)) * zeta * (1 - zeta * arc)
    return -0.75 * mass / disc_radius * (2 * arc - r**2 * (arc - zeta / (1 + zeta**2)) - vertical)  # eq. (2)


def _acot(zeta: np.ndarray) -> np.ndarray:
    return np.arctan2(1, zeta)


def _zeta(r: np.ndarray, z: float) -> np.ndarray:
    """Solve zeta^4 - (r^2 + z^2 - 1) zeta^2 - z^2 = 0 for zeta by the form of the root without cancellation."""
    b = r**2 + z**2 - 1
    large = (np.abs(b) + np.hypot(b, 2 * z)) / 2
    small = np.divide(z**2, large, out=np.zeros_like(large), where=large > 0)
    return np.sqrt(np.where(b > 0, large, small))
