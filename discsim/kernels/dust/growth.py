"""Growth of the grains of dust particles (`formulas/growth.py`). Small dust moves with the gas particles.

    Sigma_g, Sigma_small at j = sum_i (mass of gas, of small dust)_i W_ij                                       (1)
    Sigma_grown at j = sum_i V_i W_ij G_i / sum_i V_i W_ij,   G_i = sum_j m_j W_ij,   V_i = m_i / rho_i         (2)
    m_j -> m_j (1 - f_j) (Sigma_small + Sigma_grown) / Sigma_grown,   f_j = Sigma_small / Sigma_d at its size   (3)

with W_ij = W(|x_i - x_j|, h_i), gas particles i and dust particles j. A dust particle that gains mass by (3) takes it
from gas particles, in proportion to their contributions to Sigma_small. A dust particle that loses mass gives it to gas
particles, in proportion to their contributions to Sigma_g. The contributions are multiplied by 1 + b_j . (x_i - x_j),
with b_j such that their centre is at x_j (4). The mass that a dust particle takes has the mean velocity of the small
dust at j (5). Mass, momentum and angular momentum are conserved exactly.

b_j is shortened where a contribution would be negative, as at an edge. If a gas particle has less small dust than all
dust particles together demand, each gets proportionally less. Mass and momentum are conserved exactly in both cases.
"""

import math
from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable

from discsim.formulas import growth
from discsim.formulas.laws import COLUMN, SIZE, THERMAL, VALUE
from discsim.jit.decorators import inline_jit, jit
from discsim.kernels.drag.frame import orbital_frequency
from discsim.kernels.drag.laws import stopping_time

register_jitable(error_model="numpy")(growth.layer_thickness)  # midplane_density calls it
small_share, midplane_density, relative_speed, fragmentation_size = (
    inline_jit(formula)
    for formula in (growth.small_share, growth.midplane_density, growth.relative_speed, growth.fragmentation_size)
)
# Columns of `field`, the surroundings of a dust particle: surface densities of gas, small and grown dust; c^2; (dP/dr)
# / Sigma_g; the velocity (5). From TAKE and GIVE on: 1 over the sum of all contributions (4), and b (2), for small dust
# that is taken, and for gas to which mass is given.
GAS, SMALL, GROWN, SPEED2, PULL, VEL, TAKE, GIVE = 0, 1, 2, 3, 4, 5, 7, 10
COLUMNS = 13
TOLERANCE = 1e-10  # relative error of the size in a sub-step
FIRST_STEP = 0.3  # first sub-step, in growth times of the grain
SUBSTEPS = 100_000  # largest number of sub-steps that are tried; growth by twelve decades needs far fewer
# Coefficients of the stages of Dormand & Prince, the last one at the end of the step, and weights of the error
# estimate.
STAGES = np.zeros((7, 7))
STAGES[1, :1] = 1 / 5
STAGES[2, :2] = 3 / 40, 9 / 40
STAGES[3, :3] = 44 / 45, -56 / 15, 32 / 9
STAGES[4, :4] = 19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729
STAGES[5, :5] = 9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656
STAGES[6, :6] = 35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84
ERROR = np.array([71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40])


class Grains(NamedTuple):
    """Constants of the growth model of a scene, in code units."""

    small: float  # a_*, the size above which dust is grown
    smallest: float  # a_min
    material: float  # rho_s
    fragmentation: float  # v_frag
    typical: float  # grain size for which `law` holds
    code: int  # form of the drag law
    law: np.ndarray  # (5,): constants of the drag law, as in `formulas/laws.py`
    least: float  # smallest mass of a dust particle


class GrainSurroundings(NamedTuple):
    """Gas and dust at the position of a grain."""

    gas: float  # surface density of the gas
    small: float  # of the small dust
    grown: float  # of the grown dust
    sound: float  # isothermal sound speed
    omega: float  # Keplerian frequency
    alpha: float
    headwind: float  # eta v_K


@inline_jit
def growth_rate(size, start, grains, at):
    """Return d ln a / dt of a grain whose size is `size`.

    at: the surroundings of the grain when its size was `start`. Growth from `start` to `size` has turned part of the
    small dust into grown dust.
    """
    scale = size / grains.typical
    grain = (grains.law[VALUE] * scale, 0.0, grains.law[SIZE] * scale, grains.law[COLUMN], grains.law[THERMAL])
    stokes = at.omega * stopping_time(grains.code, grain, 1.0, at.gas, at.sound, at.omega)
    turned = small_share(size, grains.small, grains.smallest) - small_share(start, grains.small, grains.smallest)
    dust = at.small + at.grown
    small = min(max(at.small + turned * dust, 0.0), dust)
    density = midplane_density(small, dust - small, at.sound / at.omega, stokes, at.alpha)
    speed = relative_speed(stokes, at.alpha, at.sound, at.headwind)
    return density * speed / (grains.material * size)


@inline_jit
def grown_size(start, most, dt, grains, at, k):
    """Return the size after dt of a grain whose size is `start`; the result is at most `most`.

    at: surroundings. k (7,): scratch, overwritten by the rates of the stages. ln a is integrated by the method 5(4) of
    Dormand & Prince (1980).
    """
    if start >= most:
        return most
    log, end, elapsed, step = math.log(start), math.log(most), 0.0, dt
    for attempt in range(SUBSTEPS):
        step = min(step, dt - elapsed)
        new_log, error = log, 0.0
        for stage in range(0 if attempt == 0 else 1, 7):
            new_log = log
            for before in range(stage):
                new_log += step * STAGES[stage, before] * k[before]
            k[stage] = growth_rate(math.exp(new_log), start, grains, at)
            if attempt == 0 and stage == 0:
                if not k[0] > 0.0:
                    return start
                step = min(step, FIRST_STEP / k[0])
        for stage in range(7):
            error += step * ERROR[stage] * k[stage]
        error = abs(error)
        if error <= TOLERANCE:
            log, elapsed = new_log, elapsed + step
            k[0] = k[6]
            if log >= end:
                return most
            if elapsed >= dt:
                break
        # If a stage overflows, the error is not finite, and the step is reduced.
        step *= min(5.0, max(0.1, 0.9 * (TOLERANCE / max(error, 1e-300)) ** 0.2)) if error < math.inf else 0.1
    return max(start, math.exp(log))  # rounding may put exp(log) below `start`


@jit
def grow(first, last, dt, star, softening, pos, centre, field, alpha, grains, mass, size, wanted):
    """Advance the `size` (n,) of grains over dt, and write the mass that each gains or loses by (3) to `wanted` (n,).

    field: surroundings of the grains. alpha, mass (n,): turbulence at the grains, and masses of the dust particles.
    centre: position of the star. Returns the largest rate d ln a / dt after the changes of size and mass, without
    the limit by fragmentation.
    """
    k, fastest = np.zeros(7), 0.0
    for j in range(first, last):
        wanted[j] = 0.0
        if field[j, GAS] == 0.0:
            continue
        x, y = pos[j, 0] - centre[0], pos[j, 1] - centre[1]
        r2 = x * x + y * y
        if r2 + softening == 0.0 or not field[j, SPEED2] > 0.0:
            continue
        omega, sound = orbital_frequency(r2, star, softening), math.sqrt(field[j, SPEED2])
        headwind = 0.5 * abs(field[j, PULL]) / omega
        at = GrainSurroundings(field[j, GAS], field[j, SMALL], field[j, GROWN], sound, omega, alpha[j], headwind)
        most = fragmentation_size(at.gas, grains.fragmentation, at.alpha, sound, grains.material)
        size[j] = grown_size(size[j], max(most, grains.small), dt, grains, at, k)
        dust, left = at.small + at.grown, 1.0 - small_share(size[j], grains.small, grains.smallest)
        if at.grown > 0.0:
            wanted[j] = max(mass[j] * (left * (dust / at.grown)), grains.least) - mass[j]
        after = GrainSurroundings(at.gas, (1.0 - left) * dust, left * dust, sound, omega, alpha[j], headwind)
        rate = growth_rate(size[j], size[j], grains, after)
        if rate > fastest:  # False for NaN, which very large or small numbers may cause
            fastest = rate
    return fastest
