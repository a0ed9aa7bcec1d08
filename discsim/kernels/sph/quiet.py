"""Loops of quiet gas: densities that follow the flow, sums over rings, and the push of a ring's mean pressure.

Equations are those of `effects/quiet.py`.
"""

import math

import numpy as np

from discsim.jit.decorators import jit

MASS, NUMBER, FIRST, SECOND = range(4)  # rows of ring sums: mass, number, ln(r P / c_s^2) and its square
# Gas compressed faster than ONSET / 2 c_s/h is in a shock, fully from (ONSET + 1) / 2 c_s/h on. Its density
# relaxes to the summed one at the rate FAST c_s/h, and behind the shock this rate decays over LASTING h/c_s.
ONSET, FAST, LASTING = 0.3, 10.0, 5.0
FARTHEST = 3.0  # largest factor between followed and summed density; its ln has a scatter of 0.24 in sheared gas


@jit
def follow(
    first, last, time, memory, omega, slopes, density, pressure, sound, inv_size, followed, divergence, shock, at
):  # fmt: skip
    """Advance the densities `followed` (n,) by eq. (1), and scale `pressure` (n,) to them.

    The densities are of the times `at` (n,) before, and of `time` afterwards. A density of 0 starts as the summed
    one. The velocity gradient of a particle with few neighbours is noise. A density lowered by this noise gives a
    stronger push, and the push a larger divergence. The factor FARTHEST stops this runaway.

    memory: tau Omega. omega, inv_size (n,): orbital frequencies and 1 / h. slopes (n, 3): of the velocity.
    """
    for i in range(first, last):
        div, dt, crossing = slopes[i, 0] + slopes[i, 2], time - at[i], sound[i] * inv_size[i]
        seen, new = min(max(-2.0 * div / crossing - ONSET, 0.0), 1.0), density[i]
        if followed[i] > 0.0:
            seen = max(shock[i] * math.exp(-dt / LASTING * crossing), seen)
            ln = math.log(followed[i]) - 0.5 * dt * (divergence[i] + div)
            ln -= (math.log(density[i]) - ln) * math.expm1(-dt * (omega[i] / memory + FAST * seen * crossing))
            new = min(max(math.exp(ln), density[i] / FARTHEST), density[i] * FARTHEST)
        pressure[i] *= new / density[i]
        followed[i], divergence[i], shock[i], at[i] = new, div, seen, time


@jit
def ring_sums(first, last, count, at, mass, pressing, radius, units):
    """Return sums (4, count) over particles at the positions `at` (n,) of `count` rings, as integers in `units` (4,).

    The rows are masses, numbers, ln(r P / c_s^2) and its square. Each particle is spread over three rings (TSC).
    pressing (n,): P / c_s^2.
    """
    rings = np.zeros((4, count), np.int64)
    for i in range(first, last):
        middle = math.floor(at[i] + 0.5)
        d, value = at[i] - middle, math.log(pressing[i] * radius[i])
        for k in range(-1, 2):
            weight = 0.75 - d * d if k == 0 else 0.5 * (0.5 + k * d) ** 2
            rings[MASS, middle + k] += np.int64(weight * mass[i] * units[MASS])
            rings[NUMBER, middle + k] += np.int64(weight * units[NUMBER])
            rings[FIRST, middle + k] += np.int64(weight * value * units[FIRST])
            rings[SECOND, middle + k] += np.int64(weight * value * value * units[SECOND])
    return rings


@jit
def push(first, last, pos, at, stretch, density, coefficients, pressure, acc):
    """Subtract the ring's pressure B from `pressure` (n,) and add its push to `acc` (n, 2), eqs. (2, 3).

    coefficients (4, count): of the cubics between rings, highest power first. stretch (n,): d(at)/dr over r.
    """
    most = coefficients.shape[1] - 1
    for i in range(first, last):
        k = min(max(int(at[i]), 0), most)
        d = at[i] - k
        a, b, c, e = coefficients[0, k], coefficients[1, k], coefficients[2, k], coefficients[3, k]
        pressure[i] -= ((a * d + b) * d + c) * d + e
        pull = ((3.0 * a * d + 2.0 * b) * d + c) * stretch[i] / density[i]
        acc[i, 0] -= pull * pos[i, 0]
        acc[i, 1] -= pull * pos[i, 1]
