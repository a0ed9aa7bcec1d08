"""SPH sums over packed neighbours: density with its smoothing length, and pressure, viscosity and conduction.

    rho_i   = sum_j m_j W(r_ij, h_i),   h_i = eta (m_i / rho_i)^(1/d)                               (1)
    Omega_i = 1 + h_i / (d rho_i) sum_j m_j dW/dh_i                                                 (2)
    dv_i/dt = -sum_j m_j [P_i / (Omega_i rho_i^2) grad W(h_i) + P_j / (Omega_j rho_j^2) grad W(h_j)]  (3)
    du_i/dt = P_i / (Omega_i rho_i^2) sum_j m_j v_ij . grad W(h_i)                                  (4)
    Pi_ij   = (-alpha c_ij w + beta w^2) / rho_ij,   w = min(0, v_ij . r_ij / r_ij)                   (5)
              with `receding` = 1 the first w is that of all pairs (Lodato & Price 2010): on approaching pairs
              alone the shear of a disc makes a pressure of it, and twice the noise at one shear viscosity

(1-4): Springel & Hernquist 2002; Price 2012, eqs. 10, 27, 30, 36. (5): Monaghan 1997, with the mean of the two
kernels' gradients; Balsara 1995 multiplies it by f = |div v| / (|div v| + |curl v| + 1e-4 c/h). Conduction:
Price 2008, eq. 28.

h goes from step to step by so little that one sum over the neighbours is nearly always enough: with its first two
derivatives in h the root of (1) is known to third order in the change, and rho and Omega follow by their series.

All sums gather (each particle sums over its own neighbours, in a fixed order), so that they are bitwise the
same on any number of threads. Candidates of a cell are packed once, relative to the cell's centre, and serve
every particle of it.
"""

import functools
import math

import numpy as np
from numba import njit

from discsim.kernels.neighbours import LANES, place, whole
from discsim.kernels.smoothing import NORM, SUPPORT, bend, shape

# No 'nnan'/'ninf': a run that goes wrong must still be seen to.
# Drivers take error_model="numpy": with Python's, a division may raise, and no loop with one is vectorised.
FAST = {"reassoc", "contract", "arcp", "nsz"}
TOLERANCE = 4e-3  # of h, on the last step; the error left is some times its cube
ITERATIONS = 60
# Where nearly all of rho is that of particles at one place, h hangs on the edge of its support: pressure felt through
# it would be stiffer by 1 / Omega than the step allows. Discs, shocks and collapses have .16 and more.
LEAST_OMEGA = 0.05
# Means of 1 / rho and of grad W, each over a pair, are much more than the mean of grad W / rho where a light particle
# sits on a heavy one: its kernel is narrow, and the other's density low. Viscosity and conduction, which no step would
# then resolve, have this many times that mean at most; even gas has 1, and that of equal masses needs no such bound.
MOST_UNEVEN = 4.0
NEAREST2 = 1e-30  # least square of a distance, in units of the cell's reach: single precision has to hold it
NO_VISCOSITY, APPROACHING, ALL_PAIRS = range(3)

# A pack holds what sums read of up to CHUNK candidates, and what their loops hand on to each other: a long chain of
# instructions keeps a processor waiting, where some short loops over the same candidates do not. Its rows are of one
# array, and the distance between them is known when it is compiled: so loops that write are vectorised too.
CHUNK = 256
STRIDE = CHUNK + 2 * LANES  # no power of two: rows would push each other out of the cache
MASS, INV_H, NORM_H, PRESS, VX, VY, INV_RHO, SOUND, SWITCH, ENERGY, P = range(11)  # columns of `force_columns` too
X, Y, INV_R, Q, OWN, OTHER = range(P + 1, P + 7)
ROWS = OTHER + 1


@njit(inline="always")
def inverse_root(x):
    """1 / sqrt(x) to rounding: a guess in single precision, for which there is an instruction, and one step."""
    y = np.float64(np.float32(1.0) / np.sqrt(np.float32(x)))
    e = 1.0 - x * y * y
    return y + y * e * (0.5 + 0.375 * e)


@njit(inline="always")
def add_density(kernel, dim, shear, x, y, vx, vy, inv_h, n, pack, sums):
    """Add n packed candidates' share of what `in_units_of_density` takes to `sums` (7,)."""
    total, first, second, div, curl, more_div, more_curl = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(n):
        dx, dy = x - pack[X * STRIDE + k], y - pack[Y * STRIDE + k]
        r2 = dx * dx + (dy * dy + NEAREST2)
        inv_r = inverse_root(r2)
        pack[INV_R * STRIDE + k] = inv_r
        pack[Q * STRIDE + k] = r2 * inv_r * inv_h
    for k in range(n):
        q, m = pack[Q * STRIDE + k], pack[MASS * STRIDE + k]
        w, dw = shape(kernel, dim, q)
        ddw = q * bend(kernel, dim, q)
        total += m * w
        first += m * (q * dw)
        second += m * (q * ddw)
        if shear:
            dx, dy, m_per_r = x - pack[X * STRIDE + k], y - pack[Y * STRIDE + k], m * pack[INV_R * STRIDE + k]
            dvx, dvy = vx - pack[VX * STRIDE + k], vy - pack[VY * STRIDE + k]
            along, across = m_per_r * (dvx * dx + dvy * dy), m_per_r * (dvy * dx - dvx * dy)
            div += dw * along
            curl += dw * across
            more_div += ddw * along
            more_curl += ddw * across
    sums[0] += total
    sums[1] += first
    sums[2] += second
    if shear:
        sums[3] += div
        sums[4] += curl
        sums[5] += more_div
        sums[6] += more_curl


@njit(inline="always")
def in_units_of_density(kernel, dim, sums):
    """Of a particle's sums: h^d rho, (h / rho) drho/dh, (h^2 / rho) d2rho/dh2, and h div v, h curl v.

    The last two values are those two's slopes, as much of the velocity's derivatives per relative change of h.
    """
    rate = 1.0 / sums[0]
    first, div, curl = sums[1] * rate, sums[3] * rate, sums[4] * rate
    slope = -(dim + first)
    curve = dim * (dim + 1) + 2 * (dim + 1) * first + sums[2] * rate
    more_div, more_curl = (first - 1.0) * div - sums[5] * rate, (first - 1.0) * curl - sums[6] * rate
    return NORM[dim - 1][kernel] * sums[0], slope, curve, div, curl, more_div, more_curl


@njit(inline="always")
def improve(dim, m, h, eta, h_least, h_most, low, high, rho, slope, curve):
    """(settled, step, h, rho, Omega, low, high): a third-order step to the root of eq. (1), between its bounds.

    Where it is short enough, rho and Omega are taken along by their series. `step` is relative to h.
    """
    inv_h = 1.0 / h
    # eq. (1) is t = 1 with t = (eta / h) (m / rho)^(1/d); h - t h has the slope `rise`.
    t = eta * inv_h * (m / rho if dim == 1 else math.sqrt(m / rho))
    # A lone particle, or a crowd at one place, where (1) has no root: h stays at its limit, as if fixed.
    if (t >= 1.0 and h >= h_most) or (t <= 1.0 and h <= h_least):
        return True, 0.0, h, rho, 1.0, low, high
    rise = 1.0 + t * slope / dim
    step = (t - 1.0) / rise
    if step != step:  # no number: h stays rather than grow to its limit, and the step's limit will see it
        return True, 0.0, h, rho, 1.0, low, high
    if abs(step) <= TOLERANCE and h + h * step > h_least:
        step *= 1.0 - 0.5 * step * t / dim * (curve - (1.0 + 1.0 / dim) * slope * slope) / rise
        step = min(step, h_most * inv_h - 1.0)
        grown = 1.0 + step * (slope + 0.5 * step * curve)
        omega = 1.0 + (1.0 + step) * (slope + step * curve) / (dim * grown)
        return True, step, h * (1.0 + step), rho * grown, max(omega, LEAST_OMEGA), low, high
    if t < 1.0:
        high = h
    else:
        low = h
    new = min(max(h + h * min(max(step, -0.3), 0.5), h_least), h_most)
    if not low < new < high:
        new = 0.5 * (low + high) if high < np.inf else min(1.5 * low, h_most)
    return False, 0.0, new, rho, 1.0 + slope / dim, low, high


@functools.cache
def density_driver(kernel: int, dim: int, shear: bool):
    """Compile the pass that gives each particle its h, density and Omega, and with `shear` |div v| and |curl v|.

    `outgrown` (cells,) says where a particle wants an h that its list of candidates does not reach for.
    """
    support = SUPPORT[kernel]

    @njit(nogil=True, cache=True, fastmath=FAST, error_model="numpy")
    def density(
        first, last, lists, filled, pos, vel, mass, h, rho, gradh, div, curl, eta, h_least, h_most, fixed, cells,
        outgrown,
    ):  # fmt: skip
        order, start, radius, bounds = cells.order, cells.start, cells.radius, cells.bounds
        begin, index, turned = lists
        pack = np.zeros(ROWS * STRIDE)
        cx, cy = pack[X * STRIDE :], pack[Y * STRIDE :]
        most = 0
        for c in range(first, last):
            most = max(most, start[filled[c] + 1] - start[filled[c]])
        sums, low, high, settled = np.empty((most, 7)), np.empty(most), np.empty(most), np.empty(most, np.bool_)
        for c in range(first, last):
            cell = filled[c]
            ox, oy, unit = bounds[cell, 0], bounds[cell, 1], bounds[cell, 4]
            per_unit = 1.0 / unit
            own, members = start[cell], start[cell + 1] - start[cell]
            for p in range(members):
                settled[p], low[p], high[p] = False, 0.0, np.inf
                if not fixed:
                    h[order[own + p]] = min(max(h[order[own + p]], h_least), h_most)
            for _ in range(ITERATIONS):
                sums[:members] = 0.0
                for listed in range(begin[c - first], begin[c - first + 1], CHUNK):
                    end = min(listed + CHUNK, begin[c - first + 1])
                    place(listed, end, index, turned, pos, ox, oy, per_unit, cells, cx, cy)
                    for k in range(listed, end):
                        j = index[k]
                        pack[MASS * STRIDE + k - listed] = mass[j]
                        if shear:
                            pack[VX * STRIDE + k - listed] = vel[j, 0]
                            if dim == 2:
                                pack[VY * STRIDE + k - listed] = vel[j, 1]
                    n = whole(end - listed)
                    for k in range(end - listed, n):
                        pack[MASS * STRIDE + k] = 0.0
                    for p in range(members):
                        if settled[p]:
                            continue
                        i = order[own + p]
                        x, y, vx, vy = (pos[i, 0] - ox) * per_unit, 0.0, 0.0, 0.0
                        if dim == 2:
                            y = (pos[i, 1] - oy) * per_unit
                        if shear:
                            vx, vy = vel[i, 0], vel[i, 1] if dim == 2 else 0.0
                        add_density(kernel, dim, shear, x, y, vx, vy, unit / h[i], n, pack, sums[p])
                # Apart from the sums, whose loop need not wait for all these divisions.
                left = False
                for p in range(members):
                    if settled[p]:
                        continue
                    i = order[own + p]
                    per_h, step = 1.0 / h[i], 0.0
                    total, slope, curve, div_v, curl_v, more_div, more_curl = in_units_of_density(kernel, dim, sums[p])
                    rho[i], gradh[i], settled[p] = total * per_h**dim, 1.0, True
                    if not fixed:
                        settled[p], step, h[i], rho[i], gradh[i], low[p], high[p] = improve(
                            dim, mass[i], h[i], eta, h_least, h_most, low[p], high[p], rho[i], slope, curve
                        )
                    if shear:
                        div[i] = abs(div_v + step * more_div) * per_h
                        curl[i] = abs(curl_v + step * more_curl) * per_h
                    if support * h[i] > radius[own + p]:
                        outgrown[c], settled[p] = True, True
                    left |= not settled[p]
                if not left:
                    break

    return density


@njit(nogil=True, cache=True, error_model="numpy")
def force_columns(
    first, last, norm, vel, mass, h, rho, gradh, pressure, sound, div, curl, u, viscous, energetic, conductive, alpha,
    columns,
):  # fmt: skip
    """Write to `columns` (n, 11) what the sums of a scene read of each particle."""
    dim = vel.shape[1]
    for i in range(first, last):
        inv_h, inv_rho = 1.0 / h[i], 1.0 / rho[i]
        columns[i, MASS], columns[i, INV_H] = mass[i], inv_h
        columns[i, NORM_H] = mass[i] * norm * (inv_h * inv_h * inv_h if dim == 2 else inv_h * inv_h)
        columns[i, PRESS] = pressure[i] * inv_rho * inv_rho / gradh[i]
        if viscous != NO_VISCOSITY or energetic:
            columns[i, VX], columns[i, VY] = vel[i, 0], vel[i, 1] if dim == 2 else 0.0
        columns[i, INV_RHO] = inv_rho
        if viscous != NO_VISCOSITY:
            columns[i, SOUND], columns[i, SWITCH] = alpha * sound[i], 1.0
            if len(div) > 0:
                columns[i, SWITCH] = div[i] / (div[i] + curl[i] + 1e-4 * sound[i] * inv_h)
        if conductive:
            columns[i, ENERGY], columns[i, P] = u[i], pressure[i]


@njit(inline="always")
def force_sums(
    kernel, dim, viscous, energetic, conductive, uneven, x, y, unit, i, columns, beta, alpha_u, n, pack
):  # fmt: skip
    """Sums of particle i over n candidates, in units of `unit`: acceleration, du/dt, divergence and the rate at which
    conduction takes u towards that of its neighbours.
    """
    norm, inv_h = columns[i, NORM_H] / columns[i, MASS], columns[i, INV_H] * unit
    press, inv_rho_i, c_i = columns[i, PRESS] * norm, columns[i, INV_RHO], columns[i, SOUND]
    vx, vy, f_i, u_i, p_i = columns[i, VX], columns[i, VY], columns[i, SWITCH], columns[i, ENERGY], columns[i, P]
    conducted = 0.25 * math.sqrt(0.5) * alpha_u  # with the halves of the means over a pair, as is `beta`
    ax, ay, rate, div, conduction = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(n):
        dx, dy = x - pack[X * STRIDE + k], y - pack[Y * STRIDE + k]
        r2 = dx * dx + (dy * dy + NEAREST2)
        inv_r = inverse_root(r2)
        pack[INV_R * STRIDE + k] = inv_r
        pack[Q * STRIDE + k] = r2 * inv_r
    for k in range(n):
        r = pack[Q * STRIDE + k]
        _, own = shape(kernel, dim, r * inv_h)
        _, other = shape(kernel, dim, r * pack[INV_H * STRIDE + k])
        pack[OWN * STRIDE + k] = own * pack[MASS * STRIDE + k]
        pack[OTHER * STRIDE + k] = other * pack[NORM_H * STRIDE + k]
    for k in range(n):
        dx, dy = x - pack[X * STRIDE + k], y - pack[Y * STRIDE + k]
        inv_r, own, other = pack[INV_R * STRIDE + k], pack[OWN * STRIDE + k], pack[OTHER * STRIDE + k]
        force = press * own + pack[PRESS * STRIDE + k] * other
        if viscous != NO_VISCOSITY or energetic:
            w = ((vx - pack[VX * STRIDE + k]) * dx + (vy - pack[VY * STRIDE + k]) * dy) * inv_r
            div += w * own
            heat = press * own * w
            if viscous != NO_VISCOSITY or conductive:
                inv_rho_j = pack[INV_RHO * STRIDE + k]
                inv_rho, both = inv_rho_i + inv_rho_j, norm * own + other
                strength = inv_rho * both
                if uneven:
                    strength = max(strength, MOST_UNEVEN * (inv_rho_i * norm * own + inv_rho_j * other))  # below 0
            if viscous != NO_VISCOSITY:
                mu = min(w, 0.0)
                felt = w if viscous == ALL_PAIRS else mu
                pi = beta * mu * mu - (c_i + pack[SOUND * STRIDE + k]) * felt  # eq. (5)
                pi *= (f_i + pack[SWITCH * STRIDE + k]) * strength
                force += pi
                heat += 0.5 * pi * felt
            if conductive:
                signal = math.sqrt(abs(p_i - pack[P * STRIDE + k]) * inv_rho)
                passed = conducted * signal * strength
                conduction -= passed
                heat += passed * (u_i - pack[ENERGY * STRIDE + k])
            if energetic:
                rate += heat
        force *= inv_r
        ax -= force * dx
        ay -= force * dy
    return ax, ay, rate, -div * norm * inv_rho_i, conduction


@functools.cache
def force_driver(kernel: int, dim: int, viscous: int, energetic: bool, conductive: bool, uneven: bool):
    """Compile eqs. (3-5), leaving out what the scene does not name; `uneven`: masses may differ.

    Adds to `acc` (n, d) and, for gas with energy, to `rate` (n,); writes the velocity divergence, and the rate of
    conduction where there is any. Takes the cells whose `met` is `now` alone.
    """
    moving, rubbing = viscous != NO_VISCOSITY or energetic, viscous != NO_VISCOSITY

    @njit(nogil=True, cache=True, fastmath=FAST, error_model="numpy")
    def forces(first, last, lists, pos, columns, acc, rate, div, conduction, beta, alpha_u, cells, met, now):
        order, start, bounds = cells.order, cells.start, cells.bounds
        begin, index, turned = lists
        pack = np.zeros(ROWS * STRIDE)
        cx, cy = pack[X * STRIDE :], pack[Y * STRIDE :]
        for c in range(first, last):
            cell = cells.filled[c]
            if met[cell] != now:
                continue
            ox, oy, unit = bounds[cell, 0], bounds[cell, 1], bounds[cell, 4]
            per_unit = 1.0 / unit
            for listed in range(begin[c - first], begin[c - first + 1], CHUNK):
                end = min(listed + CHUNK, begin[c - first + 1])
                place(listed, end, index, turned, pos, ox, oy, per_unit, cells, cx, cy)
                for k in range(listed, end):
                    j, to = index[k], k - listed
                    pack[MASS * STRIDE + to] = columns[j, MASS]
                    pack[INV_H * STRIDE + to] = columns[j, INV_H] * unit
                    pack[NORM_H * STRIDE + to] = columns[j, NORM_H]
                    pack[PRESS * STRIDE + to] = columns[j, PRESS]
                    if moving:
                        pack[VX * STRIDE + to], pack[VY * STRIDE + to] = columns[j, VX], columns[j, VY]
                    if rubbing or conductive:
                        pack[INV_RHO * STRIDE + to] = columns[j, INV_RHO]
                    if rubbing:
                        pack[SOUND * STRIDE + to], pack[SWITCH * STRIDE + to] = columns[j, SOUND], columns[j, SWITCH]
                    if conductive:
                        pack[ENERGY * STRIDE + to], pack[P * STRIDE + to] = columns[j, ENERGY], columns[j, P]
                n = whole(end - listed)
                for k in range(end - listed, n):
                    pack[MASS * STRIDE + k], pack[NORM_H * STRIDE + k] = 0.0, 0.0
                for k in range(start[cell], start[cell + 1]):
                    i = order[k]
                    x, y = (pos[i, 0] - ox) * per_unit, 0.0
                    if dim == 2:
                        y = (pos[i, 1] - oy) * per_unit
                    ax, ay, r, d, passed = force_sums(
                        kernel, dim, viscous, energetic, conductive, uneven, x, y, unit, i, columns, beta, alpha_u, n,
                        pack,
                    )  # fmt: skip
                    acc[i, 0] += ax
                    if dim == 2:
                        acc[i, 1] += ay
                    if energetic:
                        rate[i] += r
                    if viscous != NO_VISCOSITY or energetic:
                        div[i] += d
                    if conductive:
                        conduction[i] += passed

    return forces


@njit(nogil=True, cache=True, error_model="numpy")
def step_limit(first, last, lengths, squeezed, sound, acc, before, divergence, alpha, beta):
    """The least of h / (c_s (1 + 1.2 alpha) + h (1 + 1.2 beta) max(0, -div v)) and sqrt(h / |a|), a = acc - before.

    h is `lengths` (n,) over `squeezed`, which says how much longer the kernel's own are than others mean theirs.
    """
    limit = np.inf
    for i in range(first, last):
        h = lengths[i] / squeezed
        closing = h * (1.0 + 1.2 * beta) * max(0.0, -divergence[i])
        limit = least(limit, h / (sound[i] * (1.0 + 1.2 * alpha) + closing))
        strength2 = 0.0
        for axis in range(acc.shape[1]):
            strength2 += (acc[i, axis] - before[i, axis]) ** 2
        limit = least(limit, math.sqrt(h / math.sqrt(strength2)))
    return limit


@njit(inline="always")
def least(a, b):
    """The smaller of two; what is no number stays none."""
    return a if a <= b or a != a else b
