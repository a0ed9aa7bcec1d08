"""Exchange of mass between dust and gas particles as grains grow: eqs. (3) to (5) of `kernels/dust/growth.py`."""

import functools

import numpy as np
from numba import njit

from discsim.jit.decorators import jit_sums_alloc
from discsim.jit.index import index
from discsim.kernels.common.candidates import padded_count
from discsim.kernels.dust.growth import GIVE, TAKE, VEL
from discsim.kernels.dust.packs import (
    FIRST_FREE,
    W,
    X,
    Y,
    add_values,
    max_members,
    members_and_centre,
    pack_kernels,
    pack_own_weights,
    pack_padded_positions,
    pack_weights,
)
from discsim.kernels.sph.packs import CHUNK, STRIDE, clear, relative
from discsim.kernels.sph.smoothing import NORM

# Rows of packs. For grains: factors of the mass that they take and give, b (2) of eq. (4), and the velocity (2) of this
# mass. For gas particles: the small dust that grains may take.
TAKEN, GIVEN, BEND_X, BEND_Y, VX, VY = range(FIRST_FREE, FIRST_FREE + 6)
OFFERED = FIRST_FREE


@njit(inline="always")
def pack_shares(begin, end, indices, order, field, wanted, vel, pack):
    """Write to `pack` how the grains `begin` to `end` exchange mass with a gas particle, by eq. (4).

    Row TAKEN: mass taken from a gas particle, divided by W and the mass of its small dust. Row GIVEN: mass given to
    a gas particle, divided by W and its mass of gas. Both rows are 0 for padding. Other rows: b, and the velocity of
    the exchanged mass. field: surroundings of the grains. wanted, vel: mass that each grain gains, and velocities.
    """
    first, count = index(begin), index(end - begin)
    for k in range(count):
        j = order[indices[first + k]]
        takes = wanted[j] > 0.0
        kind = TAKE if takes else GIVE
        factor = field[j, kind] * wanted[j]
        pack[TAKEN * STRIDE + k], pack[GIVEN * STRIDE + k] = (factor, 0.0) if takes else (0.0, -factor)
        pack[BEND_X * STRIDE + k], pack[BEND_Y * STRIDE + k] = field[j, kind + 1], field[j, kind + 2]
        pack[VX * STRIDE + k] = field[j, VEL] if takes else vel[j, 0]
        pack[VY * STRIDE + k] = field[j, VEL + 1] if takes else vel[j, 1]
    for k in range(count, index(padded_count(end - begin))):
        pack[TAKEN * STRIDE + k], pack[GIVEN * STRIDE + k] = 0.0, 0.0


@njit(inline="always")
def add_shares(x, y, n, pack, sums):
    """Add to `sums` (6,) the mass and momentum that a gas particle at (x, y) exchanges with n packed grains.

    The first three sums are mass and momentum (2) taken from the gas particle, per mass of its small dust. The last
    three are mass and momentum given to the gas particle, per mass of its gas. The norm of W is not included.
    """
    demanded = ax = ay = mass = px = py = 0.0
    for k in range(n):
        dx, dy = x - pack[X * STRIDE + k], y - pack[Y * STRIDE + k]
        w = pack[W * STRIDE + k] * (1.0 + pack[BEND_X * STRIDE + k] * dx + pack[BEND_Y * STRIDE + k] * dy)
        taken, given = w * pack[TAKEN * STRIDE + k], w * pack[GIVEN * STRIDE + k]
        vx, vy = pack[VX * STRIDE + k], pack[VY * STRIDE + k]
        demanded += taken
        ax += taken * vx
        ay += taken * vy
        mass += given
        px += given * vx
        py += given * vy
    add_values((demanded, ax, ay, mass, px, py), 0, sums)


@functools.cache
def exchange_gas_driver(kernel: int):
    """Return the kernel that computes the mass and momentum that gas particles give and receive.

    The kernel does not change the particles. Written for each gas particle: `share` (n,), the fraction of its small
    dust that is taken; `spread` (n,), this fraction divided by the fraction that grains demand; and `received` (n, 3),
    the mass that it receives, and the momentum that it receives minus the momentum that is taken.
    """
    sigma = NORM[1][kernel]

    @jit_sums_alloc
    def exchange_to_gas(first, last, lists, cells, grains, carriers, vel, field, wanted, share, spread, received):
        begin, indices, order, (gpos, _, h, gas, small) = lists.begin, lists.indices, cells.order, carriers
        pack = np.zeros((VY + 1) * STRIDE)
        sums = np.zeros((max_members(first, last, cells), 6))
        for c in range(first, last):
            own, members, ox, oy = members_and_centre(c, cells)
            clear(sums, members)
            for listed in range(begin[c - first], begin[c - first + 1], CHUNK):
                end = min(listed + CHUNK, begin[c - first + 1])
                n = pack_padded_positions(c - first, listed, end, lists, ox, oy, grains, pack)
                pack_shares(listed, end, indices, grains.order, field, wanted, vel, pack)
                for p in range(members):
                    i = order[own + p]
                    x, y = relative(2, gpos, i, ox, oy, 1.0)
                    pack_own_weights(kernel, x, y, 1.0 / h[i], n, pack)
                    add_shares(x, y, n, pack, sums[p])
            for p in range(members):
                i = order[own + p]
                norm = sigma / (h[i] * h[i])
                demanded, of_gas = norm * sums[p, 0], norm * gas[i]
                spread[i] = 1.0 / max(1.0, demanded)
                share[i] = min(1.0, demanded)
                gone = norm * small[i] * spread[i]
                received[i, 0] = of_gas * sums[p, 3]
                received[i, 1] = of_gas * sums[p, 4] - gone * sums[p, 1]
                received[i, 2] = of_gas * sums[p, 5] - gone * sums[p, 2]

    return exchange_to_gas


@njit(inline="always")
def pack_offers(begin, end, indices, order, small, spread, pack):
    """Write to `pack` the mass of small dust of the gas particles `begin` to `end`, times `spread` (n,)."""
    first = index(begin)
    for k in range(index(end - begin)):
        i = order[indices[first + k]]
        pack[OFFERED * STRIDE + k] = small[i] * spread[i]


@njit(inline="always")
def sum_offers(x, y, bx, by, n, pack):
    """Return the sum of W (1 + b . d) over n packed gas particles, weighted by the row OFFERED, as in eq. (4).

    x, y: position of the grain; d: offset of a gas particle from it.
    """
    total = 0.0
    for k in range(n):
        dx, dy = pack[X * STRIDE + k] - x, pack[Y * STRIDE + k] - y
        total += pack[OFFERED * STRIDE + k] * pack[W * STRIDE + k] * (1.0 + bx * dx + by * dy)
    return total


@functools.cache
def exchange_dust_driver(kernel: int):
    """Return the kernel that adds the exchanged mass to dust particles.

    The kernel changes `mass` (n,) by `wanted` (n,), or by less where the gas has less small dust, and `vel` (n, 2)
    by the momentum of the mass taken. spread: result of the kernel of `exchange_gas_driver`.
    """

    @jit_sums_alloc
    def exchange_to_dust(first, last, lists, grains, cells, carriers, spread, field, wanted, pos, mass, vel):
        begin, indices, order, (_, _, h, _, small) = lists.begin, lists.indices, grains.order, carriers
        pack = np.zeros((OFFERED + 1) * STRIDE)
        sums = np.zeros((max_members(first, last, grains), 1))
        for c in range(first, last):
            own, members, ox, oy = members_and_centre(c, grains)
            clear(sums, members)
            for listed in range(begin[c - first], begin[c - first + 1], CHUNK):
                end = min(listed + CHUNK, begin[c - first + 1])
                n = pack_padded_positions(c - first, listed, end, lists, ox, oy, cells, pack)
                pack_kernels(kernel, 2, listed, end, indices, cells.order, h, pack)
                pack_offers(listed, end, indices, cells.order, small, spread, pack)
                for p in range(members):
                    j = order[own + p]
                    if wanted[j] > 0.0:
                        x, y = relative(2, pos, j, ox, oy, 1.0)
                        pack_weights(kernel, 2, x, y, n, pack)
                        sums[p, 0] += sum_offers(x, y, field[j, TAKE + 1], field[j, TAKE + 2], n, pack)
            for p in range(members):
                j = order[own + p]
                if wanted[j] <= 0.0:
                    mass[j] += wanted[j]
                    continue
                gain = field[j, TAKE] * wanted[j] * sums[p, 0]
                mass[j] += gain
                for axis in range(2):
                    vel[j, axis] += gain / mass[j] * (field[j, VEL + axis] - vel[j, axis])

    return exchange_to_dust
