"""Growth of grains (`formulas/growth.py`) at dust particles, and the exchange of small dust with gas particles.

    Sigma_g, Sigma_small at j = sum_i (mass of gas, of small dust)_i W_ij                                       (1)
    Sigma_grown at j = sum_i V_i W_ij G_i / sum_i V_i W_ij,   G_i = sum_j m_j W_ij,   V_i = m_i / rho_i         (2)
    m_j -> m_j (1 - f_j) (Sigma_small + Sigma_grown) / Sigma_grown,   f_j = Sigma_small / Sigma_d at its size   (3)

with W_ij = W(|x_i - x_j|, h_i) throughout, gas particles i and dust particles j. A dust particle that gains mass takes
it from gas particles by their shares of Sigma_small. One that loses mass gives it by shares of Sigma_g. Shares are
multiplied by 1 + b_j . (x_i - x_j), with b_j such that their centre is at j (4). The mass from all gas particles has
the mean velocity of the small dust at j (5), and mass, momentum and angular momentum are exact.

b_j is shorter where a share would be negative, as at an edge. If a gas particle has less small dust than all its
neighbours demand, each gets proportionally less. Mass and momentum are exact in both cases.
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
# Columns of the surroundings of a dust particle: surface densities, c^2, dP/dr over Sigma_g, the velocity (5); then
# the factors of the shares (4), 1 over their sum and b (2), of small dust (TAKE) and of gas (GIVE).
GAS, SMALL, GROWN, SPEED2, PULL, VEL, TAKE, GIVE = 0, 1, 2, 3, 4, 5, 7, 10
COLUMNS = 13
EXACT = 1e-10  # relative error of the size in a sub-step
FIRST = 0.3  # first sub-step in growth times of the grain
SUBSTEPS = 100_000  # largest number of sub-steps tried: far more than twelve decades of sizes take
# Stages of Dormand & Prince, the last at the end of the step, and weights of the error of fourth order.
STAGES = np.zeros((7, 7))
STAGES[1, :1] = 1 / 5
STAGES[2, :2] = 3 / 40, 9 / 40
STAGES[3, :3] = 44 / 45, -56 / 15, 32 / 9
STAGES[4, :4] = 19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729
STAGES[5, :5] = 9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656
STAGES[6, :6] = 35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84
ERROR = np.array([71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40])


class Grains(NamedTuple):
    """Model of the grains of a scene, in code units."""

    small: float  # a_*
    smallest: float  # a_min
    material: float  # rho_s
    fragmentation: float  # v_frag
    typical: float  # size for which `law` holds
    code: int  # form of the drag law
    law: np.ndarray  # (5,), as in `formulas/laws.py`
    least: float  # least mass of a dust particle


class Place(NamedTuple):
    """Surroundings of a grain."""

    gas: float  # surface densities of gas, small and grown dust
    small: float
    grown: float
    sound: float
    omega: float
    alpha: float
    headwind: float  # eta v_K


@inline_jit
def rate(size, start, grains, at):
    """Return d ln a / dt of a grain of a `size`. The small dust of `at` is that for the size `start`; growth from
    `start` to `size` turns part of it into grown dust.
    """
    more = size / grains.typical
    grain = (grains.law[VALUE] * more, 0.0, grains.law[SIZE] * more, grains.law[COLUMN], grains.law[THERMAL])
    stokes = at.omega * stopping_time(grains.code, grain, 1.0, at.gas, at.sound, at.omega)
    turned = small_share(size, grains.small, grains.smallest) - small_share(start, grains.small, grains.smallest)
    dust = at.small + at.grown
    small = min(max(at.small + turned * dust, 0.0), dust)
    density = midplane_density(small, dust - small, at.sound / at.omega, stokes, at.alpha)
    speed = relative_speed(stokes, at.alpha, at.sound, at.headwind)
    return density * speed / (grains.material * size)


@inline_jit
def grown_size(start, most, dt, grains, at, k):
    """Return the size after dt of a grain of size `start`, at most `most`, by Dormand & Prince's (1980) 5(4) in ln a.

    k (7,): scratch for the rates of the stages.
    """
    if start >= most:
        return most
    log, end, passed, step = math.log(start), math.log(most), 0.0, dt
    for attempt in range(SUBSTEPS):
        step = min(step, dt - passed)
        there, wrong = log, 0.0
        for stage in range(0 if attempt == 0 else 1, 7):
            there = log
            for before in range(stage):
                there += step * STAGES[stage, before] * k[before]
            k[stage] = rate(math.exp(there), start, grains, at)
            if attempt == 0 and stage == 0:
                if not k[0] > 0.0:
                    return start
                step = min(step, FIRST / k[0])
        for stage in range(7):
            wrong += step * ERROR[stage] * k[stage]
        wrong = abs(wrong)
        if wrong <= EXACT:
            log, passed = there, passed + step
            k[0] = k[6]
            if log >= end:
                return most
            if passed >= dt:
                break
        # A stage far ahead may overflow: the step is then reduced as for too large an error.
        step *= min(5.0, max(0.1, 0.9 * (EXACT / max(wrong, 1e-300)) ** 0.2)) if wrong < math.inf else 0.1
    return max(start, math.exp(log))  # rounding may put exp(log) below `start`


@jit
def grow(first, last, dt, star, softening, pos, centre, field, alpha, grains, mass, size, wanted):
    """Write the `size` (n,) of each grain after dt, and the mass `wanted` (n,) that it gains or loses by (3).

    Returns the fastest rate d ln a / dt after both, without the limit by fragmentation.
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
        at = Place(field[j, GAS], field[j, SMALL], field[j, GROWN], sound, omega, alpha[j], headwind)
        most = fragmentation_size(at.gas, grains.fragmentation, at.alpha, sound, grains.material)
        size[j] = grown_size(size[j], max(most, grains.small), dt, grains, at, k)
        dust, left = at.small + at.grown, 1.0 - small_share(size[j], grains.small, grains.smallest)
        if at.grown > 0.0:
            wanted[j] = max(mass[j] * (left * (dust / at.grown)), grains.least) - mass[j]
        after = Place(at.gas, (1.0 - left) * dust, left * dust, sound, omega, alpha[j], headwind)
        found = rate(size[j], size[j], grains, after)
        if found > fastest:  # False for NaN, from too extreme numbers
            fastest = found
    return fastest
