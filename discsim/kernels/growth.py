"""Growth of grains (`formulas/growth.py`) at the places of dust particles, and the dust that changes hands with gas.

    Sigma_g, Sigma_small at j = sum_i (mass of gas, of small dust)_i W_ij                                       (1)
    Sigma_grown at j = sum_i V_i W_ij G_i / sum_i V_i W_ij,   G_i = sum_j m_j W_ij,   V_i = m_i / rho_i         (2)
    m_j -> m_j (1 - f_j) (Sigma_small + Sigma_grown) / Sigma_grown,   f_j = Sigma_small / Sigma_d at its size   (3)

with W_ij = W(|x_i - x_j|, h_i) throughout. What a dust particle gains it takes from gas particles by their shares of
Sigma_small, what it loses it gives by shares of Sigma_g, each of them times 1 + b_j . (x_i - x_j) such that their
centre is at j (4): mass that comes from all about has the mean velocity there (5), and mass, momentum and angular
momentum are exact. b_j is less where a share would be negative, as at an edge, and of a gas particle of which more is
asked than it has everyone gets less: mass and momentum are exact there too.
"""

import math
from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable

from discsim.formulas import growth
from discsim.formulas.laws import COLUMN, SIZE, THERMAL, VALUE
from discsim.jit.decorators import compiled, inner
from discsim.kernels.frame import kepler
from discsim.kernels.laws import stopping_time

register_jitable(error_model="numpy")(growth.layer)  # which another calls
small_share, midplane_density, relative_speed, fragmentation_size = (
    inner(formula)
    for formula in (growth.small_share, growth.midplane_density, growth.relative_speed, growth.fragmentation_size)
)
# Columns of what is about a dust particle: surface densities, c^2, dP/dr over Sigma_g, the velocity (5); then what
# makes shares of W_ij and a mass, as (4) has it: 1 over their sum and b, of small dust and of gas.
GAS, SMALL, GROWN, SPEED2, PULL, VEL, TAKE, GIVE = 0, 1, 2, 3, 4, 5, 7, 10
COLUMNS = 13
EXACT = 1e-10  # relative error of a size in a sub-step
FIRST = 0.3  # of a grain's growth time, the first sub-step that is tried
SUBSTEPS = 100_000  # that are tried: far beyond twelve decades of sizes
# Dormand & Prince's stages, the last at the end of the step, and the error of fourth order.
STAGES = np.zeros((7, 7))
STAGES[1, :1] = 1 / 5
STAGES[2, :2] = 3 / 40, 9 / 40
STAGES[3, :3] = 44 / 45, -56 / 15, 32 / 9
STAGES[4, :4] = 19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729
STAGES[5, :5] = 9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656
STAGES[6, :6] = 35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84
ERROR = np.array([71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40])


class Grains(NamedTuple):
    """What grows: numbers of a scene in code units."""

    small: float  # a_*
    smallest: float  # a_min
    material: float  # rho_s
    fragmentation: float  # v_frag
    typical: float  # the size that `law` is of
    code: int  # form of the drag's law
    law: np.ndarray  # (5,), as in `formulas/laws.py`
    least: float  # mass that a dust particle keeps


class Place(NamedTuple):
    """What is about a grain: numbers, surface densities and eta v_K among them."""

    gas: float
    small: float
    grown: float
    sound: float
    omega: float
    alpha: float
    headwind: float


@inner
def rate(size, start, grains, at):
    """d ln a / dt of a grain of a `size`, where one of size `start` had the small dust of `at` about it."""
    more = size / grains.typical
    grain = (grains.law[VALUE] * more, 0.0, grains.law[SIZE] * more, grains.law[COLUMN], grains.law[THERMAL])
    stokes = at.omega * stopping_time(grains.code, grain, 1.0, at.gas, at.sound, at.omega)
    turned = small_share(size, grains.small, grains.smallest) - small_share(start, grains.small, grains.smallest)
    dust = at.small + at.grown
    small = min(max(at.small + turned * dust, 0.0), dust)
    density = midplane_density(small, dust - small, at.sound / at.omega, stokes, at.alpha)
    speed = relative_speed(stokes, at.alpha, at.sound, at.headwind)
    return density * speed / (grains.material * size)


@inner
def grown_size(start, most, dt, grains, at, k):
    """The size after dt of a grain that begins with `start`, `most` at most: Dormand & Prince's (1980) 5(4) in ln a.

    k (7,): room for the rates of the stages.
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
        # A stage far ahead may overflow: the step is then cut as for an error that is too large.
        step *= min(5.0, max(0.1, 0.9 * (EXACT / max(wrong, 1e-300)) ** 0.2)) if wrong < math.inf else 0.1
    return max(start, math.exp(log))  # which rounding may put below it


@compiled
def grow(first, last, dt, star, softening, pos, centre, field, alpha, grains, mass, size, wanted):
    """Write the `size` (n,) of each grain after dt, and what mass (n,) it is to gain by (3), `wanted` (n,).

    Returns the fastest rate d ln a / dt after both, as grains have it that are not at the size at which they break.
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
        omega, sound = kepler(r2, star, softening), math.sqrt(field[j, SPEED2])
        headwind = 0.5 * abs(field[j, PULL]) / omega
        at = Place(field[j, GAS], field[j, SMALL], field[j, GROWN], sound, omega, alpha[j], headwind)
        most = fragmentation_size(at.gas, grains.fragmentation, at.alpha, sound, grains.material)
        size[j] = grown_size(size[j], max(most, grains.small), dt, grains, at, k)
        dust, left = at.small + at.grown, 1.0 - small_share(size[j], grains.small, grains.smallest)
        if at.grown > 0.0:
            wanted[j] = max(mass[j] * (left * (dust / at.grown)), grains.least) - mass[j]
        after = Place(at.gas, (1.0 - left) * dust, left * dust, sound, omega, alpha[j], headwind)
        found = rate(size[j], size[j], grains, after)
        if found > fastest:  # not where numbers are too extreme for one
            fastest = found
    return fastest
