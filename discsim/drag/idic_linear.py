"""idic-linear: implicit drag in cell with a linear velocity field per cell and species.

Means and slopes of both species' velocities relax exactly, with accelerations included; the means are compared at one
common point. The residual velocity of a particle about the linear field of its own species is damped (equations in
`kernels/drag/cells.py`). The origin of the lattice shifts in every step, which removes the remaining errors of the
lattice; they are of first order at t_stop ~ dt. About a star, velocities are relative to circular orbits
(`drag/frame.py`). Momentum is conserved in each cell.
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
