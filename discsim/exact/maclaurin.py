"""Field of the Maclaurin disc Sigma = Sigma_0 sqrt(1 - r^2/a^2), in its plane or at a height above it.

The limit of a flattened homogeneous spheroid (Binney & Tremaine 2008, sec. 2.5). With
zeta >= 0 from r^2/(1 + zeta^2) + z^2/zeta^2 = a^2, M = (2 pi/3) Sigma_0 a^2 and G = 1,

    a_r = -(3 M r/2 a^3) f                       f = acot zeta - zeta/(1 + zeta^2)                    (1)
    Phi = -(3 M/4 a) [2 acot zeta - (r/a)^2 f - 2 W zeta (1 - zeta acot zeta)]                        (2)
    W   = 1 - (r/a)^2/(1 + zeta^2) = (z/a zeta)^2

A Plummer softening e, 1/sqrt(r^2 + e^2), gives the unsoftened field at the height z = e: no approximation.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def surface_density(radius: ArrayLike, disc_radius: float, mass: float) -> np.ndarray:
    """Surface density at `radius`; 0 beyond `disc_radius`."""
    inside = np.maximum(1 - (np.asarray(radius, dtype=float) / disc_radius) ** 2, 0)
    return 3 * mass / (2 * np.pi * disc_radius**2) * np.sqrt(inside)


def enclosed_mass(radius: ArrayLike, disc_radius: float, mass: float) -> np.ndarray:
    """Mass within `radius`."""
    inside = np.maximum(1 - (np.asarray(radius, dtype=float) / disc_radius) ** 2, 0)
    return mass * (1 - inside**1.5)


def radial_acceleration(radius: ArrayLike, disc_radius: float, mass: float, height: float = 0.0) -> np.ndarray:
    """Radial acceleration at `radius` and `height`, or in the plane with that softening."""
    radius = np.asarray(radius, dtype=float)
    zeta = _zeta(radius / disc_radius, height / disc_radius)
    return -1.5 * mass * radius / disc_radius**3 * (_acot(zeta) - zeta / (1 + zeta**2))  # eq. (1)


def potential(radius: ArrayLike, disc_radius: float, mass: float, height: float = 0.0) -> np.ndarray:
    """Potential at `radius` and `height`, or in the plane with that softening; 0 at infinity."""
    r = np.asarray(radius, dtype=float) / disc_radius
    zeta = _zeta(r, height / disc_radius)
    arc = _acot(zeta)
    vertical = 2 * (1 - r**2 / (1 + zeta**2)) * zeta * (1 - zeta * arc)
    return -0.75 * mass / disc_radius * (2 * arc - r**2 * (arc - zeta / (1 + zeta**2)) - vertical)  # eq. (2)


def _acot(zeta: np.ndarray) -> np.ndarray:
    return np.arctan2(1, zeta)


def _zeta(r: np.ndarray, z: float) -> np.ndarray:
    """zeta from zeta^4 - (r^2 + z^2 - 1) zeta^2 - z^2 = 0, by the root that does not cancel."""
    b = r**2 + z**2 - 1
    large = (np.abs(b) + np.hypot(b, 2 * z)) / 2
    small = np.divide(z**2, large, out=np.zeros_like(large), where=large > 0)
    return np.sqrt(np.where(b > 0, large, small))
