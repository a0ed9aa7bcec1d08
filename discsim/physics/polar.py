"""Polar grid of a scene's gas (`gas.method = "grid"`): edges, rings, cells and their step limits. Numpy only."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from discsim.formulas.polar import PolarShape, angle_count, ring_count
from discsim.parts import STARTS

if TYPE_CHECKING:
    from discsim.numerics.state import Gas
    from discsim.scene import Scene

VISCOUS_STEP = 0.25  # viscous step limit in (shorter side)^2 / nu


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


def longest_step(scene: Scene, h: np.ndarray, sound_speed: np.ndarray) -> np.ndarray:
    """Return the step limit (n,) of sound waves, 1 / (c_s |(1/dr, 1/(r dphi))|), in cells with smoothing length h (n,).

    sound_speed (n,): sound speed.
    """
    ratio = polar_shape(scene).elongation
    return cell_sides(scene, h) / (np.sqrt(ratio + 1.0 / ratio) * sound_speed)


def longest_viscous_step(scene: Scene, nu: np.ndarray, h: np.ndarray) -> np.ndarray:
    """Return the step limit (n,) of gas with viscosity nu (n,), in cells with smoothing length h (n,)."""
    ratio = polar_shape(scene).elongation
    shorter = min(ratio, 1.0 / ratio)  # shorter side squared, over the area
    with np.errstate(divide="ignore"):
        return VISCOUS_STEP * shorter * cell_sides(scene, h) ** 2 / nu
