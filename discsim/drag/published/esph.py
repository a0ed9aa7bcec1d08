"""esph: explicit drag towards interpolated velocities. Momentum is not conserved.

    dv_a/dt = a_a + (U(x_a) - v_a) eps(x_a) / t_stop,   du_j/dt = a_j + (V(x_j) - u_j) / t_stop

SPH interpolates the velocities U of the dust and V of the gas to the positions of the other species. eps is that of the
interpolated dust density (`kernels/drag/interpolation.py`). ESPH of Stoyanovskaya et al. 2018
(arXiv:1811.06522), with interpolants divided by the sum of their weights. Forward Euler: its step is limited to about
t_stop, and it damps waves, by about (k h)^2 a t_stop. One-way drag takes its short steps within the kick, as dust
must not limit the gas.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.drag.base import NO_CELLS, NO_KERNEL, OWN_INTEGRATION, Dust, Gas, Kicked, Law, Scheme, Work
from discsim.parts import Lazy

if TYPE_CHECKING:
    from discsim.kernels.drag.frame import Frame

interpolation, between = Lazy("discsim.drag.published.interpolation"), Lazy("discsim.drag.published.pairs")


def kick(gas: Gas, dust: Dust, law: Law, frame: Frame, dt: float, cells: Any, work: Work) -> Kicked:
    pairs = between.pair_up(gas, dust, law, frame, work, whole=True)
    steps = between.short_steps("esph", law, dt, 0.0 if law.two_way else interpolation.fastest(gas, dust, law, pairs))
    for _ in range(steps):
        kicked = interpolation.follow(gas, dust, law, pairs, dt / steps, work.heat, implicit=False)
    return kicked


def limit(gas: Gas, dust: Dust, law: Law, frame: Frame, work: Work) -> float:
    pairs = between.pair_up(gas, dust, law, frame, work, whole=True)
    with np.errstate(divide="ignore"):
        return 1.0 / np.float64(interpolation.fastest(gas, dust, law, pairs))


UNUSED = NO_CELLS | NO_KERNEL | OWN_INTEGRATION
# Damping is too strong where h > c_s t_stop: Laibe & Price (2012), sec. 4.
SCHEME = Scheme(kick, limit=limit, conserves=False, damps=True, unused=UNUSED)
