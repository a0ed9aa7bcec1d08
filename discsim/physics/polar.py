"""Polar grid of a scene's gas (`gas.method = "grid"`): edges, numbers of rings and cells. Numpy only."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from discsim.formulas.polar import PolarShape, angle_count, ring_count
from discsim.parts import STARTS

if TYPE_CHECKING:
    from discsim.numerics.state import Gas
    from discsim.scene import Scene


def polar_shape(scene: Scene) -> PolarShape:
    """Return the polar grid of a scene: with the edges of [initial], unless gas.grid has others."""
    grid = scene.gas.grid
    inner, outer = (None, None) if grid is None else (grid.inner, grid.outer)
    if None in (inner, outer):
        edges = STARTS[scene.initial.kind].edges(scene)
        inner, outer = inner or edges[0], outer or edges[1]
    rings = grid.rings if grid is not None and grid.rings is not None else None
    rings = rings or ring_count(scene.gas.particles, inner, outer)
    closed = grid is not None and grid.edges == "closed"
    return PolarShape(rings, angle_count(scene.gas.particles, rings), inner, outer, closed)


def cell_sides(scene: Scene, h: np.ndarray) -> np.ndarray:
    """Return the sides (n,) of cells with the smoothing lengths `h` (n,), which are `gas.eta` times the sides."""
    return h / scene.gas.eta


def cell_areas(scene: Scene, gas: Gas) -> np.ndarray:
    """Return the areas (n,) of the cells of a polar grid."""
    return cell_sides(scene, gas.h) ** 2
