"""idic-linear: implicit drag in cell with a linear velocity field per cell and species.

Means and slopes of the two species relax exactly with the accelerations inside, compared at one common point. The
rest of a particle's velocity is damped towards the line of its own species (equations in `kernels/drag/cells.py`). The
origin of the cells moves with every step. This removes the remaining errors of the lattice, which are of first order
at t_stop ~ dt. About a star velocities are relative to circular orbits (`drag/frame.py`). Momentum is exact in each
cell.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from discsim.drag.base import NO_KERNEL, UNSHARED, Array, Scheme
from discsim.drag.idic import CELLS
from discsim.parts import Lazy

if TYPE_CHECKING:
    from discsim.effects.drag import Effect as Drag
    from discsim.numerics.state import State

cells = Lazy("discsim.drag.cells")


def relax(drag: Drag, state: State, dt: float, gas_vel: Array, heat: Array) -> None:
    cells.relax_in_blocks(drag, state, dt, gas_vel, heat, linear=True)


def places(drag: Drag, state: State) -> Any:
    return cells.blocks_of(drag, state, linear=True)


def members(drag: Drag, state: State) -> Any:
    return cells.layout_of(drag, state, linear=True)[0]


SCHEME = Scheme(
    relax, sizes=True, unused=NO_KERNEL, cells=CELLS, nanoseconds=100.0, places=places, members=members, reads=UNSHARED
)
