"""Field of Kuzmin's disc, whole or cut off at a radius (Kuzmin 1956; Toomre 1963; Binney & Tremaine 2008, sec. 2.3.1).

    Sigma = M a / [2 pi (r^2 + a^2)^(3/2)],    M(r) = M [1 - a / sqrt(r^2 + a^2)]                      (1)
    a_r   = -M r / [r^2 + (a + |z|)^2]^(3/2)                                                           (2)

with G = 1; a disc that ends at a radius lacks the pull of the rings beyond it. A Plummer softening e gives the field at
the height z = e: no approximation.
"""

from __future__ import annotations

import numpy as np

from discsim.exact import ring

Array = np.ndarray


def surface_density(radius: Array, scale: float, mass: float) -> Array:
    """Surface density at `radius` of the whole disc of `mass`."""
    return mass * scale / (2 * np.pi * (radius**2 + scale**2) ** 1.5)


def enclosed_mass(radius: Array, scale: float, mass: float) -> Array:
    """Mass within `radius`."""
    return mass * (1 - scale / np.hypot(radius, scale))


def radial_acceleration(radius: Array, scale: float, mass: float, height: float = 0.0, cut: float = np.inf) -> Array:
    """Radial acceleration (n,) at `radius` (n,) > 0 and `height`, or in the plane with that softening.

    `mass` is that of the whole disc, of which only what lies within `cut` is there. Then `radius` must be well within.
    """
    whole = -mass * radius / (radius**2 + (scale + abs(height)) ** 2) ** 1.5  # eq. (2)
    if np.isinf(cut):
        return whole
    return whole - ring.beyond(radius, cut, lambda s: surface_density(s, scale, mass), height)
