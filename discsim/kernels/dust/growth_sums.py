"""Sums of growth over the gas about dust particles: (1), (2), (4) and (5) of `kernels/dust/growth.py`."""

import functools
import math
from typing import NamedTuple

import numpy as np
from numba import njit

from discsim.jit.decorators import inline_jit, jit_sums_alloc
from discsim.jit.index import index
from discsim.kernels.dust.growth import COLUMNS, GAS, GIVE, GROWN, PULL, SMALL, SPEED2, TAKE, VEL
from discsim.kernels.dust.packs import (
    BROUGHT,
    STEEP,
    W,
    X,
    Y,
    farthest,
    most_members,
    pack_column,
    pack_kernels,
    pack_own_weights,
    pack_places,
    pack_weights,
    weighed,
)
from discsim.kernels.sph.packs import CHUNK, STRIDE, clear, relative
from discsim.kernels.sph.smoothing import NORM

POSITIVE = 0.999  # of the length of b at which the smallest share would be 0
# Rows of packs: of grains their mass; of gas particles the quantities that are summed about a grain.
HELD = BROUGHT
OF_GAS, OF_SMALL, VX, VY, VOLUME, PRESSURE, OF_GROWN = range(BROUGHT, BROUGHT + 7)
# Sums about a grain: moments (1, x, y, xx, xy, yy) of small dust and of gas, moments (1, x, y) of the momentum of small
# dust along each axis, sums over volumes (5), and the largest distance at which W > 0.
MOMENTS_OF_SMALL, MOMENTS_OF_GAS, FLOW, MEANS, FAR = 0, 6, 12, 18, 23


class Carriers(NamedTuple):
    """Gas particles: pos, vel (n, 2), smoothing lengths, and masses of the gas alone and of its small dust (n,)."""

    pos: np.ndarray
    vel: np.ndarray
    h: np.ndarray
    gas: np.ndarray
    small: np.ndarray


@functools.cache
def deposit_driver(kernel: int):
    """Compile the sum G_i of (2) at gas particles, written to `out` (n,)."""
    sigma = NORM[1][kernel]

    @jit_sums_alloc
    def deposit(first, last, lists, cells, grains, gpos, h, mass, out):
        begin, slots, order = lists.begin, lists.slots, cells.order
        pack = np.zeros((HELD + 1) * STRIDE)
        sums = np.zeros((most_members(first, last, cells.filled, cells.start), 1))
        for c in range(first, last):
            cell = cells.filled[c]
            own, members = cells.start[cell], cells.start[cell + 1] - cells.start[cell]
            ox, oy = cells.bounds[cell, 0], cells.bounds[cell, 1]
            clear(sums, members)
            for listed in range(begin[c - first], begin[c - first + 1], CHUNK):
                end = min(listed + CHUNK, begin[c - first + 1])
                n = pack_places(c - first, listed, end, lists, ox, oy, grains, pack)
                pack_column(listed, end, slots, grains.order, mass, HELD, pack)
                for p in range(members):
                    i = order[own + p]
                    x, y = relative(2, gpos, i, ox, oy, 1.0)
                    pack_own_weights(kernel, x, y, 1.0 / h[i], n, pack)
                    sums[p, 0] += weighed(n, HELD, pack)
            for p in range(members):
                i = order[own + p]
                out[i] = sigma * sums[p, 0] / (h[i] * h[i])

    return deposit


@inline_jit
def centred(sums, kind, far):
    """Return 1 / sum w (1 + b . d), and b such that sum w (1 + b . d) d = 0; zeros without any weight w.

    b is shortened if a share at a distance d up to `far` would be negative.
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
def pack_carriers(begin, end, slots, order, gas, small, vel, volume, pressure, grown, pack):
    """Pack the quantities of gas particles that `gather` sums; padding keeps old values, as its norm of W is 0."""
    first, count = index(begin), index(end - begin)
    for k in range(count):
        i = order[slots[first + k]]
        pack[OF_GAS * STRIDE + k], pack[OF_SMALL * STRIDE + k] = gas[i], small[i]
        pack[VX * STRIDE + k], pack[VY * STRIDE + k] = vel[i, 0], vel[i, 1]
        pack[VOLUME * STRIDE + k], pack[PRESSURE * STRIDE + k] = volume[i], pressure[i]
        pack[OF_GROWN * STRIDE + k] = grown[i]


@njit(inline="always")
def add_moments(row, first_of, x, y, n, pack, sums):
    """Add the moments 1, x, y, xx, xy, yy of n candidates about (x, y), weighted by W times a row of the pack."""
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
    sums[first_of] += one
    sums[first_of + 1] += sx
    sums[first_of + 2] += sy
    sums[first_of + 3] += xx
    sums[first_of + 4] += xy
    sums[first_of + 5] += yy


@njit(inline="always")
def add_flow(x, y, n, pack, sums):
    """Add the moments 1, x, y about (x, y) of the momentum of small dust, along each axis."""
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
    sums[FLOW] += u
    sums[FLOW + 1] += ux
    sums[FLOW + 2] += uy
    sums[FLOW + 3] += v
    sums[FLOW + 4] += vx
    sums[FLOW + 5] += vy


@njit(inline="always")
def add_means(x, y, along_x, along_y, n, pack, sums):
    """Add sums weighted by volume and W: of 1, grown dust and pressure, and the slopes of pressure and of 1 along
    (along_x, along_y).
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
    sums[MEANS] += whole
    sums[MEANS + 1] += deposit
    sums[MEANS + 2] += push
    sums[MEANS + 3] += slope
    sums[MEANS + 4] += tilt


@inline_jit
def write_about(j, r, sums, field):
    """Write the columns of `field` for dust particle j, at the distance r from the centre, from its sums."""
    for column in range(COLUMNS):
        field[j, column] = 0.0
    s, whole, push, far = sums[MOMENTS_OF_GAS], sums[MEANS], sums[MEANS + 2], sums[FAR]
    if not (s > 0.0 and whole > 0.0):
        return
    field[j, GAS], field[j, SMALL], field[j, GROWN] = s, sums[MOMENTS_OF_SMALL], sums[MEANS + 1] / whole
    for moments, first_of in ((MOMENTS_OF_SMALL, TAKE), (MOMENTS_OF_GAS, GIVE)):
        per, bx, by = centred(sums, moments, far)
        field[j, first_of], field[j, first_of + 1], field[j, first_of + 2] = per, bx, by
    for axis in range(2):
        flow = FLOW + 3 * axis
        bent = field[j, TAKE + 1] * sums[flow + 1] + field[j, TAKE + 2] * sums[flow + 2]
        field[j, VEL + axis] = field[j, TAKE] * (sums[flow] + bent)  # (5)
    field[j, SPEED2] = push / s
    field[j, PULL] = (sums[MEANS + 3] - push / whole * sums[MEANS + 4]) / s / max(r, 1e-300)


@functools.cache
def gather_driver(kernel: int):
    """Compile the sums (1), (2), (4), (5) at dust particles, written to `field` (n, COLUMNS); dP/dr is the slope of the
    interpolated pressure.
    """

    @jit_sums_alloc
    def gather(first, last, lists, grains, cells, pos, centre, carriers, volume, pressure, grown, field):
        begin, slots, order, (_, gvel, h, gas, small) = lists.begin, lists.slots, grains.order, carriers
        pack = np.zeros((OF_GROWN + 1) * STRIDE)
        sums = np.zeros((most_members(first, last, grains.filled, grains.start), FAR + 1))
        for c in range(first, last):
            cell = grains.filled[c]
            own, members = grains.start[cell], grains.start[cell + 1] - grains.start[cell]
            ox, oy = grains.bounds[cell, 0], grains.bounds[cell, 1]
            clear(sums, members)
            for listed in range(begin[c - first], begin[c - first + 1], CHUNK):
                end = min(listed + CHUNK, begin[c - first + 1])
                n = pack_places(c - first, listed, end, lists, ox, oy, cells, pack)
                pack_kernels(kernel, 2, listed, end, slots, cells.order, h, pack)
                pack_carriers(listed, end, slots, cells.order, gas, small, gvel, volume, pressure, grown, pack)
                for p in range(members):
                    j = order[own + p]
                    x, y = relative(2, pos, j, ox, oy, 1.0)
                    pack_weights(kernel, 2, x, y, n, pack)
                    add_moments(OF_SMALL, MOMENTS_OF_SMALL, x, y, n, pack, sums[p])
                    add_moments(OF_GAS, MOMENTS_OF_GAS, x, y, n, pack, sums[p])
                    add_flow(x, y, n, pack, sums[p])
                    add_means(x, y, pos[j, 0] - centre[0], pos[j, 1] - centre[1], n, pack, sums[p])
                    sums[p, FAR] = max(sums[p, FAR], farthest(n, pack))
            for p in range(members):
                j = order[own + p]
                x, y = pos[j, 0] - centre[0], pos[j, 1] - centre[1]
                write_about(j, math.sqrt(x * x + y * y), sums[p], field)

    return gather
