"""reconstructed: drag between pairs, as lab14's, with the slip of a pair taken at one common point.

y = (u_j - v_a) . r^ - r L(r^.G_j.r^, r^.G_a.r^)      in place of lab14's slip along r^ = (x_j - x_a) / r

with the slopes G of each species' own velocity (`kernels/drag/slopes.py`) and L the monotonised central limiter of van Leer:
0 for slopes of opposite signs, otherwise the smallest of |a + b| / 2, 2 |a| and 2 |b| with their sign. Price & Laibe
2020 (arXiv:2005.06562). As both slopes are limited to one, each point between the two gives the same. What lab14 damps,
differences of velocity along r, stays. Momentum and angular momentum are exact, at any step. Sparse dust is held back
as in lab14, whose bound on the energy is one for slips that are alike at both places.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from discsim.drag.base import NO_CELLS, Array, Scheme
from discsim.drag.lab14 import relax_each_pair
from discsim.numerics.threads import share
from discsim.parts import Lazy

if TYPE_CHECKING:
    from discsim.drag.cloud import Cloud
    from discsim.effects.drag import Effect as Drag
    from discsim.numerics.sph import Sph
    from discsim.numerics.state import Gas, State

kernels, neighbours = Lazy("discsim.kernels.drag.slopes"), Lazy("discsim.numerics.neighbours")


def relax(drag: Drag, state: State, dt: float, gas_vel: Array, heat: Array) -> None:
    relax_each_pair(drag, state, dt, gas_vel, heat, slopes_of)


def slopes_of(sph: Sph, points: Gas | Cloud, vel: Array) -> Array:
    """Slopes (n, d, d) of a velocity that gas or a cloud of dust has."""
    cells = sph.cells_of(points)
    slope, fit = np.empty((points.count, sph.dim, sph.dim)), kernels.slope_driver(sph.kernel, sph.dim)
    share(
        fit, len(cells.filled), points.pos, vel, points.mass, points.h, slope, cells,
        least=neighbours.LEAST, each=neighbours.candidates(cells, cells, mutual=False),
    )  # fmt: skip
    return slope


SCHEME = Scheme(relax, unused=NO_CELLS)
