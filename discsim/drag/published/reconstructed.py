"""reconstructed: drag between pairs, as in lab14, with the slip of a pair taken at one common point.

    y = (u_j - v_a) . r^ - r L(r^.G_j.r^, r^.G_a.r^)      in place of lab14's slip along r^ = (x_j - x_a) / r

with the slopes G of each species' own velocity (`kernels/drag/slopes.py`) and L the monotonised central limiter of van
Leer: 0 for slopes of opposite signs, otherwise the smallest of |a + b| / 2, 2 |a| and 2 |b| with their sign. Price &
Laibe 2020 (arXiv:2005.06562). With the same limited slope L for gas and dust, the slip is the same at every point
between the two particles. lab14 also damps velocity differences within a species along r; this scheme does not.
Momentum and angular momentum are exact, at any step. Impulses of sparse dust are scaled down as in lab14. The proof
there that the kinetic energy decreases holds here only if the slip is the same at both particles.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.drag.base import NO_CELLS, Array, DragLaw, Dust, Gas, KickContext, KickResult, Scheme
from discsim.drag.published.lab14 import relax_each_pair
from discsim.numerics.threads import parallel_for
from discsim.parts import Lazy

if TYPE_CHECKING:
    from discsim.kernels.drag.frame import Frame
    from discsim.numerics.sph import Sph

kernels, neighbours = Lazy("discsim.kernels.drag.slopes"), Lazy("discsim.numerics.neighbours")


def kick(gas: Gas, dust: Dust, law: DragLaw, frame: Frame, dt: float, cells: Any, context: KickContext) -> KickResult:
    """Kick gas and dust in place over dt, as `Scheme.kick`."""
    return relax_each_pair(gas, dust, law, frame, dt, context, slopes_of)


def slopes_of(sph: Sph, points: Any, vel: Array) -> Array:
    """Return the velocity gradients (n, d, d) at the particles of a species.

    points: `Gas`, or `DustParticles`. vel (n, d): velocities.
    """
    cells = sph.cells_of(points)
    slope, fit = np.empty((len(points.mass), sph.dim, sph.dim)), kernels.slope_driver(sph.kernel, sph.dim)
    parallel_for(
        fit, len(cells.filled), points.pos, vel, points.mass, points.h, slope, cells,
        least=neighbours.LEAST, each=neighbours.candidates(cells, cells, mutual=False),
    )  # fmt: skip
    return slope


SCHEME = Scheme(kick, by_component=False, unused=NO_CELLS)
