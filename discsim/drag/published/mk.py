"""mk: explicit drag between pairs of gas particles a and dust particles j, along their line of sight.

    dv_a/dt = a_a + d sum_j m_j K / (rho_a rho_j) (w . r) r / (r^2 + 0.001 h^2) W(r, h_a),  w = u_j - v_a, r = x_j - x_a
    du_j/dt = a_j - d sum_a m_a (the same)

with the number d of dimensions, K = rho_j / t_stop, and the SPH density rho_j of the dust. Sources: Monaghan &
Kocharyan 1995; Stoyanovskaya et al. 2018 (arXiv:1811.06506), sec. 3.2. The time integration is forward Euler. Its step
is limited to about t_stop, and it damps waves where h > c_s t_stop. Two particles at the same position have no line
between them, and no drag. Momentum and angular momentum are exact. With one-way drag, the kick takes substeps instead
of a limit, as the dust must not limit the time step of the gas.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.drag.base import NO_CELLS, OWN_INTEGRATION, Array, DragLaw, Dust, Gas, KickContext, KickResult, Scheme
from discsim.numerics.threads import parallel_for
from discsim.parts import Lazy

if TYPE_CHECKING:
    from discsim.drag.published.pairs import Pairs
    from discsim.kernels.drag.frame import Frame

kernels, between = Lazy("discsim.kernels.drag.pairs"), Lazy("discsim.drag.published.pairs")


def kick(gas: Gas, dust: Dust, law: DragLaw, frame: Frame, dt: float, cells: Any, context: KickContext) -> KickResult:
    """Kick gas and dust in place over dt, as `Scheme.kick`."""
    found = between.find_pairs(gas, dust, law, frame, context, whole=False)
    steps = between.substep_count("mk", law, dt, 0.0 if law.two_way else between.largest_rate(gas, law, context, found))
    substep = dt / steps

    def impulse(pairs: Pairs, vel: Array, gas_vel: Array, impulses: Array) -> None:
        particles = pairs.particles
        parallel_for(
            kernels.explicit_impulses, particles.count, pairs.start, pairs.gas, pairs.offset, pairs.part, pairs.time,
            gas.h, particles.mass, vel, gas_vel, substep, impulses,
        )  # fmt: skip

    for _ in range(steps):
        between.kick_by_impulses(gas, dust, law, found, substep, context.heat, impulse, at_once=True)
    return between.results_of(dust, found)


def limit(gas: Gas, dust: Dust, law: DragLaw, frame: Frame, context: KickContext) -> float:
    """Return the longest stable step, as `Scheme.limit`."""
    found = between.find_pairs(gas, dust, law, frame, context, whole=False)
    with np.errstate(divide="ignore"):
        return 1.0 / np.float64(between.largest_rate(gas, law, context, found))


# Damping is too strong where h > c_s t_stop: Laibe & Price (2012), sec. 4.
SCHEME = Scheme(kick, limit=limit, by_component=False, damps=True, unused=NO_CELLS | OWN_INTEGRATION)
