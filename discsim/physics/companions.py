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

from discsim.exact import kepler
from discsim.parts import Lazy
from discsim.physics import centre, profile
from discsim.physics.centre import kepler_omega
from discsim.physics.local import PHASES

if TYPE_CHECKING:
    from discsim.physics.local import Outlook
    from discsim.scene import Scene

Array = np.ndarray
orbits = Lazy("discsim.physics.orbits")
viscosity = Lazy("discsim.physics.viscosity")
ANGLES = 2048  # of an orbit, over which (1) is averaged: twelve within a softening of a fiftieth of it
RADII = 4096  # at which it is, and between which it is interpolated
PLANET = 0.03  # of the star's mass: what is heavier is a star
# Spacings of the disc: how far the nearest particle is beyond what a companion takes, of streams to a star, beside a
# disc that a planet stirs, and within one.
STREAM, PASSING, EMBEDDED = 2.0, 1.2, 0.5
OVERLAP, CAVITY = 1.3, 0.65  # of (m / (M + m))^(2/7) a


def ramped(companion: Any, time: float) -> float:
    """Share of its mass that gas and dust feel a time after it began: sin^2(pi t / 2 ramp) until `ramp`, then 1."""
    if time >= companion.ramp:
        return 1.0
    return math.sin(0.5 * math.pi * time / companion.ramp) ** 2 if time > 0.0 else 0.0


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


def step_of_orbit(scene: Scene, companion: Any, time: float) -> Array | float:
    """1/Omega of a companion where it is; of a bound one on an eccentric orbit at PHASES even times of half of it."""
    star: Any = scene.star
    a, e, mu = companion.semi_major_axis, companion.eccentricity, star.mass + companion.mass
    if e > 1.0:
        mean = kepler.mean_anomaly(e, math.radians(companion.phase)) + math.sqrt(mu / a**3) * time
        return math.sqrt(math.hypot(*kepler.at_mean_anomaly(mu, a, e, mean)[:2]) ** 3 / mu)
    if e == 0.0:
        return math.sqrt(a**3 / mu)
    anomaly = np.linspace(0.0, np.pi, 8 * PHASES + 1)
    at_even_times = np.interp((np.arange(PHASES) + 0.5) * np.pi / PHASES, anomaly - e * np.sin(anomaly), anomaly)
    return np.asarray(np.sqrt((a * (1.0 - e * np.cos(at_even_times))) ** 3 / mu))


def steps_nearby(scene: Scene, outlook: Outlook) -> list[float]:
    """Step limits of each companion for the nearest particle; inf where no particle comes near.

    It crosses d, with the softening in it, at (2 G m / d)^(1/2). The step takes velocities of half a step before: at
    Omega^2 a dt / 2 a particle crosses too.
    """
    found = []
    for companion in scene.table("companion") or ():
        mass, away = companion.mass * ramped(companion, outlook.time), _nearest(scene, companion, outlook)
        fallen = math.sqrt(2.0 * mass / away)
        behind = 0.5 * scene.run.courant * orbits.IN_KICKS * scene.star.mass / companion.semi_major_axis**2
        near = mass > 0.0 and away < math.inf
        found.append(2.0 * away / (fallen + math.sqrt(fallen**2 + 4.0 * behind * away)) if near else math.inf)
    return found


def gathering(scene: Scene, outlook: Outlook) -> tuple[float, int]:
    """The largest frequency (2 G m / d^3)^(1/2) of gas that gathers in the softening of a companion, and its number."""
    found = [(0.0, 0)]
    for k, companion in enumerate(scene.table("companion") or (), 1):
        away = _nearest(scene, companion, outlook)
        if _edge(companion) < softening(scene, companion, companion.semi_major_axis):
            found.append((math.sqrt(2.0 * companion.mass * ramped(companion, outlook.time) / away**3), k))
    return max(found)


def _edge(companion: Any) -> float:
    """Within which no particle is; of a companion that takes only some of what comes near, they are all the way in."""
    return float(companion.accretion_radius) if companion.accretion_rate is None else 0.0


def _nearest(scene: Scene, companion: Any, outlook: Outlook) -> float:
    """The distance of the nearest particle with the softening; inf where none comes near."""
    if not meets(scene, companion, outlook):
        return math.inf
    a, e = companion.semi_major_axis, companion.eccentricity
    beside = e < 1.0 and not (outlook.inner <= a * (1.0 + e) and outlook.outer >= a * (1.0 - e))
    spacings = STREAM if is_star(scene, companion) else PASSING if beside else EMBEDDED
    return math.hypot(_edge(companion) + spacings * outlook.spacing(a), softening(scene, companion, a))


def is_star(scene: Scene, companion: Any) -> bool:
    """True if a companion is a star, for which Hill radius and gap have no meaning."""
    star: Any = scene.star
    return bool(companion.mass >= PLANET * star.mass)


def meets(scene: Scene, companion: Any, outlook: Outlook) -> bool:
    """True if particles come near a companion: where orbits overlap within 1.3 (m / (M + m))^(2/7) a (Wisdom 1980). A
    second star holds a cavity open, and takes half of that on a circle, more on an eccentric orbit. What is beside an
    orbit comes near after half a turn of a planet, and a turn of a star.
    """
    star: Any = scene.star
    a, e = companion.semi_major_axis, companion.eccentricity
    width = CAVITY * (1.0 + 2.0 * e) if is_star(scene, companion) else OVERLAP
    reach = width * (companion.mass / (star.mass + companion.mass)) ** (2.0 / 7.0) * a
    nearest, farthest = a * abs(1.0 - e), a * (1.0 + e) if e < 1.0 else math.inf
    turns = 1.0 if is_star(scene, companion) else 0.5
    beside = not (outlook.inner <= farthest and outlook.outer >= nearest)
    if beside and e < 1.0 and outlook.passed < turns * period(scene, companion):
        return False
    return bool(outlook.inner <= farthest + reach and outlook.outer >= nearest - reach)


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
