"""idic-linear: implicit drag in cell with a linear velocity field per cell and species.

Means and slopes of the two species relax exactly with the accelerations inside, compared at one common point. The
rest of a particle's velocity is damped towards the line of its own species (equations in `kernels/drag/cells.py`). The
origin of the cells moves with every step. This removes the remaining errors of the lattice, which are of first order
at t_stop ~ dt. About a star velocities are relative to circular orbits (`drag/frame.py`). Momentum is exact in each
cell.
"""

from __future__ import annotations

from typing import Any

from discsim.drag.base import NO_KERNEL, UNSHARED, Kicked, Scheme
from discsim.drag.idic import CELLS, build
from discsim.parts import Lazy

cells = Lazy("discsim.drag.cells")


def kick(*given: Any) -> Kicked:
    return cells.relax_in_blocks(*given, linear=True)


def layout(*given: Any) -> Any:
    return cells.layout(*given, linear=True)


SCHEME = Scheme(kick, layout, build, reads=UNSHARED, sizes=True, unused=NO_KERNEL, cells=CELLS, nanoseconds=100.0)
