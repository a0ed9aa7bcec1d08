"""Uniform and sinusoidally stretched lattices in a box, for gas and each dust population."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.initial import populations, random_stream
from discsim.initial.base import Places

if TYPE_CHECKING:
    from discsim.scene import Scene

Array = np.ndarray


def lattice(size: tuple[float, ...], particles: int, offset: float = 0.0, spacing: Array | None = None) -> Array:
    """Return a square lattice of about `particles` points (n, d) in [0, size), shifted by `offset` `spacing` (d,).

    In 2D, n is the nearest product of whole rows and columns. spacing: by default that of this lattice.
    """
    counts = shape(size, particles)
    steps = np.array(size) / counts
    axes = [(np.arange(n) + 0.5) * step for n, step in zip(counts, steps, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(size))
    return (points + offset * (steps if spacing is None else spacing)) % np.array(size)


def shape(size: tuple[float, ...], particles: int) -> tuple[int, ...]:
    """Return the number of points along each axis."""
    if len(size) == 1:
        return (particles,)
    along = max(1, round((particles * size[0] / size[1]) ** 0.5))
    return along, max(1, round(particles / along))


def uniform(scene: Scene, density: float) -> dict[str, dict[str, Array]]:
    """Return arrays by species of gas and dust of uniform density at rest in the box."""
    size = scene.space.size
    mass = density * float(np.prod(size))
    out: dict[str, dict[str, Array]] = {}
    spacing = None
    if scene.gas is not None:
        pos = lattice(size, scene.gas.particles)
        spacing = np.array(size) / shape(size, scene.gas.particles)
        out["gas"] = _species(pos, mass)
    if scene.dust is not None:
        stream = random_stream(scene, "dust")

        def grains(population: Any) -> dict[str, Array]:
            if population.placement == "random":
                pos = stream.random((population.particles, len(size))) * np.array(size)
            else:
                pos = lattice(size, population.particles, population.offset, spacing)
            return _species(pos, mass * population.ratio)

        out["dust"] = populations(scene, grains)
    for arrays in out.values():
        arrays["density"] = np.full(len(arrays["mass"]), density)
    return out


def everywhere(density: float, pressure: Array | None = None) -> Places:
    """Return the places of a start whose gas has one density."""
    return Places(["everywhere"], np.array([density]), pressure=pressure)


def _species(pos: Array, mass: float) -> dict[str, Array]:
    return {"pos": pos, "vel": np.zeros_like(pos), "mass": np.full(len(pos), mass / len(pos))}


def stretch(pos: Array, wavevector: Array, amplitude: float) -> Array:
    """Move points `pos` (n, d) of a uniform lattice so that their density is multiplied by 1 + A sin(k.x); return k.x.

    Along k the mass up to phase s is s - A cos(s). The equation is solved for s by Newton's method, and by bisection
    for points where Newton's method fails, as it can for |A| near 1.
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
