"""idic-linear: implicit drag in cell with a linear velocity field per cell and species.

The means and slopes of the velocities of both species relax exactly, with accelerations included. The means are
compared at one common point. The residual velocity of a particle about the linear field of its own species is damped
(equations in `kernels/drag/cells.py`). The origin of the lattice of cells shifts in every step, which removes the
remaining errors of the lattice; they are of first order at t_stop ~ dt. About a star, velocities are relative to
circular orbits (`drag/frame.py`). Momentum is conserved in each cell.
"""

from __future__ import annotations

from discsim.drag.base import NO_KERNEL, UNSHARED, Scheme
from discsim.drag.idic import CELLS
from discsim.drag.idic import SCHEME as IDIC
from discsim.parts import Lazy

cells = Lazy("discsim.drag.cells")

SCHEME = Scheme(
    lambda *given: cells.relax_in_blocks(*given, linear=True),
    lambda *given: cells.layout(*given, linear=True),
    IDIC.build, reads=UNSHARED, sizes=True, unused=NO_KERNEL, cells=CELLS, nanoseconds=100.0,
)  # fmt: skip
