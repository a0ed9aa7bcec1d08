"""Central mass M of a disc, and the orbital frequency and temperature that follow from it.

    Omega_K = [G M / (r^2 + s^2)^(3/2)]^(1/2)      at radius r, with the softening s of the star               (1)
    c_T     = (H/r)_0 (G M / r_0)^(1/2)            at radius r_0, with the initial M                           (2)
    P       = 2 pi [a^3 / (G mu)]^(1/2)            of a companion, with the semi-major axis a                  (3)

M is the mass of the star, with the accreted mass if the star grows. In a disc about the barycentre, M includes the full
mass of each bound companion, even during a ramp. In (2) M stays the initial mass, so that a growing star does not
change the temperature. In (3), Kepler's third law, mu is the sum of the masses of star and companion; it is the mass of
the star if companions do not accelerate the star.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable

import numpy as np

Array = np.ndarray
SMALLEST = 1e-200  # lower bound of r^2 + s^2, which keeps eq. (1) finite at the centre


def central_flags(about: str, eccentricities: Iterable[float]) -> Array:
    """Return flags (n,), for the star and then for the companions: whether the body is part of the central mass.

    about: centre of the disc, "star" or "barycentre". The star is always part of the central mass; companions with
    an eccentricity below 1 are part of it only in a disc about the barycentre. eccentricities: eccentricity of each
    companion.
    """
    return np.array([True, *(about == "barycentre" and e < 1.0 for e in eccentricities)])


def omega(mass: float, radius: Array | float, softening: float) -> Array:
    """Return the angular frequency (n,) of circular orbits of `radius` (n,) about a central mass, eq. (1)."""
    return np.sqrt(mass / np.maximum(np.square(radius) + softening**2, SMALLEST) ** 1.5)


def passive_speed(mass: float, aspect_ratio: float, radius: float) -> float:
    """Return the isothermal sound speed of gas with a given H/r at a radius, eq. (2)."""
    return float(aspect_ratio * np.sqrt(mass / radius))


def orbital_mass(star: float, companion: float, sources: Collection[str] | None) -> float:
    """Return mu of the orbit of a companion, eq. (3), from the masses of star and companion.

    sources: names of the sources that accelerate the star, the key star.indirect; None, the default, includes
    "companions".
    """
    return star + companion if sources is None or "companions" in sources else star


def period(mass: float, semi_major_axis: float) -> float:
    """Return the period of an orbit with the total mass mu = `mass`, eq. (3)."""
    return 2.0 * math.pi * math.sqrt(semi_major_axis**3 / mass)
