"""tsc: drag between nodes of a lattice with the weights of a triangular-shaped cloud.

The slip at a node, from velocities of nine cells and slopes within each species, relaxes exactly with the
accelerations inside. Its change is scattered with the weights of the gather, so that momentum is exact. Angular
momentum is exact too, but for nodes with next to no gas. The rest of a particle's velocity decays towards the line of
its own species (equations in `kernels/drag/tsc/nodes.py`). About a star velocities are relative to circular orbits
(`drag/frame.py`).

Cells are those of `drag/cells.py`, with the power of two nearest to the wanted side. Each side has a lattice of its
own, whose origin moves with every step.
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
NEAREST = 0.5**0.5  # least ratio of the nearest power of two to the wanted side


def kick(*given: Any) -> Kicked:
    return nodes.kick(*given)


def layout(*given: Any) -> Any:
    return nodes.layout(*given)


def build(*given: Any) -> Any:
    return nodes.build(*given)


def leaf(scene: Scene, number: float, h_mean: Callable[[], float], h_least: float) -> float:
    """Return a side of leaves such that powers of two of it are next to `number` mean h, and to that in the densest
    gas.
    """
    wanted = number * h_mean()
    return wanted * 0.5 ** max(0.0, np.ceil(np.log2(wanted / number / h_least) - 0.5))


# A node has the particles of nine cells: with two of each kind in a cell, placed evenly, the drift is right to 0.4%
# (analysis/drift_cost.py). For dust placed at random a cloud is as good as (1/0.55)^2 = 3.3 cells.
CELLS = Cells(leaf, few=(2, 2), few_random=(3, 9), share=NEAREST)
# Three rings: a node's change is sharpened by those of its neighbours. These depend on slopes about the neighbours, and
# on dust in the cells there, whose weights depend on which of the nodes about these cells have gas.
SCHEME = Scheme(
    kick, layout, build, rings=3, reads=UNSHARED, sizes=True, unused=NO_KERNEL, cells=CELLS, nanoseconds=220.0
)
