"""Kick and drift of dust in a prescribed gas disc: circular orbits and the steady drift are exact at any step.

The gas of a prescribed disc moves on given circles. About a star of Keplerian frequency Omega_K(r), in gas of angular
momentum L_g(r) = r^2 Omega_g, a grain with radial velocity v and angular momentum L (per mass) obeys

    dr/dt = v,                    dphi/dt = L / r^2                                                       (1)
    dv/dt = L^2 / r^3 - Omega_K^2 r + a_r - v / t,     dL/dt = r a_phi - (L - L_g) / t                    (2)

with the stopping time t and the acceleration a by all other forces. The drift of a step solves (1) with constant v and
L, exactly for an r linear in time. The kick solves (2) at fixed r. Circular orbits therefore keep radius and frequency
at any step, and L is exact without drag. A leapfrog in x and y has velocities off by (Omega dt)^2 / 8, as large as the
headwind.

Drag brings grains to the steady drift, at which the terms of (2) balance (Nakagawa, Sekiya & Hayashi 1986). With
F = (Omega_K^2 - Omega_g^2) r, B = (1/r) dL_g/dr and kappa^2 = (Omega_K + Omega_g) B this drift is

    v* = -E / (1/t + kappa^2 t),        L* = L_g + r w*,    w* = E B / (1/t^2 + kappa^2),   E = F - v_g/t   (3)

With this kappa^2, grains without drag are on circular orbits. v_g is the radial velocity of the gas, due to its
viscosity; v - v_g replaces v in the drag of (2). For grains under radiation pressure, Omega_K in (2), F and kappa is
the frequency about a star of mass (1 - beta) M.

The kick relaxes the deviation from the steady drift. Half a step before or after the time of its position, a grain that
drifts by (3) has the radial velocity and the angular momentum

    v* + s q,   L* - s r w*/t,          q = L*^2 / r^3 - Omega_K^2 r - v*/t,   s = -dt/2 or dt/2          (4)

so delta = v - v* - s q and m = L - L* + s r w*/t obey, exactly and for any dt/t,

    d delta/dt = -delta/t + a_r + (2 L* m + m^2) / r^3,     dm/dt = -m/t + r a_phi                        (5)

Since (4) contains the whole force on such a grain, (5) equals (2) to second order in the step, and the drift (3) itself
has no error by the time step. Two successive kicks have the same result as one kick of their total length.

If t depends on the slip W = (v* + delta, w* + m/r), (5) at a constant time t0 gains the acceleration

    W* (1/t* - 1/t0) + N,      N = (1/t0 - 1/t(|W|)) W                                                    (6)

with t0 the stopping time at the start, where N is zero. The kick integrates exactly a parabola through N at the start,
the middle and the end of a sub-step; N at the middle and the end come from iteration (collocation). There is one
sub-step if its error is within TOLERANCE, else several. Where the slip is too small to change the drag, (5) is used.
"""

import math
from typing import NamedTuple

import numpy as np

from discsim.jit.decorators import jit, jit_subroutine
from discsim.kernels.common.arc import move_on_arc
from discsim.kernels.drag.laws import drag_factor, drag_factor_slope, drag_speed_terms, is_linear_up_to, stopping_time
from discsim.kernels.drag.nonlinear import MOST, TOLERANCE, step_ratio

SERIES = 1e-2  # dt/t below which differences of exponentials are computed from their series
ROUNDS = 5  # largest number of iterations for N


class Disc(NamedTuple):
    """Prescribed gas disc with its star, and the drag law. The gas has power laws of the radius, or a table."""

    law: int  # form of the drag law
    grains: np.ndarray  # (populations, 5): its constants, as in `formulas/laws.py`
    nonlinear: bool  # whether the stopping time depends on the slip
    ratios: np.ndarray  # (populations,): dust-to-gas ratio
    pull: np.ndarray  # (populations,): 1 - beta, the star's gravity reduced by radiation pressure, over its gravity
    star: float  # G M
    softening: float
    gas: np.ndarray  # (Sigma, p, c_s^2, q, f): Sigma ~ r^-p, c_s^2 ~ r^-q, given at r = 1; -(1/Sigma) dP/dr = f c_s^2/r
    table: np.ndarray  # (nodes, 5), replaces `gas` if not empty: ln Sigma, ln c_s^2, g = f c_s^2, dg / d ln r and v_g
    first: float  # ln r of the first node of `table`
    nodes: float  # number of nodes per unit of ln r


class Path(NamedTuple):
    """Steady drift of a grain at a position in the disc, eqs. (3) and (4), and the gas there."""

    r: float
    density: float  # Sigma of the gas
    sound: float  # sound speed
    kepler: float  # Omega_K without radiation pressure
    orbit: float  # L_g / r
    mach2: float  # coefficients of the drag factor at a finite slip, from `formulas.laws.drag_speed_terms`
    reynolds2: float
    slow: float  # stopping time at zero slip
    time: float  # stopping time at the slip of the steady drift
    radial: float  # v*
    azimuthal: float  # w*
    slip: float  # v* - v_g
    push: float  # q


@jit_subroutine
def drift_speeds(time, excess, shear, kappa2, flow):
    """Return (v*, w*) of eq. (3). time: t. excess: F. shear: B. flow: v_g."""
    rate = 1.0 / time
    carried = excess - flow * rate
    return -carried / (rate + kappa2 * time), carried * shear / (rate * rate + kappa2)


@jit_subroutine
def gas_at(r2, disc):
    """Return (Sigma, c_s^2, f, -r df/dr, v_g) of the gas at the squared radius r2.

    f = -(1/Sigma) dP/dr / r is the outward acceleration by pressure, over r. v_g is the radial velocity of the gas.
    """
    if len(disc.table) == 0:
        sound2 = disc.gas[2] * r2 ** (-0.5 * disc.gas[3])
        pressure = disc.gas[4] * sound2 / r2
        return disc.gas[0] * r2 ** (-0.5 * disc.gas[1]), sound2, pressure, (2.0 + disc.gas[3]) * pressure, 0.0
    last_node = len(disc.table) - 1
    position = min(max((0.5 * math.log(r2) - disc.first) * disc.nodes, 0.0), float(last_node))
    node = min(int(position), last_node - 1)
    part = position - node
    low, high, less = disc.table[node], disc.table[node + 1], 1.0 - part
    density, sound2 = math.exp(less * low[0] + part * high[0]), math.exp(less * low[1] + part * high[1])
    pull, rise = less * low[2] + part * high[2], less * low[3] + part * high[3]
    return density, sound2, pull / r2, (2.0 * pull - rise) / r2, less * low[4] + part * high[4]


@jit_subroutine
def time_on_path(mach2, reynolds2, slow, excess, shear, kappa2):
    """Return the stopping time t at the slip w of the steady drift (3), which itself depends on t.

    The stopping time is the root of Z = (t H / slow)^2 = 1, with H the drag factor at the slip (`drag_factor`). With
    u = t^2 the slip of (3) is w^2 = F^2 u (1 + B^2 u) / (1 + kappa^2 u)^2. Each iteration approximates Z by a power
    law u^p with the local exponent p. Far from the root it solves the power law; where Z is within a factor of 2 of
    1 it takes a step of Halley's method, of third order.
    """
    slow2, speed2 = slow * slow, excess * excess
    u = slow2
    for _ in range(60):
        damping = 1.0 / (1.0 + kappa2 * u)
        slip2 = speed2 * (u * damping) * ((1.0 + shear * shear * u) * damping)
        fast = drag_factor(mach2, reynolds2, slip2)
        z = u / slow2 * fast * fast
        if z == 1.0:
            break
        rise = 2.0 * damping - 1.0 / (1.0 + shear * shear * u)  # d ln w^2 / d ln u
        power = max(0.5, 1.0 + rise * drag_factor_slope(mach2, reynolds2, slip2, fast))
        if 0.5 < z < 2.0:
            u *= ((power - 1.0) * z + power + 1.0) / ((power + 1.0) * z + power - 1.0)
        else:
            u *= z ** (-1.0 / power)
        if abs(z - 1.0) < 1e-6:  # third order: the error is now below the square of this
            break
    return math.sqrt(u)


@jit
def path_at(x, y, k, disc):
    """Return the `Path` of a grain of population k at (x, y), relative to the star."""
    r2 = x * x + y * y
    r = math.sqrt(r2)
    density, sound2, pressure, turning, flow = gas_at(r2, disc)
    d2 = r2 + disc.softening * disc.softening
    kepler2 = disc.star / (d2 * math.sqrt(d2))
    omega2 = max(0.0, kepler2 - pressure)
    omega, sound, kepler = math.sqrt(omega2), math.sqrt(sound2), math.sqrt(kepler2)
    # 2 Omega_g B = 4 Omega_g^2 + r d(Omega_g^2)/dr, with the contributions of the star and of the pressure.
    turns = max(0.0, 4.0 * omega2 - 3.0 * r2 / d2 * kepler2 + turning)
    shear = 0.5 * turns / omega if omega > 0.0 else 0.0
    pull = disc.pull[k]
    kappa2 = (omega + kepler * math.sqrt(max(0.0, pull))) * shear
    excess = (kepler2 * pull - omega2) * r
    slow = time = stopping_time(disc.law, disc.grains[k], disc.ratios[k], density, sound, kepler)
    mach2, reynolds2 = 0.0, 0.0
    if disc.nonlinear:
        mach2, reynolds2 = drag_speed_terms(disc.law, disc.grains[k], density, sound, kepler)
        if mach2 + reynolds2 > 0.0:
            time = time_on_path(mach2, reynolds2, slow, excess, shear, kappa2)
    radial, azimuthal = drift_speeds(time, excess, shear, kappa2, flow)
    slip = radial - flow
    push = (2.0 * omega + azimuthal / r) * azimuthal - excess - slip / time
    return Path(r, density, sound, kepler, omega * r, mach2, reynolds2, slow, time, radial, azimuthal, slip, push)


@jit_subroutine
def responses(x):
    """Return exp(-x) and four means over s in [0, x].

    The four are the means of exp(-s), and of exp(s - x) times (1 - exp(-s))/x, 2 exp(-s) (1 - exp(-s))/x, and (1 -
    exp(-s))^2 / x^2.
    """
    if x < SERIES:
        first = 1.0 - x * (0.5 - x * (1.0 / 6.0 - x * (1.0 / 24.0 - x * (1.0 / 120.0 - x / 720.0))))
        e = 1.0 - x * first
        second = 0.5 - x * (1.0 / 3.0 - x * (0.125 - x * (1.0 / 30.0 - x / 144.0)))
        return e, first, second, e * (1.0 - x * (1.0 / 3.0 - x * (1.0 / 12.0 - x / 60.0))), (1.0 - x) / 3.0
    one = -math.expm1(-x)
    e, x2 = 1.0 - one, x * x
    return e, one / x, (one - x * e) / x2, 2.0 * e * (x - one) / x2, (one - 2.0 * x * e + e * one) / (x2 * x)


@jit_subroutine
def relax(delta, m, time, answer, a_r, a_phi, spin, r, dt):
    """Return (delta, m) of eq. (5) after dt, at a constant stopping time; spin: L*. answer: responses(dt / time)."""
    e, first, second, mixed, square = answer
    given = r * a_phi * dt
    turned = 2.0 * spin * (m * e + given * second) + m * m * e * first + given * (m * mixed + given * square)
    damped = first * dt / time  # 1 - e
    return delta - delta * damped + dt * (a_r * first + turned / (r * r * r)), m - m * damped + given * first


@jit_subroutine
def drag_factor_at(path, delta, m):
    """Return the squared slip of a grain that deviates by (delta, m) from the steady drift, and the drag factor H."""
    v, w = path.slip + delta, path.azimuthal + m / path.r
    slip2 = v * v + w * w
    return slip2, drag_factor(path.mach2, path.reynolds2, slip2)


@jit_subroutine
def nonlinear_drag(path, rate, v, w):
    """Return N of eq. (6), radial and azimuthal, at the slip of the steady drift plus (v, w); rate: 1/t0."""
    v += path.slip
    w += path.azimuthal
    less = rate - drag_factor(path.mach2, path.reynolds2, v * v + w * w) / path.slow
    return v * less, w * less


@jit_subroutine
def collocation_means(x, answer):
    """Return the means over s in [0, 1] of exp(x (s - 1)) times s, s^2 / 2, (1 - s) s and (1 - s) s^2 / 2.

    `answer` is responses(x).
    """
    if x < SERIES:  # to x^2, as the factors of these means are small
        return (
            0.5 - x * (1.0 / 6.0 - x / 24.0),
            1.0 / 6.0 - x * (1.0 / 24.0 - x / 120.0),
            1.0 / 6.0 - x * (1.0 / 12.0 - x / 40.0),
            1.0 / 24.0 - x * (1.0 / 60.0 - x / 240.0),
        )
    low = 1.0 / x
    first = (1.0 - answer[1]) * low
    second = (0.5 - first) * low
    turned = (first - answer[2]) * low
    return first, second, turned, (second - turned) * low


@jit_subroutine
def middle_weights(f, s):
    """Return the weights of N1 and N2 in the velocity at the middle of a sub-step.

    The weights hold for a parabola through 0, N1 and N2 at the start, middle and end. f, s: `collocation_means` of s
    and of s^2 / 2, or of (1 - s) s and (1 - s) s^2 / 2, over the first half of the sub-step.
    """
    return f - s, 0.5 * s - 0.25 * f


@jit_subroutine
def end_weights(f, s):
    """Return the weights of N1 and N2 in the velocity at the end of a sub-step, as in `middle_weights`.

    f, s: the same means, over the whole sub-step.
    """
    return 4.0 * f - 8.0 * s, 4.0 * s - f


@jit_subroutine
def velocity_from_n(n1, n2, weights, turned, turn, dt):
    """Return the radial and azimuthal velocity that N1 and N2 add within dt.

    weights: weights of N1 and N2 by `middle_weights` or `end_weights`. turned: such weights for the radial
    acceleration that the azimuthal velocity causes. turn: factor of the azimuthal velocity in this acceleration.
    """
    radial = n1[0] * weights[0] + n2[0] * weights[1]
    spun = n1[1] * turned[0] + n2[1] * turned[1]
    return dt * (radial + turn * spun), dt * (n1[1] * weights[0] + n2[1] * weights[1])


@jit_subroutine
def larger_size(a, b):
    """Return the larger of |a| and |b|."""
    return max(abs(a), abs(b))


@jit_subroutine
def step_by_speed(delta, m, path, a_r, a_phi, spin, dt):
    """Return (delta, m) of eqs. (5) and (6) after one sub-step dt, and the estimated error over the largest slip."""
    r = path.r
    slip2, fast = drag_factor_at(path, delta, m)
    rate = fast / path.slow
    time, x, more = 1.0 / rate, dt * rate, 1.0 / path.time - rate
    a_r, a_phi = a_r + path.slip * more, a_phi + path.azimuthal * more
    half, whole = responses(0.5 * x), responses(x)
    # The solution without N.
    d1, m1 = relax(delta, m, time, half, a_r, a_phi, spin, r, 0.5 * dt)
    d2, m2 = relax(delta, m, time, whole, a_r, a_phi, spin, r, dt)
    first, second, turned, turned2 = collocation_means(0.5 * x, half)
    b1, c1 = middle_weights(first, second), middle_weights(turned, turned2)
    first, second, turned, turned2 = collocation_means(x, whole)
    b2, c2 = end_weights(first, second), end_weights(turned, turned2)
    turn = 2.0 * (spin + m1) / (r * r) * dt
    v1 = w1 = v2 = w2 = change = left = 0.0
    n1 = n2 = (0.0, 0.0)
    for _ in range(ROUNDS):
        n1 = nonlinear_drag(path, rate, d1 + v1, m1 / r + w1)
        n2 = nonlinear_drag(path, rate, d2 + v2, m2 / r + w2)
        before, v, w = change, v2, w2
        v1, w1 = velocity_from_n(n1, n2, b1, c1, 0.5 * turn, dt)
        v2, w2 = velocity_from_n(n1, n2, b2, c2, turn, dt)
        change = larger_size(v2 - v, w2 - w)
        # Sum of all further changes, if each is smaller than the one before by the same factor.
        left = change * (change / (before - change) if change < 0.5 * before else 1.0)
        if left < 1e-2 * TOLERANCE * math.sqrt(slip2):
            break
    d2 += v2
    m2 += r * w2
    largest = math.sqrt(max(slip2, drag_factor_at(path, d2, m2)[0]))
    # Error of the parabola: its second difference, times the ratio of this difference to N.
    bend, size = larger_size(n2[0] - 2.0 * n1[0], n2[1] - 2.0 * n1[1]), larger_size(larger_size(*n1), larger_size(*n2))
    curve = bend / size if size > 0.0 else 0.0
    error = left + dt * whole[1] * bend * curve * min(1.0, curve + x)
    return d2, m2, error / largest if largest > 0.0 else 0.0


@jit
def relax_by_speed(delta, m, path, a_r, a_phi, spin, dt):
    """Return (delta, m) of eqs. (5) and (6) after dt, for a stopping time that depends on the slip.

    dt is divided into sub-steps.
    """
    done, step, count = 0.0, dt, 0
    while done < dt:
        count += 1
        step = min(step, dt - done)
        d, n, error = step_by_speed(delta, m, path, a_r, a_phi, spin, step)
        error /= TOLERANCE
        if error <= 1.0 or count > MOST:
            delta, m = d, n
            done = done + step if done + step < dt * (1.0 - 1e-15) else dt
        if done < dt:
            step *= step_ratio(error)
    return delta, m


@jit_subroutine
def is_linear(path, delta, m, a_r, a_phi, spin, dt):
    """Return whether the stopping time is the same at all slips that a grain can reach during dt."""
    r, lasting = path.r, min(dt, path.slow)
    turned = abs(m) / r + lasting * abs(a_phi)
    reach = abs(path.slip) + abs(path.azimuthal) + abs(delta) + turned
    reach += lasting * (abs(a_r) + turned * (2.0 * spin / r + turned) / r)
    return is_linear_up_to(path.mach2, path.reynolds2, reach * reach)


@jit
def kick_dust(first, last, pos, vel, acc, species, disc, lag, dt, time):
    """Change the velocities `vel` (n, 2) of grains over a kick dt, and write their first stopping times to `time` (n,).

    acc (n, 2): accelerations by all forces except drag. species (n,): populations. lag: time by which velocities are
    behind the positions at the start.
    """
    for i in range(first, last):
        x, y, k = pos[i, 0], pos[i, 1], species[i]
        path = path_at(x, y, k, disc)
        r = path.r
        x /= r
        y /= r
        kepler2 = path.kepler * path.kepler * disc.pull[k]
        a_r = acc[i, 0] * x + acc[i, 1] * y + kepler2 * r  # the path contains star and radiation
        a_phi = acc[i, 1] * x - acc[i, 0] * y
        spin, torque = r * (path.orbit + path.azimuthal), -r * path.azimuthal / path.time
        delta = vel[i, 0] * x + vel[i, 1] * y - path.radial + lag * path.push
        m = r * (vel[i, 1] * x - vel[i, 0] * y) - spin + lag * torque
        if path.mach2 + path.reynolds2 == 0.0 or is_linear(path, delta, m, a_r, a_phi, spin, dt):
            time[i] = path.time
            delta, m = relax(delta, m, path.time, responses(dt / path.time), a_r, a_phi, spin, r, dt)
        else:
            time[i] = path.slow / drag_factor_at(path, delta, m)[1]
            delta, m = relax_by_speed(delta, m, path, a_r, a_phi, spin, dt)
        left = dt - lag
        v, w = path.radial + left * path.push + delta, (spin + left * torque + m) / r
        vel[i, 0] = v * x - w * y
        vel[i, 1] = v * y + w * x


@jit
def path_velocities(first, last, pos, species, disc, out):
    """Write the velocity of the steady drift at each position to `out` (n, 2).

    The two columns are the radial velocity, and the azimuthal velocity minus the Keplerian one.
    """
    for i in range(first, last):
        path = path_at(pos[i, 0], pos[i, 1], species[i], disc)
        out[i, 0], out[i, 1] = path.radial, path.orbit - path.kepler * path.r + path.azimuthal


@jit
def drift_dust(first, last, pos, vel, dt):
    """Move grains over dt by eq. (1): change `pos` (n, 2), and rotate `vel` (n, 2) with the position."""
    for i in range(first, last):
        x, y, vx, vy = pos[i, 0], pos[i, 1], vel[i, 0], vel[i, 1]
        r = math.sqrt(x * x + y * y)
        v, spin = (x * vx + y * vy) / r, x * vy - y * vx
        move_on_arc(i, r, r + dt * v, v, spin, dt, pos, vel)
