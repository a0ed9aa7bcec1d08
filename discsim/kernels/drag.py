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

CONSTANT, STOPPING_TIME, STOKES_NUMBER, EPSTEIN = range(4)
LAWS = {
    "constant": CONSTANT,
    "stopping-time": STOPPING_TIME,
    "stokes-number": STOKES_NUMBER,
    "epstein": EPSTEIN,
}


@njit(cache=True, error_model="numpy")
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


@njit(cache=True, error_model="numpy")
def stopping_times(law, value, mass_ratio, density, sound, omega):
    """`stopping_time` for arrays of density, sound speed and Omega (n,)."""
    out = np.empty(len(density))
    for i in range(len(density)):
        out[i] = stopping_time(law, value, mass_ratio, density[i], sound[i], omega[i])
    return out


@njit(cache=True, error_model="numpy")
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
        g = -dt * x * (0.5 - x * (1.0 / 6.0 - x * (1.0 / 24.0 - x * (1.0 / 120.0 - x / 720.0))))
        r = dt * dt * x * (1.0 / 3.0 - x * (0.25 - x * (7.0 / 60.0 - x / 24.0)))
    q = f * f / rate if rate > 0.0 else 0.0
    return f, g, -0.5 * f * (2.0 + f), q, r


@njit(cache=True, error_model="numpy")
def relax_pair(w0, w1, rate, y0, y1, b0, b1, dt, exponential):
    """Increments of two coupled velocities of weights w0, w1 beyond their free motion, and the energy lost."""
    f, g, p, q, r = response(rate, dt, exponential)
    y, b = y0 - y1, b0 - b1
    change = f * y + g * b
    total = w0 + w1
    return w1 / total * change, -w0 / total * change, w0 * w1 / total * (p * y * y + q * y * b + r * b * b)


@njit(cache=True, error_model="numpy")
def eigen(matrix):
    """Eigenvalues and orthonormal eigenvectors (columns) of a small symmetric matrix, which is overwritten.

    Jacobi's cyclic rotations (Golub & Van Loan, sec. 8.5): small rates keep their digits beside large ones, and
    a LAPACK call would cost every run ten seconds of compilation.
    """
    n = len(matrix)
    vectors = np.eye(n)
    for _ in range(50):
        done = True
        for i in range(n):
            for j in range(i + 1, n):
                if abs(matrix[i, j]) <= 1e-17 * math.sqrt(abs(matrix[i, i] * matrix[j, j])):
                    continue
                done = False
                theta = 0.5 * (matrix[j, j] - matrix[i, i]) / matrix[i, j]
                t = math.copysign(1.0, theta) / (abs(theta) + math.hypot(theta, 1.0))
                c = 1.0 / math.hypot(t, 1.0)
                s = c * t
                for k in range(n):
                    p, q = matrix[k, i], matrix[k, j]
                    matrix[k, i], matrix[k, j] = c * p - s * q, s * p + c * q
                for k in range(n):
                    p, q = matrix[i, k], matrix[j, k]
                    matrix[i, k], matrix[j, k] = c * p - s * q, s * p + c * q
                    p, q = vectors[k, i], vectors[k, j]
                    vectors[k, i], vectors[k, j] = c * p - s * q, s * p + c * q
        if done:
            break
    rates = np.empty(n)
    for i in range(n):
        rates[i] = matrix[i, i]
    return rates, vectors


@njit(cache=True, error_model="numpy")
def relax_many(weight, time, y, b, dt, exponential, change):
    """The same for gas (entry 0) and several populations (n, d): writes `change`, returns the energy lost.

    The coupling is a star graph; symmetrised with sqrt(weight) it has orthogonal modes, of which the
    resting one is the barycentre.
    """
    n = len(weight)
    root = np.empty(n)
    for i in range(n):
        root[i] = math.sqrt(weight[i])
    matrix = np.zeros((n, n))
    for j in range(1, n):
        k = weight[j] / time[j]
        matrix[0, 0] += k / weight[0]
        matrix[j, j] = k / weight[j]
        matrix[0, j] = matrix[j, 0] = -k / (root[0] * root[j])
    rates, modes = eigen(matrix)
    rest = 0  # the barycentre, which no drag moves
    for m in range(n):
        if rates[m] < rates[rest]:
            rest = m
    for i in range(n):
        for k in range(y.shape[1]):
            change[i, k] = 0.0
    lost = 0.0
    for m in range(n):
        if m == rest:
            continue
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
    """Relax two slopes (d, d) such that I_0 G_0 + I_1 G_1 stays: angular momentum within the block is kept.

    The difference relaxes at the means' rate; its weight is the parallel sum I_0 (I_0 + I_1)^-1 I_1.
    """
    dim = len(g0)
    f, g, p, q, r = response(rate, dt, exponential)
    share0, share1 = np.zeros((dim, dim)), np.zeros((dim, dim))
    total = np.empty((dim, dim))
    for a in range(dim):
        for c in range(dim):
            total[a, c] = i0[a, c] + i1[a, c]
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


@njit(cache=True, error_model="numpy")
def follow_gas(time, y, by, slope, source, dt, exponential, dv, dslope):
    """One-way: every population towards the gas's mean and slope, which stay what they are."""
    for s in range(1, len(time)):
        f, g, _, _, _ = response(1.0 / time[s], dt, exponential)
        for c in range(y.shape[1]):
            dv[s, c] = f * (y[s, c] - y[0, c]) + g * (by[s, c] - by[0, c])
            for a in range(y.shape[1]):
                change, change_source = slope[s, a, c] - slope[0, a, c], source[s, a, c] - source[0, a, c]
                dslope[s, a, c] = f * change + g * change_source


@njit(cache=True, error_model="numpy")
def exchange(mass, time, y, by, inertia, slope, source, dt, exponential, dv, dslope):
    """Two-way: means and slopes of gas and of the populations present relax together; the energy lost."""
    dim = y.shape[1]
    present = np.empty(len(mass), np.int64)
    count = 0
    for s in range(len(mass)):
        if mass[s] > 0.0:
            present[count] = s
            count += 1
    lost = 0.0
    if count == 2:
        s = present[1]
        rate = (1.0 + mass[s] / mass[0]) / time[s]
        for c in range(dim):
            dv[0, c], dv[s, c], heat = relax_pair(
                mass[0], mass[s], rate, y[0, c], y[s, c], by[0, c], by[s, c], dt, exponential
            )
            lost += heat
        return lost + relax_slopes(
            inertia[0], inertia[s], rate, slope[0], slope[s], source[0], source[s],
            dt, exponential, dslope[0], dslope[s],
        )  # fmt: skip
    # First the means, weighed with mass, then the slopes along each axis, weighed with the moments of inertia.
    weight, times = np.empty(count), np.empty(count)
    part, part_source, change = np.empty((count, dim)), np.empty((count, dim)), np.empty((count, dim))
    for axis in range(-1, dim):
        least, most = np.inf, 0.0
        for k in range(count):
            s = present[k]
            times[k] = time[s]
            weight[k] = mass[s]
            if axis >= 0:
                weight[k] = inertia[s, 0, 0] + (inertia[s, 1, 1] if dim == 2 else 0.0)
            least, most = min(least, weight[k]), max(most, weight[k])
            for c in range(dim):
                part[k, c] = y[s, c] if axis < 0 else slope[s, axis, c]
                part_source[k, c] = by[s, c] if axis < 0 else source[s, axis, c]
        if axis >= 0 and least <= 1e-6 * most:
            continue  # a population on one point has no slope of its own
        lost += relax_many(weight, times, part, part_source, dt, exponential, change)
        for k in range(count):
            for c in range(dim):
                if axis < 0:
                    dv[present[k], c] = change[k, c]
                else:
                    dslope[present[k], axis, c] = change[k, c]
    return lost


@njit(cache=True, error_model="numpy")
def apply(members, y, b, m, xi, slope, source, dv, dslope, rate, dt, exponential, vel, acc):
    """Free kick, the change of the species' line, and what is left of each particle, eq. (2); the energy lost."""
    f, g, p, q, r = response(rate, dt, exponential)
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
            vel[i, c] += dt * acc[i, c] + (line + f * rest + g * rest_source)
            lost += m[k] * (p * rest * rest + q * rest * rest_source + r * rest_source * rest_source)
    return lost


@njit(cache=True, error_model="numpy")
def free_kick(members, vel, acc, dt):
    for i in members:
        for a in range(vel.shape[1]):
            vel[i, a] += dt * acc[i, a]


@njit(cache=True, error_model="numpy")
def relax_block(
    gas_members, gpos, gvel, gacc, gown, gmass, grho, gsound, first,
    dust_members, dpos, dvel, dacc, down, dmass, dtime,
    linear, two_way, law, values, dt, exponential, star, softening, corner, size, periodic, heat,
):  # fmt: skip
    """The kick of one block that holds both species; `first` (species + 1,) divides the dust by population."""
    n, dim = len(values) + 1, gpos.shape[1]
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
    gas_rate = 0.0
    for s in range(1, n):
        if mass[s] > 0.0:
            time[s] = stopping_time(law, values[s - 1], mass[s] / mass[0], rho, sound, omega)
            gas_rate += mass[s] / mass[0] / time[s]

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
    if two_way:
        lost += exchange(mass, time, at, at_source, inertia, slope, source, dt, exponential, dv, dslope)
        lost += apply(
            gas_members, y, b, m, xi, slope[0], source[0], dv[0], dslope[0],
            gas_rate, dt, exponential, gvel, gacc,
        )  # fmt: skip
    else:
        follow_gas(time, at, at_source, slope, source, dt, exponential, dv, dslope)
        free_kick(gas_members, gvel, gacc, dt)
    for s in range(1, n):
        lo, hi = bound[s], bound[s + 1]
        members = dust_members[lo - ng : hi - ng]
        lost += apply(
            members, y[lo:hi], b[lo:hi], m[lo:hi], xi[lo:hi], slope[s], source[s], dv[s], dslope[s],
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
    dpos, dvel, dacc, down, dmass, dorder, dstart, dtime,
    linear, two_way, law, values, dt, exponential, star, softening, corners, size, periodic, heat,
):  # fmt: skip
    """The kick of all blocks: accelerations and drag together, velocities in place.

    gorder, gstart: gas by block; dorder, dstart: dust by block and, within it, by population. `own` arrays are the
    sources (accelerations not shared; no entries where there are none). Writes each dust particle's
    stopping time, inf where it has no gas, and, if `heat` has entries, the heat per mass of each gas particle.
    """
    n = len(values)
    for block in range(block_from, block_to):
        gas = gorder[gstart[block] : gstart[block + 1]]
        first = dstart[block * n : (block + 1) * n + 1]
        dust = dorder[first[0] : first[n]]
        if len(gas) > 0 and len(dust) > 0:
            relax_block(
                gas, gpos, gvel, gacc, gown, gmass, grho, gsound, first,
                dust, dpos, dvel, dacc, down, dmass, dtime, linear, two_way, law, values, dt, exponential,
                star, softening, corners[block], size, periodic, heat,
            )  # fmt: skip
        else:
            free_kick(gas, gvel, gacc, dt)
            free_kick(dust, dvel, dacc, dt)
            for i in dust:
                dtime[i] = np.inf
