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

import functools
import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numba.extending import register_jitable

from discsim.formulas import growth
from discsim.formulas.laws import COLUMN, SIZE, THERMAL, VALUE
from discsim.kernels.frame import kepler
from discsim.kernels.inner import gathering, inner
from discsim.kernels.laws import stopping_time
from discsim.kernels.neighbours import most_of, place
from discsim.kernels.smoothing import NORM, SUPPORT, shape

register_jitable(error_model="numpy")(growth.layer)  # which another calls
small_share, midplane_density, relative_speed, fragmentation_size = map(
    inner, (growth.small_share, growth.midplane_density, growth.relative_speed, growth.fragmentation_size)
)
# Columns of what is about a dust particle: surface densities, c^2, dP/dr over Sigma_g, the velocity (5); then what
# makes shares of W_ij and a mass, as (4) has it: 1 over their sum and b, of small dust and of gas.
GAS, SMALL, GROWN, SPEED2, PULL, VEL, TAKE, GIVE = 0, 1, 2, 3, 4, 5, 7, 10
COLUMNS = 13
POSITIVE = 0.999  # of the length of b at which the least share would be nothing
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


class Carriers(NamedTuple):
    """Gas particles: pos, vel (n, 2), smoothing lengths, and masses of gas alone and of small dust (n,)."""

    pos: np.ndarray
    vel: np.ndarray
    h: np.ndarray
    gas: np.ndarray
    small: np.ndarray


class Place(NamedTuple):
    """What is about a grain: numbers, surface densities and eta v_K among them."""

    gas: float
    small: float
    grown: float
    sound: float
    omega: float
    alpha: float
    headwind: float


@functools.cache
def deposit_driver(kernel: int):
    """Compile G_i of (2), `out` (n,) at gas particles."""
    sigma, support = NORM[1][kernel], SUPPORT[kernel]

    @gathering
    def deposit(first, last, lists, cells, grains, gpos, h, mass, out):
        begin, slots = lists.begin, lists.slots
        room = most_of(begin)
        cx, cy = np.zeros(room), np.zeros(room)
        for c in range(first, last):
            cell, listed, end = cells.filled[c], begin[c - first], begin[c - first + 1]
            ox, oy = cells.bounds[cell, 0], cells.bounds[cell, 1]
            place(c - first, listed, end, lists, ox, oy, 1.0, grains, cx, cy)
            for m in range(cells.start[cell], cells.start[cell + 1]):
                i = cells.order[m]
                inverse, total = 1.0 / h[i], 0.0
                reach2 = support * support * h[i] * h[i]
                for k in range(end - listed):
                    dx, dy = cx[k] - (gpos[i, 0] - ox), cy[k] - (gpos[i, 1] - oy)
                    r2 = dx * dx + dy * dy
                    if r2 < reach2:
                        total += mass[grains.order[slots[listed + k]]] * shape(kernel, 2, math.sqrt(r2) * inverse)[0]
                out[i] = total * sigma * inverse * inverse

    return deposit


@inner
def add_moments(moments, kind, weight, dx, dy):
    """Add a weight at (dx, dy) to sums of 1, x, y, xx, xy, yy."""
    moments[kind, 0] += weight
    moments[kind, 1] += weight * dx
    moments[kind, 2] += weight * dy
    moments[kind, 3] += weight * dx * dx
    moments[kind, 4] += weight * dx * dy
    moments[kind, 5] += weight * dy * dy


@inner
def add_flow(flow, weight, vel, i, dx, dy):
    """Add a weight at (dx, dy) times the velocity of a particle to sums of it (2,), and of it times x and y."""
    for axis in range(2):
        part = weight * vel[i, axis]
        flow[axis, 0] += part
        flow[axis, 1] += part * dx
        flow[axis, 2] += part * dy


@inner
def centred(moments, kind, far):
    """1 / sum w (1 + b . d) and b such that sum w (1 + b . d) d = 0, b no longer than all shares are positive with, of
    weights that are no further than `far`; zeros where there are none.
    """
    m, mx, my = moments[kind, 0], moments[kind, 1], moments[kind, 2]
    xx, xy, yy = moments[kind, 3], moments[kind, 4], moments[kind, 5]
    if m == 0.0:
        return 0.0, 0.0, 0.0
    bx = by = 0.0
    det = xx * yy - xy * xy
    if det > 1e-9 * (xx + yy) ** 2:  # else they are on a line
        bx, by = (xy * my - yy * mx) / det, (xy * mx - xx * my) / det
        longest = math.sqrt(bx * bx + by * by) * far
        if longest > POSITIVE:
            bx *= POSITIVE / longest
            by *= POSITIVE / longest
    return 1.0 / (m + bx * mx + by * my), bx, by


@functools.cache
def gather_driver(kernel: int):
    """Compile (1), (2), (4), (5) at dust particles: `field` (n, COLUMNS); dP/dr is that of interpolated pressures."""
    sigma, support = NORM[1][kernel], SUPPORT[kernel]

    @gathering
    def gather(first, last, lists, grains, cells, pos, centre, carriers, volume, pressure, grown, field):
        begin, slots, (_, gvel, h, gas, small) = lists.begin, lists.slots, carriers
        room = most_of(begin)
        cx, cy = np.zeros(room), np.zeros(room)
        moments, flow = np.zeros((2, 6)), np.zeros((2, 3))
        for c in range(first, last):
            cell, listed, end = grains.filled[c], begin[c - first], begin[c - first + 1]
            ox, oy = grains.bounds[cell, 0], grains.bounds[cell, 1]
            place(c - first, listed, end, lists, ox, oy, 1.0, cells, cx, cy)
            for m in range(grains.start[cell], grains.start[cell + 1]):
                j = grains.order[m]
                moments[:], flow[:] = 0.0, 0.0
                far = 0.0
                x, y = pos[j, 0] - centre[0], pos[j, 1] - centre[1]
                whole = deposit = push = slope = tilt = 0.0
                for k in range(end - listed):
                    i = cells.order[slots[listed + k]]
                    dx, dy = pos[j, 0] - ox - cx[k], pos[j, 1] - oy - cy[k]
                    r2 = dx * dx + dy * dy
                    if r2 >= support * support * h[i] * h[i]:
                        continue
                    inverse = 1.0 / h[i]
                    r = math.sqrt(r2)
                    w, steep = shape(kernel, 2, r * inverse)
                    w *= sigma * inverse * inverse
                    steep *= sigma * inverse**3 * volume[i] * (x * dx + y * dy) / max(r, 1e-300)
                    far = max(far, r)
                    add_moments(moments, 0, small[i] * w, -dx, -dy)
                    add_moments(moments, 1, gas[i] * w, -dx, -dy)
                    add_flow(flow, small[i] * w, gvel, i, -dx, -dy)
                    w *= volume[i]
                    whole += w
                    deposit += w * grown[i]
                    push += w * pressure[i]
                    slope += steep * pressure[i]
                    tilt += steep
                for column in range(COLUMNS):
                    field[j, column] = 0.0
                s = moments[1, 0]
                if s > 0.0 and whole > 0.0:
                    field[j, GAS], field[j, SMALL], field[j, GROWN] = s, moments[0, 0], deposit / whole
                    for kind, first_of in ((0, TAKE), (1, GIVE)):
                        per, bx, by = centred(moments, kind, far)
                        field[j, first_of], field[j, first_of + 1], field[j, first_of + 2] = per, bx, by
                    for axis in range(2):
                        bent = field[j, TAKE + 1] * flow[axis, 1] + field[j, TAKE + 2] * flow[axis, 2]
                        field[j, VEL + axis] = field[j, TAKE] * (flow[axis, 0] + bent)  # (5)
                    field[j, SPEED2] = push / s
                    field[j, PULL] = (slope - push / whole * tilt) / s / max(math.sqrt(x * x + y * y), 1e-300)

    return gather


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


@njit(nogil=True, cache=True, error_model="numpy")
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


@inner
def shared(field, j, kind, dx, dy):
    """What makes a share of W_ij and a mass at (dx, dy) from j."""
    return field[j, kind] * (1.0 + field[j, kind + 1] * dx + field[j, kind + 2] * dy)


@functools.cache
def hand_driver(kernel: int):
    """Compile what gas particles give and get: of the small dust of each the `share` (n,) that is taken, that over what
    is asked, `spread` (n,), and the mass that comes and the momentum that comes less what goes, `got` (n, 3).
    """
    sigma, support = NORM[1][kernel], SUPPORT[kernel]

    @gathering
    def hand(first, last, lists, cells, grains, carriers, vel, field, wanted, share, spread, got):
        begin, slots, (gpos, _, h, gas, small) = lists.begin, lists.slots, carriers
        room = most_of(begin)
        cx, cy = np.zeros(room), np.zeros(room)
        for c in range(first, last):
            cell, listed, end = cells.filled[c], begin[c - first], begin[c - first + 1]
            ox, oy = cells.bounds[cell, 0], cells.bounds[cell, 1]
            place(c - first, listed, end, lists, ox, oy, 1.0, grains, cx, cy)
            for m in range(cells.start[cell], cells.start[cell + 1]):
                i = cells.order[m]
                inverse, asked, ax, ay, mass, px, py = 1.0 / h[i], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
                reach2 = support * support * h[i] * h[i]
                for k in range(end - listed):
                    dx, dy = cx[k] - (gpos[i, 0] - ox), cy[k] - (gpos[i, 1] - oy)
                    r2 = dx * dx + dy * dy
                    j = grains.order[slots[listed + k]]
                    if r2 >= reach2 or wanted[j] == 0.0:
                        continue
                    w = shape(kernel, 2, math.sqrt(r2) * inverse)[0] * sigma * inverse * inverse
                    if wanted[j] > 0.0:
                        part = w * shared(field, j, TAKE, -dx, -dy) * wanted[j]
                        asked += part
                        ax += part * field[j, VEL]
                        ay += part * field[j, VEL + 1]
                    else:
                        part = gas[i] * w * shared(field, j, GIVE, -dx, -dy) * -wanted[j]
                        mass += part
                        px += part * vel[j, 0]
                        py += part * vel[j, 1]
                spread[i] = 1.0 / max(1.0, asked)
                share[i] = min(1.0, asked)
                gone = small[i] * spread[i]
                got[i, 0], got[i, 1], got[i, 2] = mass, px - gone * ax, py - gone * ay

    return hand


@functools.cache
def take_driver(kernel: int):
    """Compile what dust particles take and give: their mass (n,), and their velocities (n, 2)."""
    sigma, support = NORM[1][kernel], SUPPORT[kernel]

    @gathering
    def take(first, last, lists, grains, cells, carriers, spread, field, wanted, pos, mass, vel):
        begin, slots, (_, _, h, _, small) = lists.begin, lists.slots, carriers
        room = most_of(begin)
        cx, cy = np.zeros(room), np.zeros(room)
        for c in range(first, last):
            cell, listed, end = grains.filled[c], begin[c - first], begin[c - first + 1]
            ox, oy = grains.bounds[cell, 0], grains.bounds[cell, 1]
            place(c - first, listed, end, lists, ox, oy, 1.0, cells, cx, cy)
            for m in range(grains.start[cell], grains.start[cell + 1]):
                j = grains.order[m]
                if wanted[j] <= 0.0:
                    mass[j] += wanted[j]
                    continue
                gain = 0.0
                for k in range(end - listed):
                    i = cells.order[slots[listed + k]]
                    dx, dy = pos[j, 0] - ox - cx[k], pos[j, 1] - oy - cy[k]
                    r2 = dx * dx + dy * dy
                    if r2 >= support * support * h[i] * h[i]:
                        continue
                    inverse = 1.0 / h[i]
                    w = shape(kernel, 2, math.sqrt(r2) * inverse)[0] * sigma * inverse * inverse
                    gain += small[i] * w * shared(field, j, TAKE, -dx, -dy) * wanted[j] * spread[i]
                mass[j] += gain
                for axis in range(2):
                    vel[j, axis] += gain / mass[j] * (field[j, VEL + axis] - vel[j, axis])

    return take
