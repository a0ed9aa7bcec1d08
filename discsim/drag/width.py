"""Target side s of drag cells as a function of position; the same for all schemes.

A scene may give the side as a length (`drag.cell_length`), or in smoothing lengths h (`drag.cell`). The default is

    s = min(2 h, 2.7 d, max(0.7 H, sqrt(n) d))     in two dimensions,      s = min(h, 2 d)     in one dimension,

with the mean particle spacing d = h / eta of the gas, and the scale height H about the star from the temperature of the
scene. n is the number of gas particles that a cell of the scheme needs, and at least 4. The default depends on d as
well as h because kernels with the same spacing have values of h that differ by a factor of 2. If cells are wider than
H, the drift of grains is wrong (docs/accuracy.md).
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from discsim.numerics import alloc
from discsim.numerics.threads import parallel_for
from discsim.parts import SCHEMES, Lazy
from discsim.physics.centre import kepler_omega
from discsim.physics.eos import eos_of

if TYPE_CHECKING:
    from discsim.scene import Scene

kernels = Lazy("discsim.kernels.drag.width")
Array = np.ndarray
LENGTHS, SPACINGS = (1.0, 2.0), (2.0, 2.7)  # largest side in h and in d, for one and for two dimensions
HEIGHTS = 0.7  # largest side in H; rounding to powers of two makes some cells 1.4 times as wide
FEWEST = 4.0  # least number n of gas particles in a cell that H limits; with fewer, too many cells are empty and merge
NODES, BEYOND = 4096, 1.5  # number of radii in the table of H, and its largest radius over the longest side of space

# Relative error of the drift at St = 0.01: ERROR_AT_H (side of the cells / H)^ERROR_POWER, but at least LEAST_ERROR
# (`analysis/drift_cells.py`).
ERROR_AT_H, ERROR_POWER, LEAST_ERROR = 0.02, 7, 0.004


def drift_error(width: float) -> float:
    """Return an estimate of the relative error of the drift at St = 0.01 with the scheme tsc.

    width: side of the drag cells in H.
    """
    return max(LEAST_ERROR, ERROR_AT_H * float(width) ** ERROR_POWER)


def in_lengths(scene: Scene) -> float:
    """Return the target side in smoothing lengths, without the limit by H; 0 if the scene gives a length instead."""
    drag, dim = scene.drag, scene.space.dimensions
    if drag.cell_length is not None:
        return 0.0
    if drag.cell is not None:
        return drag.cell
    return min(LENGTHS[dim - 1], SPACINGS[dim - 1] / scene.gas.eta)


class CellWidth:
    """Target side of a scene's drag cells: `number` times the smoothing length that `limited_lengths` returns.

    least: smallest factor by which H may reduce a smoothing length. limited: whether H limits the side at all. rounded:
    factor of the smallest side of a leaf, below 1 if H limits the side.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene, self.number = scene, in_lengths(scene)
        cells = SCHEMES[scene.drag.scheme].cells if scene.drag else None
        by_default = scene.drag is not None and scene.drag.cell is None and scene.drag.cell_length is None
        self.least = 1.0
        if by_default and cells is not None and scene.space.dimensions == 2 and self._has_heights:
            self.least = max(cells.adequate[0], FEWEST) ** 0.5 / scene.gas.eta / self.number
        self.limited = self.least < 1.0
        # Sides of leaves are rounded up to whole grid cells. With this factor they are not too wide where H is small.
        self.rounded = cells.least_side if cells is not None and self.limited else 1.0

    @property
    def _has_heights(self) -> bool:
        """True if the scene defines a scale height H about a star; for a polytrope it does not."""
        scene = self.scene
        given = (getattr(scene.gas.eos, key, None) for key in ("aspect_ratio", "sound_speed"))
        brings = getattr(scene.initial, "sets_temperature", False)
        return bool(scene.star) and (brings or any(value is not None for value in given))

    @cached_property
    def table(self) -> tuple[Array, float]:
        """Upper limits (NODES,) of smoothing lengths, and the number of limits per unit radius.

        The limits are HEIGHTS H / `number` at equidistant radii from 0.
        """
        end = BEYOND * max(self.scene.space.size)
        r = np.linspace(0.0, end, NODES)
        r[0] = 1e-3 * r[1]
        height = eos_of(self.scene).thermal_speed(self.scene, r) / kepler_omega(self.scene, r)
        return HEIGHTS / self.number * height, (NODES - 1) / end

    def limited_lengths(self, pos: Array, h: Array) -> Array:
        """Return the smoothing lengths `h` (n,) of gas at `pos` (n, d), reduced to the limit by H.

        `least` is the smallest factor of the reduction. The result may be the array `h` itself.
        """
        if not self.limited:
            return h
        out = alloc.allocate_like(h)
        parallel_for(kernels.limit_lengths, len(h), pos, h, self.least, *self.table, out, light=True)
        return out

    def limited_lengths_at(self, radius: Array, h: Array) -> Array:
        """Return the result of `limited_lengths` for gas at the radii `radius` (n,).

        The function uses numpy only, and compiles nothing.
        """
        if not self.limited:
            return h
        table, nodes = self.table
        limit: Array = np.interp(radius, np.arange(NODES) / nodes, table)
        return np.minimum(h, np.maximum(limit, self.least * h))
