"""lab14: drag between pairs along their line of sight; the slip of each pair relaxes exactly by itself.

m_j du_j = sum_a d w_a m_j [rho_a / (rho_a + rho_j)] (f y + g b) r^,   w_a = V_a W(r, h_a) / sum_a V_a W(r, h_a)
f y + g b = (y - b t) (exp(-dt/t) - 1) - b dt,   y = (u_j - v_a) . r^,   b = (a_j - a_a) . r^
1/t = (1 + rho_j / rho_a) / t_stop

with the number d of dimensions; the gas of a pair gets exactly the opposite. Loren-Aguilar & Bate 2014
(arXiv:1406.3250) have b = 0 after a kick; with b inside, as in their second paper (2015, arXiv:1509.08374), the slip
is right at steps beyond t_stop. Momentum and angular momentum are exact, at any step. It damps waves, by about
(k h)^2 a step. `drag.kernel = "double-hump"` gives distant pairs more weight.
"""

import numpy as np

from discsim.drag.pairs import exchange, note_times, pair_up
from discsim.kernels.pairs import push_by_relaxing
from discsim.threads import share

FLAT = np.empty((0, 0, 0))


def relax(drag, state, dt, gas_vel, heat):
    relax_each_pair(drag, state, dt, gas_vel, heat, lambda sph, points, vel: FLAT)


def relax_each_pair(drag, state, dt, gas_vel, heat, slopes):
    """Relax the slip of each pair; `slopes(sph, points, vel)` of each species take it to a common point."""
    gas = state.gas
    found = pair_up(drag, state, whole=True, hump=drag.drag.kernel == "double-hump")
    note_times(drag, state.dust, found)

    def impulse(pairs, vel, gas_seen, pushed):
        cloud = pairs.cloud
        slope, gas_slope = slopes(cloud.sph, cloud, vel), slopes(cloud.sph, gas, gas_seen)
        share(
            push_by_relaxing, cloud.count, pairs.start, pairs.gas, pairs.offset, pairs.part, pairs.time, gas.density,
            cloud.density, cloud.mass, vel, cloud.own, slope, gas_seen, state.own_acc["gas"], gas_slope, drag.two_way,
            dt, drag.exponential, pushed,
        )  # fmt: skip

    exchange(drag, state, found, dt, gas_vel, heat, impulse, at_once=False)
