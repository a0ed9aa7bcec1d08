"""Gaps of planets in snapshots: surface density without the planet's own disc, and the edges of a gap.

The edges of a gap are the radii, inside and outside the orbit, at which

    Sigma = Sigma_0 / 2                                                    (Kanagawa et al. 2016, PASJ 68, 43)

Sigma is the mean over the angles that are not within two Hill radii of the planet, whose own disc is not part of the
gap. Sigma_0 is the surface density without the planet; in figures it is that of the first snapshot. A gap that is
nowhere that deep, within two Hill radii of the orbit, has no edges.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from discsim.exact import kepler
from discsim.formulas.companions import LARGEST_PLANET, hill_radius
from discsim.output.cells import polar_grid

if TYPE_CHECKING:
    from discsim.output.snapshot import Snapshot, SnapshotParticles

Array = np.ndarray
RINGS = 160  # number of rings of a profile, between half and twice the orbital radius
START_WIDTH = 6.0  # rings over which Sigma_0 is smoothed, as the particles of a quiet start lie on rings
HILLS = 2.0  # Hill radii around the planet that the profile excludes
OUTSIDE = 0.02  # fraction of the largest Sigma_0, below which a ring is outside the disc
AT_EDGE = 0.5  # Sigma / Sigma_0 at the edges of a gap


class BodyOrbit(NamedTuple):
    """Orbit of a companion about the centre of the disc, in a snapshot.

    Attributes
    ----------
    number : int
        Number of the companion, from 1.
    place : ndarray, shape (2,)
        Position relative to the centre of the disc.
    radius : float
        Semi-major axis; the present distance for an unbound companion.
    eccentricity : float
        Eccentricity; 0 for an unbound companion.
    ratio : float
        Mass over that of the star.
    distance : float
        Present distance from the star.
    """

    number: int
    place: Array
    radius: float
    eccentricity: float
    ratio: float
    distance: float

    @property
    def is_planet(self) -> bool:
        """True for a planet, False for a second star, which has no Hill radius and no gap."""
        return self.ratio < LARGEST_PLANET

    @property
    def hill(self) -> float:
        """Hill radius at the present distance from the star."""
        return hill_radius(self.distance, self.ratio)


def companion_orbits(snap: Snapshot) -> list[BodyOrbit]:
    """Return the orbits of the companions of a snapshot relative to the centre of the disc; [] without companions.

    Elements are those of the two-body orbit about the star. In a disc about the barycentre, the semi-major axis is
    scaled to the companion's distance from the barycentre.
    """
    bodies, found = snap.bodies, []
    if bodies is None or bodies.vel is None or snap.dimensions != 2 or "companion" not in snap.tables:
        return []
    indirect = snap.tables["star"].get("indirect")
    pulls_star = not isinstance(indirect, list) or "companions" in indirect
    for k in range(1, bodies.count):
        r, v = bodies.pos[k] - bodies.pos[0], bodies.vel[k] - bodies.vel[0]
        star, mass, away = float(bodies.mass[0]), float(bodies.mass[k]), float(np.hypot(*r))
        if away == 0.0 or star == 0.0:
            continue
        orbit = kepler.elements(star + mass * pulls_star, *r.tolist(), *v.tolist())
        is_bound = 0.0 < orbit.semi_major_axis < np.inf and orbit.eccentricity < 1.0
        size, e = (orbit.semi_major_axis, orbit.eccentricity) if is_bound else (away, 0.0)
        scale = float(np.hypot(*bodies.pos[k])) / away
        found.append(BodyOrbit(k, bodies.pos[k], scale * size, e, mass / star, away))
    return found


def ring_edges(orbit: float) -> Array:
    """Return the edges (RINGS + 1,) of the rings of a profile about an orbital radius."""
    return np.geomspace(0.5 * orbit, 2.0 * orbit, RINGS + 1)


def excluded_angles(radius: Array, distance: float, hill: float) -> Array:
    """Return the angle (n,) from a planet within which rings are nearer to it than HILLS Hill radii.

    `radius` (n,) are the radii of the rings, `distance` is the planet's distance from the centre.
    """
    cosine = (radius**2 + distance**2 - (HILLS * hill) ** 2) / (2.0 * radius * distance)
    return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))


def ring_density(particles: SnapshotParticles, edges: Array, place: Array, hill: float) -> Array:
    """Return the surface density (rings,) at the angles that are not within HILLS Hill radii of a planet.

    `place` (2,) is the position of the planet. The density is NaN in a ring that is that near at all angles.
    """
    angle = np.arctan2(particles.pos[:, 1], particles.pos[:, 0]) - np.arctan2(place[1], place[0])
    angle = np.abs((angle + np.pi) % (2 * np.pi) - np.pi)
    middle = 0.5 * (edges[1:] + edges[:-1])
    if (grid := polar_grid(particles.pos)) is not None:
        radius, _, area = grid.centroids()
        kept = angle.reshape(grid.rings, -1) > excluded_angles(radius, float(np.hypot(*place)), hill)[:, None]
        mass = np.where(kept, particles.mass.reshape(kept.shape), 0.0).sum(axis=1)
        with np.errstate(invalid="ignore"):
            density = mass / (area * kept.sum(axis=1))
        return np.interp(np.log(middle), np.log(radius), density, left=0.0, right=0.0)
    out = excluded_angles(middle, float(np.hypot(*place)), hill)
    ring = np.clip(np.searchsorted(edges, particles.radius) - 1, 0, len(middle) - 1)
    kept = (angle > out[ring]) & (particles.radius > edges[0]) & (particles.radius < edges[-1])
    mass = np.bincount(ring[kept], particles.mass[kept], len(middle))
    with np.errstate(invalid="ignore"):
        return np.asarray(mass / ((np.pi - out) * np.diff(np.square(edges))))


def smoothed(values: Array, rings: float = 2.0) -> Array:
    """Return a profile smoothed by a Gaussian with a width of `rings` rings."""
    from scipy.ndimage import gaussian_filter1d

    return np.asarray(gaussian_filter1d(values, rings, mode="nearest"))


def within_disc(start: Array) -> Array:
    """Return Sigma_0 (rings,), with NaN in rings outside the disc."""
    return np.where(start > OUTSIDE * start.max(initial=0.0), start, np.nan)


def gap_edges(radius: Array, left: Array, orbit: float, reach: float) -> tuple[float, float]:
    """Return the radii of the inner and outer edge of a gap; NaN for an edge that there is not.

    `radius` (rings,) are the radii of rings, `left` (rings,) is Sigma / Sigma_0. The gap contains each ring with less
    than half of Sigma_0 within `reach` of the orbit, and extends to the next ring with more than half.
    """
    deep = np.flatnonzero((left < AT_EDGE) & (np.abs(radius - orbit) < reach))
    if not len(deep):
        return np.nan, np.nan
    above = ~(left < AT_EDGE)  # NaN outside the disc counts, and gives NaN
    inside, outside = np.flatnonzero(above[: deep[0]]), deep[-1] + np.flatnonzero(above[deep[-1] :])

    def crossing(high: int, low: int) -> float:
        part = (AT_EDGE - left[low]) / (left[high] - left[low])
        return float(radius[low] + part * (radius[high] - radius[low]))

    return (
        crossing(inside[-1], inside[-1] + 1) if len(inside) else np.nan,
        crossing(outside[0], outside[0] - 1) if len(outside) else np.nan,
    )


def planet_gap(start: Snapshot, snap: Snapshot, planet: BodyOrbit) -> tuple[float, float]:
    """Return the edges of a planet's gap in the gas of a snapshot, with Sigma_0 from the snapshot `start`.

    Both snapshots are relative to the centre of the disc. An edge that there is not is NaN.
    """
    if start.gas is None or snap.gas is None:
        return np.nan, np.nan
    edges = ring_edges(planet.radius)
    hill = hill_radius(planet.radius, planet.ratio)
    first = within_disc(smoothed(ring_density(start.gas, edges, planet.place, 0.0), START_WIDTH))
    now = smoothed(ring_density(snap.gas, edges, planet.place, hill))
    return gap_edges(np.sqrt(edges[1:] * edges[:-1]), now / first, planet.radius, HILLS * hill)
