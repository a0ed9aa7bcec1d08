"""Interpolation of the velocity of the other species to each gas and dust particle, and the rate of drag towards it.

For pairs of dust particle j and gas particle a (`kernels/drag/pairs.py`) with volumes V = m / rho and the weight
W(r_ja, h_a):

    dust j:   velocity sum_a V_a W v_a / sum_a V_a W,    rate sum_a V_a W / t_stop / sum_a V_a W
    gas a:    velocity sum_j V_j W u_j / sum_j V_j W,    rate sum_j m_j W / (rho_a t_stop)

Division by the sums of weights makes the interpolation exact for a uniform velocity.
"""

from discsim.jit.decorators import jit


@jit
def drag_on_gas(first, last, by_gas, begin, dust, weight, time, dmass, drho, dvel, rho, rate, pull):
    """Add the drag of one dust population on each gas particle to `rate` and `pull`.

    rate (n,): drag rate. pull (n, d): drag rate times the velocity of the population at the gas particle. The pairs of
    gas particle a have the indices by_gas[begin[a] : begin[a + 1]]. dust, weight, time (pairs,): dust particle, W and
    stopping time of each pair. dmass, drho, dvel: masses, densities and velocities of the dust. rho: densities of the
    gas.
    """
    for a in range(first, last):
        total, mine = 0.0, 0.0
        for m in range(begin[a], begin[a + 1]):
            k = by_gas[m]
            total += weight[k] * dmass[dust[k]] / drho[dust[k]]
            mine += weight[k] * dmass[dust[k]] / (rho[a] * time[k])
        if total == 0.0:
            continue
        rate[a] += mine
        for m in range(begin[a], begin[a + 1]):
            k = by_gas[m]
            part = weight[k] * dmass[dust[k]] / drho[dust[k]] / total
            for i in range(pull.shape[1]):
                pull[a, i] += mine * part * dvel[dust[k], i]


@jit
def kick_towards(first, last, rate, other, now, acc, dt, implicit, vel, heat):
    """Add accelerations and drag over dt to `vel` (n, d), and the work of the drag per mass to `heat` (n,).

    Drag acts on the velocities `now` (n, d), towards the velocities `other` (n, d), at `rate` (n,). implicit: whether
    the drag is implicit in the velocity. An empty `heat` is not written.
    """
    for k in range(first, last):
        x = rate[k] * dt
        f = -x / (1.0 + x) if implicit else -x
        for i in range(vel.shape[1]):
            change = f * (now[k, i] - other[k, i])
            vel[k, i] += dt * acc[k, i] + change
            if len(heat) > 0:
                heat[k] += change * (other[k, i] - now[k, i] - 0.5 * change)
