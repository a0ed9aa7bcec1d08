"""idic: implicit drag in cell, as published: a particle relaxes towards the mean velocity of the other species.

    dv_i/dt = a_i + e (U - v_i) / t_stop,  du_j/dt = a_j + (V - u_j) / t_stop

v_i, a_i and u_j, a_j are velocities and accelerations of gas and dust particles. V and U are the mean velocities of gas
and dust in the cell, which relax together. e is the dust-to-gas ratio of the cell. The scheme is that of Stoyanovskaya
et al. 2018 (arXiv:1811.06506), sec. 3.3. Momentum is conserved in each cell. Waves have the relative error k h_cell /
sqrt(24) in cells of width h_cell, at any K; in a Keplerian shear the error acts as a viscosity. The lattice of cells
does not shift. If it did, the jumps of the mean velocity between cells would spread over all particles.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from discsim.drag.base import NO_KERNEL, UNSHARED, CellSizes, Scheme
from discsim.numerics.layout import NOISY_LOADING
from discsim.parts import Lazy

if TYPE_CHECKING:
    from discsim.scene import Scene

cells = Lazy("discsim.drag.cells")


def leaf(scene: Scene, number: float, h_mean: Callable[[], float], h_least: float) -> float:
    """Return the smallest allowed side of a leaf, as `CellSizes.leaf`."""
    # A cell of this size has the required number of gas particles; smaller leaves would be merged again.
    fewest = minimum(scene)[0] ** (1.0 / scene.space.dimensions) / scene.gas.eta
    return h_least * (max(number, fewest) if scene.space.dimensions == 2 else number)


def minimum(scene: Scene) -> tuple[int, int]:
    """Return two numbers of particles, of gas and of dust: a cell with fewer is enlarged."""
    if scene.space.dimensions == 1:
        return 4, 4
    # Shot noise in the dust-to-gas ratio of a cell matters if this ratio is near one.
    massive = sum(population.ratio for population in scene.dust) > NOISY_LOADING
    return 8, 30 if massive and scene.drag.direction == "two-way" else 8


CELLS = CellSizes(leaf, adequate=(8, 30), adequate_random=(8, 30), minimum=minimum)
SCHEME = Scheme(
    lambda *given: cells.relax_in_blocks(*given, linear=False),
    lambda *given: cells.layout(*given, linear=False),
    lambda *given: cells.sort_into_blocks(*given),
    reads=UNSHARED, sizes=True, unused=NO_KERNEL, cells=CELLS, nanoseconds=90.0,
)  # fmt: skip
