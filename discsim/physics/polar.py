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

    def side(self, r: np.ndarray) -> np.ndarray:
        """Return the sides (n,) of cells at the radii `r` (n,), the roots of their areas."""
        return r * np.sqrt(np.log(self.outer / self.inner) * 2.0 * np.pi / self.cells)


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
