"""esph: explicit drag towards interpolated velocities. Momentum is not conserved.

    dv_a/dt = a_a + (U(x_a) - v_a) eps(x_a) / t_stop,   du_j/dt = a_j + (V(x_j) - u_j) / t_stop

SPH interpolates the velocities U of the dust and V of the gas to the positions of the other species. eps is that of the
interpolated dust density (`kernels/drag/interpolation.py`). ESPH of Stoyanovskaya et al. 2018
(arXiv:1811.06522), with interpolants divided by the sum of their weights. Forward Euler: its step is limited to about
t_stop, and it damps waves, by about (k h)^2 a t_stop. One-way drag takes its short steps within the kick, as dust
must not limit the gas.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from discsim.drag.base import NO_CELLS, NO_KERNEL, OWN_INTEGRATION, Array, Scheme
from discsim.parts import Lazy

if TYPE_CHECKING:
    from discsim.effects.drag import Effect as Drag
    from discsim.numerics.state import State

interpolation, pairs = Lazy("discsim.drag.published.interpolation"), Lazy("discsim.drag.published.pairs")


def relax(drag: Drag, state: State, dt: float, gas_vel: Array, heat: Array) -> None:
    found = pairs.pair_up(drag, state, whole=True)
    steps = pairs.short_steps(drag, dt, 0.0 if drag.two_way else interpolation.fastest(drag, state, found))
    for _ in range(steps):
        interpolation.follow(drag, state, found, dt / steps, gas_vel, heat, implicit=False)


def limit(drag: Drag, state: State) -> float:
    with np.errstate(divide="ignore"):
        return 1.0 / np.float64(interpolation.fastest(drag, state, pairs.pair_up(drag, state, whole=True)))


UNUSED = NO_CELLS | NO_KERNEL | OWN_INTEGRATION
# Damping is too strong where h > c_s t_stop: Laibe & Price (2012), sec. 4.
SCHEME = Scheme(relax, limit=limit, conserves=False, damps=True, unused=UNUSED)
