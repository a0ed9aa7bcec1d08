"""Gas of a disc in the cells of a polar grid (`gas.method = "grid"`)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.formulas.polar import FLOOR
from discsim.initial import rings
from discsim.numerics.polar import PolarCells
from discsim.physics import profile
from discsim.physics.polar import polar_shape

if TYPE_CHECKING:
    from discsim.scene import Scene

PARTS = 16  # parts of a ring in the integral of its mass


def gas_in_cells(scene: Scene) -> dict[str, Any]:
    """Return the arrays of the gas at rest in the cells of the scene's polar grid.

    The mass of a cell is the integral of the surface density. With `initial.perturbation` the cells of a ring share its
    mass unequally. Cells with less than FLOOR times the largest surface density have this density.
    """
    cells = PolarCells(*polar_shape(scene))
    disc, sides = profile.radial(scene), cells.geometry.sides
    r = np.interp(np.arange(PARTS * cells.rings + 1) / PARTS, np.arange(cells.rings + 1), sides)
    within = disc.mass_within(np.clip(r, disc.inner, disc.outer))[::PARTS]
    mass = np.repeat(np.diff(within) / cells.angles, cells.angles)
    if getattr(scene.initial, "perturbation", 0.0) > 0.0:
        mass *= 1.0 + _relative_change(scene, cells)
    density = mass / cells.area
    density = np.maximum(density, FLOOR * density.max())
    return {"pos": cells.pos, "vel": np.zeros_like(cells.pos), "mass": density * cells.area, "density": density}


def _relative_change(scene: Scene, cells: PolarCells) -> np.ndarray:
    """Return the relative change (n,) of the mass of cells by `initial.perturbation`: the squeezing of the angles."""
    radius = np.repeat(cells.geometry.radius, cells.angles)
    angle, wide = np.tile(cells.azimuth, cells.rings), cells.geometry.angle
    ends = (rings.perturb_angles(scene, radius, angle + part * wide) for part in (-0.5, 0.5))
    low, high = (end - (angle + part * wide) for end, part in zip(ends, (-0.5, 0.5), strict=True))
    return -(high - low) / wide
