"""Central mass of a disc, and the orbits and the temperature that it gives: one place for every part that needs them.

    Omega_K = [G M / (r^2 + s^2)^(3/2)]^(1/2),     s the star's softening                                      (1)
    c_T     = (H/r)_0 (G M / r_0)^(1/2) at r_0,    M at the start: starlight keeps it while the star grows      (2)

with M the mass of the star and what it has accreted where it grows; about the barycentre also that of each bound
companion, which a ramp leaves whole.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

Array = np.ndarray
LEAST = 1e-200  # of r^2 + s^2: eq. (1) stays finite at the centre itself


def central(about: str, eccentricities: Iterable[float]) -> Array:
    """Bodies that a disc turns about (n,): the star, and where `about` is "barycentre" the bound companions."""
    return np.array([True, *(about == "barycentre" and e < 1.0 for e in eccentricities)])


def omega(mass: float, radius: Array | float, softening: float) -> Array:
    """Frequency of circles (n,) about a central mass, eq. (1)."""
    return np.sqrt(mass / np.maximum(np.square(radius) + softening**2, LEAST) ** 1.5)


def passive_speed(mass: float, aspect_ratio: float, radius: float) -> float:
    """Isothermal sound speed of gas with a given H/r at a radius, eq. (2)."""
    return float(aspect_ratio * np.sqrt(mass / radius))
