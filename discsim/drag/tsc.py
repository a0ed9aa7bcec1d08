"""tsc: drag at the nodes of a lattice, with weights of triangular-shaped clouds (TSC) between particles and nodes.

Each node gathers mean velocities and velocity slopes of gas and dust from nine cells. The slip at a node, the velocity
of dust relative to gas, relaxes exactly, with accelerations included. The change of the slip is scattered to particles
with the weights of the gather, so that momentum is conserved. What these weights smooth away is added again, to second
order, also where the dust-to-gas ratio varies. Angular momentum is conserved too, except at nodes with almost no gas.
The residual velocity of a particle about the linear field of its own species decays (equations in
`kernels/drag/tsc/nodes.py`). About a star, velocities are relative to circular orbits (`drag/frame.py`).

Cells are blocks of `drag/cells.py`. The side of a cell is the power of two, in leaves, that is nearest to the target
side. Cells of the same side have their own lattice of nodes. The origin of all lattices shifts in every step.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from discsim.drag.base import NO_KERNEL, UNSHARED, CellSizes, Scheme
from discsim.parts import Lazy

if TYPE_CHECKING:
    from discsim.scene import Scene

nodes = Lazy("discsim.drag.nodes")
NEAREST = 0.5**0.5  # smallest ratio of the nearest power of two to the target side


def leaf(scene: Scene, number: float, h_mean: Callable[[], float], h_least: float) -> float:
    """Return the smallest allowed side of a leaf, as `CellSizes.leaf`.

    The result is the target side at the mean h, halved until it is near the target side at the smallest h.
    """
    side = number * h_mean()
    return side * 0.5 ** max(0.0, np.ceil(np.log2(side / number / h_least) - 0.5))


# A node gathers the particles of nine cells. With two gas and two dust particles in a cell, placed evenly, the drift is
# right to 0.4% (analysis/drift_cost.py). For dust placed at random, the TSC weights of a node average as many particles
# as (1/0.55)^2 = 3.3 whole cells have.
CELLS = CellSizes(leaf, adequate=(2, 2), adequate_random=(3, 9), least_side=NEAREST)
# Three rings of nodes affect a cell. The change at a node is corrected with the changes at its neighbours. The latter
# depend on slopes around the neighbours, and on dust in the cells there. The weights of this dust depend on which nodes
# about these cells have gas.
SCHEME = Scheme(
    lambda *given: nodes.kick(*given),
    lambda *given: nodes.layout(*given),
    lambda *given: nodes.build(*given),
    rings=3, reads=UNSHARED, sizes=True, unused=NO_KERNEL, cells=CELLS, nanoseconds=220.0,
)  # fmt: skip
