"""esph: explicit drag towards interpolated velocities. Momentum is not conserved.

    dv_a/dt = a_a + (U(x_a) - v_a) eps(x_a) / t_stop,   du_j/dt = a_j + (V(x_j) - u_j) / t_stop

U and V are the velocities of dust and gas interpolated to the positions of the other species, and eps is the ratio of
the interpolated dust density to the gas density (`kernels/drag/interpolation.py`). This is ESPH of Stoyanovskaya et al.
2018 (arXiv:1811.06522), with interpolated values divided by the sum of their weights. The time integration is forward
Euler. Its step is limited to about t_stop, and it damps waves, by about (k h)^2 per t_stop. With one-way drag, the kick
takes substeps instead of a limit, as the dust must not limit the time step of the gas.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.drag.base import NO_CELLS, NO_KERNEL, OWN_INTEGRATION, DragLaw, Dust, Gas, KickContext, KickResult, Scheme
from discsim.parts import Lazy

if TYPE_CHECKING:
    from discsim.kernels.drag.frame import Frame

interpolation, between = Lazy("discsim.drag.published.interpolation"), Lazy("discsim.drag.published.pairs")


def kick(gas: Gas, dust: Dust, law: DragLaw, frame: Frame, dt: float, cells: Any, context: KickContext) -> KickResult:
    """Kick gas and dust in place over dt, as `Scheme.kick`."""
    pairs = between.find_pairs(gas, dust, law, frame, context, whole=True)
    rate = 0.0 if law.two_way else interpolation.largest_rate(gas, dust, law, pairs)
    steps = between.substep_count("esph", law, dt, rate)
    given = gas, dust, law, pairs, dt / steps, context.heat
    for _ in range(steps):
        result = interpolation.kick_towards_interpolated(*given, implicit=False)
    return result


def limit(gas: Gas, dust: Dust, law: DragLaw, frame: Frame, context: KickContext) -> float:
    """Return the longest stable step, as `Scheme.limit`."""
    pairs = between.find_pairs(gas, dust, law, frame, context, whole=True)
    with np.errstate(divide="ignore"):
        return 1.0 / np.float64(interpolation.largest_rate(gas, dust, law, pairs))


UNUSED = NO_CELLS | NO_KERNEL | OWN_INTEGRATION
# Damping is too strong where h > c_s t_stop: Laibe & Price (2012), sec. 4.
SCHEME = Scheme(kick, limit=limit, conserves=False, damps=True, unused=UNUSED)
