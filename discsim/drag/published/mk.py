"""mk: explicit drag between pairs of gas particles a and dust particles j, along their line of sight.

    dv_a/dt = a_a + d sum_j m_j K / (rho_a rho_j) (w . r) r / (r^2 + 0.001 h^2) W(r, h_a),  w = u_j - v_a, r = x_j - x_a
    du_j/dt = a_j - d sum_a m_a (the same)

with the number d of dimensions, K = rho_j / t_stop, the dust's sum density rho_j and each particle's own
acceleration. Monaghan & Kocharyan 1995; Stoyanovskaya et al. 2018 (arXiv:1811.06506), sec. 3.2. Forward Euler: its
step is limited to about t_stop, and it damps waves where h > c_s t_stop. A pair at one place has no line of sight and
no drag. Momentum and angular momentum are exact. One-way drag takes its short steps within the kick, as dust must not
limit the gas.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.drag.base import NO_CELLS, OWN_INTEGRATION, Array, Dust, Gas, Kicked, Law, Scheme, Work
from discsim.numerics.threads import parallel_for
from discsim.parts import Lazy

if TYPE_CHECKING:
    from discsim.drag.published.pairs import Pairs
    from discsim.kernels.drag.frame import Frame

kernels, between = Lazy("discsim.kernels.drag.pairs"), Lazy("discsim.drag.published.pairs")


def kick(gas: Gas, dust: Dust, law: Law, frame: Frame, dt: float, cells: Any, work: Work) -> Kicked:
    found = between.pair_up(gas, dust, law, frame, work, whole=False)
    steps = between.short_steps("mk", law, dt, 0.0 if law.two_way else between.fastest(gas, law, work, found))
    short = dt / steps

    def impulse(pairs: Pairs, vel: Array, gas_seen: Array, pushed: Array) -> None:
        cloud = pairs.cloud
        parallel_for(
            kernels.push_explicitly, cloud.count, pairs.start, pairs.gas, pairs.offset, pairs.part, pairs.time, gas.h,
            cloud.mass, vel, gas_seen, short, pushed,
        )  # fmt: skip

    for _ in range(steps):
        between.exchange(gas, dust, law, found, short, work.heat, impulse, at_once=True)
    return between.times_in(dust, found)


def limit(gas: Gas, dust: Dust, law: Law, frame: Frame, work: Work) -> float:
    found = between.pair_up(gas, dust, law, frame, work, whole=False)
    with np.errstate(divide="ignore"):
        return 1.0 / np.float64(between.fastest(gas, law, work, found))


# Damping is too strong where h > c_s t_stop: Laibe & Price (2012), sec. 4.
SCHEME = Scheme(kick, limit=limit, damps=True, unused=NO_CELLS | OWN_INTEGRATION)
