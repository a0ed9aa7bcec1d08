"""Random walk of grains whose equilibrium is a uniform Sigma_d / Sigma_g.

    S(x) = sum_a m_a W(|x - x_a|, h_a),   c^2(x) = sum_a m_a W c_a^2 / S                                  (1)
    dx   = (grad D + D grad ln S) dt + sqrt(2 D dt) xi,   D = D_g / (1 + St^2)                            (2)

so that d Sigma_d/dt = div [D S grad(Sigma_d / S)] in Ito's sense, with the actual gas S, particle noise included.
Gradients of S and c^2 are those of the sums (1), or of a given disc. The gradient of St = t Omega follows from them by
the law of the drag.

About a star a grain keeps its radial and azimuthal velocity relative to the circular orbit at its position: otherwise
each displacement would put it onto an eccentric orbit. The gas about the middle of the displacement loses the angular
momentum that the grain gains, so that gas and dust diffuse through each other (`effects/dust_diffusion.py`).
"""

import functools
import math
from typing import NamedTuple

import numpy as np
from numba import njit

from discsim.jit.decorators import inline_jit, jit, jit_sums_alloc
from discsim.jit.index import index
from discsim.kernels.common.neighbours import whole
from discsim.kernels.common.philox import counter_of, normal_pair
from discsim.kernels.drag.frame import orbital_frequency
from discsim.kernels.drag.laws import stopping_time
from discsim.kernels.dust.background import gas_at
from discsim.kernels.dust.packs import (
    BROUGHT,
    STEEP,
    W,
    X,
    Y,
    most_members,
    pack_kernels,
    pack_own_weights,
    pack_places,
    pack_weights,
    weighed,
)
from discsim.kernels.sph.packs import CHUNK, STRIDE, clear, relative
from discsim.kernels.sph.smoothing import NORM

# Columns of the gas about grains: S, the length that limits a displacement, c^2; then d columns of grad ln S and d of
# grad ln c^2.
DENSITY, LENGTH, SPEED2, SLOPES = range(4)
# Rows of packs: of gas particles h, mass and c^2; of grains the angular momentum that they gained over S.
LONG, MASS, C2 = range(BROUGHT, BROUGHT + 3)
PER_DENSITY = BROUGHT
OVER = 1e-3  # step in ln r for the slopes of a given disc; larger than the spacing of its table
OF_HEIGHT = 1.0 / 3.0  # LENGTH over H in a given disc: about an h of SPH
NUDGE = 1e-4  # relative step of the arguments of a stopping time, for its slopes


class Turbulence(NamedTuple):
    """Turbulence that stirs the grains, and the law of their drag."""

    table: np.ndarray  # (nodes, 2) of alpha and d alpha / d ln r; if empty, D_g is `constant`
    first: float  # ln r of the first node
    nodes: float  # number of nodes per unit of ln r
    constant: float
    inert: bool  # whether D = D_g / (1 + St^2), else D_g
    star: float
    softening: float
    frequency: float  # Omega where there is no star
    law: int
    grains: np.ndarray  # (populations, 5), as in `formulas/laws.py`


class Circles(NamedTuple):
    """Circular orbits that velocities are relative to; none if star = 0. Velocities are `lag` behind the positions."""

    star: float
    softening: float
    lag: float
    centre: np.ndarray  # (4,): position and velocity of the centre


@njit(inline="always")
def pack_gas(begin, end, slots, order, h, mass, speed2, pack):
    """Pack h, mass and c^2 of gas particles."""
    first = index(begin)
    for k in range(index(end - begin)):
        a = order[slots[first + k]]
        pack[LONG * STRIDE + k], pack[MASS * STRIDE + k], pack[C2 * STRIDE + k] = h[a], mass[a], speed2[a]


@njit(inline="always")
def add_gas(x, y, n, pack, sums):
    """Add the terms of n gas particles in S, S h, S c^2, grad S and grad (S c^2) at (x, y) to `sums` (7,)."""
    s = length = speed = sx = sy = vx = vy = 0.0
    for k in range(n):
        dx, dy = x - pack[X * STRIDE + k], y - pack[Y * STRIDE + k]
        m, c2 = pack[MASS * STRIDE + k], pack[C2 * STRIDE + k]
        w, steep = m * pack[W * STRIDE + k], m * pack[STEEP * STRIDE + k]
        s += w
        length += w * pack[LONG * STRIDE + k]
        speed += w * c2
        sx += steep * dx
        sy += steep * dy
        vx += steep * dx * c2
        vy += steep * dy * c2
    sums[0] += s
    sums[1] += length
    sums[2] += speed
    sums[3] += sx
    sums[4] += sy
    sums[5] += vx
    sums[6] += vy


@njit(inline="always")
def write_gas(dim, j, sums, field):
    """Write the columns of `field` for grain j from the sums of `add_gas`."""
    s, length, speed = sums[0], sums[1], sums[2]
    field[j, DENSITY] = s
    if s > 0.0:
        field[j, LENGTH], field[j, SPEED2] = length / s, speed / s
        for axis in range(dim):
            slope = sums[3 + axis] / s
            field[j, SLOPES + axis] = slope
            field[j, SLOPES + dim + axis] = sums[5 + axis] / speed - slope if speed > 0.0 else 0.0


@functools.cache
def gas_driver(kernel: int, dim: int):
    """Compile the sums (1) at grains: columns `field` (n, 3 + 2 d) of the gas there, with S = 0 outside the gas."""

    @jit_sums_alloc
    def gas_about(first, last, lists, grains, cells, pos, h, mass, speed2, field):
        begin, slots, order = lists.begin, lists.slots, grains.order
        pack = np.zeros((C2 + 1) * STRIDE)
        sums = np.zeros((most_members(first, last, grains.filled, grains.start), 7))
        for c in range(first, last):
            cell = grains.filled[c]
            own, members = grains.start[cell], grains.start[cell + 1] - grains.start[cell]
            ox, oy = grains.bounds[cell, 0], grains.bounds[cell, 1]
            clear(sums, members)
            for listed in range(begin[c - first], begin[c - first + 1], CHUNK):
                end = min(listed + CHUNK, begin[c - first + 1])
                n = pack_places(c - first, listed, end, lists, ox, oy, cells, pack)
                pack_kernels(kernel, dim, listed, end, slots, cells.order, h, pack)
                pack_gas(listed, end, slots, cells.order, h, mass, speed2, pack)
                for p in range(members):
                    x, y = relative(dim, pos, order[own + p], ox, oy, 1.0)
                    pack_weights(kernel, dim, x, y, n, pack)
                    add_gas(x, y, n, pack, sums[p])
            for p in range(members):
                write_gas(dim, order[own + p], sums[p], field)

    return gas_about


@functools.cache
def recoil_driver(kernel: int):
    """Compile the recoil of the gas: it loses the angular momentum `given` (n,) to grains, by the weights of (1).

    `density` (n,) is S at the grains; `centre` as in `Circles`; the velocities `gvel` (n, 2) of the gas change.
    """
    sigma = NORM[1][kernel]

    @jit_sums_alloc
    def recoil(first, last, lists, cells, grains, gpos, h, density, given, centre, gvel):
        begin, slots, order = lists.begin, lists.slots, cells.order
        pack = np.zeros((PER_DENSITY + 1) * STRIDE)
        sums = np.zeros((most_members(first, last, cells.filled, cells.start), 1))
        for c in range(first, last):
            cell = cells.filled[c]
            own, members = cells.start[cell], cells.start[cell + 1] - cells.start[cell]
            ox, oy = cells.bounds[cell, 0], cells.bounds[cell, 1]
            clear(sums, members)
            for listed in range(begin[c - first], begin[c - first + 1], CHUNK):
                end = min(listed + CHUNK, begin[c - first + 1])
                n = pack_places(c - first, listed, end, lists, ox, oy, grains, pack)
                pack_given(listed, end, slots, grains.order, density, given, pack)
                for p in range(members):
                    i = order[own + p]
                    x, y = relative(2, gpos, i, ox, oy, 1.0)
                    pack_own_weights(kernel, x, y, 1.0 / h[i], n, pack)
                    sums[p, 0] += weighed(n, PER_DENSITY, pack)
            for p in range(members):
                # The recoil is tangential, as angular momentum has to balance. The mass of the particle has cancelled.
                i = order[own + p]
                x, y = gpos[i, 0] - centre[0], gpos[i, 1] - centre[1]
                per = sigma * sums[p, 0] / (h[i] * h[i] * max(x * x + y * y, 1e-300))
                gvel[i, 0] += per * y
                gvel[i, 1] -= per * x

    return recoil


@njit(inline="always")
def pack_given(begin, end, slots, order, density, given, pack):
    """Pack the angular momentum given to grains over the gas density there; 0 outside the gas and for padding."""
    first, count = index(begin), index(end - begin)
    for k in range(count):
        j = order[slots[first + k]]
        pack[PER_DENSITY * STRIDE + k] = given[j] / density[j] if density[j] != 0.0 else 0.0
    for k in range(count, index(whole(end - begin))):
        pack[PER_DENSITY * STRIDE + k] = 0.0


@jit
def given_about(first, last, pos, disc, field):
    """Write the columns `field` (n, 7) of the gas at positions (n, 2) in a given disc about the origin."""
    for i in range(first, last):
        r2 = pos[i, 0] * pos[i, 0] + pos[i, 1] * pos[i, 1]
        density, sound2 = gas_at(r2, disc)[:2]
        out, out_sound2 = gas_at(r2 * math.exp(2.0 * OVER), disc)[:2]
        within, within_sound2 = gas_at(r2 * math.exp(-2.0 * OVER), disc)[:2]
        slope, steep = math.log(out / within), math.log(out_sound2 / within_sound2)
        field[i, DENSITY], field[i, SPEED2] = density, sound2
        field[i, LENGTH] = OF_HEIGHT * math.sqrt(sound2) / orbital_frequency(r2, disc.star, disc.softening)
        for k in range(2):
            per = pos[i, k] / (r2 * 2.0 * OVER)
            field[i, SLOPES + k], field[i, SLOPES + 2 + k] = slope * per, steep * per


@inline_jit
def slopes_of_time(law, grain, density, sound, star, own):
    """Return the slopes of ln t over ln of the gas density, sound speed and Omega, at a stopping time t = `own`."""
    up = 1.0 + NUDGE
    per = 1.0 / math.log(up)
    by_density = math.log(stopping_time(law, grain, 1.0, density * up, sound, star) / own)
    by_sound = math.log(stopping_time(law, grain, 1.0, density, sound * up, star) / own)
    by_omega = math.log(stopping_time(law, grain, 1.0, density, sound, star * up) / own) if star > 0.0 else 0.0
    return per * by_density, per * by_sound, per * by_omega


@jit
def strengths(first, last, pos, centre, species, field, times, norm, fresh, stirring, strength, drift):
    """Write D (n,) and grad D + D grad ln S (n, d) of each grain, 0 where there is no gas or no drag.

    If `fresh`, `times` (n,) are the stopping times, and their ratios to the law's values at `field` go to `norm` (n,).
    Otherwise stopping times are the law's values times `norm`. Returns the largest D over the squared LENGTH of
    `field`.
    """
    dim, most, steepest = pos.shape[1], len(stirring.table) - 1, 0.0
    for i in range(first, last):
        strength[i] = 0.0
        for k in range(dim):
            drift[i, k] = 0.0
        density, speed2 = field[i, DENSITY], field[i, SPEED2]
        if density == 0.0:
            continue
        x, y = pos[i, 0] - centre[0], (pos[i, 1] - centre[1] if dim == 2 else 0.0)
        r2 = x * x + y * y
        # `turned` x is d ln Omega / dx and `turned` y is d ln Omega / dy; likewise `rise`, for alpha.
        omega, turned, rise = stirring.frequency, 0.0, 0.0
        if stirring.star > 0.0:
            if r2 + stirring.softening == 0.0:
                continue
            omega = orbital_frequency(r2, stirring.star, stirring.softening)
            turned = -1.5 / (r2 + stirring.softening * stirring.softening)
        strong = stirring.constant
        if most >= 0:
            at = min(max((0.5 * math.log(max(r2, 1e-300)) - stirring.first) * stirring.nodes, 0.0), float(most))
            node = min(int(at), most - 1)
            part = at - node
            alpha = (1.0 - part) * stirring.table[node, 0] + part * stirring.table[node + 1, 0]
            rise = (1.0 - part) * stirring.table[node, 1] + part * stirring.table[node + 1, 1]
            if r2 > 0.0:
                rise *= speed2 / omega / r2  # the slope of D_g itself, as alpha may be 0
            strong = alpha * speed2 / omega
        less, by_density, by_speed, by_omega = 1.0, 0.0, 0.0, 0.0
        if stirring.inert:
            star = omega if stirring.star > 0.0 else 0.0
            grain, sound = stirring.grains[species[i]], math.sqrt(speed2)
            own = stopping_time(stirring.law, grain, 1.0, density, sound, star)
            if fresh:
                norm[i] = times[i] / own
            stokes2 = (norm[i] * own * omega) ** 2
            less = 1.0 / (1.0 + stokes2)
            if less > 0.0:
                steep = -2.0 * stokes2 * less  # d ln D / d ln St
                by_density, by_speed, by_omega = slopes_of_time(stirring.law, grain, density, sound, star, own)
                by_density, by_speed, by_omega = steep * by_density, 0.5 * steep * by_speed, steep * (1.0 + by_omega)
        strong *= less
        # A constant D_g depends on c^2 and Omega only through St.
        if most >= 0:
            by_speed += 1.0
            by_omega -= 1.0
        strength[i] = strong
        steepest = max(steepest, strong / (field[i, LENGTH] * field[i, LENGTH]))
        for k in range(dim):
            way = x if k == 0 else y
            slope = (1.0 + by_density) * field[i, SLOPES + k] + by_speed * field[i, SLOPES + dim + k]
            drift[i, k] = strong * (slope + by_omega * turned * way) + less * (rise * way if r2 > 0.0 else 0.0)
    return steepest


@jit
def walk(first, last, pos, vel, ids, strength, drift, field, key, step, dt, circles, gained):
    """Move grains by eq. (2) over dt; write the angular momenta per mass that they gain to `gained` (n,), unless empty.

    The displacement without noise is limited to half the LENGTH of `field`: it diverges at the very edge of the gas.
    """
    dim = pos.shape[1]
    for i in range(first, last):
        if strength[i] == 0.0:
            if len(gained) > 0:
                gained[i] = 0.0
            continue
        xi, eta = normal_pair(key, counter_of(ids[i], step))
        wide = math.sqrt(2.0 * strength[i] * dt)
        u, v = dt * drift[i, 0], (dt * drift[i, 1] if dim == 2 else 0.0)
        far, most = math.sqrt(u * u + v * v), 0.5 * field[i, LENGTH]
        if far > most:
            u *= most / far
            v *= most / far
        u += wide * xi
        v += wide * eta
        if circles.star > 0.0:
            shift(i, pos, vel, u, v, circles, gained)
        pos[i, 0] += u
        if dim == 2:
            pos[i, 1] += v


@inline_jit
def shift(i, pos, vel, u, v, circles, gained):
    """Change the velocity of grain i for a displacement (u, v): the velocity relative to the circular orbit stays."""
    cx, cy = circles.centre[0], circles.centre[1]
    x, y = pos[i, 0] - cx, pos[i, 1] - cy
    vx, vy = vel[i, 0] - circles.centre[2], vel[i, 1] - circles.centre[3]
    before = x * vy - y * vx
    sense = 1.0 if before >= 0.0 else -1.0
    r = max(math.sqrt(x * x + y * y), 1e-300)
    falls, turns = behind(r, sense, circles)
    radial, azimuthal = (x * vx + y * vy) / r - falls, before / r - turns
    x += u
    y += v
    r = max(math.sqrt(x * x + y * y), 1e-300)
    falls, turns = behind(r, sense, circles)
    radial += falls
    azimuthal += turns
    vx, vy = (x * radial - y * azimuthal) / r, (y * radial + x * azimuthal) / r
    vel[i, 0], vel[i, 1] = vx + circles.centre[2], vy + circles.centre[3]
    if len(gained) > 0:
        gained[i] = r * azimuthal - before


@inline_jit
def behind(r, sense, circles):
    """Return the radial and azimuthal velocity on a circular orbit, at a time `lag` before that of the position: the
    circular velocity turned back by asin(Omega lag).
    """
    omega = orbital_frequency(r * r, circles.star, circles.softening)
    sine = min(1.0, omega * circles.lag)
    return omega * r * sine, sense * omega * r * math.sqrt(1.0 - sine * sine)
