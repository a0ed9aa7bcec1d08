"""Particles on rings for a disc given as functions of radius (`physics/profile.py`).

All particles of a species have equal mass, except gas of a disc with a `resolution`: then the mass of each ring is that
of the disc, divided equally among the particles of the ring.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.initial import SPECIES, populations, random_stream
from discsim.physics import profile

if TYPE_CHECKING:
    from discsim.scene import Scene

Array = np.ndarray


def particles(scene: Scene) -> dict[str, dict[str, Array]]:
    """Return particle arrays of the disc at rest, by species; each dust population is placed between its radii."""
    disc = profile.radial(scene)
    out = {}
    if scene.gas is not None:
        stream = random_stream(scene, "gas")
        out["gas"] = _species_arrays(scene, disc, stream, scene.gas.particles, None)
    if scene.dust is not None:
        own = random_stream(scene, "dust")
        out["dust"] = populations(scene, lambda dust: _species_arrays(scene, disc, own, dust.particles, dust))
    return out


def edges(scene: Scene) -> tuple[float, float]:
    disc = profile.radial(scene)
    return disc.inner, disc.outer


def mass(scene: Scene, population: Any) -> float:
    """Return the mass of gas in the region of a dust population; `dust.ratio` times this mass is the mass of dust.

    population: None for all gas. If the disc has its own dust-to-gas ratio, gas is weighted by `dust_share`.
    """
    return float(_mass_within(profile.radial(scene), population)[1][-1])


def _mass_within(disc: profile.Radial, population: Any) -> tuple[Array, Array]:
    """Return radii (n,) from edge to edge, and the mass (n,) of gas within each; None as population: of all gas.

    For a dust population the edges are its own, and gas is weighted by `disc.dust_share`.
    """
    inner, outer = disc.inner, disc.outer
    if population is not None:
        inner, outer = max(population.inner or 0.0, inner), min(population.outer or np.inf, outer)
    r = np.linspace(inner, max(inner, outer), profile.SAMPLES)
    if population is None or disc.dust_share is None:
        return r, disc.mass_within(r)
    return r, profile.integral(r, disc.surface_density(r) * disc.dust_share(r))


def _species_arrays(
    scene: Scene, disc: profile.Radial, stream: np.random.Generator, count: int, population: Any
) -> dict[str, Array]:
    r, mass = _mass_within(disc, population)
    ratio, placement = (1.0, "even") if population is None else (population.ratio, population.placement)
    weight = np.full(count, ratio * mass[-1] / count)
    if placement == "random":
        radius = np.interp(stream.random(count) * mass[-1], mass, r)
        angle = 2.0 * np.pi * stream.random(count)
    elif population is None and disc.resolution is not None:
        number = profile.integral(r, disc.surface_density(r) * disc.resolution(r))
        number *= count / number[-1]
        radius, angle = rings(r, number, stream)
        weight = ring_masses(radius, np.interp(np.arange(count + 1), number, mass))
    else:
        radius, angle = rings(r, mass / mass[-1] * count, stream)
    if getattr(scene.initial, "perturbation", 0.0) > 0.0:
        angle = perturbed(scene, radius, angle)
    pos = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return {
        "pos": pos,
        "vel": np.zeros_like(pos),
        "mass": weight,
        "density": disc.surface_density(radius),
    }


def rings(r: Array, number: Array, stream: np.random.Generator) -> tuple[Array, Array]:
    """Return the radii and angles (n,) of particles on rings, with equal spacing along and between rings.

    number (m,): cumulative number of particles within each of the increasing radii `r` (m,). A ring contains the
    particles between two values of `number`, and is at the radius that halves their number. Its particles are evenly
    spaced, from a random first angle.
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
    place = np.arange(count) - np.repeat(edges[:-1], held)
    angle = 2.0 * np.pi * (place + np.repeat(phase, held)) / np.repeat(held, held)
    return np.repeat(radius, held), angle


def ring_masses(radius: Array, mass: Array) -> Array:
    """Return the masses (n,) of particles; all particles of a ring have the same mass.

    radius (n,): radii, sorted from ring to ring. mass (n + 1,): mass of the disc up to the k-th particle, from k = 0.
    """
    first = np.flatnonzero(np.diff(radius, prepend=-1.0) > 0.0)
    ends = np.append(first, len(radius))
    return np.repeat(np.diff(mass[ends]) / np.diff(ends), np.diff(ends))


def perturbed(scene: Scene, radius: Array, angle: Array) -> Array:
    """Return the angles (n,), displaced so that the density along a ring becomes 1 + A sum_m cos(m phi + phase_m(r)).

    This holds to first order in A = `initial.perturbation`; m is 2 to 6. These modes seed leading and trailing spiral
    arms, because evenly spaced rings have no other asymmetry. Each phase_m(r) is a spline through ten random values
    from edge to edge, the same for gas and dust.
    """
    start: Any = scene.initial
    stream = np.random.default_rng([scene.run.seed, len(SPECIES)])
    moved = angle.copy()
    ring, of = np.unique(radius, return_inverse=True)
    for m in range(2, 7):
        phase = spline((start.inner, start.outer), 2.0 * np.pi * stream.random(10), ring)[of]
        moved -= start.perturbation / m * np.sin(m * angle + phase)
    return moved


def spline(ends: tuple[float, float], values: Array, x: Array) -> Array:
    """Return at `x` (m,) the cubic spline through `values` (n,) at evenly spaced nodes from ends[0] to ends[1].

    The third derivative is continuous at the second nodes from the ends ("not-a-knot"), as in scipy.interpolate, whose
    import would take 17% of the time of a start.
    """
    n, last = len(values), len(values) - 1
    system = 4.0 * np.eye(n) + np.eye(n, k=1) + np.eye(n, k=-1)
    system[0, :3] = system[-1, -3:] = 1.0, -2.0, 1.0
    bend = np.linalg.solve(system, 6.0 * np.pad(np.diff(values, 2), 1))  # second derivatives, in units of the spacing
    place = (x - ends[0]) * (last / (ends[1] - ends[0]))
    low = np.clip(place.astype(int), 0, last - 1)
    part = place - low
    less = 1.0 - part
    curved = (less**3 - less) * bend[low] + (part**3 - part) * bend[low + 1]
    return less * values[low] + part * values[low + 1] + curved / 6.0
