"""lab14: drag between pairs along their line of sight; the slip of each pair relaxes exactly by itself.

    m_j du_j = sum_a d w_a m_j [rho_a / (rho_a + rho_j)] (f y + g b) r^,   w_a = V_a W(r, h_a) / sum_a V_a W(r, h_a)
    f y + g b = (y - b t) (exp(-dt/t) - 1) - b dt,   y = (u_j - v_a) . r^,   b = (a_j - a_a) . r^
    1/t = (1 + rho_j / rho_a) / t_stop

with the number d of dimensions; the gas of a pair gets exactly the opposite. Loren-Aguilar & Bate 2014
(arXiv:1406.3250) have b = 0 after a kick. With b inside, as in their second paper (2015, arXiv:1509.08374), the slip
is right at steps beyond t_stop. Momentum and angular momentum are exact, at any step. The scheme damps waves, by
about (k h)^2 a step. `drag.kernel = "double-hump"` gives distant pairs more weight.

Where dust is much sparser than gas, the whole impulse of a dust particle would accelerate the gas particles near it
beyond its own velocity. So the impulses of a pair are scaled down together, by

    2 / max(2, e_j, e_a),   e_i = max over the pairs (j, a) of i of l_j + l_a                                        (1)

where a pair with slip y exchanges the impulse c y, and l_i is the largest eigenvalue of sum c r^ r^T / m_i over the
pairs of i. As |sum c y r^|^2 <= m_i l_i sum c y^2 for both particles of each pair, the kinetic energy then changes by

    dE = -sum c y^2 + sum_i |sum c y r^|^2 / (2 m_i) <= 0.

If gas and dust have similar numbers of particles, l_j + l_a is about 1 - exp(-dt/t), and no impulse is scaled. Scaled
impulses couple gas and dust less strongly than the drag law.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.drag.base import NO_CELLS, Array, Dust, Gas, Kicked, Law, Scheme, Work
from discsim.numerics.threads import parallel_for
from discsim.parts import Lazy

if TYPE_CHECKING:
    from discsim.drag.cloud import Cloud
    from discsim.drag.published.pairs import Pairs
    from discsim.kernels.drag.frame import Frame
    from discsim.numerics.sph import Sph

    Slopes = Callable[[Sph, Gas | Cloud, Array], Array]

kernels, between = Lazy("discsim.kernels.drag.pairs"), Lazy("discsim.drag.published.pairs")

NO_SLOPES = np.empty((0, 0, 0))
ALREADY_SORTED = np.empty(0, np.uint32)  # an empty order: pairs are already sorted by dust particle


def kick(gas: Gas, dust: Dust, law: Law, frame: Frame, dt: float, cells: Any, work: Work) -> Kicked:
    return relax_each_pair(gas, dust, law, frame, dt, work, lambda sph, points, vel: NO_SLOPES)


def relax_each_pair(gas: Gas, dust: Dust, law: Law, frame: Frame, dt: float, work: Work, slopes: Slopes) -> Kicked:
    """Relax the slip of each pair by itself.

    slopes(sph, points, vel): return the velocity gradients (n, d, d) of a species, by which its velocity is
    extrapolated to a common point of the pair; an empty array for velocities at the particles.
    """
    found = between.pair_up(gas, dust, law, frame, work, whole=True)

    def impulse(pairs: Pairs, vel: Array, gas_seen: Array, pushed: Array) -> None:
        cloud = pairs.cloud
        slope, gas_slope = slopes(cloud.sph, cloud, vel), slopes(cloud.sph, gas, gas_seen)
        pull = np.empty(len(pushed))
        parallel_for(
            kernels.push_by_relaxing, cloud.count,
            kernels.Couples(pairs.start, pairs.gas, pairs.part, pairs.time), pairs.offset,
            kernels.Side(gas.mass, gas.density, gas_seen), gas.acc_unshared, gas_slope,
            kernels.Side(cloud.mass, cloud.density, vel), cloud.acc_unshared, slope,
            law.two_way, dt, law.exponential, pull, pushed,
        )  # fmt: skip
        if law.two_way:
            limit_impulses(pairs, gas, pull, pushed)

    between.exchange(gas, dust, law, found, dt, work.heat, impulse, at_once=False)
    return between.times_in(dust, found)


def limit_impulses(pairs: Pairs, gas: Gas, pull: Array, pushed: Array) -> None:
    """Scale the impulses `pushed` (pairs, d) in place, eq. (1); `pull` (pairs,) has c of each pair."""
    cloud, count = pairs.cloud, len(gas.mass)
    one, other = np.empty(cloud.count), np.empty(count)
    both, gas_both = np.empty(cloud.count), np.empty(count)
    of_dust, of_gas = (cloud.count, pairs.start, ALREADY_SORTED), (count, pairs.begin, pairs.by_gas)
    parallel_for(kernels.shares, *of_dust, pairs.offset, pull, cloud.mass, one)
    parallel_for(kernels.shares, *of_gas, pairs.offset, pull, gas.mass, other)
    parallel_for(kernels.most_shares, *of_dust, pairs.gas, one, other, both)
    parallel_for(kernels.most_shares, *of_gas, pairs.dust, other, one, gas_both)
    parallel_for(kernels.limit_impulses, cloud.count, pairs.start, pairs.gas, both, gas_both, pushed)


# Damping is too strong where h > c_s t_stop: Laibe & Price (2012), sec. 4.
SCHEME = Scheme(kick, damps=True, unused=NO_CELLS)
