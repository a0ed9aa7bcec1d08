"""Uniform and sinusoidally stretched lattices of particles in a box, for gas and each dust population."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.initial import populations, random_stream
from discsim.initial.base import Places

if TYPE_CHECKING:
    from discsim.scene import Scene

Array = np.ndarray


def lattice(size: tuple[float, ...], particles: int, offset: float = 0.0, spacing: Array | None = None) -> Array:
    """Return a lattice of about `particles` points (n, d) in the periodic box [0, size), shifted by offset * spacing.

    In 2D the cells are as square as whole numbers of rows and columns allow. spacing (d,): by default the spacing of
    the lattice itself.
    """
    counts = shape(size, particles)
    steps = np.array(size) / counts
    axes = [(np.arange(n) + 0.5) * step for n, step in zip(counts, steps, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(size))
    return (points + offset * (steps if spacing is None else spacing)) % np.array(size)


def shape(size: tuple[float, ...], particles: int) -> tuple[int, ...]:
    """Return the numbers of points of a lattice along each axis; their product is about `particles`."""
    if len(size) == 1:
        return (particles,)
    along = max(1, round((particles * size[0] / size[1]) ** 0.5))
    return along, max(1, round(particles / along))


def uniform(scene: Scene, density: float) -> dict[str, dict[str, Array]]:
    """Return particle arrays of uniform gas and dust at rest in the box, by species.

    density: density of the gas; that of each population is `dust.ratio` times as large.
    """
    size = scene.space.size
    mass = density * float(np.prod(size))
    out: dict[str, dict[str, Array]] = {}
    spacing = None
    if scene.gas is not None:
        pos = lattice(size, scene.gas.particles)
        spacing = np.array(size) / shape(size, scene.gas.particles)
        out["gas"] = _species_at_rest(pos, mass)
    if scene.dust is not None:
        stream = random_stream(scene, "dust")

        def grains(population: Any) -> dict[str, Array]:
            if population.placement == "random":
                pos = stream.random((population.particles, len(size))) * np.array(size)
            else:
                pos = lattice(size, population.particles, population.offset, spacing)
            return _species_at_rest(pos, mass * population.ratio)

        out["dust"] = populations(scene, grains)
    for arrays in out.values():
        arrays["density"] = np.full(len(arrays["mass"]), density)
    return out


def everywhere(density: float, pressure: Array | None = None) -> Places:
    """Return `Places` with a single point, for gas with the same density and pressure everywhere."""
    return Places(["everywhere"], np.array([density]), pressure=pressure)


def _species_at_rest(pos: Array, mass: float) -> dict[str, Array]:
    return {"pos": pos, "vel": np.zeros_like(pos), "mass": np.full(len(pos), mass / len(pos))}


def stretch(pos: Array, wavevector: Array, amplitude: float) -> Array:
    """Move the points `pos` (n, d) of a uniform lattice in place; return the phases k.x (n,) at the new positions.

    The density of the points is then proportional to 1 + A sin(k.x). wavevector (d,): k. amplitude: A.
    The mass between phase 0 and s along k is s - A cos(s) up to a constant. This is solved for s by Newton's method,
    and by bisection for points where Newton's method fails, as it can for |A| near 1.
    """
    start = pos @ wavevector
    phase = start.copy()
    for _ in range(30):
        phase -= (phase - amplitude * np.cos(phase) - start) / (1.0 + amplitude * np.sin(phase))
    astray = np.abs(phase - amplitude * np.cos(phase) - start) > 1e-12 * np.maximum(1.0, np.abs(start))
    low, high = start[astray] - abs(amplitude), start[astray] + abs(amplitude)
    for _ in range(60):
        middle = 0.5 * (low + high)
        above = middle - amplitude * np.cos(middle) > start[astray]
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    phase[astray] = low
    pos += np.outer(phase - start, wavevector / (wavevector @ wavevector))
    return phase
