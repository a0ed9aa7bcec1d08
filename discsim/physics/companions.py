"""Effects of companions of the star on a disc: softening, ramp, mean pull, gap. Numpy only.

A companion of mass m at distance a pulls a ring of radius r, averaged over its orbit, inwards with

    g(r) = m < (r - a cos phi) / (r^2 + a^2 - 2 r a cos phi + eps^2)^(3/2) >_phi                              (1)

Its gap has the number (Kanagawa et al. 2015)

    K = q^2 (H/r)^-5 / alpha,   and is as deep as   Sigma / Sigma_0 = 1 / (1 + 0.04 K)                          (2)
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.parts import Lazy
from discsim.physics import centre, profile
from discsim.physics.centre import kepler_omega

if TYPE_CHECKING:
    from discsim.scene import Scene

Array = np.ndarray
orbits = Lazy("discsim.physics.orbits")
viscosity = Lazy("discsim.physics.viscosity")
ANGLES = 2048  # of an orbit, over which (1) is averaged: twelve within a softening of a fiftieth of it
RADII = 4096  # at which it is, and between which it is interpolated


def ramped(companion: Any, time: float) -> float:
    """Share of its mass that gas and dust feel a time after it began: sin^2(pi t / 2 ramp) until `ramp`, then 1."""
    if time >= companion.ramp:
        return 1.0
    return math.sin(0.5 * math.pi * max(time, 0.0) / companion.ramp) ** 2


def scale_height(scene: Scene, r: Array | float, mass: float | None = None) -> Array:
    """H = c_T / Omega (n,) at radius r, of the temperature that the scene gives (a polytrope of particles gives none).

    mass: central mass, by default that of the start.
    """
    r = np.asarray(r, dtype=float)
    return profile.thermal_speed(scene, r) / kepler_omega(scene, r, mass)


def softening(scene: Scene, companion: Any, r: float, mass: float | None = None) -> float:
    """Plummer length of a companion at distance r from the centre: a length, or a number of the local H, of which
    `mass` is the central mass as in `scale_height`.
    """
    number, in_heights = companion.softening
    return number * float(scale_height(scene, r, mass)) if in_heights else number


def hill_radius(scene: Scene, companion: Any) -> float:
    """a (m / 3 M)^(1/3), within which it outweighs the star."""
    star: Any = scene.star
    return companion.semi_major_axis * (companion.mass / (3.0 * star.mass)) ** (1.0 / 3.0)


def period(scene: Scene, companion: Any) -> float:
    """Of its orbit about the star, with its own mass."""
    star: Any = scene.star
    mass = orbits.orbital_mass(scene, star.mass, companion.mass)
    return 2.0 * math.pi * math.sqrt(companion.semi_major_axis**3 / mass)


def gap_number(scene: Scene, companion: Any) -> float:
    """K of eq. (2) in gas of a physical viscosity."""
    star: Any = scene.star
    a = companion.semi_major_axis
    height = float(scale_height(scene, a))
    nu = float(viscosity.diffusivity(scene, np.array([a]))[0])
    alpha = nu / (height**2 * kepler_omega(scene, a))
    return float((companion.mass / star.mass) ** 2 * (height / a) ** -5 / alpha)


def longest_step(scene: Scene, companion: Any, in_gas: bool) -> float:
    """About what it allows: 1/Omega of its orbit at the pericentre, and where it is `in_gas` that of a particle within
    its softening, or at the edge of what it takes.
    """
    star: Any = scene.star
    a, e = companion.semi_major_axis, companion.eccentricity
    orbit = math.sqrt((a * abs(1.0 - e)) ** 3 / (star.mass + companion.mass))
    if not in_gas:
        return orbit
    # Of a companion that takes only some of what comes near, particles are all the way in.
    nearest = companion.accretion_radius if companion.accretion_rate is None else 0.0
    around = math.hypot(nearest, softening(scene, companion, a))
    return min(orbit, math.sqrt(around**3 / companion.mass))


def mean_pull(scene: Scene, radius: Array) -> Array:
    """Inward acceleration (n,) at `radius` (n,) that companions add to that of a star at the centre at t = 0, eq. (1).

    About the barycentre the star is on a circle too, and the difference is part of it. A companion with a ramp pulls as
    its whole mass at the barycentre where the disc turns about that, and else not at all. Orbits count as circles of
    their semi-major axis; unbound companions have no mean pull.
    """
    radius = np.asarray(radius, dtype=float)
    rings = list(_rings(scene))
    if not rings or radius.size == 0:
        return np.zeros_like(radius)
    at = np.linspace(radius.min(), radius.max(), RADII) if np.ptp(radius) > 0.0 else radius.ravel()[:1]
    total = np.zeros_like(at)
    for mass, distance, length in rings:
        total += mass * _of_ring(at, distance, length)
    return np.interp(radius, at, total)


def _rings(scene: Scene) -> Any:
    """Mass, radius and softening of rings whose pull is that of companions, and of a star on a circle less that of one
    at the centre.
    """
    star: Any = scene.star
    for companion, central in zip(scene.table("companion") or (), centre.central(scene)[1:].tolist(), strict=True):
        mass, distance = companion.mass, companion.semi_major_axis
        if companion.eccentricity >= 1.0:
            continue
        if ramped(companion, 0.0) == 0.0:
            if central:
                yield mass, 0.0, star.softening
            continue
        share = star.mass / (star.mass + mass) if central else 1.0  # of the distance, that the companion is away
        yield mass, share * distance, softening(scene, companion, share * distance)
        if central:
            yield star.mass, (1.0 - share) * distance, star.softening
            yield -star.mass, 0.0, star.softening


def _of_ring(r: Array, distance: float, length: float) -> Array:
    """Eq. (1) of unit mass (n,)."""
    if distance == 0.0:
        return r / (r * r + length * length) ** 1.5
    out = np.zeros_like(r)
    # At the middles of even parts of half a circle; the other half is its mirror image.
    for angle in (np.arange(ANGLES // 2) + 0.5) * (2.0 * math.pi / ANGLES):
        cosine = math.cos(angle)
        out += (r - distance * cosine) / (r * r + distance * (distance - 2.0 * r * cosine) + length * length) ** 1.5
    return out / (ANGLES // 2)
