"""idic: implicit drag in cell as published; every particle relaxes towards the mean velocity of the other species.

    dv_i/dt = a_i + e (U - v_i) / t_stop,  du_j/dt = a_j + (V - u_j) / t_stop

V and U are the mean velocities of gas and dust in the cell, which relax together, and e is the dust-to-gas ratio of the
cell. Stoyanovskaya et al. 2018 (arXiv:1811.06506), sec. 3.3. Momentum is conserved in each cell. The error of waves is
k h_cell / sqrt(24) for cells of width h_cell, at any K; in a Keplerian shear the error acts as a viscosity. The lattice
of cells does not shift, as the steps of the mean velocity between cells would then spread over all particles.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from discsim.drag.base import NO_KERNEL, UNSHARED, Cells, Kicked, Scheme
from discsim.numerics.layout import NOISY_LOADING
from discsim.parts import Lazy

if TYPE_CHECKING:
    from discsim.scene import Scene

cells = Lazy("discsim.drag.cells")


def kick(*given: Any) -> Kicked:
    return cells.relax_in_blocks(*given, linear=False)


def layout(*given: Any) -> Any:
    return cells.layout(*given, linear=False)


def build(*given: Any) -> Any:
    return cells.sort_into_blocks(*given)


def leaf(scene: Scene, number: float, h_mean: Callable[[], float], h_least: float) -> float:
    """Return the smallest allowed side of a leaf, as `Cells.leaf`."""
    assert scene.gas is not None
    # A cell of this size holds the required number of gas particles; smaller leaves would be merged again.
    fewest = least(scene)[0] ** (1.0 / scene.space.dimensions) / scene.gas.eta
    return h_least * (max(number, fewest) if scene.space.dimensions == 2 else number)


def least(scene: Scene) -> tuple[int, int]:
    """Return the numbers of gas and dust particles below which a cell grows."""
    assert scene.drag is not None and scene.dust is not None
    if scene.space.dimensions == 1:
        return 4, 4
    # Shot noise in the dust-to-gas ratio of a cell matters if this ratio is near one.
    loaded = sum(population.ratio for population in scene.dust) > NOISY_LOADING
    return 8, 30 if loaded and scene.drag.direction == "two-way" else 8


CELLS = Cells(leaf, few=(8, 30), few_random=(8, 30), least=least)
SCHEME = Scheme(kick, layout, build, reads=UNSHARED, sizes=True, unused=NO_KERNEL, cells=CELLS, nanoseconds=90.0)
