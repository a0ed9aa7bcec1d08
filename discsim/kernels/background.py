"""Dust in a gas that turns on given circles: exact circles and drifts at any step.

About a star of Keplerian frequency Omega_K(r), in gas of angular momentum L_g(r) = r^2 Omega_g, a grain with radial
velocity v and angular momentum L (per mass) obeys

    dr/dt = v,                    dphi/dt = L / r^2                                                       (1)
    dv/dt = L^2 / r^3 - Omega_K^2 r + a_r - v / t,     dL/dt = r a_phi - (L - L_g) / t                    (2)

with stopping time t and the acceleration a of all else. The drift of a step solves (1) with v and L constant, exactly
for an r linear in time; the kick solves (2) at fixed r. So circular orbits keep radius and frequency at any step, and
without drag L is exact: a leapfrog in x and y has velocities off by (Omega dt)^2 / 8, as large as the headwind.

Grains settle into the drift where (2) balances (Nakagawa, Sekiya & Hayashi 1986), with F = (Omega_K^2 - Omega_g^2) r,
B = (1/r) dL_g/dr and kappa^2 = (Omega_K + Omega_g) B, such that grains that feel no drag are on circular orbits:

    v* = -F / (1/t + kappa^2 t),        L* = L_g + r w*,    w* = F B / (1/t^2 + kappa^2)                  (3)

The kick relaxes what differs from it. Half a step before or after the time of its place a grain on that path has

    v* + s q,   L* - s r w*/t,          q = L*^2 / r^3 - Omega_K^2 r - v*/t,   s = -dt/2 or dt/2          (4)

so delta = v - v* - s q and m = L - L* + s r w*/t do, exactly and for any dt/t,

    d delta/dt = -delta/t + a_r + (2 L* m + m^2) / r^3,     dm/dt = -m/t + r a_phi                        (5)

As (4) has the whole force on the path, (5) is (2) to second order in the step wherever the grain is, and the drift (3)
itself has no error of the step. Kicks compose exactly. Where t depends on the slip, (5) is solved in sub-steps, two
halves against a whole, as short as TOLERANCE asks.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from discsim.kernels.laws import hastening, stopping_time
from discsim.kernels.nonlinear import MOST, TOLERANCE, next_step

SERIES = 1e-2  # dt/t, below which differences of exponentials are taken from their series
STRAIGHT = 0.5  # of its radius that is left of a grain's after a drift; those that fall faster move on a straight line


class Path(NamedTuple):
    """A place in the disc and the steady drift through it, eqs. (3) and (4)."""

    r: float
    density: float
    sound: float
    kepler: float  # Omega_K
    orbit: float  # L_g / r
    slow: float  # stopping time at vanishing slip
    time: float  # and on the path
    radial: float  # v*
    azimuthal: float  # w*
    push: float  # q


@njit(cache=True, error_model="numpy")
def drift_speeds(time, excess, shear, kappa2):
    """(v*, w*) of eq. (3)."""
    rate = 1.0 / time
    return -excess / (rate + kappa2 * time), excess * shear / (rate * rate + kappa2)


@njit(cache=True, error_model="numpy")
def time_on_path(law, grain, density, sound, kepler, slow, excess, shear, kappa2):
    """The stopping time at the speed of the drift that it gives itself: secants in the logarithm."""
    log = last = math.log(slow)
    gap = 0.0
    for count in range(30):
        radial, azimuthal = drift_speeds(math.exp(log), excess, shear, kappa2)
        fast = hastening(law, grain, density, sound, kepler, math.sqrt(radial * radial + azimuthal * azimuthal))
        before, gap = gap, math.log(slow / fast) - log
        if abs(gap) < 1e-8:
            break
        # The time may fall as fast as the speed rises: half the gap is a step that always comes nearer.
        slope = (gap - before) / (log - last) if count > 0 and log != last else -2.0
        last, log = log, log - gap / min(slope, -0.5)
    return math.exp(log)


@njit(cache=True, error_model="numpy")
def path_at(x, y, law, grain, nonlinear, ratio, star, softening, disc):
    """The Path through a place; `disc` as in `kick_dust`."""
    r2 = x * x + y * y
    r = math.sqrt(r2)
    density, sound2 = disc[0] * r2 ** (-0.5 * disc[1]), disc[2] * r2 ** (-0.5 * disc[3])
    d2 = r2 + softening * softening
    kepler2 = star / (d2 * math.sqrt(d2))
    pressure = disc[4] * sound2 / r2
    omega2 = max(0.0, kepler2 - pressure)
    omega, sound, kepler = math.sqrt(omega2), math.sqrt(sound2), math.sqrt(kepler2)
    # 2 Omega_g B = 4 Omega_g^2 + r d(Omega_g^2)/dr, of the star's part and of the pressure's, a power of the radius.
    turns = max(0.0, 4.0 * omega2 - 3.0 * r2 / d2 * kepler2 + (2.0 + disc[3]) * pressure)
    shear = 0.5 * turns / omega if omega > 0.0 else 0.0
    kappa2 = (omega + kepler) * shear
    excess = (kepler2 - omega2) * r
    slow = time = stopping_time(law, grain, ratio, density, sound, kepler)
    if nonlinear:
        time = time_on_path(law, grain, density, sound, kepler, slow, excess, shear, kappa2)
    radial, azimuthal = drift_speeds(time, excess, shear, kappa2)
    push = (2.0 * omega + azimuthal / r) * azimuthal - excess - radial / time
    return Path(r, density, sound, kepler, omega * r, slow, time, radial, azimuthal, push)


@njit(cache=True, error_model="numpy")
def responses(x):
    """exp(-x), and the means over s in [0, x] of exp(-s), and of exp(s - x) times (1 - exp(-s))/x,
    2 exp(-s) (1 - exp(-s))/x and (1 - exp(-s))^2 / x^2.
    """
    if x < SERIES:
        first = 1.0 - x * (0.5 - x * (1.0 / 6.0 - x * (1.0 / 24.0 - x * (1.0 / 120.0 - x / 720.0))))
        e = 1.0 - x * first
        second = 0.5 - x * (1.0 / 3.0 - x * (0.125 - x * (1.0 / 30.0 - x / 144.0)))
        return e, first, second, e * (1.0 - x * (1.0 / 3.0 - x * (1.0 / 12.0 - x / 60.0))), (1.0 - x) / 3.0
    one = -math.expm1(-x)
    e, x2 = 1.0 - one, x * x
    return e, one / x, (one - x * e) / x2, 2.0 * e * (x - one) / x2, (one - 2.0 * x * e + e * one) / (x2 * x)


@njit(cache=True, error_model="numpy")
def relax(delta, m, time, a_r, a_phi, spin, r, dt):
    """(delta, m) of eq. (5) after dt; L* is `spin`."""
    e, first, second, mixed, square = responses(dt / time)
    given = r * a_phi * dt
    turned = 2.0 * spin * (m * e + given * second) + m * m * e * first + given * (m * mixed + given * square)
    damped = first * dt / time  # 1 - e
    return delta - delta * damped + dt * (a_r * first + turned / (r * r * r)), m - m * damped + given * first


@njit(cache=True, error_model="numpy")
def slip_of(path, delta, m):
    v, w = path.radial + delta, path.azimuthal + m / path.r
    return math.sqrt(v * v + w * w)


@njit(cache=True, error_model="numpy")
def time_at(path, law, grain, delta, m):
    """The stopping time at a slip."""
    return path.slow / hastening(law, grain, path.density, path.sound, path.kepler, slip_of(path, delta, m))


@njit(cache=True, error_model="numpy")
def relax_by_speed(delta, m, path, law, grain, a_r, a_phi, spin, dt):
    """The same where the stopping time depends on the slip, and the mean of that: as in `kernels/nonlinear.py`."""
    done, step, rate, count = 0.0, dt, 0.0, 0
    stage = np.empty((3, 2))
    time = time_at(path, law, grain, delta, m)
    while done < dt:
        count += 1
        step = min(step, dt - done)
        for level in range(3):
            part, mean = step / 2.0**level, 0.0
            d, n = delta, m
            for _ in range(2**level):
                half, half_m = d, n
                for share in (0.5, 1.0):  # to half-way by the time at the start, then all the way by that half-way
                    time = time_at(path, law, grain, half, half_m)
                    # What the path's own slip loses more than at the path's own time.
                    more = 1.0 / path.time - 1.0 / time
                    half, half_m = relax(
                        d, n, time, a_r + path.radial * more, a_phi + path.azimuthal * more, spin, path.r, share * part
                    )  # fmt: skip
                d, n = half, half_m
                mean += part / time
            stage[level, 0], stage[level, 1] = d, n
        error = 0.0
        best = stage[2]
        for k in range(2):
            first = stage[1, k] + (stage[1, k] - stage[0, k]) / 3.0
            second = stage[2, k] + (stage[2, k] - stage[1, k]) / 3.0
            best[k] = second + (second - first) / 7.0
            error = max(error, abs(best[k] - second) / (path.r if k == 1 else 1.0))
        scale = max(slip_of(path, delta, m), slip_of(path, best[0], best[1]))
        error = error / scale / TOLERANCE if scale > 0.0 else 0.0
        if error <= 1.0 or count > MOST:
            delta, m = best[0], best[1]
            rate += mean
            done = done + step if done + step < dt * (1.0 - 1e-15) else dt
        step *= next_step(error)
    return delta, m, dt / rate if rate > 0.0 else time


@njit(nogil=True, cache=True, error_model="numpy")
def kick_dust(
    first, last, pos, vel, acc, species, law, grains, nonlinear, ratios, star, softening, disc, lag, dt, time
):  # fmt: skip
    """Kick dust over dt from `lag` before the time of its places; writes stopping times (n,).

    disc: (Sigma, p, c_s^2, q, f) with Sigma ~ r^-p and c_s^2 ~ r^-q given at radius 1, -(1/Sigma) dP/dr = f c_s^2 / r.
    """
    for i in range(first, last):
        x, y, k = pos[i, 0], pos[i, 1], species[i]
        path = path_at(x, y, law, grains[k], nonlinear, ratios[k], star, softening, disc)
        r = path.r
        x /= r
        y /= r
        kepler2 = path.kepler * path.kepler
        a_r = acc[i, 0] * x + acc[i, 1] * y + kepler2 * r  # without the star's, which the path has
        a_phi = acc[i, 1] * x - acc[i, 0] * y
        spin, torque = r * (path.orbit + path.azimuthal), -r * path.azimuthal / path.time
        delta = vel[i, 0] * x + vel[i, 1] * y - path.radial + lag * path.push
        m = r * (vel[i, 1] * x - vel[i, 0] * y) - spin + lag * torque
        time[i] = path.time
        if nonlinear:
            delta, m, time[i] = relax_by_speed(delta, m, path, law, grains[k], a_r, a_phi, spin, dt)
        else:
            delta, m = relax(delta, m, path.time, a_r, a_phi, spin, r, dt)
        left = dt - lag
        v, w = path.radial + left * path.push + delta, (spin + left * torque + m) / r
        vel[i, 0] = v * x - w * y
        vel[i, 1] = v * y + w * x


@njit(nogil=True, cache=True, error_model="numpy")
def path_velocities(first, last, pos, species, law, grains, nonlinear, ratios, star, softening, disc, out):
    """Radial and azimuthal velocity (n, 2) of the steady drift at each place, the latter beyond Kepler's."""
    for i in range(first, last):
        k = species[i]
        path = path_at(pos[i, 0], pos[i, 1], law, grains[k], nonlinear, ratios[k], star, softening, disc)
        out[i, 0], out[i, 1] = path.radial, path.orbit - path.kepler * path.r + path.azimuthal


@njit(nogil=True, cache=True, error_model="numpy")
def drift_dust(first, last, pos, vel, dt):
    """Eq. (1): move dust over dt with its radial velocity and angular momentum, and turn the velocity with it."""
    for i in range(first, last):
        x, y, vx, vy = pos[i, 0], pos[i, 1], vel[i, 0], vel[i, 1]
        r = math.sqrt(x * x + y * y)
        v, spin = (x * vx + y * vy) / r, x * vy - y * vx
        after = r + dt * v
        if after > STRAIGHT * r:
            angle = spin * dt / (r * after)
            c, s = math.cos(angle) / r, math.sin(angle) / r
            x, y = x * c - y * s, x * s + y * c
            pos[i, 0], pos[i, 1] = after * x, after * y
            w = spin / after
            vel[i, 0], vel[i, 1] = v * x - w * y, v * y + w * x
        else:
            pos[i, 0] += dt * vx
            pos[i, 1] += dt * vy
