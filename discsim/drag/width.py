"""Wanted side of drag cells as a function of position, for any scheme.

A scene may give the side as a length, or as a number of smoothing lengths h. The default is

    s = min(2 h, 2.7 d, max(0.7 H, sqrt(n) d))     in a plane,      s = min(h, 2 d)     on a line,

with the mean spacing d = h / eta of the gas, and its scale height H about the star by the temperature of the scene. n
is the number of gas particles that a cell of the scheme needs, 4 at least. h alone is no measure: at one spacing it
differs by a factor of 2 between kernels. A node of `tsc` averages over the gas of nine cells. Where cells are wider
than H, the drift is wrong (docs/accuracy.md).
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
LENGTHS, SPACINGS = (1.0, 2.0), (2.0, 2.7)  # largest side in h and in d, by dimensions
HEIGHTS = 0.7  # largest side in H: sides are powers of two of each other, so that some cells are 1.4 times as wide
FEWEST = 4.0  # least gas particles of a cell that H limits: with fewer, too many cells are empty and merge
NODES, BEYOND = 4096, 1.5  # nodes of the table of H, and its end in sides of space from the centre

# Relative error of the drift at St = 0.01 in cells as wide as H, its power of the width, and its value in narrow cells
# (`analysis/drift_cells.py`).
OFF, POWER, LEAST_OFF = 0.02, 7, 0.004


def drift_error(width: float) -> float:
    """Return the relative error of the drift of grains of St = 0.01 with `tsc`, in cells of this width in H."""
    return max(LEAST_OFF, OFF * float(width) ** POWER)


def in_lengths(scene: Scene) -> float:
    """Return the wanted side in smoothing lengths, before H limits it; 0 if the scene gives it as a length."""
    drag, dim = scene.drag, scene.space.dimensions
    assert drag is not None and scene.gas is not None
    if drag.cell_length is not None:
        return 0.0
    if drag.cell is not None:
        return drag.cell
    return min(LENGTHS[dim - 1], SPACINGS[dim - 1] / scene.gas.eta)


class Width:
    """Wanted side of a scene's drag cells: `number` times the smoothing lengths that `counted` returns."""

    def __init__(self, scene: Scene) -> None:
        self.scene, self.number = scene, in_lengths(scene)
        cells = SCHEMES[scene.drag.scheme].cells if scene.drag else None
        by_default = scene.drag is not None and scene.drag.cell is None and scene.drag.cell_length is None
        self.least = 1.0  # least share of h to which H may limit it
        if by_default and cells is not None and scene.space.dimensions == 2 and self._has_heights:
            self.least = max(cells.few[0], FEWEST) ** 0.5 / scene.gas.eta / self.number
        self.limited = self.least < 1.0
        # Leaves are whole cells of the grid. Without this factor, leaves rounded up would be too wide where H is small.
        self.rounded = cells.share if cells is not None and self.limited else 1.0

    @property
    def _has_heights(self) -> bool:
        """True if the scene gives a temperature about a star; a polytrope gives none."""
        scene = self.scene
        given = (getattr(scene.gas.eos, key, None) for key in ("aspect_ratio", "sound_speed"))
        brings = getattr(scene.initial, "brings_temperature", False)
        return bool(scene.star) and (brings or any(value is not None for value in given))

    @cached_property
    def table(self) -> tuple[Array, float]:
        """HEIGHTS times H over `number` at even radii from 0 (NODES,), and the number of nodes per unit of length."""
        end = BEYOND * max(self.scene.space.size)
        r = np.linspace(0.0, end, NODES)
        r[0] = 1e-3 * r[1]
        height = eos_of(self.scene).thermal_speed(self.scene, r) / kepler_omega(self.scene, r)
        return HEIGHTS / self.number * height, (NODES - 1) / end

    def counted(self, pos: Array, h: Array) -> Array:
        """Return the smoothing lengths (n,) at positions (n, 2) that set the side of cells: h, or less where H limits
        cells.
        """
        if not self.limited:
            return h
        out = alloc.allocate_like(h)
        parallel_for(kernels.limit_lengths, len(h), pos, h, self.least, *self.table, out, light=True)
        return out

    def counted_at(self, radius: Array, h: Array) -> Array:
        """Return smoothing lengths (n,) at radii (n,) that are limited as in `counted`, by numpy alone."""
        if not self.limited:
            return h
        table, nodes = self.table
        limit: Array = np.interp(radius, np.arange(NODES) / nodes, table)
        return np.minimum(h, np.maximum(limit, self.least * h))
