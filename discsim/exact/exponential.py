"""Field of the exponential disc Sigma = Sigma_0 exp(-r/R), in its plane or at a height above it.

With y = r / 2R, M = 2 pi Sigma_0 R^2 and G = 1 (Freeman 1970, ApJ 160, 811; Binney & Tremaine 2008, eq. 2.165),

    a_r = -(M y / R^2) [I_0(y) K_0(y) - I_1(y) K_1(y)]                               in the plane      (1)

At a height z a disc is a line of masses at imaginary heights, Phi = -int_0^inf g(t) Re[r^2 + (z + it)^2]^(-1/2) dt with
g(t) = 4 int_t^inf Sigma r dr / sqrt(r^2 - t^2) = 4 Sigma_0 t K_1(t/R). By parts, with w = z + it,

    a_r = -(2 M / pi R^3 r) Im int_0^inf t K_0(t/R) w / sqrt(r^2 + w^2) dt                             (2)

whose integrand is smooth along t = s exp(-i pi/4), s > 0. A disc that ends at a radius lacks the pull of the rings
beyond it. A Plummer softening e gives the field at the height z = e: no approximation.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ive, kv, kve

from discsim.exact import ring

Array = np.ndarray
STEP = 0.1  # of ln s, for the trapezoidal rule: 1e-12 of the largest field


def surface_density(radius: Array, scale: float, mass: float) -> Array:
    """Surface density at `radius` of the whole disc of `mass`."""
    return mass / (2 * np.pi * scale**2) * np.exp(-radius / scale)


def enclosed_mass(radius: Array, scale: float, mass: float) -> Array:
    """Mass within `radius`."""
    x = radius / scale
    return -mass * (np.expm1(-x) + x * np.exp(-x))


def radial_acceleration(radius: Array, scale: float, mass: float, height: float = 0.0, cut: float = np.inf) -> Array:
    """Radial acceleration (n,) at `radius` (n,) > 0 and `height`, or in the plane with that softening.

    `mass` is that of the whole disc, of which only what lies within `cut` is there. Then `radius` must be well within.
    """
    whole = _at_height(radius, scale, mass, height) if height else _in_plane(radius, scale, mass)
    if np.isinf(cut):
        return whole
    return whole - ring.beyond(radius, cut, lambda s: surface_density(s, scale, mass), height)


def _in_plane(radius: Array, scale: float, mass: float) -> Array:
    y = radius / (2 * scale)
    return -mass * y / scale**2 * (ive(0, y) * kve(0, y) - ive(1, y) * kve(1, y))  # eq. (1)


def _at_height(radius: Array, scale: float, mass: float, height: float) -> Array:
    t = scale * np.exp(np.arange(-20, 4.5, STEP) - 0.25j * np.pi)
    total = np.zeros(np.shape(radius))
    for at, weight in zip(height + 1j * t, STEP * t**2 * kv(0, t / scale), strict=True):
        total += (weight * at / np.sqrt(radius**2 + at**2)).imag
    return -2 * mass / (np.pi * scale**3 * radius) * total  # eq. (2)
