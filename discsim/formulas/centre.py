"""Central mass of a disc, and the orbital frequency and temperature that follow from it.

    Omega_K = [G M / (r^2 + s^2)^(3/2)]^(1/2),     s the star's softening                                      (1)
    c_T     = (H/r)_0 (G M / r_0)^(1/2) at r_0,    M at the start: starlight keeps it while the star grows      (2)

M is the mass of the star, with its accreted mass if it grows. About the barycentre it includes the full mass of each
bound companion, even during a ramp.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

Array = np.ndarray
LEAST = 1e-200  # lower bound of r^2 + s^2, which keeps eq. (1) finite at the centre


def central(about: str, eccentricities: Iterable[float]) -> Array:
    """Return which bodies are part of the central mass, bool (n,).

    They are the star, and if `about` is "barycentre" the bound companions too.
    """
    return np.array([True, *(about == "barycentre" and e < 1.0 for e in eccentricities)])


def omega(mass: float, radius: Array | float, softening: float) -> Array:
    """Return the orbital frequency (n,) of circles about a central mass, eq. (1)."""
    return np.sqrt(mass / np.maximum(np.square(radius) + softening**2, LEAST) ** 1.5)


def passive_speed(mass: float, aspect_ratio: float, radius: float) -> float:
    """Return the isothermal sound speed of gas with a given H/r at a radius, eq. (2)."""
    return float(aspect_ratio * np.sqrt(mass / radius))
