"""tsc: drag at the nodes of a lattice, with weights of triangular-shaped clouds (TSC) between particles and nodes.

Each node gathers mean velocities and velocity slopes of gas and dust from nine cells. The slip at a node relaxes
exactly, with accelerations included. Its change is scattered to particles with the weights of the gather, so that
momentum is conserved. Angular momentum is conserved too, except at nodes with almost no gas. The residual velocity of a
particle about the linear field of its own species decays (equations in `kernels/drag/tsc/nodes.py`). About a star,
velocities are relative to circular orbits (`drag/frame.py`).

Cells are blocks of `drag/cells.py`; their sides are the powers of two, in leaves, nearest to the target side. Each side
has its own lattice of nodes. The origin of the lattices shifts in every step.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.drag.base import NO_KERNEL, UNSHARED, Cells, Kicked, Scheme
from discsim.parts import Lazy

if TYPE_CHECKING:
    from discsim.scene import Scene

nodes = Lazy("discsim.drag.nodes")
NEAREST = 0.5**0.5  # smallest ratio of the nearest power of two to the target side


def kick(*given: Any) -> Kicked:
    return nodes.kick(*given)


def layout(*given: Any) -> Any:
    return nodes.layout(*given)


def build(*given: Any) -> Any:
    return nodes.build(*given)


def leaf(scene: Scene, number: float, h_mean: Callable[[], float], h_least: float) -> float:
    """Return the side of a leaf, as `Cells.leaf`: `number` mean h, halved until it is near `number` h_least."""
    wanted = number * h_mean()
    return wanted * 0.5 ** max(0.0, np.ceil(np.log2(wanted / number / h_least) - 0.5))


# A node gathers the particles of nine cells. With two gas and two dust particles in a cell, placed evenly, the drift is
# right to 0.4% (analysis/drift_cost.py). For dust placed at random, the TSC weights of a node average like
# (1/0.55)^2 = 3.3 whole cells.
CELLS = Cells(leaf, few=(2, 2), few_random=(3, 9), share=NEAREST)
# Three rings of nodes: the change at a node is corrected with those at its neighbours. These depend on slopes around
# the neighbours, and on dust in the cells there, whose weights depend on which of the nodes about these cells have gas.
SCHEME = Scheme(
    kick, layout, build, rings=3, reads=UNSHARED, sizes=True, unused=NO_KERNEL, cells=CELLS, nanoseconds=220.0
)
