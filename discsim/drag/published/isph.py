"""isph: drag towards interpolated velocities, implicit in a particle's own velocity. Momentum is not conserved.

    (v_a' - v_a*) / dt = (U*(x_a) - v_a') eps(x_a) / t_stop,   (u_j' - u_j*) / dt = (V*(x_j) - u_j') / t_stop

with v* = v + a dt, and u* likewise. U* of the dust and V* of the gas are velocities that SPH interpolates to the
positions of the other species (`kernels/drag/interpolation.py`). ISPH of Stoyanovskaya et al. 2018 (arXiv:1811.06522),
with interpolants divided by the sum of their weights. First order and stable at any step. A step far above t_stop
swaps the velocities of gas and dust at eps = 1, and damps waves, by about (k h)^2 a step.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from discsim.drag.base import NO_CELLS, NO_KERNEL, OWN_INTEGRATION, Dust, Gas, Kicked, Law, Scheme, Work
from discsim.parts import Lazy

if TYPE_CHECKING:
    from discsim.kernels.drag.frame import Frame

interpolation, between = Lazy("discsim.drag.published.interpolation"), Lazy("discsim.drag.published.pairs")


def kick(gas: Gas, dust: Dust, law: Law, frame: Frame, dt: float, cells: Any, work: Work) -> Kicked:
    pairs = between.pair_up(gas, dust, law, frame, work, whole=True)
    return interpolation.follow(gas, dust, law, pairs, dt, work.heat, implicit=True)


UNUSED = NO_CELLS | NO_KERNEL | OWN_INTEGRATION
# Damping is too strong where h > c_s t_stop: Laibe & Price (2012), sec. 4.
SCHEME = Scheme(kick, conserves=False, damps=True, unused=UNUSED)
