"""Pull of thin rings about the z axis, and of a razor-thin disc as the sum of its rings.

A ring of radius s and mass 1 gives at radius r and height z (Binney & Tremaine 2008, sec. 2.6.2), with G = 1 and
m = 4 r s / [(r + s)^2 + z^2] the parameter of the elliptic integrals,

    a_r = -[K(m) + (r^2 - s^2 - z^2) / ((r - s)^2 + z^2) E(m)] / (pi r sqrt((r + s)^2 + z^2))          (1)

A Plummer softening e gives the field at the height z = e: no approximation.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.special import ellipe, ellipk

Array = np.ndarray
NODES = 64


def radial_acceleration(radius: Array, ring: Array, height: float = 0.0) -> Array:
    """Radial acceleration at `radius` > 0 by a ring of radius `ring` and mass 1; shapes broadcast."""
    far2, near2 = (radius + ring) ** 2 + height**2, (radius - ring) ** 2 + height**2
    m = 4 * radius * ring / far2
    pull = ellipk(m) + (radius**2 - ring**2 - height**2) / near2 * ellipe(m)
    return -pull / (np.pi * radius * np.sqrt(far2))  # eq. (1)


def beyond(radius: Array, cut: float, surface_density: Callable[[Array], Array], height: float = 0.0) -> Array:
    """Radial acceleration (n,) at `radius` (n,) > 0 and < `cut` by what lies beyond `cut`, out to infinity.

    Gauss-Legendre in cut / s; s^2 `surface_density`(s) must stay finite. 1e-11 at cut/100 from `cut`, and worse nearer.
    """
    node, weight = np.polynomial.legendre.leggauss(NODES)
    inverse = (node + 1) / 2
    ring = cut / inverse
    mass = np.pi * ring * surface_density(ring) * cut / inverse**2 * weight
    return sum(m * radial_acceleration(radius, s, height) for s, m in zip(ring, mass, strict=True))
