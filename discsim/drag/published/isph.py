"""isph: drag towards interpolated velocities, implicit in a particle's own velocity. Momentum is not conserved.

    (v_a' - v_a*) / dt = (U*(x_a) - v_a') eps(x_a) / t_stop,   (u_j' - u_j*) / dt = (V*(x_j) - u_j') / t_stop

v_a and u_j are velocities of gas and dust particles, a prime marks values after the step, and v* = v + a dt and u* = u
+ a dt. U* and V* are the velocities of dust and gas interpolated to the positions of the other species
(`kernels/drag/interpolation.py`). This is ISPH of Stoyanovskaya et al. 2018 (arXiv:1811.06522), with interpolated
values divided by the sum of their weights. The scheme is of first order and stable at any step. A step far above t_stop
swaps the velocities of gas and dust at eps = 1, and damps waves, by about (k h)^2 a step.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from discsim.drag.base import NO_CELLS, NO_KERNEL, OWN_INTEGRATION, DragLaw, Dust, Gas, KickContext, KickResult, Scheme
from discsim.parts import Lazy

if TYPE_CHECKING:
    from discsim.kernels.drag.frame import Frame

interpolation, between = Lazy("discsim.drag.published.interpolation"), Lazy("discsim.drag.published.pairs")


def kick(gas: Gas, dust: Dust, law: DragLaw, frame: Frame, dt: float, cells: Any, context: KickContext) -> KickResult:
    """Kick gas and dust in place over dt, as `Scheme.kick`."""
    pairs = between.find_pairs(gas, dust, law, frame, context, whole=True)
    return interpolation.kick_towards_interpolated(gas, dust, law, pairs, dt, context.heat, implicit=True)


UNUSED = NO_CELLS | NO_KERNEL | OWN_INTEGRATION
# Damping is too strong where h > c_s t_stop: Laibe & Price (2012), sec. 4.
SCHEME = Scheme(kick, conserves=False, damps=True, unused=UNUSED)
