"""Interpolation of the velocity of the other species to gas and dust particles, and the rate of drag towards it.

With the pairs of `kernels/drag/pairs.py`, V = m / rho and weights W(r_ja, h_a):

    dust j:   V(x_j) = sum_a V_a W v_a / sum_a V_a W,        1 / t_stop in the gas in the same way
    gas a:    U(x_a) = sum_j V_j W u_j / sum_j V_j W,        sum_j m_j W / (rho_a t_stop)

Division by the sums of weights makes the interpolation exact for a uniform velocity.
"""

from discsim.jit.decorators import jit


@jit
def seen_by_dust(first, last, start, gas, part, gvel, other):
    """Write the gas velocity (n, d) at each dust particle; the weights `part` (pairs,) of a dust particle sum to 1."""
    for j in range(first, last):
        for i in range(other.shape[1]):
            total = 0.0
            for k in range(start[j], start[j + 1]):
                total += part[k] * gvel[gas[k], i]
            other[j, i] = total


@jit
def seen_by_gas(first, last, by_gas, begin, dust, weight, time, dmass, drho, dvel, rho, rate, pull):
    """Add the drag rate (n,) of one population at each gas particle, and to `pull` (n, d) the rate times the
    interpolated velocity of the population.
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
    """Kick over dt, with drag from velocities `now` towards `other` (n, d) at `rate` (n,), explicitly or implicitly.

    Adds the work of the drag per mass to `heat` (n,), unless empty.
    """
    for k in range(first, last):
        x = rate[k] * dt
        f = -x / (1.0 + x) if implicit else -x
        for i in range(vel.shape[1]):
            change = f * (now[k, i] - other[k, i])
            vel[k, i] += dt * acc[k, i] + change
            if len(heat) > 0:
                heat[k] += change * (other[k, i] - now[k, i] - 0.5 * change)
