"""Exchange of small dust between grains and gas particles as grains grow: (3) and (4) of `kernels/dust/growth.py`."""

import functools

import numpy as np
from numba import njit

from discsim.jit.decorators import jit_sums_alloc
from discsim.jit.index import index
from discsim.kernels.common.neighbours import whole
from discsim.kernels.dust.growth import GIVE, TAKE, VEL
from discsim.kernels.dust.packs import (
    BROUGHT,
    W,
    X,
    Y,
    most_members,
    pack_kernels,
    pack_own_weights,
    pack_places,
    pack_weights,
)
from discsim.kernels.sph.packs import CHUNK, STRIDE, clear, relative
from discsim.kernels.sph.smoothing import NORM

# Rows of packs: of grains the factors of the mass taken and given, b (2) of the shares and the velocity of this mass;
# of gas particles the small dust that they offer.
TAKEN, GIVEN, BEND_X, BEND_Y, VX, VY = range(BROUGHT, BROUGHT + 6)
OFFERED = BROUGHT


@njit(inline="always")
def pack_shares(begin, end, slots, order, field, wanted, vel, pack):
    """Pack the shares (4) of grains that take or give mass: factors of W and the mass of a gas particle, b, and the
    velocity of the exchanged mass. The factors are 0 for padding.
    """
    first, count = index(begin), index(end - begin)
    for k in range(count):
        j = order[slots[first + k]]
        takes = wanted[j] > 0.0
        kind = TAKE if takes else GIVE
        factor = field[j, kind] * wanted[j]
        pack[TAKEN * STRIDE + k], pack[GIVEN * STRIDE + k] = (factor, 0.0) if takes else (0.0, -factor)
        pack[BEND_X * STRIDE + k], pack[BEND_Y * STRIDE + k] = field[j, kind + 1], field[j, kind + 2]
        pack[VX * STRIDE + k] = field[j, VEL] if takes else vel[j, 0]
        pack[VY * STRIDE + k] = field[j, VEL + 1] if takes else vel[j, 1]
    for k in range(count, index(whole(end - begin))):
        pack[TAKEN * STRIDE + k], pack[GIVEN * STRIDE + k] = 0.0, 0.0


@njit(inline="always")
def add_shares(x, y, n, pack, sums):
    """Add to `sums` (6,) the mass and momentum that n grains take from a gas particle at (x, y), per mass of its small
    dust, and the mass and momentum that they give to it, per mass of its gas; all without the norm of W.
    """
    asked = ax = ay = mass = px = py = 0.0
    for k in range(n):
        dx, dy = x - pack[X * STRIDE + k], y - pack[Y * STRIDE + k]
        w = pack[W * STRIDE + k] * (1.0 + pack[BEND_X * STRIDE + k] * dx + pack[BEND_Y * STRIDE + k] * dy)
        taken, given = w * pack[TAKEN * STRIDE + k], w * pack[GIVEN * STRIDE + k]
        vx, vy = pack[VX * STRIDE + k], pack[VY * STRIDE + k]
        asked += taken
        ax += taken * vx
        ay += taken * vy
        mass += given
        px += given * vx
        py += given * vy
    sums[0] += asked
    sums[1] += ax
    sums[2] += ay
    sums[3] += mass
    sums[4] += px
    sums[5] += py


@functools.cache
def exchange_gas_driver(kernel: int):
    """Compile the exchange for gas particles. The kernel writes the fraction of the small dust that is taken,
    `share` (n,); this over the fraction demanded, `spread` (n,); and `got` (n, 3), the mass received and the momentum
    received less that given.
    """
    sigma = NORM[1][kernel]

    @jit_sums_alloc
    def hand(first, last, lists, cells, grains, carriers, vel, field, wanted, share, spread, got):
        begin, slots, order, (gpos, _, h, gas, small) = lists.begin, lists.slots, cells.order, carriers
        pack = np.zeros((VY + 1) * STRIDE)
        sums = np.zeros((most_members(first, last, cells.filled, cells.start), 6))
        for c in range(first, last):
            cell = cells.filled[c]
            own, members = cells.start[cell], cells.start[cell + 1] - cells.start[cell]
            ox, oy = cells.bounds[cell, 0], cells.bounds[cell, 1]
            clear(sums, members)
            for listed in range(begin[c - first], begin[c - first + 1], CHUNK):
                end = min(listed + CHUNK, begin[c - first + 1])
                n = pack_places(c - first, listed, end, lists, ox, oy, grains, pack)
                pack_shares(listed, end, slots, grains.order, field, wanted, vel, pack)
                for p in range(members):
                    i = order[own + p]
                    x, y = relative(2, gpos, i, ox, oy, 1.0)
                    pack_own_weights(kernel, x, y, 1.0 / h[i], n, pack)
                    add_shares(x, y, n, pack, sums[p])
            for p in range(members):
                i = order[own + p]
                norm = sigma / (h[i] * h[i])
                asked, of_gas = norm * sums[p, 0], norm * gas[i]
                spread[i] = 1.0 / max(1.0, asked)
                share[i] = min(1.0, asked)
                gone = norm * small[i] * spread[i]
                got[i, 0] = of_gas * sums[p, 3]
                got[i, 1] = of_gas * sums[p, 4] - gone * sums[p, 1]
                got[i, 2] = of_gas * sums[p, 5] - gone * sums[p, 2]

    return hand


@njit(inline="always")
def pack_offers(begin, end, slots, order, small, spread, pack):
    """Pack the small dust that gas particles offer, its mass times `spread`."""
    first = index(begin)
    for k in range(index(end - begin)):
        i = order[slots[first + k]]
        pack[OFFERED * STRIDE + k] = small[i] * spread[i]


@njit(inline="always")
def offered(x, y, bx, by, n, pack):
    """Return the sum over n packed gas particles of the small dust that they offer to a grain at (x, y), by (4)."""
    total = 0.0
    for k in range(n):
        dx, dy = pack[X * STRIDE + k] - x, pack[Y * STRIDE + k] - y
        total += pack[OFFERED * STRIDE + k] * pack[W * STRIDE + k] * (1.0 + bx * dx + by * dy)
    return total


@functools.cache
def exchange_dust_driver(kernel: int):
    """Compile the exchange for dust particles, which changes their mass (n,) and velocities (n, 2)."""

    @jit_sums_alloc
    def take(first, last, lists, grains, cells, carriers, spread, field, wanted, pos, mass, vel):
        begin, slots, order, (_, _, h, _, small) = lists.begin, lists.slots, grains.order, carriers
        pack = np.zeros((OFFERED + 1) * STRIDE)
        sums = np.zeros((most_members(first, last, grains.filled, grains.start), 1))
        for c in range(first, last):
            cell = grains.filled[c]
            own, members = grains.start[cell], grains.start[cell + 1] - grains.start[cell]
            ox, oy = grains.bounds[cell, 0], grains.bounds[cell, 1]
            clear(sums, members)
            for listed in range(begin[c - first], begin[c - first + 1], CHUNK):
                end = min(listed + CHUNK, begin[c - first + 1])
                n = pack_places(c - first, listed, end, lists, ox, oy, cells, pack)
                pack_kernels(kernel, 2, listed, end, slots, cells.order, h, pack)
                pack_offers(listed, end, slots, cells.order, small, spread, pack)
                for p in range(members):
                    j = order[own + p]
                    if wanted[j] > 0.0:
                        x, y = relative(2, pos, j, ox, oy, 1.0)
                        pack_weights(kernel, 2, x, y, n, pack)
                        sums[p, 0] += offered(x, y, field[j, TAKE + 1], field[j, TAKE + 2], n, pack)
            for p in range(members):
                j = order[own + p]
                if wanted[j] <= 0.0:
                    mass[j] += wanted[j]
                    continue
                gain = field[j, TAKE] * wanted[j] * sums[p, 0]
                mass[j] += gain
                for axis in range(2):
                    vel[j, axis] += gain / mass[j] * (field[j, VEL + axis] - vel[j, axis])

    return take
