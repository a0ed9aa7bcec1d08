"""idic: implicit drag in cell as published; every particle relaxes towards its cell's mean of the other species.

dv_i/dt = a_i + e (U - v_i) / t_stop,  du_j/dt = a_j + (V - u_j) / t_stop,  V and U relaxing together.
Stoyanovskaya et al. 2018 (arXiv:1811.06506), sec. 3.3. Momentum is exact in each cell. Error on waves:
k h_cell / sqrt(24), whatever K; in a Keplerian shear it is a viscosity. Its cells stand still: moving ones would
smear its staircase over the particles.
"""

from discsim.drag.base import NO_KERNEL, Cells, Scheme
from discsim.numerics.layout import leaf_of_cells, least_in_cells
from discsim.parts import Lazy

cells = Lazy("discsim.drag.cells")


def relax(drag, state, dt, gas_vel, heat):
    cells.relax_in_blocks(drag, state, dt, gas_vel, heat, linear=False)


# Drag at eps ~ 1 wants this much dust for the noise of its loading.
CELLS = Cells(lambda scene, mean, least: leaf_of_cells(scene, least), (8, 30), (8, 30), least=least_in_cells)
SCHEME = Scheme(relax, unused=NO_KERNEL, cells=CELLS, nanoseconds=90.0)
