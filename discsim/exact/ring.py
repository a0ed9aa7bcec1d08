"""Gravitational field of thin rings about the z axis, and of razor-thin discs as sums of rings.

The radial acceleration at radius r and height z by a ring of radius s and mass 1 is (Binney & Tremaine 2008,
sec. 2.6.2), with G = 1 and m = 4 r s / [(r + s)^2 + z^2] the parameter of the elliptic integrals,

    a_r = -[K(m) + (r^2 - s^2 - z^2) / ((r - s)^2 + z^2) E(m)] / (pi r sqrt((r + s)^2 + z^2))          (1)

A Plummer softening e in the plane is exactly equivalent to the unsoftened field at the height z = e.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.special import ellipe, ellipk

Array = np.ndarray
NODES = 64


def radial_acceleration(radius: Array, ring: Array, height: float = 0.0) -> Array:
    """Return the radial acceleration by a ring of mass 1, eq. (1); G = 1.

    Parameters
    ----------
    radius : ndarray
        Radius r, above 0. `radius` and `ring` broadcast.
    ring : ndarray
        Radius s of the ring.
    height : float
        Height z above the ring, or the Plummer softening in its plane.

    Returns
    -------
    ndarray
        Radial acceleration, of the arguments' joint shape, negative inwards.
    """
    far2, near2 = (radius + ring) ** 2 + height**2, (radius - ring) ** 2 + height**2
    m = 4 * radius * ring / far2
    pull = ellipk(m) + (radius**2 - ring**2 - height**2) / near2 * ellipe(m)
    return -pull / (np.pi * radius * np.sqrt(far2))  # eq. (1)


def outer_disc_acceleration(
    radius: Array, cut: float, surface_density: Callable[[Array], Array], height: float = 0.0
) -> Array:
    """Return the radial acceleration by the part of an infinite disc beyond the radius `cut`; G = 1.

    Parameters
    ----------
    radius : ndarray, shape (n,)
        Radius r, above 0 and below `cut`.
    cut : float
        Inner radius of this part.
    surface_density : callable (radius)
        Return the surface density at radii; s^2 times its value must be bounded as s goes to infinity.
    height : float
        Height z, or the Plummer softening in the plane.

    Returns
    -------
    ndarray, shape (n,)
        Radial acceleration, positive outwards. Gauss-Legendre quadrature in cut / s has an error of 1e-11 at a
        distance of cut / 100 from `cut`, and a larger one nearer to it.
    """
    node, weight = np.polynomial.legendre.leggauss(NODES)
    inverse = (node + 1) / 2
    ring = cut / inverse
    mass = np.pi * ring * surface_density(ring) * cut / inverse**2 * weight
    return sum(m * radial_acceleration(radius, s, height) for s, m in zip(ring, mass, strict=True))
