"""idic: implicit drag in cell as published; every particle relaxes towards its cell's mean of the other species.

dv_i/dt = a_i + e (U - v_i) / t_stop,  du_j/dt = a_j + (V - u_j) / t_stop,  V and U relaxing together.
Stoyanovskaya et al. 2018 (arXiv:1811.06506), sec. 3.3. Momentum is exact in each cell. Error on waves:
k h_cell / sqrt(24), whatever K; in a Keplerian shear it is a viscosity. Its cells stand still: moving ones would
smear its staircase over the particles.
"""

from discsim.drag.cells import relax_in_blocks


def relax(drag, state, dt, gas_vel, heat):
    relax_in_blocks(drag, state, dt, gas_vel, heat, linear=False)
