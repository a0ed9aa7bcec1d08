"""Companions as functions of a scene: softening, ramp, mean pull on the disc, gap, time-step limits. Numpy only.

The inward acceleration of a ring of radius r by a companion of mass m at distance a, averaged over its orbit, is

    g(r) = m < (r - a cos phi) / (r^2 + a^2 - 2 r a cos phi + eps^2)^(3/2) >_phi                              (1)

with the softening eps and the average < > over phi. The gap number and the depth of the gap are (Kanagawa et al. 2015)

    K = q^2 (H/r)^-5 / alpha,   Sigma / Sigma_0 = 1 / (1 + 0.04 K)                                              (2)
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.exact import kepler
from discsim.formulas import centre as centre_formulas
from discsim.formulas import companions as formulas
from discsim.parts import Lazy
from discsim.physics import centre, profile
from discsim.physics.centre import kepler_omega
from discsim.physics.local import PHASES

if TYPE_CHECKING:
    from discsim.physics.local import ForecastState
    from discsim.scene import Scene

Array = np.ndarray
orbits = Lazy("discsim.physics.orbits")
viscosity = Lazy("discsim.physics.viscosity")
ANGLES = 2048  # number of angles in the average (1): 12 within a softening of 0.02 a
RADII = 4096  # number of radii at which (1) is tabulated for linear interpolation
# Distance of the nearest particle beyond the accretion radius, in particle spacings of the disc: in streams to a
# second star, for a planet outside the radii of the disc, and for a planet between them.
SPACINGS_STREAM, SPACINGS_PASSING, SPACINGS_EMBEDDED = 2.0, 1.2, 0.5
# Largest distance from the orbit, in (m / (M + m))^(2/7) a, from which particles reach a planet or a second star.
REACH_OF_PLANET, REACH_OF_STAR = 1.3, 0.65


def ramp_fraction(companion: Any, time: float) -> float:
    """Return the fraction of a companion's mass that acts on gas and dust: sin^2(pi t / 2 ramp) until `ramp`, then 1.

    time: time t since the companion was added to the run.
    """
    if time >= companion.ramp:
        return 1.0
    return math.sin(0.5 * math.pi * time / companion.ramp) ** 2 if time > 0.0 else 0.0


def scale_height(scene: Scene, r: Array | float, mass: float | None = None) -> Array:
    """Return the initial H = c_T / Omega (n,) at radius `r` (n,); not for polytropic SPH gas, as H depends on density.

    mass: central mass, by default the initial one.
    """
    r = np.asarray(r, dtype=float)
    return profile.initial_thermal_speed(scene, r) / kepler_omega(scene, r, mass)


def softening(scene: Scene, companion: Any, r: float, mass: float | None = None) -> float:
    """Return the Plummer softening of a companion at distance `r` from the centre: a fixed length, or a multiple of H.

    mass: central mass for H, as in `scale_height`.
    """
    number, in_heights = companion.softening
    return number * float(scale_height(scene, r, mass)) if in_heights else number


def hill_radius(scene: Scene, companion: Any) -> float:
    """Return the Hill radius a (m / 3 M)^(1/3), within which the gravity of a companion dominates."""
    return formulas.hill_radius(companion.semi_major_axis, companion.mass / scene.star.mass)


def period(scene: Scene, companion: Any) -> float:
    """Return the period of a companion's orbit about the star."""
    mass = centre_formulas.orbital_mass(scene.star.mass, companion.mass, scene.star.indirect)
    return centre_formulas.period(mass, companion.semi_major_axis)


def gap_number(scene: Scene, companion: Any) -> float:
    """Return the gap number K of eq. (2), with alpha of [alpha_viscosity]."""
    a = companion.semi_major_axis
    height = float(scale_height(scene, a))
    nu = float(viscosity.diffusivity(scene, np.array([a]))[0])
    alpha = nu / (height**2 * kepler_omega(scene, a))
    return float((companion.mass / scene.star.mass) ** 2 * (height / a) ** -5 / alpha)


def step_of_orbit(scene: Scene, companion: Any, time: float) -> Array | float:
    """Return 1 / Omega = (r^3 / mu)^(1/2) of a companion at the distance r from the star; mu is the sum of both masses.

    For an unbound companion, r is the distance at `time`. For a bound eccentric orbit, the result is an array
    (PHASES,) with values at equidistant times in half an orbit, which represent the other half too.
    """
    a, e, mu = companion.semi_major_axis, companion.eccentricity, scene.star.mass + companion.mass
    if e > 1.0:
        mean = kepler.mean_anomaly(e, math.radians(companion.phase)) + math.sqrt(mu / a**3) * time
        return math.sqrt(math.hypot(*kepler.motion_at_mean_anomaly(mu, a, e, mean)[:2]) ** 3 / mu)
    if e == 0.0:
        return math.sqrt(a**3 / mu)
    anomaly = np.linspace(0.0, np.pi, 8 * PHASES + 1)
    at_even_times = np.interp((np.arange(PHASES) + 0.5) * np.pi / PHASES, anomaly - e * np.sin(anomaly), anomaly)
    return np.asarray(np.sqrt((a * (1.0 - e * np.cos(at_even_times))) ** 3 / mu))


def encounter_limits(scene: Scene, outlook: ForecastState) -> list[float]:
    """Estimate the time-step limit of each companion by its nearest particle; inf if no particle comes near.

    The limit is the time in which the particle crosses the softened distance d at the speed (2 G m / d)^(1/2). As
    velocities are half a step behind positions, the speed Omega^2 a dt / 2 is added.
    """
    found = []
    for companion in scene.table("companion") or ():
        mass = companion.mass * ramp_fraction(companion, outlook.time)
        away = _nearest_distance(scene, companion, outlook)
        fallen = math.sqrt(2.0 * mass / away)
        behind = 0.5 * scene.run.courant * orbits.IN_KICKS * scene.star.mass / companion.semi_major_axis**2
        near = mass > 0.0 and away < math.inf
        found.append(2.0 * away / (fallen + math.sqrt(fallen**2 + 4.0 * behind * away)) if near else math.inf)
    return found


def fastest_in_softening(scene: Scene, outlook: ForecastState) -> tuple[float, int]:
    """Return the largest frequency (2 G m / d^3)^(1/2) of gas near a companion, and the number of this companion.

    d is the softened distance of the nearest particle. Only companions with an accretion radius below their softening
    count; the first companion has the number 1. Returns (0, 0) if there are none.
    """
    found = [(0.0, 0)]
    for k, companion in enumerate(scene.table("companion") or (), 1):
        away = _nearest_distance(scene, companion, outlook)
        if _cleared_radius(companion) < softening(scene, companion, companion.semi_major_axis):
            found.append((math.sqrt(2.0 * companion.mass * ramp_fraction(companion, outlook.time) / away**3), k))
    return max(found)


def _cleared_radius(companion: Any) -> float:
    """Return the radius of the region, around a companion, that has no particles.

    The result is the accretion radius, or 0 if accretion takes time (accretion_rate).
    """
    return float(companion.accretion_radius) if companion.accretion_rate is None else 0.0


def _nearest_distance(scene: Scene, companion: Any, outlook: ForecastState) -> float:
    """Return the softened distance of the particle nearest to a companion; inf if none comes near."""
    if not particles_reach(scene, companion, outlook):
        return math.inf
    a, e = companion.semi_major_axis, companion.eccentricity
    spacings = SPACINGS_EMBEDDED
    if is_second_star(scene, companion):
        spacings = SPACINGS_STREAM
    elif e < 1.0 and not (outlook.inner <= a * (1.0 + e) and outlook.outer >= a * (1.0 - e)):
        spacings = SPACINGS_PASSING
    return math.hypot(_cleared_radius(companion) + spacings * outlook.spacing(a), softening(scene, companion, a))


def is_second_star(scene: Scene, companion: Any) -> bool:
    """Return whether a companion is massive enough to count as a star. Hill radius and gap are defined for planets."""
    return bool(companion.mass >= formulas.LARGEST_PLANET * scene.star.mass)


def particles_reach(scene: Scene, companion: Any, outlook: ForecastState) -> bool:
    """Return whether particles come near a companion by the time of `outlook`.

    Particles come near a planet from within 1.3 (m / (M + m))^(2/7) a of its orbit, where resonances overlap (Wisdom
    1980). A second star clears a cavity: for it the distance is half as large on a circular orbit, and larger by the
    factor 1 + 2 e on an eccentric one. If the disc lies wholly inside or outside the orbit, its particles need half an
    orbital period to come near a planet, and a full period for a star.
    """
    a, e = companion.semi_major_axis, companion.eccentricity
    width, orbits_needed = REACH_OF_PLANET, 0.5
    if is_second_star(scene, companion):
        width, orbits_needed = REACH_OF_STAR * (1.0 + 2.0 * e), 1.0
    reach = width * (companion.mass / (scene.star.mass + companion.mass)) ** (2.0 / 7.0) * a
    nearest, farthest = a * abs(1.0 - e), a * (1.0 + e) if e < 1.0 else math.inf
    mark_outside = not (outlook.inner <= farthest and outlook.outer >= nearest)
    if mark_outside and e < 1.0 and outlook.elapsed < orbits_needed * period(scene, companion):
        return False
    return bool(outlook.inner <= farthest + reach and outlook.outer >= nearest - reach)


def mean_pull(scene: Scene, radius: Array) -> Array:
    """Return the mean inward acceleration (n,) by companions at `radius` (n,) at t = 0, eq. (1).

    The total acceleration is the result plus the acceleration by a star at the centre. Orbits are treated as circles
    with the semi-major axis as radius, and unbound companions have no mean pull. If the centre of the disc is the
    barycentre, the star too moves on a circle; the result includes the change of its pull, and a companion with a
    ramp acts with its full mass at the barycentre. If the centre is the star, a companion with a ramp does not act.
    """
    radius = np.asarray(radius, dtype=float)
    rings = list(_mean_rings(scene))
    if not rings or radius.size == 0:
        return np.zeros_like(radius)
    at = np.linspace(radius.min(), radius.max(), RADII) if np.ptp(radius) > 0.0 else radius.ravel()[:1]
    total = np.zeros_like(at)
    for mass, distance, length in rings:
        total += mass * _pull_of_ring(at, distance, length)
    return np.interp(radius, at, total)


def _mean_rings(scene: Scene) -> Any:
    """Yield (mass, radius, softening) of rings whose gravity is the mean gravity of the companions.

    For a star that moves on a circle, a ring for the star and a negative mass at the centre are yielded too.
    """
    for companion, central in zip(scene.table("companion") or (), centre.central_mask(scene)[1:].tolist(), strict=True):
        mass, distance = companion.mass, companion.semi_major_axis
        if companion.eccentricity >= 1.0:
            continue
        if ramp_fraction(companion, 0.0) == 0.0:
            if central:
                yield mass, 0.0, scene.star.softening
            continue
        star = scene.star
        share = star.mass / (star.mass + mass) if central else 1.0  # companion's distance from the centre, over a
        yield mass, share * distance, softening(scene, companion, share * distance)
        if central:
            yield star.mass, (1.0 - share) * distance, star.softening
            yield -star.mass, 0.0, star.softening


def _pull_of_ring(r: Array, distance: float, length: float) -> Array:
    """Return the acceleration (n,) of eq. (1) at radius `r` (n,), for m = 1, a = `distance` and eps = `length`."""
    if distance == 0.0:
        return r / (r * r + length * length) ** 1.5
    out = np.zeros_like(r)
    # Midpoint rule over half a circle; the other half is its mirror image.
    for angle in (np.arange(ANGLES // 2) + 0.5) * (2.0 * math.pi / ANGLES):
        cosine = math.cos(angle)
        out += (r - distance * cosine) / (r * r + distance * (distance - 2.0 * r * cosine) + length * length) ** 1.5
    return out / (ANGLES // 2)
