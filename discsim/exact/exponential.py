"""Field of the exponential disc Sigma = Sigma_0 exp(-r/R), in its plane or at a height above it.

With y = r / 2R, M = 2 pi Sigma_0 R^2 and G = 1 (Freeman 1970, ApJ 160, 811; Binney & Tremaine 2008, eq. 2.165),

    a_r = -(M y / R^2) [I_0(y) K_0(y) - I_1(y) K_1(y)]                               in the plane      (1)

At a height z the field is that of a line of masses at imaginary heights,
Phi = -int_0^inf g(t) Re[r^2 + (z + it)^2]^(-1/2) dt with
g(t) = 4 int_t^inf Sigma r dr / sqrt(r^2 - t^2) = 4 Sigma_0 t K_1(t/R). Integration by parts, with w = z + it, gives

    a_r = -(2 M / pi R^3 r) Im int_0^inf t K_0(t/R) w / sqrt(r^2 + w^2) dt                             (2)

The integrand is smooth along t = s exp(-i pi/4), s > 0. For a disc that ends at a radius, the pull of the rings beyond
is subtracted. A Plummer softening e in the plane is exactly equivalent to the unsoftened field at the height z = e.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ive, kv, kve

from discsim.exact import ring

Array = np.ndarray
STEP = 0.1  # step of ln s in the trapezoidal rule; the error is 1e-12 of the largest field


def surface_density(radius: Array, scale: float, mass: float) -> Array:
    """Return the surface density of the infinite disc.

    Parameters
    ----------
    radius : ndarray
        Radius r.
    scale : float
        Scale length R.
    mass : float
        Mass M of the infinite disc.

    Returns
    -------
    ndarray
        Surface density, of the shape of `radius`.
    """
    return mass / (2 * np.pi * scale**2) * np.exp(-radius / scale)


def enclosed_mass(radius: Array, scale: float, mass: float) -> Array:
    """Return the mass within a radius of the infinite disc.

    Parameters
    ----------
    radius : ndarray
        Radius r.
    scale : float
        Scale length R.
    mass : float
        Mass M of the infinite disc.

    Returns
    -------
    ndarray
        Mass, of the shape of `radius`.
    """
    x = radius / scale
    return -mass * (np.expm1(-x) + x * np.exp(-x))


def radial_acceleration(radius: Array, scale: float, mass: float, height: float = 0.0, cut: float = np.inf) -> Array:
    """Return the radial acceleration of the disc, whole or cut off at a radius; G = 1.

    Parameters
    ----------
    radius : ndarray, shape (n,)
        Radius r, above 0, and well within `cut` if that is finite.
    scale : float
        Scale length R.
    mass : float
        Mass M of the infinite disc.
    height : float
        Height z above the plane, or the Plummer softening in the plane.
    cut : float
        Radius at which the disc ends.

    Returns
    -------
    ndarray, shape (n,)
        Radial acceleration, negative inwards.
    """
    whole = (
        _acceleration_at_height(radius, scale, mass, height) if height else _acceleration_in_plane(radius, scale, mass)
    )
    if np.isinf(cut):
        return whole
    return whole - ring.outer_disc_acceleration(radius, cut, lambda s: surface_density(s, scale, mass), height)


def _acceleration_in_plane(radius: Array, scale: float, mass: float) -> Array:
    y = radius / (2 * scale)
    return -mass * y / scale**2 * (ive(0, y) * kve(0, y) - ive(1, y) * kve(1, y))  # eq. (1)


def _acceleration_at_height(radius: Array, scale: float, mass: float, height: float) -> Array:
    t = scale * np.exp(np.arange(-20, 4.5, STEP) - 0.25j * np.pi)
    total = np.zeros(np.shape(radius))
    for at, weight in zip(height + 1j * t, STEP * t**2 * kv(0, t / scale), strict=True):
        total += (weight * at / np.sqrt(radius**2 + at**2)).imag
    return -2 * mass / (np.pi * scale**3 * radius) * total  # eq. (2)
