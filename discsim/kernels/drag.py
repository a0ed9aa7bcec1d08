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

from discsim.kernels.laws import stopping_time
from discsim.kernels.nonlinear import relax_by_speed
from discsim.kernels.relax import relax_means, response


@njit(cache=True, error_model="numpy")
def clip01(x):
    return min(max(x, 0.0), 1.0)


@njit(cache=True, error_model="numpy")
def solve_slope(inertia, moment, dim, out):
    """out (d, d) = inertia^-1 moment, or False where the particles lie too nearly on a point or a line."""
    if dim == 1:
        if inertia[0, 0] <= 0.0:
            return False
        out[0, 0] = moment[0, 0] / inertia[0, 0]
        return True
    det = inertia[0, 0] * inertia[1, 1] - inertia[0, 1] * inertia[0, 1]
    trace = inertia[0, 0] + inertia[1, 1]
    if det <= 1e-3 * trace * trace:
        return False
    for k in range(2):
        out[0, k] = (inertia[1, 1] * moment[0, k] - inertia[0, 1] * moment[1, k]) / det
        out[1, k] = (inertia[0, 0] * moment[1, k] - inertia[0, 1] * moment[0, k]) / det
    return True


@njit(cache=True, error_model="numpy")
def moments(xi, y, b, mass, inertia, moment, moment_source):
    """Second moments of one species about its centroid: of place with place, velocity and source, (d, d) each."""
    dim = xi.shape[1]
    for a in range(dim):
        for c in range(dim):
            ii, iy, ib = 0.0, 0.0, 0.0
            for k in range(len(mass)):
                arm = mass[k] * xi[k, a]
                ii += arm * xi[k, c]
                iy += arm * y[k, c]
                ib += arm * b[k, c]
            inertia[a, c], moment[a, c], moment_source[a, c] = ii, iy, ib


@njit(cache=True, error_model="numpy")
def pack(pos, vel, own, mass, members, corner, size, periodic, star, softening, xi, y, b, m):
    """Copy members of a block: place in it, velocity (relative to Kepler's about a star), source, mass."""
    dim = pos.shape[1]
    for k in range(len(members)):
        i = members[k]
        m[k] = mass[i]
        for a in range(dim):
            x = pos[i, a] - corner[a]
            xi[k, a] = x - size[a] * math.floor(x / size[a]) if periodic else x
            y[k, a] = vel[i, a]
            b[k, a] = own[i, a] if len(own) > 0 else 0.0
        if star > 0.0:
            omega = kepler(pos[i, 0] * pos[i, 0] + pos[i, 1] * pos[i, 1], star, softening)
            y[k, 0] += omega * pos[i, 1]
            y[k, 1] -= omega * pos[i, 0]


@njit(cache=True, error_model="numpy")
def kepler(r2, star, softening):
    """Omega about a softened star at squared radius r2."""
    d2 = r2 + softening * softening
    return math.sqrt(star / (d2 * math.sqrt(d2)))


@njit(cache=True, error_model="numpy")
def centre(first, xi, y, b, m, mass, x, v, acc):
    """Mass, centroid, mean velocity and source of each species; the members keep what differs from them."""
    for s in range(len(mass)):
        for k in range(first[s], first[s + 1]):
            mass[s] += m[k]
        for a in range(xi.shape[1]):
            for k in range(first[s], first[s + 1]):
                x[s, a] += m[k] * xi[k, a]
                v[s, a] += m[k] * y[k, a]
                acc[s, a] += m[k] * b[k, a]
            if mass[s] > 0.0:
                x[s, a] /= mass[s]
                v[s, a] /= mass[s]
                acc[s, a] /= mass[s]
            for k in range(first[s], first[s + 1]):
                xi[k, a] -= x[s, a]
                y[k, a] -= v[s, a]
                b[k, a] -= acc[s, a]


@njit(cache=True, error_model="numpy")
def fit_slopes(first, xi, y, b, m, two_way, inertia, slope, source, pooled, pooled_source):
    """Slopes of velocity and source: pooled within species (of the gas alone for one-way drag), and each species' own.

    They fade in with the number of particles; a species with too few for its own takes the pooled one.
    """
    n, dim = len(first) - 1, xi.shape[1]
    moment, moment_source = np.empty((n, dim, dim)), np.empty((n, dim, dim))
    total, total_moment, total_source = np.zeros((dim, dim)), np.zeros((dim, dim)), np.zeros((dim, dim))
    freedom = 0
    for s in range(n):
        lo, hi = first[s], first[s + 1]
        moments(xi[lo:hi], y[lo:hi], b[lo:hi], m[lo:hi], inertia[s], moment[s], moment_source[s])
        if s == 0 or two_way:
            freedom += max(hi - lo - 1, 0)
            for a in range(dim):
                for c in range(dim):
                    total[a, c] += inertia[s, a, c]
                    total_moment[a, c] += moment[s, a, c]
                    total_source[a, c] += moment_source[s, a, c]
    fade = clip01((freedom - dim) / (3.0 * dim))
    if fade > 0.0 and solve_slope(total, total_moment, dim, pooled):
        solve_slope(total, total_source, dim, pooled_source)
        for a in range(dim):
            for c in range(dim):
                pooled[a, c] *= fade
                pooled_source[a, c] *= fade
    for s in range(n):
        fade = clip01((first[s + 1] - first[s] - 1.0 - dim) / (2.0 * dim))
        own = fade > 0.0 and solve_slope(inertia[s], moment[s], dim, slope[s])
        if own:
            solve_slope(inertia[s], moment_source[s], dim, source[s])
        else:
            fade = 0.0
        for a in range(dim):
            for c in range(dim):
                slope[s, a, c] = fade * slope[s, a, c] + (1.0 - fade) * pooled[a, c]
                source[s, a, c] = fade * source[s, a, c] + (1.0 - fade) * pooled_source[a, c]


@njit(cache=True, error_model="numpy")
def relax_slopes(i0, i1, rate, g0, g1, h0, h1, dt, exponential, out0, out1):
    """Change two slopes (d, d) such that I_0 G_0 + I_1 G_1 stays: angular momentum within the block is kept.

    The difference relaxes at the means' rate.
    """
    dim = len(g0)
    f, g = response(rate, dt, exponential)
    share0, share1 = np.zeros((dim, dim)), np.zeros((dim, dim))
    total = np.empty((dim, dim))
    for a in range(dim):
        for c in range(dim):
            total[a, c] = i0[a, c] + i1[a, c]
    if not (solve_slope(total, i1, dim, share0) and solve_slope(total, i0, dim, share1)):
        return
    for c in range(dim):
        for a in range(dim):
            for k in range(dim):
                change = f * (g0[k, c] - g1[k, c]) + g * (h0[k, c] - h1[k, c])
                out0[a, c] += share0[a, k] * change
                out1[a, c] -= share1[a, k] * change


@njit(cache=True, error_model="numpy")
def exchange_slopes(mass, time, inertia, slope, source, two_way, dt, exponential, dslope):
    """Changes (n, d, d) of the slopes, weighed with the moments of inertia."""
    n, dim = slope.shape[0], slope.shape[1]
    count, only = 0, 0
    for s in range(1, n):
        if mass[s] > 0.0:
            count += 1
            only = s
    if two_way and count == 1:
        rate = (1.0 + mass[only] / mass[0]) / time[only]
        relax_slopes(
            inertia[0], inertia[only], rate, slope[0], slope[only], source[0], source[only],
            dt, exponential, dslope[0], dslope[only],
        )  # fmt: skip
        return
    weight, change = np.zeros(n), np.empty((n, dim))
    least, most = np.inf, 0.0
    for s in range(n):
        if mass[s] > 0.0:
            weight[s] = inertia[s, 0, 0] + (inertia[s, 1, 1] if dim == 2 else 0.0) if two_way else mass[s]
            least, most = min(least, weight[s]), max(most, weight[s])
    if two_way and least <= 1e-6 * most:
        return  # a population on one point has no slope of its own
    for axis in range(dim):
        relax_means(weight, time, slope[:, axis], source[:, axis], two_way, dt, exponential, change)
        dslope[:, axis] = change


@njit(cache=True, error_model="numpy")
def apply(members, y, b, m, mean, xi, slope, source, dv, dslope, rate, dt, exponential, vel, acc):
    """Free kick, the change of the species' line, and what is left of each particle, eq. (2).

    Returns what is lost of the energy of motion beside the work of the sources, both at the velocities half-way;
    `mean` (d,) is that of the species, in any frame that all of them share.
    """
    f, g = response(rate, dt, exponential)
    lost = 0.0
    dim = y.shape[1]
    for k in range(len(members)):
        i = members[k]
        for c in range(dim):
            rest, rest_source, line = y[k, c], b[k, c], dv[c]
            for a in range(dim):
                rest -= slope[a, c] * xi[k, a]
                rest_source -= source[a, c] * xi[k, a]
                line += dslope[a, c] * xi[k, a]
            change = line + f * rest + g * rest_source
            vel[i, c] += dt * acc[i, c] + change
            lost -= m[k] * change * (mean[c] + y[k, c] + 0.5 * (dt * b[k, c] + change))
    return lost


@njit(cache=True, error_model="numpy")
def free_kick(members, vel, acc, dt):
    for i in members:
        for a in range(vel.shape[1]):
            vel[i, a] += dt * acc[i, a]


@njit(cache=True, error_model="numpy")
def relax_block(
    gas_members, gpos, gvel, gacc, gown, gmass, grho, gsound, first,
    dust_members, dpos, dvel, dacc, down, dmass, drho, dtime,
    linear, two_way, law, grains, nonlinear, dt, exponential, star, softening, corner, size, periodic, heat,
):  # fmt: skip
    """The kick of one block that holds both species; `first` (species + 1,) divides the dust by population."""
    n, dim = len(grains) + 1, gpos.shape[1]
    ng = len(gas_members)
    count = ng + len(dust_members)
    reference = star if linear else 0.0
    xi, y, b, m = np.empty((count, dim)), np.empty((count, dim)), np.empty((count, dim)), np.empty(count)
    pack(gpos, gvel, gown, gmass, gas_members, corner, size, periodic, reference, softening, xi, y, b, m)
    pack(
        dpos, dvel, down, dmass, dust_members, corner, size, periodic, reference, softening,
        xi[ng:], y[ng:], b[ng:], m[ng:],
    )  # fmt: skip
    bound = np.empty(n + 1, np.int64)
    bound[0] = 0
    for s in range(n):
        bound[s + 1] = first[s] - first[0] + ng
    mass, time = np.zeros(n), np.full(n, np.inf)
    x, v, acc = np.zeros((n, dim)), np.zeros((n, dim)), np.zeros((n, dim))
    centre(bound, xi, y, b, m, mass, x, v, acc)

    rho, sound, r2 = 0.0, 0.0, 0.0
    for i in gas_members:
        rho += grho[i] / ng
        sound += gsound[i] / ng
    for i in dust_members:
        for a in range(dim):
            r2 += dpos[i, a] * dpos[i, a] / len(dust_members)
    omega = kepler(r2, star, softening) if star > 0.0 else 0.0
    for s in range(1, n):
        if mass[s] > 0.0:
            ratio = mass[s] / mass[0]
            if len(drho) > 0:
                own = 0.0
                for k in range(bound[s], bound[s + 1]):
                    own += drho[dust_members[k - ng]] / (bound[s + 1] - bound[s])
                ratio = own / rho if own > 0.0 else ratio
            time[s] = stopping_time(law, grains[s - 1], ratio, rho, sound, omega)

    slope, source, dslope = np.zeros((n, dim, dim)), np.zeros((n, dim, dim)), np.zeros((n, dim, dim))
    inertia = np.zeros((n, dim, dim))
    pooled, pooled_source = np.zeros((dim, dim)), np.zeros((dim, dim))
    if linear:
        fit_slopes(bound, xi, y, b, m, two_way, inertia, slope, source, pooled, pooled_source)
    at, at_source = v.copy(), acc.copy()
    for s in range(1, n):  # what each species' velocity would be at the gas's centroid
        for a in range(dim):
            for c in range(dim):
                at[s, c] -= pooled[a, c] * (x[s, a] - x[0, a])
                at_source[s, c] -= pooled_source[a, c] * (x[s, a] - x[0, a])
    dv, lost = np.zeros((n, dim)), 0.0
    if nonlinear:
        relax_by_speed(mass, time, law, grains, rho, sound, omega, at, at_source, two_way, dt, exponential, dv)
    else:
        relax_means(mass, time, at, at_source, two_way, dt, exponential, dv)
    if linear:
        exchange_slopes(mass, time, inertia, slope, source, two_way, dt, exponential, dslope)
    half = v - v[0] + 0.5 * dt * (acc - acc[0])
    gas_rate = 0.0
    for s in range(1, n):
        if mass[s] > 0.0:
            gas_rate += mass[s] / mass[0] / time[s]
    if two_way:
        lost += apply(
            gas_members, y, b, m, half[0], xi, slope[0], source[0], dv[0], dslope[0],
            gas_rate, dt, exponential, gvel, gacc,
        )  # fmt: skip
    else:
        free_kick(gas_members, gvel, gacc, dt)
    for s in range(1, n):
        lo, hi = bound[s], bound[s + 1]
        members = dust_members[lo - ng : hi - ng]
        lost += apply(
            members, y[lo:hi], b[lo:hi], m[lo:hi], half[s], xi[lo:hi], slope[s], source[s], dv[s], dslope[s],
            1.0 / time[s], dt, exponential, dvel, dacc,
        )  # fmt: skip
        for i in members:
            dtime[i] = time[s]
    if len(heat) > 0:
        for i in gas_members:
            heat[i] = lost / mass[0]


@njit(nogil=True, cache=True, error_model="numpy")
def relax_blocks(
    block_from, block_to, gpos, gvel, gacc, gown, gmass, grho, gsound, gorder, gstart,
    dpos, dvel, dacc, down, dmass, drho, dorder, dstart, dtime,
    linear, two_way, law, grains, nonlinear, dt, exponential, star, softening, corners, size, periodic, heat,
):  # fmt: skip
    """The kick of all blocks: accelerations and drag together, velocities in place.

    gorder, gstart: gas by block; dorder, dstart: dust by block and, within it, by population. `own` arrays are the
    sources (accelerations not shared; no entries where there are none). Writes each dust particle's
    stopping time, inf where it has no gas, and, if `heat` has entries, the heat per mass of each gas particle.
    """
    n = len(grains)
    for block in range(block_from, block_to):
        gas = gorder[gstart[block] : gstart[block + 1]]
        first = dstart[block * n : (block + 1) * n + 1]
        dust = dorder[first[0] : first[n]]
        if len(gas) > 0 and len(dust) > 0:
            relax_block(
                gas, gpos, gvel, gacc, gown, gmass, grho, gsound, first,
                dust, dpos, dvel, dacc, down, dmass, drho, dtime, linear, two_way, law, grains, nonlinear, dt,
                exponential, star, softening, corners[block], size, periodic, heat,
            )  # fmt: skip
        else:
            free_kick(gas, gvel, gacc, dt)
            free_kick(dust, dvel, dacc, dt)
            for i in dust:
                dtime[i] = np.inf
