"""Particles on concentric rings, for a disc that is given by radial profiles (`physics/profile.py`).

All particles of a species have equal mass. The exception is gas of a disc with a `resolution`: each ring has the mass
of the disc there, divided equally among the particles of the ring.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.initial import SPECIES, make_populations, particles_at_rest, random_stream
from discsim.physics import profile

if TYPE_CHECKING:
    from discsim.scene import Scene

Array = np.ndarray


def particles(scene: Scene) -> dict[str, dict[str, Array]]:
    """Return the particles of the disc at rest, as {species: {name: array}}.

    Each dust population is placed between its own inner and outer radius.
    """
    disc = profile.radial(scene)
    out = {}
    if scene.gas is not None:
        stream = random_stream(scene, "gas")
        out["gas"] = _make_species(scene, disc, stream, scene.gas.particles, None)
    if scene.dust is not None:
        of_dust = random_stream(scene, "dust")
        out["dust"] = make_populations(scene, lambda dust: _make_species(scene, disc, of_dust, dust.particles, dust))
    return out


def edges(scene: Scene) -> tuple[float, float]:
    """Return the radii of the inner and the outer edge of the disc."""
    disc = profile.radial(scene)
    return disc.inner, disc.outer


def gas_mass(scene: Scene, population: Any) -> float:
    """Return the mass of gas between the edges of a dust population, or of all gas if `population` is None.

    `dust.ratio` times this mass is the mass of the population. Gas is therefore weighted by `Radial.dust_share`.
    """
    return float(_mass_within(profile.radial(scene), population)[1][-1])


def _mass_within(disc: profile.Radial, population: Any) -> tuple[Array, Array]:
    """Return radii (n,) from edge to edge, and the gas mass (n,) between the inner edge and each radius.

    population: a dust population, which has its own edges and for which gas is weighted by `disc.dust_share`. If
    `population` is None, the edges are those of the disc, without weights.
    """
    inner, outer = disc.inner, disc.outer
    if population is not None:
        inner, outer = max(population.inner or 0.0, inner), min(population.outer or np.inf, outer)
    r = np.linspace(inner, max(inner, outer), profile.SAMPLES)
    if population is None or disc.dust_share is None:
        return r, disc.mass_within(r)
    return r, profile.integral(r, disc.surface_density(r) * disc.dust_share(r))


def _make_species(
    scene: Scene, disc: profile.Radial, stream: np.random.Generator, count: int, population: Any
) -> dict[str, Array]:
    """Return the arrays of `count` particles of a dust population, or of the gas if `population` is None."""
    r, mass = _mass_within(disc, population)
    ratio, placement = (1.0, "even") if population is None else (population.ratio, population.placement)
    weight = np.full(count, ratio * mass[-1] / count)
    if placement == "random":
        radius = np.interp(stream.random(count) * mass[-1], mass, r)
        angle = 2.0 * np.pi * stream.random(count)
    elif population is None and disc.resolution is not None:
        number = profile.integral(r, disc.surface_density(r) * disc.resolution(r))
        number *= count / number[-1]
        radius, angle = place_on_rings(r, number, stream)
        weight = ring_masses(radius, np.interp(np.arange(count + 1), number, mass))
    else:
        radius, angle = place_on_rings(r, mass / mass[-1] * count, stream)
    if getattr(scene.initial, "perturbation", 0.0) > 0.0:
        angle = perturb_angles(scene, radius, angle)
    pos = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return particles_at_rest(pos, weight) | {"density": disc.surface_density(radius)}


def place_on_rings(r: Array, number: Array, stream: np.random.Generator) -> tuple[Array, Array]:
    """Return the radii and angles (n,) of particles on rings, whose spacing along a ring equals that between rings.

    r (m,): increasing radii. number (m,): number of particles within each of these radii. A ring contains the
    particles in a range of `number`, and its radius is that of the middle of this range. The particles of a ring are
    evenly spaced, and the angle of the first one is random.
    """
    count = round(number[-1])
    per_area = np.gradient(number, r) / (2.0 * np.pi * r)
    ring = np.concatenate([[0.0], np.cumsum(np.diff(r) * np.sqrt(0.5 * (per_area[1:] + per_area[:-1])))])
    total = max(1, round(ring[-1]))
    edges = np.round(np.interp(np.arange(total + 1) * ring[-1] / total, ring, number)).astype(int)
    edges[0], edges[-1] = 0, count
    held = np.diff(edges)
    radius = np.interp(0.5 * (edges[1:] + edges[:-1]), number, r)
    phase = stream.random(total)
    index = np.arange(count) - np.repeat(edges[:-1], held)
    angle = 2.0 * np.pi * (index + np.repeat(phase, held)) / np.repeat(held, held)
    return np.repeat(radius, held), angle


def ring_masses(radius: Array, mass: Array) -> Array:
    """Return the masses (n,) of particles on rings, equal for all particles of a ring.

    radius (n,): radii of the particles in rising order. mass (n + 1,): entry k is the mass of the disc that the k
    innermost particles represent.
    """
    first = np.flatnonzero(np.diff(radius, prepend=-1.0) > 0.0)
    ends = np.append(first, len(radius))
    return np.repeat(np.diff(mass[ends]) / np.diff(ends), np.diff(ends))


def perturb_angles(scene: Scene, radius: Array, angle: Array) -> Array:
    """Return the angles (n,) of particles, displaced so that the density is ~ 1 + A sum_m cos(m phi + phase_m(r)).

    radius, angle (n,): radii and angles of particles that are evenly spaced on rings. The density holds to first order
    in A = `initial.perturbation`; m is 2 to 6. These modes seed leading and trailing spiral arms, because evenly spaced
    rings have no other asymmetry. Each phase_m(r) is a spline through ten random values from edge to edge, the same for
    gas and dust.
    """
    start: Any = scene.initial
    stream = np.random.default_rng([scene.run.seed, len(SPECIES)])
    moved = angle.copy()
    ring, of = np.unique(radius, return_inverse=True)
    for m in range(2, 7):
        phase = cubic_spline((start.inner, start.outer), 2.0 * np.pi * stream.random(10), ring)[of]
        moved -= start.perturbation / m * np.sin(m * angle + phase)
    return moved


def cubic_spline(ends: tuple[float, float], values: Array, x: Array) -> Array:
    """Return the cubic spline through `values` (n,), evaluated at `x` (m,).

    The nodes are evenly spaced from ends[0] to ends[1]. The third derivative is continuous at the nodes next to the
    ends ("not-a-knot"), as in scipy.interpolate, whose import would take 17% of the time of a start.
    """
    n, last = len(values), len(values) - 1
    system = 4.0 * np.eye(n) + np.eye(n, k=1) + np.eye(n, k=-1)
    system[0, :3] = system[-1, -3:] = 1.0, -2.0, 1.0
    bend = np.linalg.solve(system, 6.0 * np.pad(np.diff(values, 2), 1))  # second derivatives, in units of the spacing
    at = (x - ends[0]) * (last / (ends[1] - ends[0]))
    low = np.clip(at.astype(int), 0, last - 1)
    part = at - low
    less = 1.0 - part
    curved = (less**3 - less) * bend[low] + (part**3 - part) * bend[low + 1]
    return less * values[low] + part * values[low + 1] + curved / 6.0
