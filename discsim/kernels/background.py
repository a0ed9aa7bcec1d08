"""Dust in a gas that turns on given circles: exact relaxation in the frame of the gas's own motion.

A parcel of gas at x turns with Omega_g; moved in steps of length s with constant velocities it stays on its circle
if they are

    V(x, s) = (R(Omega_g s) x - x) / s,                                                                (1)

R a rotation, s < 0 for the step that led to x. The dust's w = u - V obeys dw/dt = a + Omega_g^2 x - w / t, the
source turning with the parcel; over a kick that ends tau after the time of x

    w' = w exp(-dt/t) + R(Omega_g tau) (a + Omega_g^2 x) (1 - exp(-z dt)) / z,   z = 1/t + i Omega_g    (2)

in complex notation. (2) composes exactly. Where t depends on |w| it is that half-way through sub-steps, two halves
against a whole, as short as TOLERANCE asks. So the slip keeps its digits at any dt/t and Omega_g dt: a stiff grain's
drift is a difference of 1e-10 and less of the velocity.
"""

import math

import numpy as np
from numba import njit

from discsim.kernels.laws import hastening, stopping_time
from discsim.kernels.nonlinear import MOST, TOLERANCE, next_step


@njit(cache=True, inline="always", error_model="numpy")
def circle(x, y, omega, step):
    """Eq. (1)."""
    if step == 0.0:
        return -omega * y, omega * x
    low = math.sin(0.5 * omega * step)
    less, turn = -2.0 * low * low / step, math.sin(omega * step) / step
    return less * x - turn * y, less * y + turn * x


@njit(nogil=True, cache=True, error_model="numpy")
def mean_response(z):
    """(1 - exp(-z)) / z of a complex z; its series where that loses digits."""
    if abs(z) < 1e-2:
        return 1.0 - z * (0.5 - z * (1.0 / 6.0 - z * (1.0 / 24.0 - z / 120.0)))
    return (1.0 - np.exp(-z)) / z


@njit(nogil=True, cache=True, error_model="numpy")
def slip_after(w, source, time, omega, dt, late):
    """What eq. (2) makes of the slip w over a part dt of the kick that ends `late` after the time of x."""
    z = complex(dt / time, omega * dt)
    turn = complex(math.cos(omega * late), math.sin(omega * late))
    return w + math.expm1(-dt / time) * w + dt * source * turn * mean_response(z)


@njit(nogil=True, cache=True, error_model="numpy")
def slip_by_speed(w, source, slow, law, grain, density, sound, kepler, omega, dt, lag):
    """The slip after the kick and the mean stopping time in it, which depends on the slip: `kernels/nonlinear.py`."""
    done, step, rate, count = 0.0, dt, 0.0, 0
    stage = np.empty(3, np.complex128)
    time = slow / hastening(law, grain, density, sound, kepler, abs(w))
    while done < dt:
        count += 1
        step = min(step, dt - done)
        for level in range(3):
            part, late, mean = step / 2.0**level, done - lag, 0.0
            at = w
            for _ in range(2**level):
                late += part
                time = slow / hastening(law, grain, density, sound, kepler, abs(at))
                half = slip_after(at, source, time, omega, 0.5 * part, late - 0.5 * part)
                time = slow / hastening(law, grain, density, sound, kepler, abs(half))
                at = slip_after(at, source, time, omega, part, late)
                mean += part / time
            stage[level] = at
        first, second = stage[1] + (stage[1] - stage[0]) / 3.0, stage[2] + (stage[2] - stage[1]) / 3.0
        best = second + (second - first) / 7.0
        scale = max(abs(w), abs(best))
        error = abs(best - second) / scale / TOLERANCE if scale > 0.0 else 0.0
        if error <= 1.0 or count > MOST:
            w = best
            rate += mean
            done = done + step if done + step < dt * (1.0 - 1e-15) else dt
        step *= next_step(error)
    return w, dt / rate if rate > 0.0 else time


@njit(nogil=True, cache=True, error_model="numpy")
def relax_background(
    first, last, pos, vel, acc, species, law, grains, nonlinear, ratios, star, softening, disc, lag, dt, time
):  # fmt: skip
    """Kick dust over dt from `lag` before the time of its places; writes stopping times (n,).

    disc: (Sigma, p, c_s^2, q, f) with Sigma ~ r^-p and c_s^2 ~ r^-q given at radius 1, -(1/Sigma) dP/dr = f c_s^2 / r.
    """
    for i in range(first, last):
        x, y = pos[i, 0], pos[i, 1]
        r2 = x * x + y * y
        density, sound2 = disc[0] * r2 ** (-0.5 * disc[1]), disc[2] * r2 ** (-0.5 * disc[3])
        d2 = r2 + softening * softening
        kepler2 = star / (d2 * math.sqrt(d2))
        omega2 = max(0.0, kepler2 - disc[4] * sound2 / r2)
        omega, k = math.sqrt(omega2), species[i]
        sound, kepler = math.sqrt(sound2), math.sqrt(kepler2)
        time[i] = stopping_time(law, grains[k], ratios[k], density, sound, kepler)
        before_x, before_y = circle(x, y, omega, -2.0 * lag)
        after_x, after_y = circle(x, y, omega, 2.0 * (dt - lag))
        slip = complex(vel[i, 0] - before_x, vel[i, 1] - before_y)
        source = complex(acc[i, 0] + omega2 * x, acc[i, 1] + omega2 * y)
        if nonlinear:
            slip, time[i] = slip_by_speed(
                slip, source, time[i], law, grains[k], density, sound, kepler, omega, dt, lag
            )  # fmt: skip
        else:
            slip = slip_after(slip, source, time[i], omega, dt, dt - lag)
        vel[i, 0] = after_x + slip.real
        vel[i, 1] = after_y + slip.imag
