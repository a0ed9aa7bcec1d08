"""Field of the finite Mestel disc, in its plane or at a height above it (Mestel 1963, MNRAS 126, 553).

    Sigma = M arccos(r/a) / (2 pi a r),    M(r) = M [x arccos x + 1 - sqrt(1 - x^2)], x = r/a          (1)

In its plane the rotation curve is flat: a_r = -pi M / (2 a r) (Lynden-Bell & Pineault 1978; G = 1). The disc is a sum
of discs m / [2 pi b sqrt(b^2 - r^2)] with equal masses m in equal ranges of b < a. The field of such a disc is that of
a line of masses at the imaginary heights t < b: Phi = -(M/a) int_0^a ln(a/t) Re[r^2 + (z + it)^2]^(-1/2) dt.
Integration by parts, with w = z + ia and s = sqrt(r^2 + z^2), gives

    a_r = -(M / a r) {Im arsinh(w/r) - (z/s) arg[s sqrt(r^2 + w^2) + r^2 + z w]}                       (2)

A Plummer softening e in the plane is exactly equivalent to the unsoftened field at the height z = e.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def surface_density(radius: Array, disc_radius: float, mass: float) -> Array:
    """Return the surface density of the disc, eq. (1).

    Parameters
    ----------
    radius : ndarray
        Radius r, above 0.
    disc_radius : float
        Radius a of the edge.
    mass : float
        Mass M of the disc.

    Returns
    -------
    ndarray
        Surface density, of the shape of `radius`; 0 beyond the edge.
    """
    return mass * np.arccos(np.minimum(radius / disc_radius, 1)) / (2 * np.pi * disc_radius * radius)


def enclosed_mass(radius: Array, disc_radius: float, mass: float) -> Array:
    """Return the mass within a radius, eq. (1).

    Parameters
    ----------
    radius : ndarray
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
    x = np.minimum(radius / disc_radius, 1)
    return mass * (x * np.arccos(x) + 1 - np.sqrt(1 - x**2))  # eq. (1)


def radial_acceleration(radius: Array, disc_radius: float, mass: float, height: float = 0.0) -> Array:
    """Return the radial acceleration of the disc, eq. (2); G = 1.

    Parameters
    ----------
    radius : ndarray
        Radius r, above 0.
    disc_radius : float
        Radius a of the edge.
    mass : float
        Mass M of the disc.
    height : float
        Height z >= 0, or the Plummer softening in the plane.

    Returns
    -------
    ndarray
        Radial acceleration, of the shape of `radius`, negative inwards.
    """
    w, s = height + 1j * disc_radius, np.hypot(radius, height)
    turn = np.angle(s * np.sqrt(radius**2 + w**2) + radius**2 + height * w)
    return -mass / (disc_radius * radius) * (np.arcsinh(w / radius).imag - height / s * turn)  # eq. (2)
