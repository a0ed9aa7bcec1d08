"""Particles of a start on a fixed 1D grid: one particle of gas and one of dust at the centre of each cell."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from discsim.parts import STARTS

if TYPE_CHECKING:
    from discsim.initial.base import Arrays
    from discsim.scene import Scene


def particles(scene: Scene) -> dict[str, Arrays]:
    """Return particle arrays by species, from the function `cells` of the scene's start."""
    count, length, start = scene.gas.particles, scene.space.size[0], STARTS[scene.initial.kind]
    dx = length / count
    x = (np.arange(count) + 0.5) * dx - (0.5 * length if scene.centred else 0.0)
    density, vel, u = start.cells(scene, x, dx)
    out = {name: {"pos": x[:, None], "vel": vel[name][:, None]} for name in ("gas", "dust")}
    out["gas"] |= {"mass": density * dx, "density": density} | ({} if u is None else {"u": u})
    out["dust"] |= {"mass": scene.dust[0].ratio * density * dx}
    return out
