"""Sums of grain growth over the gas near dust particles: (1), (2), (4) and (5) of `kernels/dust/growth.py`."""

import functools
import math
from typing import NamedTuple

import numpy as np
from numba import njit

from discsim.jit.decorators import inline_jit, jit_sums_alloc
from discsim.jit.index import index
from discsim.kernels.dust.growth import COLUMNS, GAS, GIVE, GROWN, PULL, SMALL, SPEED2, TAKE, VEL
from discsim.kernels.dust.packs import (
    FIRST_FREE,
    STEEP,
    W,
    X,
    Y,
    add_values,
    largest_distance,
    max_members,
    members_and_centre,
    pack_column,
    pack_kernels,
    pack_own_weights,
    pack_padded_positions,
    pack_weights,
    weighted_sum,
)
from discsim.kernels.sph.packs import CHUNK, STRIDE, clear, relative
from discsim.kernels.sph.smoothing import NORM

POSITIVE = 0.999  # largest length of b, over the length at which the smallest contribution would be 0
# Rows of packs. For grains: their mass. For gas particles: the quantities that are summed around a grain.
HELD = FIRST_FREE
OF_GAS, OF_SMALL, VX, VY, VOLUME, PRESSURE, OF_GROWN = range(FIRST_FREE, FIRST_FREE + 7)
# Sums around a grain: moments (1, x, y, xx, xy, yy) of small dust and of gas; moments (1, x, y) of the momentum of
# small dust along each axis; five means over the volume; and the largest distance at which W > 0.
MOMENTS_OF_SMALL, MOMENTS_OF_GAS, FLOW, MEANS, FAR = 0, 6, 12, 18, 23


class CarrierGas(NamedTuple):
    """Gas particles, which carry the small dust."""

    pos: np.ndarray  # (n, 2)
    vel: np.ndarray  # (n, 2)
    h: np.ndarray  # (n,)
    gas: np.ndarray  # (n,): mass of the gas without its small dust
    small: np.ndarray  # (n,): mass of the small dust


@functools.cache
def deposit_driver(kernel: int):
    """Return the kernel that writes the sum G_i of (2) at gas particles to `out` (n,).

    lists: candidate lists of grains, for the filled cells `first` to `last` of the gas, `cells`. gpos, h: positions and
    h of the gas particles. mass: masses of the dust particles.
    """
    sigma = NORM[1][kernel]

    @jit_sums_alloc
    def deposit(first, last, lists, cells, grains, gpos, h, mass, out):
        begin, indices, order = lists.begin, lists.indices, cells.order
        pack = np.zeros((HELD + 1) * STRIDE)
        sums = np.zeros((max_members(first, last, cells), 1))
        for c in range(first, last):
            own, members, ox, oy = members_and_centre(c, cells)
            clear(sums, members)
            for listed in range(begin[c - first], begin[c - first + 1], CHUNK):
                end = min(listed + CHUNK, begin[c - first + 1])
                n = pack_padded_positions(c - first, listed, end, lists, ox, oy, grains, pack)
                pack_column(listed, end, indices, grains.order, mass, HELD, pack)
                for p in range(members):
                    i = order[own + p]
                    x, y = relative(2, gpos, i, ox, oy, 1.0)
                    pack_own_weights(kernel, x, y, 1.0 / h[i], n, pack)
                    sums[p, 0] += weighted_sum(n, HELD, pack)
            for p in range(members):
                i = order[own + p]
                out[i] = sigma * sums[p, 0] / (h[i] * h[i])

    return deposit


@inline_jit
def centring_factors(sums, kind, far):
    """Return 1 / sum w (1 + b . d), and b such that sum w (1 + b . d) d = 0; zeros if the sum of weights w is 0.

    sums[kind:kind + 6]: moments of w. b is shortened if 1 + b . d would be negative at a distance |d| <= far.
    """
    m, mx, my = sums[kind], sums[kind + 1], sums[kind + 2]
    xx, xy, yy = sums[kind + 3], sums[kind + 4], sums[kind + 5]
    if m == 0.0:
        return 0.0, 0.0, 0.0
    bx = by = 0.0
    det = xx * yy - xy * xy
    if det > 1e-9 * (xx + yy) ** 2:  # else particles are on a line
        bx, by = (xy * my - yy * mx) / det, (xy * mx - xx * my) / det
        longest = math.sqrt(bx * bx + by * by) * far
        if longest > POSITIVE:
            bx *= POSITIVE / longest
            by *= POSITIVE / longest
    return 1.0 / (m + bx * mx + by * my), bx, by


@njit(inline="always")
def pack_carriers(begin, end, indices, order, gas, small, vel, volume, pressure, grown, pack):
    """Write to `pack` the quantities of gas particles that `gather` sums. Padding keeps old values, as its W is 0."""
    first, count = index(begin), index(end - begin)
    for k in range(count):
        i = order[indices[first + k]]
        pack[OF_GAS * STRIDE + k], pack[OF_SMALL * STRIDE + k] = gas[i], small[i]
        pack[VX * STRIDE + k], pack[VY * STRIDE + k] = vel[i, 0], vel[i, 1]
        pack[VOLUME * STRIDE + k], pack[PRESSURE * STRIDE + k] = volume[i], pressure[i]
        pack[OF_GROWN * STRIDE + k] = grown[i]


@njit(inline="always")
def add_moments(row, first_of, x, y, n, pack, sums):
    """Add to `sums`, from entry `first_of` on, six moments of n packed candidates about (x, y).

    The moments are 1, x, y, xx, xy and yy, weighted by W times a row of `pack`.
    """
    one = sx = sy = xx = xy = yy = 0.0
    for k in range(n):
        dx, dy = pack[X * STRIDE + k] - x, pack[Y * STRIDE + k] - y
        w = pack[row * STRIDE + k] * pack[W * STRIDE + k]
        wx, wy = w * dx, w * dy
        one += w
        sx += wx
        sy += wy
        xx += wx * dx
        xy += wx * dy
        yy += wy * dy
    add_values((one, sx, sy, xx, xy, yy), first_of, sums)


@njit(inline="always")
def add_flow(x, y, n, pack, sums):
    """Add to `sums`, from entry FLOW on, sums of the momentum of small dust times 1, x and y about (x, y), on each
    axis.
    """
    u = ux = uy = v = vx = vy = 0.0
    for k in range(n):
        dx, dy = pack[X * STRIDE + k] - x, pack[Y * STRIDE + k] - y
        w = pack[OF_SMALL * STRIDE + k] * pack[W * STRIDE + k]
        of_u, of_v = w * pack[VX * STRIDE + k], w * pack[VY * STRIDE + k]
        u += of_u
        ux += of_u * dx
        uy += of_u * dy
        v += of_v
        vx += of_v * dx
        vy += of_v * dy
    add_values((u, ux, uy, v, vx, vy), FLOW, sums)


@njit(inline="always")
def add_means(x, y, along_x, along_y, n, pack, sums):
    """Add to `sums`, from entry MEANS on, five sums over n packed gas particles, weighted by volume and W.

    The sums are those of 1, grown dust and pressure, and the derivatives along (along_x, along_y) of the sums of
    pressure and of 1.
    """
    whole = deposit = push = slope = tilt = 0.0
    for k in range(n):
        dx, dy = x - pack[X * STRIDE + k], y - pack[Y * STRIDE + k]
        volume, pressure = pack[VOLUME * STRIDE + k], pack[PRESSURE * STRIDE + k]
        w, steep = volume * pack[W * STRIDE + k], volume * pack[STEEP * STRIDE + k] * (along_x * dx + along_y * dy)
        whole += w
        deposit += w * pack[OF_GROWN * STRIDE + k]
        push += w * pressure
        slope += steep * pressure
        tilt += steep
    add_values((whole, deposit, push, slope, tilt), MEANS, sums)


@inline_jit
def write_surroundings(j, r, sums, field):
    """Write row j of `field`, the surroundings of a dust particle at distance r from the centre, from its `sums`."""
    for column in range(COLUMNS):
        field[j, column] = 0.0
    s, whole, push, far = sums[MOMENTS_OF_GAS], sums[MEANS], sums[MEANS + 2], sums[FAR]
    if not (s > 0.0 and whole > 0.0):
        return
    field[j, GAS], field[j, SMALL], field[j, GROWN] = s, sums[MOMENTS_OF_SMALL], sums[MEANS + 1] / whole
    for moments, first_of in ((MOMENTS_OF_SMALL, TAKE), (MOMENTS_OF_GAS, GIVE)):
        per, bx, by = centring_factors(sums, moments, far)
        field[j, first_of], field[j, first_of + 1], field[j, first_of + 2] = per, bx, by
    for axis in range(2):
        flow = FLOW + 3 * axis
        bent = field[j, TAKE + 1] * sums[flow + 1] + field[j, TAKE + 2] * sums[flow + 2]
        field[j, VEL + axis] = field[j, TAKE] * (sums[flow] + bent)  # (5)
    field[j, SPEED2] = push / s
    field[j, PULL] = (sums[MEANS + 3] - push / whole * sums[MEANS + 4]) / s / max(r, 1e-300)


@functools.cache
def gather_driver(kernel: int):
    """Return the kernel that writes the surroundings of dust particles, (1), (2), (4) and (5), to `field` (n, COLUMNS).

    dP/dr is the derivative of the interpolated pressure. lists: candidate lists of gas particles, for the filled cells
    `first` to `last` of `grains`. pos: dust particles. carriers: `CarrierGas`. volume, pressure, grown: V_i, pressures
    and G_i of the gas particles.
    """

    @jit_sums_alloc
    def gather(first, last, lists, grains, cells, pos, centre, carriers, volume, pressure, grown, field):
        begin, indices, order, (_, gvel, h, gas, small) = lists.begin, lists.indices, grains.order, carriers
        pack = np.zeros((OF_GROWN + 1) * STRIDE)
        sums = np.zeros((max_members(first, last, grains), FAR + 1))
        for c in range(first, last):
            own, members, ox, oy = members_and_centre(c, grains)
            clear(sums, members)
            for listed in range(begin[c - first], begin[c - first + 1], CHUNK):
                end = min(listed + CHUNK, begin[c - first + 1])
                n = pack_padded_positions(c - first, listed, end, lists, ox, oy, cells, pack)
                pack_kernels(kernel, 2, listed, end, indices, cells.order, h, pack)
                pack_carriers(listed, end, indices, cells.order, gas, small, gvel, volume, pressure, grown, pack)
                for p in range(members):
                    j = order[own + p]
                    x, y = relative(2, pos, j, ox, oy, 1.0)
                    pack_weights(kernel, 2, x, y, n, pack)
                    add_moments(OF_SMALL, MOMENTS_OF_SMALL, x, y, n, pack, sums[p])
                    add_moments(OF_GAS, MOMENTS_OF_GAS, x, y, n, pack, sums[p])
                    add_flow(x, y, n, pack, sums[p])
                    add_means(x, y, pos[j, 0] - centre[0], pos[j, 1] - centre[1], n, pack, sums[p])
                    sums[p, FAR] = max(sums[p, FAR], largest_distance(n, pack))
            for p in range(members):
                j = order[own + p]
                x, y = pos[j, 0] - centre[0], pos[j, 1] - centre[1]
                write_surroundings(j, math.sqrt(x * x + y * y), sums[p], field)

    return gather
