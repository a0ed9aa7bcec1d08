"""idic-linear: implicit drag in cell with a linear velocity field per cell and species.

Means and slopes of the two species relax exactly with the accelerations inside, compared at one common point;
what is left of a particle is damped towards its own species' line (equations in `kernels/drag.py`). The cells'
origin moves with every step, and about a star velocities are taken relative to Kepler's. Momentum is exact in
each cell.
"""

LINEAR = True  # a velocity field linear in the cell, or its mean alone
SHIFTED = True  # removes what is left of the lattice of cells: first-order errors at t_stop ~ dt
