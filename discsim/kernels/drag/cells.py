"""Implicit drag in cells: exact relaxation of the gas and dust in a block, accelerations included.

In a block, species s (g: gas, j: a dust population) has the mass M_s, centroid X_s, mean velocity V_s and mean source
A_s. A source is an acceleration that acts on one species only. In the linear scheme, G_s and H_s are the slopes of
velocity and source about the centroid. With e_j = M_j / M_g

    dV_g/dt = A_g + sum_j e_j (V_j - V_g) / t_j,    dV_j/dt = A_j + (V_g - V_j) / t_j                 (1)

is solved exactly over dt for the velocities at one common point X, V_s - G (X_s - X). G is the slope that fits all
species, each about its own mean. Differences of slopes relax in the same way, weighted by the moments of inertia I_s,
so that sum_s I_s G_s does not change. The residual velocity r_i of a particle about the linear field of its own
species, with the residual source b_i, is damped:

    r_i' = r_i exp(-dt/t) + b_i t (1 - exp(-dt/t)),   1/t = 1/t_j for dust, sum_j e_j / t_j for gas    (2)

With G = 0, (1) and (2) are sec. 3.3 of Stoyanovskaya et al. 2018 (individual accelerations). Their implicit Euler can
be selected instead of the exact exponential.
"""

import math
from typing import NamedTuple

import numpy as np

from discsim.formulas.laws import CONSTANT
from discsim.jit.decorators import inline_jit, jit, jit_no_alloc, jit_subroutine
from discsim.jit.index import index
from discsim.kernels.drag import linear_fit
from discsim.kernels.drag.coupled import SCRATCH_COLUMNS
from discsim.kernels.drag.frame import orbital_frequency, rotation_sign
from discsim.kernels.drag.laws import stopping_time
from discsim.kernels.drag.linear_fit import (
    BX,
    BY,
    CHANGE,
    COLUMNS,
    INERTIA,
    MASS,
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
)
from discsim.kernels.drag.nonlinear import relax_nonlinear
from discsim.kernels.drag.relax import relax_means, response


class BlockCorners(NamedTuple):
    """Positions of the blocks, and the period of space.

    corner (n, 2): lower corner of each block. period (2,): period of space along x and y, inf where space is open.
    """

    corner: np.ndarray
    period: np.ndarray


class BlockScratch(NamedTuple):
    """Scratch arrays for the particles of one block and its n species, in d dimensions. Species 0 is the gas.

    p (ROWS, particles): packed particles, gas first, with the rows of `kernels/drag/linear_fit.py`. o (n + 1, COLUMNS):
    means, moments and slopes of each species, with the columns of that module; the last row is for all species
    together. bound (n + 1,): first packed particle of each species. mass, time (n,): masses and stopping times. y, b,
    change (n, d): velocities, sources and velocity changes. weight (n,): weights of the slopes. coupled: scratch of
    `relax_coupled`.
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
    """Copy particles kind.order[first:last] of a block to the columns of `p` from column `at` on.

    Positions are relative to the corner of the block. In one dimension the second components are 0.
    """
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
    if len(kind.source) > 0:
        for k in range(first, last):
            i, j = kind.order[k], k - first + at
            p[BX, j], p[BY, j] = kind.source[i, 0], 0.0 if line else kind.source[i, 1]


@linear_fit.inline_reordered
def to_kepler_frame(p, count, x0, y0, star, softening, sense):
    """Subtract the Keplerian velocity from the velocities of the first `count` packed particles in `p`, in place.

    (x0, y0): corner of the block. star, softening: mass and softening length of the star. sense: sigma of eq. (1) of
    `drag/frame.py`.
    """
    for k in range(index(count)):
        x, y = p[X, k] + x0, p[Y, k] + y0
        omega = sense * orbital_frequency(x * x + y * y, star, softening)
        p[VX, k] += omega * y
        p[VY, k] -= omega * x


@jit_subroutine
def relax_two_slopes(one, rate, dim, dt, exponential, o):
    """Write to `o` the changes of the velocity slopes of gas and population `one`; their difference decays at `rate`.

    `rate` is that of the mean velocities. I_0 G_0 + I_1 G_1 does not change, which conserves angular momentum within
    the block.
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
        linear_fit.solve_columns(o, s, xx, xy, yy, SLOPE_CHANGE, SLOPE_CHANGE, dim, sign)


@jit_no_alloc
def relax_all_slopes(dim, two_way, dt, exponential, several, scratch):
    """Write to `scratch.o` the changes of the velocity slopes of all species, which relax like velocities.

    With several populations the trace of the moments of inertia replaces the mass. y, b and change of `scratch` are
    overwritten.
    """
    o, mass, time, weight, y, b = scratch.o, scratch.mass, scratch.time, scratch.weight, scratch.y, scratch.b
    n, count, only = len(mass), 0, 0
    for s in range(1, n):
        if mass[s] > 0.0:
            count += 1
            only = s
    if two_way and count == 1:
        relax_two_slopes(only, (1.0 + mass[only] / mass[0]) / time[only], dim, dt, exponential, o)
        return
    widest = 0.0
    for s in range(n):
        weight[s] = o[s, INERTIA] + o[s, INERTIA + 2] if two_way else mass[s]
        widest = max(widest, weight[s] / mass[s] if mass[s] > 0.0 else 0.0)
    for s in range(n):  # particles at one point have no slope, and are left out
        if weight[s] <= 1e-6 * widest * mass[s]:
            weight[s] = 0.0
    if weight[0] == 0.0:
        return
    for a in range(0, 2 * dim, 2):
        for s in range(n):
            for c in range(dim):
                y[s, c], b[s, c] = o[s, SLOPE + a + c], o[s, SLOPE_SOURCE + a + c]
        relax_means(weight, time, y, b, two_way, dt, exponential, several, scratch.coupled, scratch.change)
        for s in range(n):
            for c in range(dim):
                o[s, SLOPE_CHANGE + a + c] = scratch.change[s, c]


@linear_fit.inline_reordered
def write_velocity_changes(p, first, last, o, s, sources, f, g):
    """Overwrite the positions of packed particles of species s, `first` to `last`, with velocity changes by drag.

    The change is that of the linear velocity field of the species, plus that of the particle's residual velocity by eq.
    (2), with (f, g) from `response`. sources: whether the species has sources.
    """
    x0, y0, u0, v0 = o[s, X], o[s, Y], o[s, VX], o[s, VY]
    # The terms with f and g below act on whole velocities; their effect on the linear field is subtracted here.
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


@linear_fit.inline_reordered
def lost_energy(p, first, last, o, s, sources, dt):
    """Return the kinetic energy that the packed particles `first` to `last` of species s lose by drag.

    The result is minus the sum of m dv . v. dv is the velocity change by drag, which `write_velocity_changes` stored
    in the rows of the position. v is the velocity at mid-step relative to the mean velocity of the gas.
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
def lost_energy_of_frame(kind, first, last, at, p, dt):
    """Return the kinetic energy that drag removes because of velocities that the packed velocities exclude.

    Excluded are the Keplerian velocity, and half the kick by the accelerations that gas and dust share. Drag that
    moves momentum between two orbits changes the energy.
    """
    lost, sources = 0.0, len(kind.source) > 0
    for k in range(first, last):
        i, j = kind.order[k], k - first + at
        for c in range(kind.vel.shape[1]):
            shared = kind.acc[i, c] - p[BX + c, j] if sources else kind.acc[i, c]
            lost -= p[MASS, j] * p[X + c, j] * (kind.vel[i, c] - p[VX + c, j] + 0.5 * dt * shared)
    return lost


@inline_jit
def kick(kind, first, last, at, p, dt):
    """Kick the particles kind.order[first:last] in place, by accelerations over dt and by the velocity changes in `p`.

    at: column of the first of these particles in `p`.
    """
    for k in range(first, last):
        i, j = kind.order[k], index(k - first + at)
        kind.vel[i, 0] += dt * kind.acc[i, 0] + p[X, j]
        if kind.vel.shape[1] == 2:
            kind.vel[i, 1] += dt * kind.acc[i, 1] + p[Y, j]


@jit
def kick_freely(members, vel, acc, dt):
    """Add the accelerations over dt to the velocities `vel` (n, d) of the particles `members`, in place."""
    for i in members:
        for a in range(vel.shape[1]):
            vel[i, a] += dt * acc[i, a]


@inline_jit
def mean_value(values, order, first, last):
    """Return the mean of `values` over the particles order[first:last]."""
    total = 0.0
    for k in range(first, last):
        total += values[order[k]]
    return total / (last - first)


@inline_jit
def mean_by_mass(values, mass, order, first, last):
    """Return the mass-weighted mean of `values` over the particles order[first:last]."""
    total, weight = 0.0, 0.0
    for k in range(first, last):
        total += mass[order[k]] * values[order[k]]
        weight += mass[order[k]]
    return total / weight


@inline_jit
def load_block(block, gas, dust, blocks, law, linear, frame, scratch):
    """Pack the particles of a block into `scratch`, and compute the means and moments of each species.

    Returns (density, thermal speed, Omega) of the gas. linear: whether velocities have slopes.
    """
    n, p, o, bound = len(scratch.mass), scratch.p, scratch.o, scratch.bound
    g0, g1 = gas.start[block], gas.start[block + 1]
    d0, d1 = dust.start[block * (n - 1)], dust.start[(block + 1) * (n - 1)]
    ng, nd = g1 - g0, d1 - d0
    pack(gas, g0, g1, 0, block, blocks, p)
    pack(dust, d0, d1, ng, block, blocks, p)
    rho, sound, omega = mean_value(gas.density, gas.order, g0, g1), mean_value(gas.sound, gas.order, g0, g1), 0.0
    if frame.star > 0.0:
        x0, y0 = blocks.corner[block, 0], blocks.corner[block, 1]
        r2 = linear_fit.mean_square(p, ng, ng + nd, x0, y0)
        omega = orbital_frequency(r2, frame.star, frame.softening)
        if linear:
            to_kepler_frame(p, ng + nd, x0, y0, frame.star, frame.softening, rotation_sign(r2, frame))
    bound[0] = 0
    for s in range(n):
        bound[s + 1] = dust.start[block * (n - 1) + s] - d0 + ng
        first, last, sources = bound[s], bound[s + 1], len(gas.source if s == 0 else dust.source) > 0
        linear_fit.mass_and_means(p, first, last, PLACE, o, s)
        linear_fit.mass_and_means(p, first, last, VELOCITY, o, s)
        if sources:
            linear_fit.mass_and_means(p, first, last, SOURCE, o, s)
        if linear:
            linear_fit.second_moments(p, first, last, o, s)
            if sources:
                linear_fit.moments_of_source(p, first, last, o, s)
        scratch.mass[s], scratch.time[s] = o[s, MASS], np.inf
        if s > 0 and scratch.mass[s] > 0.0:
            own = 0.0
            if len(dust.density) > 0:
                own = mean_value(dust.density, dust.order, d0 + first - ng, d0 + last - ng)
            ratio = own / rho if own > 0.0 else scratch.mass[s] / scratch.mass[0]
            scratch.time[s] = stopping_time(law.code, law.grains[s - 1], ratio, rho, sound, omega)
            if law.code != CONSTANT and own > 0.0:  # grains have individual sizes
                scratch.time[s] *= mean_by_mass(dust.density, dust.mass, dust.order, d0 + first - ng, d0 + last - ng)
    return rho, sound, omega


@inline_jit
def relax(law, linear, nonlinear, several, rho, sound, omega, dim, scratch):
    """Write to `scratch.o` the changes of the mean velocities and of the slopes of all species by drag.

    rho, sound, omega: density, thermal speed and orbital frequency of the gas. linear: whether velocities have slopes.
    nonlinear, several: as in `DragLaw`.
    """
    n, o, y, b = len(scratch.mass), scratch.o, scratch.y, scratch.b
    if linear:
        linear_fit.fit_slopes(scratch.bound, dim, law.two_way, o)
    for s in range(n):  # velocity of each species at the centroid of the gas
        x, z = o[s, X] - o[0, X], o[s, Y] - o[0, Y]
        for c in range(dim):
            y[s, c] = o[s, VX + c] - o[n, SLOPE + c] * x - o[n, SLOPE + 2 + c] * z
            b[s, c] = o[s, BX + c] - o[n, SLOPE_SOURCE + c] * x - o[n, SLOPE_SOURCE + 2 + c] * z
    mass, time, coupled, change = scratch.mass, scratch.time, scratch.coupled, scratch.change
    if nonlinear:
        relax_nonlinear(
            mass, time, law.code, law.grains, rho, sound, omega, y, b, law.two_way, law.dt, law.exponential, several,
            coupled, change,
        )  # fmt: skip
    else:
        relax_means(mass, time, y, b, law.two_way, law.dt, law.exponential, several, coupled, change)
    for s in range(n):
        for c in range(dim):
            o[s, CHANGE + c] = change[s, c]
        for c in range(4):
            o[s, SLOPE_CHANGE + c] = 0.0
    if linear:
        relax_all_slopes(dim, law.two_way, law.dt, law.exponential, several, scratch)


@inline_jit
def apply_changes(block, gas, dust, law, scratch, heat):
    """Kick the particles of a block in place, and write the heat of its gas to `heat` (n,) unless this is empty."""
    n, p, o, bound, heated = len(scratch.mass), scratch.p, scratch.o, scratch.bound, len(heat) > 0
    g0, g1 = gas.start[block], gas.start[block + 1]
    d0, d1 = dust.start[block * (n - 1)], dust.start[(block + 1) * (n - 1)]
    rate, lost = 0.0, 0.0
    for s in range(n - 1, -1, -1):
        if scratch.mass[s] == 0.0 or (s == 0 and not law.two_way):
            continue
        if s > 0:
            rate += scratch.mass[s] / scratch.mass[0] / scratch.time[s]
        f, g = response(1.0 / scratch.time[s] if s > 0 else rate, law.dt, law.exponential)
        sources = len(gas.source if s == 0 else dust.source) > 0
        write_velocity_changes(p, bound[s], bound[s + 1], o, s, sources, f, g)
        if heated:
            lost += lost_energy(p, bound[s], bound[s + 1], o, s, sources, law.dt)
    if heated:
        lost += lost_energy_of_frame(gas, g0, g1, 0, p, law.dt)
        lost += lost_energy_of_frame(dust, d0, d1, g1 - g0, p, law.dt)
        for k in range(g0, g1):
            heat[gas.order[k]] = lost / scratch.mass[0]
    if law.two_way:
        kick(gas, g0, g1, 0, p, law.dt)
    kick(dust, d0, d1, g1 - g0, p, law.dt)


@inline_jit
def relax_block(block, gas, dust, blocks, law, linear, nonlinear, several, frame, scratch, times, heat):
    """Kick the particles of one block, as `relax_blocks`."""
    g0, g1 = gas.start[block], gas.start[block + 1]
    d0, d1 = dust.start[block * dust.number], dust.start[(block + 1) * dust.number]
    if g0 == g1 or d0 == d1:
        if law.two_way:
            kick_freely(gas.order[g0:g1], gas.vel, gas.acc, law.dt)
        kick_freely(dust.order[d0:d1], dust.vel, dust.acc, law.dt)
        for s in range(dust.number):
            times[block, s] = np.inf
        return
    rho, sound, omega = load_block(block, gas, dust, blocks, law, linear, frame, scratch)
    relax(law, linear, nonlinear, several, rho, sound, omega, gas.pos.shape[1], scratch)
    apply_changes(block, gas, dust, law, scratch, heat)
    for s in range(dust.number):
        times[block, s] = scratch.time[s + 1]


@inline_jit
def largest_block(block_from, block_to, gas, dust):
    """Return the largest number of particles in one of the blocks."""
    most, number = 0, dust.number
    for block in range(block_from, block_to):
        of_gas = gas.start[block + 1] - gas.start[block]
        most = max(most, of_gas + dust.start[(block + 1) * number] - dust.start[block * number])
    return most


@jit
def relax_blocks(block_from, block_to, gas, dust, blocks, law, linear, nonlinear, several, frame, times, heat):
    """Kick the particles of the blocks in place, by accelerations and drag together; with one-way drag only the dust.

    gas, dust: `Species`. linear: whether the velocity of a species in a block is a linear function of position. Writes
    to `times` (blocks, populations) the stopping times, inf for a block without gas or without dust. Writes to `heat`
    (n,) the heat per mass of each gas particle, unless `heat` is empty.
    """
    n, dim = dust.number + 1, gas.pos.shape[1]
    scratch = BlockScratch(
        np.empty((ROWS, largest_block(block_from, block_to, gas, dust))), np.zeros((n + 1, COLUMNS)),
        np.empty(n + 1, np.int64), np.empty(n), np.empty(n), np.empty((n, dim)), np.empty((n, dim)), np.empty((n, dim)),
        np.empty(n), np.empty((n, SCRATCH_COLUMNS)),
    )  # fmt: skip
    for block in range(block_from, block_to):
        relax_block(block, gas, dust, blocks, law, linear, nonlinear, several, frame, scratch, times, heat)
