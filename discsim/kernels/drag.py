"""Implicit drag in cells: exact relaxation of gas and dust in a block, with the accelerations inside.

In a block the species s have masses M_s, centroids X_s, mean velocities V_s and sources A_s, and (linear scheme) slopes
G_s, H_s of velocity and source about their own centroids. With e_j = M_j / M_g

    dV_g/dt = A_g + sum_j e_j (V_j - V_g) / t_j,    dV_j/dt = A_j + (V_g - V_j) / t_j                 (1)

is solved exactly over dt for V_s compared at one common point, V_s - G (X_s - X), G the slope pooled within species;
the slopes' difference relaxes the same way, weighed with the moments of inertia, so that
sum_s I_s G_s stays; what is left of a particle's velocity is damped towards its own species' line:

    r_i' = r_i exp(-dt/t) + b_i t (1 - exp(-dt/t)),   1/t = 1/t_j for dust, sum_j e_j / t_j for gas    (2)

(1), (2) with G = 0 are Stoyanovskaya et al. 2018, sec. 3.3 (individual accelerations); the exact exponential replaces their
implicit Euler, which stays selectable. Sources are the accelerations that gas and dust do not share.
"""

import functools
import math

import numpy as np
from numba import njit, prange

CONSTANT, STOPPING_TIME, STOKES_NUMBER, EPSTEIN = range(4)
LAWS = {
    "constant": CONSTANT,
    "stopping-time": STOPPING_TIME,
    "stokes-number": STOKES_NUMBER,
    "epstein": EPSTEIN,
}


@njit(inline="always")
def stopping_time(law, value, mass_ratio, density, sound, omega):
    """Stopping time of the dust in a block.

    constant: value = K, t = rho_d / K with rho_d = e rho_g. stokes-number: t = St / Omega. epstein: value =
    s rho_s times the convention's factor, t = value / (c_s rho_g), in 2D with rho_g = Sigma Omega / (sqrt(2 pi) c_s).
    """
    if law == CONSTANT:
        return mass_ratio * density / value
    if law == STOPPING_TIME:
        return value
    if law == STOKES_NUMBER:
        return value / omega
    if omega > 0.0:
        return value * math.sqrt(2.0 * math.pi) / (density * omega)
    return value / (sound * density)


@njit(cache=True)
def stopping_times(law, value, mass_ratio, density, sound, omega):
    """`stopping_time` for arrays of density, sound speed and Omega (n,)."""
    out = np.empty(len(density))
    for i in range(len(density)):
        out[i] = stopping_time(law, value, mass_ratio, density[i], sound[i], omega[i])
    return out


@njit(cache=True)
def response(rate, dt, exponential):
    """What dy/dt = b - rate y does beyond the free y + b dt: (f, g, p, q, r).

    y' = y + b dt + f y + g b; energy lost to the drag, rate * integral of y^2 dt = p y^2 + q y b + r b^2.
    """
    x = rate * dt
    if not exponential:
        low = 1.0 / (1.0 + x)
        g = dt * low
        return -x * low, -x * g, 0.5 * x * low * (1.0 + low), 0.5 * x * g * (1.0 + 2.0 * low), 0.5 * x * g * g
    f = math.expm1(-x)
    if x > 1e-2:
        g = -f / rate - dt
        r = (x + f - 0.5 * f * f) / rate / rate
    else:
        g = -dt * x * (0.5 - x * (1.0 / 6.0 - x * (1.0 / 24.0 - x / 120.0)))
        r = dt * dt * x * (1.0 / 3.0 - x * (0.25 - x * (7.0 / 60.0 - x / 24.0)))
    q = f * f / rate if rate > 0.0 else 0.0
    return f, g, -0.5 * f * (2.0 + f), q, r


@njit(cache=True)
def relax_pair(w0, w1, rate, y0, y1, b0, b1, dt, exponential):
    """Increments of two coupled velocities of weights w0, w1 beyond their free motion, and the energy lost."""
    f, g, p, q, r = response(rate, dt, exponential)
    y, b = y0 - y1, b0 - b1
    change = f * y + g * b
    total = w0 + w1
    return w1 / total * change, -w0 / total * change, w0 * w1 / total * (p * y * y + q * y * b + r * b * b)


@njit(cache=True)
def relax_many(weight, time, y, b, dt, exponential, change):
    """The same for gas (entry 0) and several populations (n, d): writes `change`, returns the energy lost.

    The coupling is a star graph; symmetrised with sqrt(weight) it has orthogonal modes, of which the
    resting one is the barycentre.
    """
    n = len(weight)
    root = np.sqrt(weight)
    matrix = np.zeros((n, n))
    for j in range(1, n):
        k = weight[j] / time[j]
        matrix[0, 0] += k / weight[0]
        matrix[j, j] = k / weight[j]
        matrix[0, j] = matrix[j, 0] = -k / (root[0] * root[j])
    rates, modes = np.linalg.eigh(matrix)
    rates[0] = 0.0
    change[:] = 0.0
    lost = 0.0
    for m in range(1, n):
        f, g, p, q, r = response(rates[m], dt, exponential)
        for k in range(y.shape[1]):
            c, s = 0.0, 0.0
            for i in range(n):
                c += modes[i, m] * root[i] * y[i, k]
                s += modes[i, m] * root[i] * b[i, k]
            lost += p * c * c + q * c * s + r * s * s
            for i in range(1, n):
                change[i, k] += modes[i, m] / root[i] * (f * c + g * s)
    for k in range(y.shape[1]):
        for i in range(1, n):
            change[0, k] -= weight[i] / weight[0] * change[i, k]
    return lost


@njit(inline="always")
def clip01(x):
    return min(max(x, 0.0), 1.0)


@njit(inline="always")
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


@njit(inline="always")
def local_frame(pos, i, corner, size, periodic, dim, star, softening, xi, ref):
    """Place of particle i in its block and the common reference velocity there: Kepler's about a star, or 0."""
    for a in range(dim):
        x = pos[i, a] - corner[a]
        if periodic:
            x -= size[a] * math.floor(x / size[a])
        xi[a] = x
        ref[a] = 0.0
    if star > 0.0 and dim == 2:
        d2 = pos[i, 0] * pos[i, 0] + pos[i, 1] * pos[i, 1] + softening * softening
        omega = math.sqrt(star / (d2 * math.sqrt(d2)))
        ref[0] = -omega * pos[i, 1]
        ref[1] = omega * pos[i, 0]


@functools.cache
def block_driver(dim: int, linear: bool, two_way: bool):
    """Compile the kick of all blocks: accelerations and drag together, on velocities in place.

    Species 0 is gas, 1.. the dust populations. `own_*` are the sources (the accelerations not shared),
    of no entries where there are none. Writes each dust particle's stopping time, each block's heat and dust mass
    without gas.
    """

    @njit(parallel=True, cache=True)
    def drag(
        gpos, gvel, gacc, gown, gmass, grho, gsound, gorder, gstart,
        dpos, dvel, dacc, down, dmass, dorder, dstart, dtime,
        corners, species, law, values, dt, exponential, star, softening, size, periodic, heat,
    ):  # fmt: skip
        # dstart counts populations within blocks: those of block b are dstart[b * species : (b + 1) * species + 1].
        for b in prange(len(corners)):
            g0, g1 = gstart[b], gstart[b + 1]
            d0, d1 = dstart[b * species], dstart[(b + 1) * species]
            if g0 == g1 or d0 == d1:
                for k in range(g0, g1):
                    for a in range(dim):
                        gvel[gorder[k], a] += dt * gacc[gorder[k], a]
                for k in range(d0, d1):
                    dtime[dorder[k]] = np.inf
                    for a in range(dim):
                        dvel[dorder[k], a] += dt * dacc[dorder[k], a]
                continue
            corner = corners[b]
            n = species + 1
            mass, number, time = np.zeros(n), np.zeros(n, np.int64), np.full(n, np.inf)
            x, v, acc = np.zeros((n, dim)), np.zeros((n, dim)), np.zeros((n, dim))
            xi, ref = np.empty(dim), np.empty(dim)
            rho, sound, dust_r2 = 0.0, 0.0, 0.0
            for s in range(n):
                first, last = (g0, g1) if s == 0 else (dstart[b * species + s - 1], dstart[b * species + s])
                for k in range(first, last):
                    i = gorder[k] if s == 0 else dorder[k]
                    m = gmass[i] if s == 0 else dmass[i]
                    local_frame(
                        gpos if s == 0 else dpos, i, corner, size, periodic, dim, star if linear else 0.0, softening, xi, ref
                    )
                    mass[s] += m
                    if s == 0:
                        rho += grho[i]
                        sound += gsound[i]
                    elif star > 0.0:
                        dust_r2 += m * (dpos[i, 0] ** 2 + dpos[i, dim - 1] ** 2)
                    for a in range(dim):
                        x[s, a] += m * xi[a]
                        v[s, a] += m * ((gvel[i, a] if s == 0 else dvel[i, a]) - ref[a])
                        if s == 0:
                            acc[s, a] += m * gown[i, a]
                        elif len(down) > 0:
                            acc[s, a] += m * down[i, a]
                number[s] = last - first
                if mass[s] > 0.0:
                    x[s] /= mass[s]
                    v[s] /= mass[s]
                    acc[s] /= mass[s]
            rho /= number[0]
            sound /= number[0]
            dust = mass[1:].sum()
            omega = 0.0
            if star > 0.0:
                d2 = dust_r2 / dust + softening * softening
                omega = math.sqrt(star / (d2 * math.sqrt(d2)))
            gas_rate = 0.0
            for s in range(1, n):
                if mass[s] > 0.0:
                    time[s] = stopping_time(law, values[s - 1], mass[s] / mass[0], rho, sound, omega)
                    gas_rate += mass[s] / mass[0] / time[s]

            # Slopes within species, and the pooled one.
            slope, source = np.zeros((n, dim, dim)), np.zeros((n, dim, dim))
            inertia = np.zeros((n, dim, dim))
            pooled, pooled_source = np.zeros((dim, dim)), np.zeros((dim, dim))
            if linear:
                moment, moment_source = np.zeros((n, dim, dim)), np.zeros((n, dim, dim))
                freedom = 0
                for s in range(n):
                    first, last = (g0, g1) if s == 0 else (dstart[b * species + s - 1], dstart[b * species + s])
                    for k in range(first, last):
                        i = gorder[k] if s == 0 else dorder[k]
                        m = gmass[i] if s == 0 else dmass[i]
                        local_frame(
                            gpos if s == 0 else dpos, i, corner, size, periodic, dim, star, softening, xi, ref
                        )
                        for a in range(dim):
                            for c in range(dim):
                                q = (gvel[i, c] if s == 0 else dvel[i, c]) - ref[c] - v[s, c]
                                own = gown[i, c] if s == 0 else (down[i, c] if len(down) > 0 else 0.0)
                                inertia[s, a, c] += m * (xi[a] - x[s, a]) * (xi[c] - x[s, c])
                                moment[s, a, c] += m * (xi[a] - x[s, a]) * q
                                moment_source[s, a, c] += m * (xi[a] - x[s, a]) * (own - acc[s, c])
                    freedom += max(number[s] - 1, 0)
                # One-way dust follows the gas's own slope.
                if not two_way:
                    freedom = number[0] - 1
                total = inertia.sum(axis=0) if two_way else inertia[0]
                fade = clip01((freedom - dim) / (3.0 * dim))
                sum_moment = moment.sum(axis=0) if two_way else moment[0]
                sum_source = moment_source.sum(axis=0) if two_way else moment_source[0]
                if fade > 0.0 and solve_slope(total, sum_moment, dim, pooled):
                    solve_slope(total, sum_source, dim, pooled_source)
                    pooled *= fade
                    pooled_source *= fade
                for s in range(n):
                    slope[s] = pooled
                    source[s] = pooled_source
                    fade = clip01((number[s] - 1.0 - dim) / (2.0 * dim))
                    fit, fit_source = np.empty((dim, dim)), np.empty((dim, dim))
                    if fade > 0.0 and solve_slope(inertia[s], moment[s], dim, fit):
                        solve_slope(inertia[s], moment_source[s], dim, fit_source)
                        slope[s] = fade * fit + (1.0 - fade) * pooled
                        source[s] = fade * fit_source + (1.0 - fade) * pooled_source

            # Means, compared at one point; only the slopes' difference matters for where that is.
            dv, lost = np.zeros((n, dim)), 0.0
            y, by = np.empty((n, dim)), np.empty((n, dim))
            for s in range(n):
                for c in range(dim):
                    y[s, c], by[s, c] = v[s, c], acc[s, c]
                    for a in range(dim):
                        y[s, c] -= pooled[a, c] * (x[s, a] - x[0, a])
                        by[s, c] -= pooled_source[a, c] * (x[s, a] - x[0, a])
            dslope = np.zeros((n, dim, dim))
            present = np.flatnonzero(mass > 0.0)
            if not two_way:
                for s in present[1:]:
                    f, g, _, _, _ = response(1.0 / time[s], dt, exponential)
                    for c in range(dim):
                        dv[s, c] = f * (y[s, c] - y[0, c]) + g * (by[s, c] - by[0, c])
                        for a in range(dim):
                            dslope[s, a, c] = f * (slope[s, a, c] - slope[0, a, c]) + g * (
                                source[s, a, c] - source[0, a, c]
                            )
            elif len(present) == 2:
                s = present[1]
                rate = (1.0 + mass[s] / mass[0]) / time[s]
                for c in range(dim):
                    dv[0, c], dv[s, c], e = relax_pair(
                        mass[0], mass[s], rate, y[0, c], y[s, c], by[0, c], by[s, c], dt, exponential
                    )
                    lost += e
                if linear:
                    lost += relax_slopes(
                        inertia[0], inertia[s], rate, slope[0], slope[s], source[0], source[s],
                        dt, exponential, dslope[0], dslope[s],
                    )  # fmt: skip
            else:
                change = np.zeros((len(present), dim))
                lost += relax_many(mass[present], time[present], y[present], by[present], dt, exponential, change)
                dv[present] = change
                if linear:
                    weight = np.empty(len(present))
                    for k in range(len(present)):
                        weight[k] = np.trace(inertia[present[k]])
                    if weight.min() > 1e-6 * weight.max():
                        for a in range(dim):
                            lost += relax_many(
                                weight, time[present], np.ascontiguousarray(slope[:, a])[present],
                                np.ascontiguousarray(source[:, a])[present], dt, exponential, change,
                            )  # fmt: skip
                            for k in range(len(present)):
                                dslope[present[k], a] = change[k]

            # Particles: their free kick, their species' line, and what is left of them, eq. (2).
            for s in range(n):
                if s == 0 and not two_way:
                    continue
                first, last = (g0, g1) if s == 0 else (dstart[b * species + s - 1], dstart[b * species + s])
                rate = gas_rate if s == 0 else 1.0 / time[s]
                f, g, p, q, r = response(rate, dt, exponential)
                for k in range(first, last):
                    i = gorder[k] if s == 0 else dorder[k]
                    m = gmass[i] if s == 0 else dmass[i]
                    local_frame(
                        gpos if s == 0 else dpos, i, corner, size, periodic, dim, star if linear else 0.0, softening, xi, ref
                    )
                    if s > 0:
                        dtime[i] = time[s]
                    for c in range(dim):
                        vel = gvel[i, c] if s == 0 else dvel[i, c]
                        own = gown[i, c] if s == 0 else (down[i, c] if len(down) > 0 else 0.0)
                        rest, rest_source, line = vel - ref[c] - v[s, c], own - acc[s, c], dv[s, c]
                        for a in range(dim):
                            z = xi[a] - x[s, a]
                            rest -= slope[s, a, c] * z
                            rest_source -= source[s, a, c] * z
                            line += dslope[s, a, c] * z
                        free = dt * (gacc[i, c] if s == 0 else dacc[i, c])
                        new = vel + (free + line + f * rest + g * rest_source)
                        lost += m * (p * rest * rest + q * rest * rest_source + r * rest_source * rest_source)
                        if s == 0:
                            gvel[i, c] = new
                        else:
                            dvel[i, c] = new
            if not two_way:
                for k in range(g0, g1):
                    for a in range(dim):
                        gvel[gorder[k], a] += dt * gacc[gorder[k], a]
            elif len(heat) > 0:
                for k in range(g0, g1):
                    heat[gorder[k]] += lost / mass[0]

    return drag


@njit(inline="always")
def relax_slopes(i0, i1, rate, g0, g1, h0, h1, dt, exponential, out0, out1):
    """Relax two slopes (d, d) such that I_0 G_0 + I_1 G_1 stays: angular momentum within the block is kept.

    The difference relaxes at the means' rate; its weight is the parallel sum I_0 (I_0 + I_1)^-1 I_1.
    """
    dim = len(g0)
    f, g, p, q, r = response(rate, dt, exponential)
    share0, share1 = np.zeros((dim, dim)), np.zeros((dim, dim))
    total = i0 + i1
    if not (solve_slope(total, i1, dim, share0) and solve_slope(total, i0, dim, share1)):
        return 0.0
    lost = 0.0
    for c in range(dim):
        for a in range(dim):
            for k in range(dim):
                change = f * (g0[k, c] - g1[k, c]) + g * (h0[k, c] - h1[k, c])
                out0[a, c] += share0[a, k] * change
                out1[a, c] -= share1[a, k] * change
                weight = 0.0
                for l in range(dim):
                    weight += i0[a, l] * share0[l, k]
                y1, y2 = g0[a, c] - g1[a, c], g0[k, c] - g1[k, c]
                b1, b2 = h0[a, c] - h1[a, c], h0[k, c] - h1[k, c]
                lost += weight * (p * y1 * y2 + q * y1 * b2 + r * b1 * b2)
    return lost
