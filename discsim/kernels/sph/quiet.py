"""Loops of quiet gas: densities that are advanced with the flow, sums over rings, and the mean pressure of rings.

Quiet gas has the pressure forces of a smooth density, without the noise of SPH sums. Equation numbers are those of
`effects/quiet.py`.
"""

import math

import numpy as np

from discsim.jit.decorators import inline_jit, jit

MASS, NUMBER, FIRST, SECOND = range(4)  # rows of ring sums: mass, number, ln(r P / c_s^2) and the square of this ln
MASS_X, MASS_Y, LOG_X, LOG_Y = range(4)  # rows of pattern sums: m e and m l e, e the direction of a particle
# Gas that is compressed at a rate above (ONSET / 2) c_s/h is in a shock; the strength of the shock, from 0 to 1, is 1
# above ((ONSET + 1) / 2) c_s/h. In a shock the followed density relaxes to the SPH density at the rate FAST c_s/h times
# this strength. Behind the shock the strength decays over LASTING h/c_s.
ONSET, FAST, LASTING = 0.3, 10.0, 5.0
# Largest factor between the followed and the SPH density. The ln of their ratio has a scatter of 0.24 in sheared gas.
FARTHEST = 3.0


@jit
def follow_density(
    first, last, time, memory, omega, slopes, density, pressure, sound, inv_size, followed, divergence, shock, updated
):  # fmt: skip
    """Advance the densities `followed` (n,) by eq. (1) to `time`.

    `pressure` (n,) is rescaled in proportion to these densities. memory: tau Omega. omega (n,): orbital frequencies.
    slopes (n, 3): velocity gradients, xx, xy and yy. density (n,): SPH densities. inv_size (n,): 1 / h. A particle with
    followed = 0 starts with its SPH density. Also changed in place, and needed for the next call: `divergence` of the
    velocity, strength of the `shock`, and `updated`, the time of the followed density, (n,) each.

    The velocity gradient of a particle with few neighbours is noise. Noise that lowers a density enlarges the
    acceleration by the pressure, and this acceleration enlarges the divergence. The factor FARTHEST stops this runaway.
    """
    for i in range(first, last):
        div, dt, crossing = slopes[i, 0] + slopes[i, 2], time - updated[i], sound[i] * inv_size[i]
        strength, new = min(max(-2.0 * div / crossing - ONSET, 0.0), 1.0), density[i]
        if followed[i] > 0.0:
            strength = max(shock[i] * math.exp(-dt / LASTING * crossing), strength)
            ln = math.log(followed[i]) - 0.5 * dt * (divergence[i] + div)
            ln -= (math.log(density[i]) - ln) * math.expm1(-dt * (omega[i] / memory + FAST * strength * crossing))
            new = min(max(math.exp(ln), density[i] / FARTHEST), density[i] * FARTHEST)
        pressure[i] *= new / density[i]
        followed[i], divergence[i], shock[i], updated[i] = new, div, strength, time


@inline_jit
def ring_weight(at, ring):
    """Return the TSC weight of a particle at the ring coordinate `at` in a ring at most one from the nearest."""
    d = abs(at - ring)
    return 0.75 - d * d if d <= 0.5 else 0.5 * (1.5 - d) ** 2


@jit
def ring_sums(first, last, count, at, mass, pressure_per_c2, radius, units):
    """Return four sums (4, count) over the particles of each of `count` rings, as integers.

    The rows sum the mass, the number, ln(r P / c_s^2), and the square of this logarithm. Each term is multiplied by the
    entry of `units` (4,) and cut to an integer, so that sums do not depend on the order. A particle is spread over
    three rings (TSC).

    at (n,): ring coordinate of each particle; ring k is at coordinate k. pressure_per_c2 (n,): P / c_s^2.
    """
    rings = np.zeros((4, count), np.int64)
    for i in range(first, last):
        middle, value = math.floor(at[i] + 0.5), math.log(pressure_per_c2[i] * radius[i])
        for k in range(middle - 1, middle + 2):
            weight = ring_weight(at[i], k)
            rings[MASS, k] += np.int64(weight * mass[i] * units[MASS])
            rings[NUMBER, k] += np.int64(weight * units[NUMBER])
            rings[FIRST, k] += np.int64(weight * value * units[FIRST])
            rings[SECOND, k] += np.int64(weight * value * value * units[SECOND])
    return rings


@jit
def pattern_sums(first, last, count, at, mass, direction, deviation, units):
    """Return sums (4, count) of m e and m l e over the particles of each of `count` rings, as integers.

    at, mass, units: as in `ring_sums`. direction (n, 2): unit vectors e from the centre. deviation (n,): l, the
    logarithm of r P / c_s^2 minus its mean in the ring.
    """
    rings = np.zeros((4, count), np.int64)
    for i in range(first, last):
        middle = math.floor(at[i] + 0.5)
        for k in range(middle - 1, middle + 2):
            x = ring_weight(at[i], k) * mass[i] * direction[i, 0]
            y = ring_weight(at[i], k) * mass[i] * direction[i, 1]
            rings[MASS_X, k] += np.int64(x * units[MASS_X])
            rings[MASS_Y, k] += np.int64(y * units[MASS_Y])
            rings[LOG_X, k] += np.int64(x * deviation[i] * units[LOG_X])
            rings[LOG_Y, k] += np.int64(y * deviation[i] * units[LOG_Y])
    return rings


@jit
def replace_ring_pressure(first, last, pos, at, stretch, density, coefficients, pressure, acc):
    """Subtract the mean pressure B of the rings from `pressure` (n,), and add its acceleration to `acc` (n, 2).

    The acceleration is -grad B / density, eqs. (2, 3). at (n,): ring coordinate of each particle. stretch (n,):
    (d at / dr) / r. coefficients (4, intervals): cubics that interpolate B between rings, highest power first.
    """
    last_interval = coefficients.shape[1] - 1
    for i in range(first, last):
        k = min(max(int(at[i]), 0), last_interval)
        d = at[i] - k
        a, b, c, e = coefficients[0, k], coefficients[1, k], coefficients[2, k], coefficients[3, k]
        pressure[i] -= ((a * d + b) * d + c) * d + e
        pull = ((3.0 * a * d + 2.0 * b) * d + c) * stretch[i] / density[i]
        acc[i, 0] -= pull * pos[i, 0]
        acc[i, 1] -= pull * pos[i, 1]
