"""Effects of companions of the star on a disc: softening, ramp, mean pull, gap. Numpy only.

The inward acceleration of a ring of radius r by a companion of mass m at distance a, averaged over its orbit, is

    g(r) = m < (r - a cos phi) / (r^2 + a^2 - 2 r a cos phi + eps^2)^(3/2) >_phi                              (1)

The gap number and the depth of the gap are (Kanagawa et al. 2015)

    K = q^2 (H/r)^-5 / alpha,   Sigma / Sigma_0 = 1 / (1 + 0.04 K)                                              (2)
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
ANGLES = 2048  # angles of the average (1) over an orbit: 12 within a softening of 0.02 a
RADII = 4096  # radii at which (1) is tabulated for linear interpolation
PLANET = 0.03  # companion mass over that of the star from which on it counts as a star
# Distance of the nearest particle beyond the accretion radius, in particle spacings of the disc: in streams to a
# second star, for a planet next to a disc, and for a planet inside the disc.
STREAM, PASSING, EMBEDDED = 2.0, 1.2, 0.5
OVERLAP, CAVITY = 1.3, 0.65  # reach of a planet, and of a second star, in (m / (M + m))^(2/7) a


def ramped(companion: Any, time: float) -> float:
    """Return the fraction of a companion's mass that gas and dust feel: sin^2(pi t / 2 ramp) until `ramp`, then 1.

    time: since the companion was introduced.
    """
    if time >= companion.ramp:
        return 1.0
    return math.sin(0.5 * math.pi * time / companion.ramp) ** 2 if time > 0.0 else 0.0


def scale_height(scene: Scene, r: Array | float, mass: float | None = None) -> Array:
    """Return H = c_T / Omega (n,) at radius r by the scene's temperature; a polytrope of particles does not give one.

    mass: central mass, by default that of the start.
    """
    r = np.asarray(r, dtype=float)
    return profile.thermal_speed(scene, r) / kepler_omega(scene, r, mass)


def softening(scene: Scene, companion: Any, r: float, mass: float | None = None) -> float:
    """Return the Plummer softening of a companion at distance r from the centre: given, or a multiple of H there.

    mass: central mass of H, as in `scale_height`.
    """
    number, in_heights = companion.softening
    return number * float(scale_height(scene, r, mass)) if in_heights else number


def hill_radius(scene: Scene, companion: Any) -> float:
    """Return a (m / 3 M)^(1/3), the radius within which a companion's pull dominates."""
    star: Any = scene.star
    return companion.semi_major_axis * (companion.mass / (3.0 * star.mass)) ** (1.0 / 3.0)


def period(scene: Scene, companion: Any) -> float:
    """Return the period of a companion's orbit about the star."""
    star: Any = scene.star
    mass = orbits.orbital_mass(scene, star.mass, companion.mass)
    return 2.0 * math.pi * math.sqrt(companion.semi_major_axis**3 / mass)


def gap_number(scene: Scene, companion: Any) -> float:
    """Return K of eq. (2) in gas with a physical viscosity."""
    star: Any = scene.star
    a = companion.semi_major_axis
    height = float(scale_height(scene, a))
    nu = float(viscosity.diffusivity(scene, np.array([a]))[0])
    alpha = nu / (height**2 * kepler_omega(scene, a))
    return float((companion.mass / star.mass) ** 2 * (height / a) ** -5 / alpha)


def step_of_orbit(scene: Scene, companion: Any, time: float) -> Array | float:
    """Return (r^3 / mu)^(1/2) at the companion's present distance; on a bound eccentric orbit (PHASES,) of such values.

    The latter are at even times of half an orbit, by symmetry all of it.
    """
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


def encounter_limits(scene: Scene, outlook: Outlook) -> list[float]:
    """Return the time-step limit of each companion by the nearest particle; inf if no particle comes near.

    The particle crosses the distance d, which includes the softening, at (2 G m / d)^(1/2). Velocities lag by half a
    step, which adds a speed of Omega^2 a dt / 2.
    """
    found = []
    for companion in scene.table("companion") or ():
        mass, away = companion.mass * ramped(companion, outlook.time), _nearest(scene, companion, outlook)
        fallen = math.sqrt(2.0 * mass / away)
        behind = 0.5 * scene.run.courant * orbits.IN_KICKS * scene.star.mass / companion.semi_major_axis**2
        near = mass > 0.0 and away < math.inf
        found.append(2.0 * away / (fallen + math.sqrt(fallen**2 + 4.0 * behind * away)) if near else math.inf)
    return found


def fastest_in_softening(scene: Scene, outlook: Outlook) -> tuple[float, int]:
    """Return the largest frequency (2 G m / d^3)^(1/2) of gas that collects in a companion's softening, and its number.

    Return (0, 0) if no companion has an accretion radius below its softening.
    """
    found = [(0.0, 0)]
    for k, companion in enumerate(scene.table("companion") or (), 1):
        away = _nearest(scene, companion, outlook)
        if _edge(companion) < softening(scene, companion, companion.semi_major_axis):
            found.append((math.sqrt(2.0 * companion.mass * ramped(companion, outlook.time) / away**3), k))
    return max(found)


def _edge(companion: Any) -> float:
    """Return the radius about a companion without particles: that of accretion; 0 if its accretion rate is limited."""
    return float(companion.accretion_radius) if companion.accretion_rate is None else 0.0


def _nearest(scene: Scene, companion: Any, outlook: Outlook) -> float:
    """Return the softened distance of the particle nearest to a companion; inf if none comes near."""
    if not particles_reach(scene, companion, outlook):
        return math.inf
    a, e = companion.semi_major_axis, companion.eccentricity
    beside = e < 1.0 and not (outlook.inner <= a * (1.0 + e) and outlook.outer >= a * (1.0 - e))
    spacings = STREAM if is_star(scene, companion) else PASSING if beside else EMBEDDED
    return math.hypot(_edge(companion) + spacings * outlook.spacing(a), softening(scene, companion, a))


def is_star(scene: Scene, companion: Any) -> bool:
    """Return whether a companion is a star, for which Hill radius and gap have no meaning."""
    star: Any = scene.star
    return bool(companion.mass >= PLANET * star.mass)


def particles_reach(scene: Scene, companion: Any, outlook: Outlook) -> bool:
    """Return whether particles come near a companion.

    Resonances overlap within 1.3 (m / (M + m))^(2/7) a of the orbit (Wisdom 1980). A second star keeps a cavity open:
    half that width on a circle, more on an eccentric orbit. Particles next to the orbit come near after half a period
    of a planet, or one of a star.
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
    """Return the inward acceleration (n,) at `radius` (n,) that companions add at t = 0 to a central star, eq. (1).

    If the disc is about the barycentre, the star is on a circle too; the result includes the difference. A companion
    with a ramp then acts with its whole mass at the barycentre; about the star it does not act at all. Orbits count as
    circles of their semi-major axis; unbound companions have no mean pull.
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
    """Yield mass, radius and softening of rings with the mean pull of companions.

    For a star on a circle, rings with its mean pull less that of a star at the centre are added.
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
        share = star.mass / (star.mass + mass) if central else 1.0  # companion's distance from the centre, over a
        yield mass, share * distance, softening(scene, companion, share * distance)
        if central:
            yield star.mass, (1.0 - share) * distance, star.softening
            yield -star.mass, 0.0, star.softening


def _of_ring(r: Array, distance: float, length: float) -> Array:
    """Return eq. (1) (n,) for unit mass."""
    if distance == 0.0:
        return r / (r * r + length * length) ** 1.5
    out = np.zeros_like(r)
    # Midpoint rule over half a circle; the other half is its mirror image.
    for angle in (np.arange(ANGLES // 2) + 0.5) * (2.0 * math.pi / ANGLES):
        cosine = math.cos(angle)
        out += (r - distance * cosine) / (r * r + distance * (distance - 2.0 * r * cosine) + length * length) ** 1.5
    return out / (ANGLES // 2)
