"""Particles on uniform or sinusoidally stretched lattices in a periodic box, for gas and each dust population."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.initial import make_populations, particles_at_rest, random_stream
from discsim.initial.base import Array, SamplePoints

if TYPE_CHECKING:
    from discsim.scene import Scene


def lattice_points(size: tuple[float, ...], particles: int, offset: float = 0.0, spacing: Array | None = None) -> Array:
    """Return the points (n, d) of a lattice in the periodic box [0, size); n is about `particles`.

    In 2D the cells of the lattice are as square as whole numbers of rows and columns allow. All points are shifted by
    offset * spacing. spacing (d,): distances along each axis; None: the spacing of this lattice.
    """
    counts = lattice_shape(size, particles)
    steps = np.array(size) / counts
    axes = [(np.arange(n) + 0.5) * step for n, step in zip(counts, steps, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(size))
    return (points + offset * (steps if spacing is None else spacing)) % np.array(size)


def lattice_shape(size: tuple[float, ...], particles: int) -> tuple[int, ...]:
    """Return the numbers of lattice points along the axes of a box; their product is about `particles`."""
    if len(size) == 1:
        return (particles,)
    along = max(1, round((particles * size[0] / size[1]) ** 0.5))
    return along, max(1, round(particles / along))


def triangular_points(
    size: tuple[float, ...], particles: int, offset: float = 0.0, spacing: Array | None = None
) -> Array:
    """Return the points (n, 2) of a triangular lattice in the periodic box [0, size); n is about `particles`.

    The number of rows is even, and triangles are equilateral as far as whole numbers allow. A square lattice of gas is
    unstable if velocities vary. offset, spacing: as in `lattice_points`.
    """
    step = math.sqrt(size[0] * size[1] / particles * 2.0 / math.sqrt(3.0))
    rows = 2 * max(1, round(size[1] / (step * math.sqrt(3.0))))
    columns = max(1, round(particles / rows))
    x, y = np.meshgrid(np.arange(columns) + 0.25, np.arange(rows) + 0.5, indexing="ij")
    x += 0.5 * (np.arange(rows) % 2)
    steps = np.array(size) / (columns, rows)
    points = np.stack([x, y], axis=-1).reshape(-1, 2) * steps
    return (points + offset * (steps if spacing is None else spacing)) % np.array(size)


def uniform_particles(
    scene: Scene, density: float, points: Callable[..., Array] = lattice_points
) -> dict[str, dict[str, Array]]:
    """Return the particles of uniform gas and dust at rest in a box, as {species: {name: array}}.

    density: density of the gas. The density of each dust population is `dust.ratio` times as large. points: function
    that returns the points of a lattice, as `lattice_points`.
    """
    size = scene.space.size
    mass = density * float(np.prod(size))
    out: dict[str, dict[str, Array]] = {}
    spacing = None
    if scene.gas is not None:
        pos = points(size, scene.gas.particles)
        spacing = np.array(size) / lattice_shape(size, scene.gas.particles)
        out["gas"] = particles_at_rest(pos, mass / len(pos))
    if scene.dust is not None:
        stream = random_stream(scene, "dust")

        def make_dust(population: Any) -> dict[str, Array]:
            if population.placement == "random":
                pos = stream.random((population.particles, len(size))) * np.array(size)
            else:
                pos = points(size, population.particles, population.offset, spacing)
            return particles_at_rest(pos, mass * population.ratio / len(pos))

        out["dust"] = make_populations(scene, make_dust)
    for arrays in out.values():
        arrays["density"] = np.full(len(arrays["mass"]), density)
    return out


def sample_uniform_gas(density: float, pressure: Array | None = None) -> SamplePoints:
    """Return the `SamplePoints` of uniform gas: a single point with this density and pressure (1,).

    If `pressure` is None, the equation of state sets the pressure.
    """
    return SamplePoints(["everywhere"], np.array([density]), pressure=pressure)


def stretch_lattice(pos: Array, wavevector: Array, amplitude: float) -> Array:
    """Move the points `pos` (n, d) of a uniform lattice in place, so that their density is ~ 1 + A sin(k.x).

    wavevector (d,): k. amplitude: A. Returns the phases k.x (n,) at the new positions.
    The mass between the phases 0 and s is proportional to s - A cos(s) up to a constant. A point with phase s_0 in the
    uniform lattice moves to the s with s - A cos(s) = s_0. Newton's method finds s, and bisection where Newton's method
    fails, as it can for |A| near 1.
    """
    start = pos @ wavevector
    phase = start.copy()
    for _ in range(30):
        phase -= (phase - amplitude * np.cos(phase) - start) / (1.0 + amplitude * np.sin(phase))
    failed = np.abs(phase - amplitude * np.cos(phase) - start) > 1e-12 * np.maximum(1.0, np.abs(start))
    low, high = start[failed] - abs(amplitude), start[failed] + abs(amplitude)
    for _ in range(60):
        middle = 0.5 * (low + high)
        above = middle - amplitude * np.cos(middle) > start[failed]
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    phase[failed] = low
    pos += np.outer(phase - start, wavevector / (wavevector @ wavevector))
    return phase
