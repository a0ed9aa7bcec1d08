"""Implicit drag in cells: exact relaxation of the gas and dust in a block, accelerations included.

In a block the species s have masses M_s, centroids X_s, mean velocities V_s and sources A_s and, in the linear scheme,
slopes G_s, H_s of velocity and source about their own centroids. Sources are accelerations of one species alone. With
e_j = M_j / M_g

    dV_g/dt = A_g + sum_j e_j (V_j - V_g) / t_j,    dV_j/dt = A_j + (V_g - V_j) / t_j                 (1)

is solved exactly over dt for velocities at one common point, V_s - G (X_s - X), with G the slope pooled within species.
Differences of slopes relax in the same way, weighted by the moments of inertia I_s, so that sum_s I_s G_s stays. The
residual velocity r_i of a particle about the line of its own species, with residual source b_i, is damped:

    r_i' = r_i exp(-dt/t) + b_i t (1 - exp(-dt/t)),   1/t = 1/t_j for dust, sum_j e_j / t_j for gas    (2)

(1), (2) with G = 0 are Stoyanovskaya et al. 2018, sec. 3.3 (individual accelerations); the exact exponential
replaces their implicit Euler, which stays selectable.
"""

import math
from typing import NamedTuple

import numpy as np

from discsim.formulas.laws import CONSTANT
from discsim.jit.decorators import inline_jit, jit, jit_no_alloc, jit_subroutine
from discsim.jit.index import index
from discsim.kernels.drag.coupled import ROOM
from discsim.kernels.drag.frame import kepler, sense_at
from discsim.kernels.drag.laws import stopping_time
from discsim.kernels.drag.lines import (
    BX,
    BY,
    CHANGE,
    INERTIA,
    MASS,
    NUMBERS,
    PLACE,
    ROWS,
    SLOPE,
    SLOPE_CHANGE,
    SLOPE_SOURCE,
    SOURCE,
    VELOCITY,
    VX,
    VY,
    X,
    Y,
    fast,
    fit_slopes,
    mean_square,
    means,
    moments_of_source,
    second_moments,
    solve_in,
)
from discsim.kernels.drag.nonlinear import relax_by_speed
from discsim.kernels.drag.relax import relax_means, response


class Corners(NamedTuple):
    """Lower corner of each block (n, 2), and the period of space along both axes, inf where it is open."""

    corner: np.ndarray
    period: np.ndarray


class BlockScratch(NamedTuple):
    """Scratch for one block.

    p: packed particles, gas first. o: quantities of each species and, in the last row, of all. bound: first packed
    particle of each species. mass, time, y, b, change: masses, stopping times, velocities, sources and changes of the
    species. weight: moments of inertia. coupled: scratch of `relax_coupled`.
    """

    p: np.ndarray
    o: np.ndarray
    bound: np.ndarray
    mass: np.ndarray
    time: np.ndarray
    y: np.ndarray
    b: np.ndarray
    change: np.ndarray
    weight: np.ndarray
    coupled: np.ndarray


@inline_jit
def pack(kind, first, last, at, block, blocks, p):
    """Copy the particles of a block into the columns of `p` from `at` on; y is 0 in one dimension."""
    x0, y0 = blocks.corner[block, 0], blocks.corner[block, 1]
    line = kind.pos.shape[1] == 1
    for k in range(first, last):
        i, j = kind.order[k], index(k - first + at)
        p[MASS, j], p[X, j], p[VX, j] = kind.mass[i], kind.pos[i, 0] - x0, kind.vel[i, 0]
        p[Y, j], p[VY, j] = (0.0, 0.0) if line else (kind.pos[i, 1] - y0, kind.vel[i, 1])
    if blocks.period[0] < math.inf:
        for k in range(at, at + last - first):
            p[X, k] -= blocks.period[0] * math.floor(p[X, k] / blocks.period[0])
            p[Y, k] -= blocks.period[1] * math.floor(p[Y, k] / blocks.period[1])
    if len(kind.own) > 0:
        for k in range(first, last):
            i, j = kind.order[k], k - first + at
            p[BX, j], p[BY, j] = kind.own[i, 0], 0.0 if line else kind.own[i, 1]


@fast
def leave_orbits(p, count, x0, y0, star, softening, sense):
    """Subtract Kepler's velocity from packed velocities; `sense` is sigma in eq. (1) of `drag/frame.py`."""
    for k in range(index(count)):
        x, y = p[X, k] + x0, p[Y, k] + y0
        omega = sense * kepler(x * x + y * y, star, softening)
        p[VX, k] += omega * y
        p[VY, k] -= omega * x


@jit_subroutine
def relax_slopes(one, rate, dim, dt, exponential, o):
    """Compute the changes of the slopes of gas and population `one`, whose difference relaxes at the rate of the means.

    I_0 G_0 + I_1 G_1 stays, which conserves angular momentum within the block.
    """
    f, g = response(rate, dt, exponential)
    xx, xy = o[0, INERTIA] + o[one, INERTIA], o[0, INERTIA + 1] + o[one, INERTIA + 1]
    yy = o[0, INERTIA + 2] + o[one, INERTIA + 2]
    for s, other, sign in ((0, one, 1.0), (one, 0, -1.0)):
        ixx, ixy, iyy = o[other, INERTIA], o[other, INERTIA + 1], o[other, INERTIA + 2]
        for c in range(2):
            along = f * (o[0, SLOPE + c] - o[one, SLOPE + c])
            along += g * (o[0, SLOPE_SOURCE + c] - o[one, SLOPE_SOURCE + c])
            across = f * (o[0, SLOPE + 2 + c] - o[one, SLOPE + 2 + c])
            across += g * (o[0, SLOPE_SOURCE + 2 + c] - o[one, SLOPE_SOURCE + 2 + c])
            o[s, SLOPE_CHANGE + c] = ixx * along + ixy * across
            o[s, SLOPE_CHANGE + 2 + c] = ixy * along + iyy * across
        solve_in(o, s, xx, xy, yy, SLOPE_CHANGE, SLOPE_CHANGE, dim, sign)


@jit_no_alloc
def exchange_slopes(dim, two_way, dt, exponential, several, room):
    """Compute the changes of the slopes, weighted by moments of inertia; y, b and change of `room` are overwritten."""
    o, mass, time, weight, y, b, change = room.o, room.mass, room.time, room.weight, room.y, room.b, room.change
    n, count, only = len(mass), 0, 0
    for s in range(1, n):
        if mass[s] > 0.0:
            count += 1
            only = s
    if two_way and count == 1:
        relax_slopes(only, (1.0 + mass[only] / mass[0]) / time[only], dim, dt, exponential, o)
        return
    if not two_way:
        for s in range(1, n):
            if mass[s] > 0.0:
                f, g = response(1.0 / time[s], dt, exponential)
                for k in range(4):
                    slip, source = o[s, SLOPE + k] - o[0, SLOPE + k], o[s, SLOPE_SOURCE + k] - o[0, SLOPE_SOURCE + k]
                    o[s, SLOPE_CHANGE + k] = f * slip + g * source
        return
    widest = 0.0
    for s in range(n):
        weight[s] = o[s, INERTIA] + o[s, INERTIA + 2]
        widest = max(widest, weight[s] / mass[s] if mass[s] > 0.0 else 0.0)
    for s in range(n):  # particles at one point have no slope and take no part
        if weight[s] <= 1e-6 * widest * mass[s]:
            weight[s] = 0.0
    if weight[0] == 0.0:
        return
    for a in range(0, 2 * dim, 2):
        for s in range(n):
            for c in range(dim):
                y[s, c], b[s, c] = o[s, SLOPE + a + c], o[s, SLOPE_SOURCE + a + c]
        relax_means(weight, time, y, b, two_way, dt, exponential, several, room.coupled, change)
        for s in range(n):
            for c in range(dim):
                o[s, SLOPE_CHANGE + a + c] = change[s, c]


@fast
def make_changes(p, first, last, o, s, sources, f, g):
    """Overwrite packed positions with the velocity changes by drag: that of the line of the species, plus that of the
    residual of each particle by eq. (2).
    """
    x0, y0, u0, v0 = o[s, X], o[s, Y], o[s, VX], o[s, VY]
    # The terms with f and g below act on whole velocities; their effect on the line is subtracted here.
    xx = o[s, SLOPE_CHANGE] - f * o[s, SLOPE] - g * o[s, SLOPE_SOURCE]
    xy = o[s, SLOPE_CHANGE + 1] - f * o[s, SLOPE + 1] - g * o[s, SLOPE_SOURCE + 1]
    yx = o[s, SLOPE_CHANGE + 2] - f * o[s, SLOPE + 2] - g * o[s, SLOPE_SOURCE + 2]
    yy = o[s, SLOPE_CHANGE + 3] - f * o[s, SLOPE + 3] - g * o[s, SLOPE_SOURCE + 3]
    mean_x, mean_y = o[s, CHANGE], o[s, CHANGE + 1]
    for k in range(index(first), index(last)):
        x, y = p[X, k] - x0, p[Y, k] - y0
        p[X, k] = mean_x + (xx * x + yx * y) + f * (p[VX, k] - u0)
        p[Y, k] = mean_y + (xy * x + yy * y) + f * (p[VY, k] - v0)
    if sources:
        a0, b0 = o[s, BX], o[s, BY]
        for k in range(index(first), index(last)):
            p[X, k] += g * (p[BX, k] - a0)
            p[Y, k] += g * (p[BY, k] - b0)


@fast
def loss(p, first, last, o, s, sources, dt):
    """Return the kinetic energy lost by drag: minus the sum of m dv . v, with dv the velocity changes by drag and v the
    mid-step velocities relative to the mean of the gas.
    """
    ax, ay = (-o[s, BX], -o[s, BY]) if sources else (0.0, 0.0)
    ux = 0.5 * dt * (o[s, BX] - o[0, BX] + ax) - o[0, VX]
    uy = 0.5 * dt * (o[s, BY] - o[0, BY] + ay) - o[0, VY]
    lost = 0.0
    for k in range(index(first), index(last)):
        a, b = (p[BX, k], p[BY, k]) if sources else (0.0, 0.0)
        lost -= p[MASS, k] * p[X, k] * (ux + p[VX, k] + 0.5 * (dt * a + p[X, k]))
        lost -= p[MASS, k] * p[Y, k] * (uy + p[VY, k] + 0.5 * (dt * b + p[Y, k]))
    return lost


@inline_jit
def loss_of_frame(kind, first, last, at, p, dt):
    """Return the kinetic energy lost by drag through the velocities that packs leave out: Kepler's, and half the kick
    of the accelerations that gas and dust share. A transfer of momentum between orbits changes the energy.
    """
    lost, sources = 0.0, len(kind.own) > 0
    for k in range(first, last):
        i, j = kind.order[k], k - first + at
        for c in range(kind.vel.shape[1]):
            shared = kind.acc[i, c] - p[BX + c, j] if sources else kind.acc[i, c]
            lost -= p[MASS, j] * p[X + c, j] * (kind.vel[i, c] - p[VX + c, j] + 0.5 * dt * shared)
    return lost


@inline_jit
def kick(kind, first, last, at, p, dt):
    """Kick particles by their accelerations, and add the velocity changes by drag."""
    for k in range(first, last):
        i, j = kind.order[k], index(k - first + at)
        kind.vel[i, 0] += dt * kind.acc[i, 0] + p[X, j]
        if kind.vel.shape[1] == 2:
            kind.vel[i, 1] += dt * kind.acc[i, 1] + p[Y, j]


@inline_jit
def kick_freely(kind, first, last, dt):
    for k in range(first, last):
        for a in range(kind.vel.shape[1]):
            kind.vel[kind.order[k], a] += dt * kind.acc[kind.order[k], a]


@jit
def free_kick(members, vel, acc, dt):
    for i in members:
        for a in range(vel.shape[1]):
            vel[i, a] += dt * acc[i, a]


@inline_jit
def mean_of(values, order, first, last):
    total = 0.0
    for k in range(first, last):
        total += values[order[k]]
    return total / (last - first)


@inline_jit
def mean_by_mass(values, mass, order, first, last):
    total, weight = 0.0, 0.0
    for k in range(first, last):
        total += mass[order[k]] * values[order[k]]
        weight += mass[order[k]]
    return total / weight


@inline_jit
def load_block(block, gas, dust, blocks, law, linear, frame, room):
    """Pack a block and compute the quantities of each species; return gas density, sound speed and Omega."""
    n, p, o, bound = len(room.mass), room.p, room.o, room.bound
    g0, g1 = gas.start[block], gas.start[block + 1]
    d0, d1 = dust.start[block * (n - 1)], dust.start[(block + 1) * (n - 1)]
    ng, nd = g1 - g0, d1 - d0
    pack(gas, g0, g1, 0, block, blocks, p)
    pack(dust, d0, d1, ng, block, blocks, p)
    rho, sound, omega = mean_of(gas.density, gas.order, g0, g1), mean_of(gas.sound, gas.order, g0, g1), 0.0
    if frame.star > 0.0:
        x0, y0 = blocks.corner[block, 0], blocks.corner[block, 1]
        r2 = mean_square(p, ng, ng + nd, x0, y0)
        omega = kepler(r2, frame.star, frame.softening)
        if linear:
            leave_orbits(p, ng + nd, x0, y0, frame.star, frame.softening, sense_at(r2, frame))
    bound[0] = 0
    for s in range(n):
        bound[s + 1] = dust.start[block * (n - 1) + s] - d0 + ng
        first, last, sources = bound[s], bound[s + 1], len(gas.own if s == 0 else dust.own) > 0
        means(p, first, last, PLACE, o, s)
        means(p, first, last, VELOCITY, o, s)
        if sources:
            means(p, first, last, SOURCE, o, s)
        if linear:
            second_moments(p, first, last, o, s)
            if sources:
                moments_of_source(p, first, last, o, s)
        room.mass[s], room.time[s] = o[s, MASS], np.inf
        if s > 0 and room.mass[s] > 0.0:
            own = mean_of(dust.density, dust.order, d0 + first - ng, d0 + last - ng) if len(dust.density) > 0 else 0.0
            ratio = own / rho if own > 0.0 else room.mass[s] / room.mass[0]
            room.time[s] = stopping_time(law.code, law.grains[s - 1], ratio, rho, sound, omega)
            if law.code != CONSTANT and own > 0.0:  # grains have individual sizes
                room.time[s] *= mean_by_mass(dust.density, dust.mass, dust.order, d0 + first - ng, d0 + last - ng)
    return rho, sound, omega


@inline_jit
def relax(law, linear, nonlinear, several, rho, sound, omega, dim, room):
    """Compute the changes of the means and of the slopes of all species."""
    n, o, y, b = len(room.mass), room.o, room.y, room.b
    if linear:
        fit_slopes(room.bound, dim, law.two_way, o)
    for s in range(n):  # velocity of each species at the centroid of the gas
        x, z = o[s, X] - o[0, X], o[s, Y] - o[0, Y]
        for c in range(dim):
            y[s, c] = o[s, VX + c] - o[n, SLOPE + c] * x - o[n, SLOPE + 2 + c] * z
            b[s, c] = o[s, BX + c] - o[n, SLOPE_SOURCE + c] * x - o[n, SLOPE_SOURCE + 2 + c] * z
    if nonlinear:
        relax_by_speed(
            room.mass, room.time, law.code, law.grains, rho, sound, omega, y, b, law.two_way, law.dt, law.exponential,
            several, room.coupled, room.change,
        )  # fmt: skip
    else:
        relax_means(
            room.mass, room.time, y, b, law.two_way, law.dt, law.exponential, several, room.coupled, room.change
        )
    for s in range(n):
        for c in range(dim):
            o[s, CHANGE + c] = room.change[s, c]
        for c in range(4):
            o[s, SLOPE_CHANGE + c] = 0.0
    if linear:
        exchange_slopes(dim, law.two_way, law.dt, law.exponential, several, room)


@inline_jit
def apply_changes(block, gas, dust, law, room, heat):
    """Change the velocities of the particles of a block, and heat its gas."""
    n, p, o, bound, heated = len(room.mass), room.p, room.o, room.bound, len(heat) > 0
    g0, g1 = gas.start[block], gas.start[block + 1]
    d0, d1 = dust.start[block * (n - 1)], dust.start[(block + 1) * (n - 1)]
    rate, lost = 0.0, 0.0
    for s in range(n - 1, -1, -1):
        if room.mass[s] == 0.0 or (s == 0 and not law.two_way):
            continue
        if s > 0:
            rate += room.mass[s] / room.mass[0] / room.time[s]
        f, g = response(1.0 / room.time[s] if s > 0 else rate, law.dt, law.exponential)
        sources = len(gas.own if s == 0 else dust.own) > 0
        make_changes(p, bound[s], bound[s + 1], o, s, sources, f, g)
        if heated:
            lost += loss(p, bound[s], bound[s + 1], o, s, sources, law.dt)
    if heated:
        lost += loss_of_frame(gas, g0, g1, 0, p, law.dt)
        lost += loss_of_frame(dust, d0, d1, g1 - g0, p, law.dt)
        for k in range(g0, g1):
            heat[gas.order[k]] = lost / room.mass[0]
    if law.two_way:
        kick(gas, g0, g1, 0, p, law.dt)
    kick(dust, d0, d1, g1 - g0, p, law.dt)


@inline_jit
def relax_block(block, gas, dust, blocks, law, linear, nonlinear, several, frame, room, times, heat):
    g0, g1 = gas.start[block], gas.start[block + 1]
    d0, d1 = dust.start[block * dust.number], dust.start[(block + 1) * dust.number]
    if g0 == g1 or d0 == d1:
        if law.two_way:
            kick_freely(gas, g0, g1, law.dt)
        kick_freely(dust, d0, d1, law.dt)
        for s in range(dust.number):
            times[block, s] = np.inf
        return
    rho, sound, omega = load_block(block, gas, dust, blocks, law, linear, frame, room)
    relax(law, linear, nonlinear, several, rho, sound, omega, gas.pos.shape[1], room)
    apply_changes(block, gas, dust, law, room, heat)
    for s in range(dust.number):
        times[block, s] = room.time[s + 1]


@inline_jit
def most_in(block_from, block_to, gas, dust):
    """Return the largest number of particles in a block."""
    most, number = 0, dust.number
    for block in range(block_from, block_to):
        of_gas = gas.start[block + 1] - gas.start[block]
        most = max(most, of_gas + dust.start[(block + 1) * number] - dust.start[block * number])
    return most


@jit
def relax_blocks(block_from, block_to, gas, dust, blocks, law, linear, nonlinear, several, frame, times, heat):
    """Kick the particles of the blocks by accelerations and drag together, in place; only the dust if one-way.

    Writes the stopping times (blocks, populations), inf for a block without gas or without dust, and the heat per mass
    of each gas particle to `heat` (n,), unless this is empty.
    """
    n, dim = dust.number + 1, gas.pos.shape[1]
    room = BlockScratch(
        np.empty((ROWS, most_in(block_from, block_to, gas, dust))), np.zeros((n + 1, NUMBERS)),
        np.empty(n + 1, np.int64), np.empty(n), np.empty(n), np.empty((n, dim)), np.empty((n, dim)), np.empty((n, dim)),
        np.empty(n), np.empty((n, ROOM)),
    )  # fmt: skip
    for block in range(block_from, block_to):
        relax_block(block, gas, dust, blocks, law, linear, nonlinear, several, frame, room, times, heat)
