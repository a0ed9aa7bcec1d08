"""Implicit drag in cells: exact relaxation of gas and dust in a block, with the accelerations inside.

In a block the species s have masses M_s, centroids X_s, mean velocities V_s and sources A_s, and (linear
scheme) slopes G_s, H_s of velocity and source about their own centroids. With e_j = M_j / M_g

    dV_g/dt = A_g + sum_j e_j (V_j - V_g) / t_j,    dV_j/dt = A_j + (V_g - V_j) / t_j                 (1)

is solved exactly over dt for V_s compared at one common point, V_s - G (X_s - X), G the slope pooled within
species; the slopes' difference relaxes the same way, weighed with the moments of inertia, so that sum_s I_s G_s
stays; what is left of a particle's velocity is damped towards its own species' line:

    r_i' = r_i exp(-dt/t) + b_i t (1 - exp(-dt/t)),   1/t = 1/t_j for dust, sum_j e_j / t_j for gas    (2)

(1), (2) with G = 0 are Stoyanovskaya et al. 2018, sec. 3.3 (individual accelerations); the exact exponential
replaces their implicit Euler, which stays selectable. Sources are the accelerations that gas and dust do not
share.
"""

import math

import numpy as np
from numba import njit

from discsim.kernels.frame import kepler, sense_at
from discsim.kernels.laws import stopping_time
from discsim.kernels.lines import (
    BX,
    BY,
    CHANGE,
    FAST,
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
    fit_slopes,
    mean_square,
    means,
    moments_of_source,
    second_moments,
    solve_in,
)
from discsim.kernels.nonlinear import relax_by_speed
from discsim.kernels.relax import relax_means, response


@njit(nogil=True, cache=True, error_model="numpy")
def pack(order, first, last, at, pos, vel, own, mass, corners, block, size, periodic, p):
    """Copy a block's members into columns from `at` on; 0 along an axis that there is not."""
    x0, y0 = corners[block, 0], corners[block, 1]
    line = pos.shape[1] == 1
    if line:
        for k in range(first, last):
            i, j = order[k], np.uint64(k - first + at)
            p[MASS, j], p[X, j], p[Y, j], p[VX, j], p[VY, j] = mass[i], pos[i, 0] - x0, 0.0, vel[i, 0], 0.0
    else:
        for k in range(first, last):
            i, j = order[k], np.uint64(k - first + at)
            p[MASS, j], p[X, j], p[Y, j] = mass[i], pos[i, 0] - x0, pos[i, 1] - y0
            p[VX, j], p[VY, j] = vel[i, 0], vel[i, 1]
    if periodic:
        for k in range(at, at + last - first):
            p[X, k] -= size[0] * math.floor(p[X, k] / size[0])
            p[Y, k] -= size[1] * math.floor(p[Y, k] / size[1])
    if len(own) > 0:
        for k in range(first, last):
            i, j = order[k], k - first + at
            p[BX, j], p[BY, j] = own[i, 0], 0.0 if line else own[i, 1]


@njit(cache=True, error_model="numpy", fastmath=FAST, forceinline=True)
def leave_orbits(p, count, x0, y0, star, softening, sense):
    """Velocities relative to Kepler's, taken in the sense in which gas and dust turn."""
    for k in range(np.uint64(count)):
        x, y = p[X, k] + x0, p[Y, k] + y0
        omega = sense * kepler(x * x + y * y, star, softening)
        p[VX, k] += omega * y
        p[VY, k] -= omega * x


@njit(nogil=True, cache=True, error_model="numpy")
def relax_slopes(one, rate, dim, dt, exponential, o):
    """Change the slopes of gas and population `one` such that I_0 G_0 + I_1 G_1 stays: angular momentum within the
    block is kept. The difference relaxes at the means' rate.
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


@njit(nogil=True, cache=True, error_model="numpy")
def exchange_slopes(mass, time, dim, two_way, dt, exponential, several, y, b, change, o):
    """Changes of the slopes, weighed with the moments of inertia; y, b and change (n, d) are overwritten."""
    n = len(mass)
    count, only = 0, 0
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
    weight = np.zeros(n)
    least, most = np.inf, 0.0
    for s in range(n):
        if mass[s] > 0.0:
            weight[s] = o[s, INERTIA] + o[s, INERTIA + 2]
            least, most = min(least, weight[s]), max(most, weight[s])
    if least <= 1e-6 * most:
        return  # a population on one point has no slope of its own
    for a in range(0, 2 * dim, 2):
        for s in range(n):
            for c in range(dim):
                y[s, c], b[s, c] = o[s, SLOPE + a + c], o[s, SLOPE_SOURCE + a + c]
        relax_means(weight, time, y, b, two_way, dt, exponential, several, change)
        for s in range(n):
            for c in range(dim):
                o[s, SLOPE_CHANGE + a + c] = change[s, c]


@njit(cache=True, error_model="numpy", fastmath=FAST, forceinline=True)
def make_changes(p, first, last, o, s, sources, f, g):
    """What the drag changes, the line of the species and what is left of each particle, eq. (2), in place of places."""
    x0, y0, u0, v0 = o[s, X], o[s, Y], o[s, VX], o[s, VY]
    # What is linear in the place: the change of the line, less what the line itself has no part in.
    xx = o[s, SLOPE_CHANGE] - f * o[s, SLOPE] - g * o[s, SLOPE_SOURCE]
    xy = o[s, SLOPE_CHANGE + 1] - f * o[s, SLOPE + 1] - g * o[s, SLOPE_SOURCE + 1]
    yx = o[s, SLOPE_CHANGE + 2] - f * o[s, SLOPE + 2] - g * o[s, SLOPE_SOURCE + 2]
    yy = o[s, SLOPE_CHANGE + 3] - f * o[s, SLOPE + 3] - g * o[s, SLOPE_SOURCE + 3]
    mean_x, mean_y = o[s, CHANGE], o[s, CHANGE + 1]
    for k in range(np.uint64(first), np.uint64(last)):
        x, y = p[X, k] - x0, p[Y, k] - y0
        p[X, k] = mean_x + (xx * x + yx * y) + f * (p[VX, k] - u0)
        p[Y, k] = mean_y + (xy * x + yy * y) + f * (p[VY, k] - v0)
    if sources:
        a0, b0 = o[s, BX], o[s, BY]
        for k in range(np.uint64(first), np.uint64(last)):
            p[X, k] += g * (p[BX, k] - a0)
            p[Y, k] += g * (p[BY, k] - b0)


@njit(cache=True, error_model="numpy", fastmath=FAST, forceinline=True)
def loss(p, first, last, o, s, sources, dt):
    """What is lost of the energy of motion beside the work of the sources, both at the velocities half-way, relative to
    the gas's means.
    """
    ax, ay = (-o[s, BX], -o[s, BY]) if sources else (0.0, 0.0)
    ux = 0.5 * dt * (o[s, BX] - o[0, BX] + ax) - o[0, VX]
    uy = 0.5 * dt * (o[s, BY] - o[0, BY] + ay) - o[0, VY]
    lost = 0.0
    for k in range(np.uint64(first), np.uint64(last)):
        a, b = (p[BX, k], p[BY, k]) if sources else (0.0, 0.0)
        lost -= p[MASS, k] * p[X, k] * (ux + p[VX, k] + 0.5 * (dt * a + p[X, k]))
        lost -= p[MASS, k] * p[Y, k] * (uy + p[VY, k] + 0.5 * (dt * b + p[Y, k]))
    return lost


@njit(nogil=True, cache=True, error_model="numpy")
def loss_of_frame(order, first, last, at, vel, acc, p, sources, dt):
    """The same of what packed velocities leave out, Kepler's and half a kick of what gas and dust share: from one orbit
    to another the same momentum is not the same energy.
    """
    lost = 0.0
    for k in range(first, last):
        i, j = order[k], k - first + at
        for c in range(vel.shape[1]):
            shared = acc[i, c] - p[BX + c, j] if sources else acc[i, c]
            lost -= p[MASS, j] * p[X + c, j] * (vel[i, c] - p[VX + c, j] + 0.5 * dt * shared)
    return lost


@njit(nogil=True, cache=True, error_model="numpy")
def kick(order, first, last, at, p, dt, vel, acc):
    """Free kick, and the changes."""
    if vel.shape[1] == 1:
        for k in range(first, last):
            i = order[k]
            vel[i, 0] += dt * acc[i, 0] + p[X, k - first + at]
    else:
        for k in range(first, last):
            i, j = order[k], np.uint64(k - first + at)
            vel[i, 0] += dt * acc[i, 0] + p[X, j]
            vel[i, 1] += dt * acc[i, 1] + p[Y, j]


@njit(nogil=True, cache=True, error_model="numpy")
def free_kick(members, vel, acc, dt):
    for i in members:
        for a in range(vel.shape[1]):
            vel[i, a] += dt * acc[i, a]


@njit(nogil=True, cache=True, error_model="numpy")
def mean_of(values, order, first, last):
    total = 0.0
    for k in range(first, last):
        total += values[order[k]]
    return total / (last - first)


@njit(nogil=True, cache=True, error_model="numpy")
def relax_blocks(
    block_from, block_to, gpos, gvel, gacc, gown, gmass, grho, gsound, gorder, gstart,
    dpos, dvel, dacc, down, dmass, drho, dorder, dstart, times,
    linear, two_way, law, grains, nonlinear, dt, exponential, several, frame, corners, size, periodic, heat,
):  # fmt: skip
    """The kick of all blocks: accelerations and drag together, velocities in place; that of dust alone if one-way.

    gorder, gstart: gas by block; dorder, dstart: dust by block and, within it, by population. `own` arrays are the
    sources (accelerations not shared; no entries where there are none). Writes the stopping times of the populations in
    each block, inf where it has no gas, and, if `heat` has entries, the heat per mass of each gas particle.
    """
    n, dim, heated, star, softening = len(grains) + 1, gpos.shape[1], len(heat) > 0, frame.star, frame.softening
    most = 0
    for block in range(block_from, block_to):
        most = max(most, gstart[block + 1] - gstart[block] + dstart[(block + 1) * (n - 1)] - dstart[block * (n - 1)])
    p, o, bound = np.empty((ROWS, most)), np.zeros((n + 1, NUMBERS)), np.empty(n + 1, np.int64)
    mass, time = np.empty(n), np.empty(n)
    y, b, change = np.empty((n, dim)), np.empty((n, dim)), np.empty((n, dim))
    for block in range(block_from, block_to):
        g0, g1, d0, d1 = gstart[block], gstart[block + 1], dstart[block * (n - 1)], dstart[(block + 1) * (n - 1)]
        if g0 == g1 or d0 == d1:
            if two_way:
                free_kick(gorder[g0:g1], gvel, gacc, dt)
            free_kick(dorder[d0:d1], dvel, dacc, dt)
            for s in range(n - 1):
                times[block, s] = np.inf
            continue
        x0, y0, ng, nd = corners[block, 0], corners[block, 1], g1 - g0, d1 - d0
        pack(gorder, g0, g1, 0, gpos, gvel, gown, gmass, corners, block, size, periodic, p)
        pack(dorder, d0, d1, ng, dpos, dvel, down, dmass, corners, block, size, periodic, p)
        rho, sound = mean_of(grho, gorder, g0, g1), mean_of(gsound, gorder, g0, g1)
        omega = 0.0
        if star > 0.0:
            r2 = mean_square(p, ng, ng + nd, x0, y0)
            omega = kepler(r2, star, softening)
            if linear:
                leave_orbits(p, ng + nd, x0, y0, star, softening, sense_at(r2, frame))
        bound[0] = 0
        for s in range(n):
            bound[s + 1] = dstart[block * (n - 1) + s] - d0 + ng
            first, last = bound[s], bound[s + 1]
            means(p, first, last, PLACE, o, s)
            means(p, first, last, VELOCITY, o, s)
            if len(gown if s == 0 else down) > 0:
                means(p, first, last, SOURCE, o, s)
            if linear:
                second_moments(p, first, last, o, s)
                if len(gown if s == 0 else down) > 0:
                    moments_of_source(p, first, last, o, s)
            mass[s], time[s] = o[s, MASS], np.inf
            if s > 0 and mass[s] > 0.0:
                own = mean_of(drho, dorder, d0 + first - ng, d0 + last - ng) if len(drho) > 0 else 0.0
                ratio = own / rho if own > 0.0 else mass[s] / mass[0]
                time[s] = stopping_time(law, grains[s - 1], ratio, rho, sound, omega)
        if linear:
            fit_slopes(bound, dim, two_way, o)
        for s in range(n):  # what each species' velocity would be at the gas's centroid
            x, z = o[s, X] - o[0, X], o[s, Y] - o[0, Y]
            for c in range(dim):
                y[s, c] = o[s, VX + c] - o[n, SLOPE + c] * x - o[n, SLOPE + 2 + c] * z
                b[s, c] = o[s, BX + c] - o[n, SLOPE_SOURCE + c] * x - o[n, SLOPE_SOURCE + 2 + c] * z
        if nonlinear:
            relax_by_speed(mass, time, law, grains, rho, sound, omega, y, b, two_way, dt, exponential, several, change)
        else:
            relax_means(mass, time, y, b, two_way, dt, exponential, several, change)
        for s in range(n):
            for c in range(dim):
                o[s, CHANGE + c] = change[s, c]
            for c in range(4):
                o[s, SLOPE_CHANGE + c] = 0.0
        if linear:
            exchange_slopes(mass, time, dim, two_way, dt, exponential, several, y, b, change, o)
        rate, lost = 0.0, 0.0
        for s in range(n - 1, -1, -1):
            if mass[s] == 0.0 or (s == 0 and not two_way):
                continue
            if s > 0:
                rate += mass[s] / mass[0] / time[s]
            f, g = response(1.0 / time[s] if s > 0 else rate, dt, exponential)
            sources = len(gown if s == 0 else down) > 0
            make_changes(p, bound[s], bound[s + 1], o, s, sources, f, g)
            if heated:
                lost += loss(p, bound[s], bound[s + 1], o, s, sources, dt)
        if heated:
            lost += loss_of_frame(gorder, g0, g1, 0, gvel, gacc, p, len(gown) > 0, dt)
            lost += loss_of_frame(dorder, d0, d1, ng, dvel, dacc, p, len(down) > 0, dt)
        if two_way:
            kick(gorder, g0, g1, 0, p, dt, gvel, gacc)
        kick(dorder, d0, d1, ng, p, dt, dvel, dacc)
        for s in range(1, n):
            times[block, s - 1] = time[s]
        if heated:
            for k in range(g0, g1):
                heat[gorder[k]] = lost / mass[0]
