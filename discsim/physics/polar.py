"""Polar grid of a scene's gas (`gas.method = "grid"`): edges, numbers of rings and cells, mass in rings. Numpy only."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from discsim.formulas import polar
from discsim.parts import STARTS

if TYPE_CHECKING:
    from discsim.numerics.state import Gas, Particles
    from discsim.scene import Scene


class PolarShape(NamedTuple):
    """Polar grid: numbers of rings and of cells in a ring, radii of the edges, and whether the edges are closed."""

    rings: int
    angles: int
    inner: float
    outer: float
    closed: bool

    @property
    def cells(self) -> int:
        """Number of cells."""
        return self.rings * self.angles

    @property
    def elongation(self) -> float:
        """Azimuthal over radial side of the cells."""
        return 2.0 * np.pi / self.angles / float(np.log(self.outer / self.inner) / self.rings)

    def side(self, r: np.ndarray) -> np.ndarray:
        """Return the sides (n,) of cells at the radii `r` (n,), the roots of their areas."""
        return r * np.sqrt(np.log(self.outer / self.inner) * 2.0 * np.pi / self.cells)

    def centroids(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return radii (rings,) and azimuths (angles,) of the centroids of cells, and the areas (rings,) of cells."""
        sides, angle = polar.ring_sides(self.rings, self.inner, self.outer), 2.0 * np.pi / self.angles
        low, high = sides[:-1], sides[1:]
        radius = (high**2 + high * low + low**2) / (1.5 * (high + low))
        return radius, (np.arange(self.angles) + 0.5) * angle, 0.5 * angle * (high - low) * (high + low)


class Interpolation:
    """Interpolation of values in cells of a polar grid, linear in ln r and azimuth, at points `r` and `azimuth`.

    Beyond the centroids of the innermost and outermost ring values are those of this ring. ring, outwards: ring below
    each point, and the part of the way to the next ring.
    """

    def __init__(self, shape: PolarShape, r: np.ndarray, azimuth: np.ndarray) -> None:
        middle = shape.centroids()[0]
        with np.errstate(divide="ignore"):
            position = np.interp(np.log(r), np.log(middle), np.arange(shape.rings))
        self.ring = np.minimum(position.astype(np.int64), shape.rings - 2)
        self.outwards = position - self.ring
        along = azimuth * (shape.angles / (2.0 * np.pi)) - 0.5
        left = np.floor(along).astype(np.int64)
        self._ahead = along - left
        self._left, self._right = left % shape.angles, (left + 1) % shape.angles

    def of(self, values: np.ndarray) -> np.ndarray:
        """Return the `values` (rings, angles) of cells at the points."""
        inner, outer = (
            (1.0 - self._ahead) * values[k, self._left] + self._ahead * values[k, self._right]
            for k in (self.ring, self.ring + 1)
        )
        found: np.ndarray = (1.0 - self.outwards) * inner + self.outwards * outer
        return found


def shape_of_cells(pos: np.ndarray, closed: bool = False) -> PolarShape:
    """Return the polar grid whose cells have the centroids `pos` (n, 2), in rings from the inside.

    Raises ValueError if there is no such grid.
    """
    r = np.sqrt((pos**2).sum(axis=1))
    rings = 1 + int((np.diff(r) > 1e-9 * r[1:]).sum())
    if rings > 1 and len(r) % rings == 0 and r[0] > 0.0 and r[-1] > r[0]:
        ratio = float(r[-1] / r[0]) ** (1.0 / (rings - 1))
        # The centroid of a ring is at 2/3 (r_o^3 - r_i^3) / (r_o^2 - r_i^2).
        inner = float(r[0]) * 1.5 * (ratio**2 - 1.0) / (ratio**3 - 1.0)
        shape = PolarShape(rings, len(r) // rings, inner, inner * ratio**rings, closed)
        radius, azimuth, _ = shape.centroids()
        wanted = np.stack([np.outer(radius, np.cos(azimuth)), np.outer(radius, np.sin(azimuth))], axis=-1)
        if np.allclose(pos, wanted.reshape(-1, 2), rtol=0.0, atol=1e-9 * shape.outer):
            return shape
    raise ValueError("the gas is not in the cells of a polar grid")


def polar_shape(scene: Scene) -> PolarShape:
    """Return the polar grid of a scene: with the edges of [initial], unless gas.grid has others."""
    grid = scene.gas.grid
    inner, outer = (None, None) if grid is None else (grid.inner, grid.outer)
    if None in (inner, outer):
        edges = STARTS[scene.initial.kind].edges(scene)
        inner, outer = inner or edges[0], outer or edges[1]
    rings = grid.rings if grid is not None and grid.rings is not None else None
    rings = rings or polar.ring_count(scene.gas.particles, inner, outer)
    closed = grid is not None and grid.edges == "closed"
    return PolarShape(rings, polar.angle_count(scene.gas.particles, rings), inner, outer, closed)


def cell_areas(scene: Scene, gas: Gas) -> np.ndarray:
    """Return the areas (n,) of the cells of a polar grid, whose smoothing length is `gas.eta` times their side."""
    return (gas.h / scene.gas.eta) ** 2


def mass_in_rings(scene: Scene, gas: Particles, edges: np.ndarray) -> np.ndarray:
    """Return the mass of the gas of a scene in the rings between the radii `edges` (rings + 1,).

    The edges divide the cells of a polar grid, whose densities are uniform.
    """
    if not scene.model.polar:
        return np.histogram(np.sqrt((gas.pos**2).sum(axis=1)), edges, weights=gas.mass)[0]
    shape = polar_shape(scene)
    of_ring = gas.mass.reshape(shape.rings, shape.angles).sum(axis=1)
    sides = polar.ring_sides(shape.rings, shape.inner, shape.outer)
    return np.diff(np.interp(edges**2, sides**2, np.concatenate([[0.0], np.cumsum(of_ring)])))
