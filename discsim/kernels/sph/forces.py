"""SPH sums over packed neighbours: density with its smoothing length, and pressure, viscosity and conduction.

    rho_i   = sum_j m_j W(r_ij, h_i),   h_i = eta (m_i / rho_i)^(1/d)                               (1)
    Omega_i = 1 + h_i / (d rho_i) sum_j m_j dW/dh_i                                                 (2)
    dv_i/dt = -sum_j m_j [P_i / (Omega_i rho_i^2) grad W(h_i) + P_j / (Omega_j rho_j^2) grad W(h_j)]  (3)
    du_i/dt = P_i / (Omega_i rho_i^2) sum_j m_j v_ij . grad W(h_i)                                  (4)
    Pi_ij   = (-alpha c_ij w + beta w^2) / rho_ij,   w = min(0, v_ij . r_ij / |r_ij|)                 (5)
    w_ij   -= 2 a b / (a + b) where a b > 0,   a = |r_ij| e . G_i e,   b = |r_ij| e . G_j e         (6)
    G_i     = A_i T_i^-1,   A_i = sum_j m_j W(r_ij, h_i) v_ij x r_ij,   T_i = sum_j m_j W(r_ij, h_i) r_ij x r_ij  (7)

With `pairs` "all" the first w of (5) is v_ij . r_ij / |r_ij| for all pairs (Lodato & Price 2010). On approaching pairs
alone this term is partly a pressure in the shear of a disc, with twice the noise at the same shear viscosity. With
reconstruction (6) applies to both terms of (5): w becomes the jump between velocities extrapolated to the middle of a
pair, and e = r_ij / |r_ij|. Viscous heating uses the full relative velocity of the pair.

(1-4): Springel & Hernquist 2002; Price 2012, eqs. 10, 27, 30, 36. (5): Monaghan 1997, with the mean of the two
kernels' gradients; Balsara 1995 multiplies it by f = |div v| / (|div v| + |curl v| + 1e-4 c/h). (6): Frontiere,
Raskin & Owen 2017 and Rosswog 2020, with the harmonic mean of both slopes as limiter (van Leer 1974). (7): the
gradient of Garcia-Senz, Cabezon & Escartin 2012, exact for linear flows, which hence have no viscosity. Conduction:
Price 2008, eq. 28. Shear viscosity nu: eq. (1) of `effects/alpha_viscosity.py`.

Each particle sums over its own neighbours, in a fixed order, so that results are bitwise the same on any number of
threads. The data of a cell's candidates are packed once for all its members, the particles of the cell (`packs.py`).
The sums of (1), (2) and (7) are in `density.py`.
"""

import functools
import math
from typing import NamedTuple

from discsim.jit.decorators import inline_sums, jit, jit_sums
from discsim.jit.index import index
from discsim.kernels.common.candidates import LANES, find_window, pack_positions, padded_count, slabs_per_length
from discsim.kernels.common.simd import prefetch
from discsim.kernels.sph.packs import (
    CHUNK,
    ENERGY,
    FLUIDITY,
    INV_H,
    INV_R,
    INV_RHO,
    MASS,
    NEAREST2,
    NORM_H,
    OTHER,
    OWN,
    PRESS,
    SOUND,
    STRIDE,
    SWITCH,
    SXX,
    SXY,
    SYY,
    VX,
    VY,
    P,
    R,
    X,
    Y,
    clear,
    inverse_sqrt,
)
from discsim.kernels.sph.smoothing import NORM, SQUEEZED, scaled_shape, shape_factors

# Viscosity and conduction of a pair contain the mean of 1 / rho times the mean of grad W. Where a light particle is
# very close to a heavy one, the kernel of the light one is narrow, and the density of the heavy one is low. The product
# is then much larger than the mean of grad W / rho, and no time step resolves it. It is limited to MOST_UNEVEN times
# the mean of grad W / rho. Their ratio is 1 in even gas, and equal masses need no limit.
MOST_UNEVEN = 4.0
NO_VISCOSITY, APPROACHING, ALL_PAIRS, RECONSTRUCTED = range(4)
# Factors 1/2 of the means over a pair, which are taken out of the sums.
ALPHA, BETA = 1.0 / 16.0, 1.0 / 8.0


class Strengths(NamedTuple):
    """Coefficients of dissipation and of the time-step limit."""

    beta: float  # of artificial viscosity
    conductivity: float  # alpha of artificial conductivity
    signal: float  # factor of c_s / h in the rate that limits the step
    closing: float  # factor of -div v in this rate
    shear: float  # 2 d / <q^2> of the kernel, a factor of shear viscosity


@jit
def write_force_columns(
    first, last, given, found, pressure, sound, u, nu, viscous, energetic, conductive, alpha, scale, order, columns
):  # fmt: skip
    """Write to `columns` (n, c), in cell order, the data of each particle that the force sums read.

    c is 8, 11 or 14 (see `packs.py`). The data are in units of `scale`. given, found: input and results of the
    density pass. alpha: coefficient alpha of artificial viscosity. nu (n,): shear viscosity; empty if there is none.
    """
    vel, mass, h, rho, gradh, div, curl = given.vel, given.mass, found.h, found.rho, found.gradh, found.div, found.curl
    dim = vel.shape[1]
    per_mass, per_speed, density = 1.0 / scale.mass, 1.0 / scale.speed, scale.mass / scale.length**dim
    per_pressure = per_speed * per_speed / density
    for k in range(index(first), index(last)):
        i = order[k]
        inv_h, inv_rho, press = 1.0 / h[i], density / rho[i], pressure[i] * per_pressure
        columns[k, MASS], columns[k, INV_H], columns[k, INV_RHO] = mass[i] * per_mass, scale.length * inv_h, inv_rho
        columns[k, PRESS] = press * inv_rho * inv_rho / gradh[i]
        if viscous != NO_VISCOSITY or energetic or len(nu) > 0:
            columns[k, VX], columns[k, VY] = vel[i, 0] * per_speed, vel[i, 1] * per_speed if dim == 2 else 0.0
        if viscous != NO_VISCOSITY:
            columns[k, SOUND], columns[k, SWITCH] = ALPHA * alpha * sound[i] * per_speed, 1.0
            if viscous == RECONSTRUCTED:
                per_rate = per_speed * scale.length
                columns[k, SXX] = found.slopes[i, 0] * per_rate
                columns[k, SXY] = 2.0 * found.slopes[i, 1] * per_rate
                columns[k, SYY] = found.slopes[i, 2] * per_rate
            if len(div) > 0:
                columns[k, SWITCH] = div[i] / (div[i] + curl[i] + 1e-4 * sound[i] * inv_h)
        if conductive:
            columns[k, ENERGY], columns[k, P] = u[i] * per_speed * per_speed, press
        if len(nu) > 0:
            columns[k, FLUIDITY] = inv_rho * (scale.speed * scale.length / nu[i])


@inline_sums
def pack_columns(dim, moving, viscous, conductive, shearing, indices, norm, frame, columns, pack):
    """Write to `pack` the data of the candidates `indices` that the force sums of a scene read.

    frame: (unit, ux, uy) of the cell: the unit of h in the pack, and the velocity that is subtracted.
    """
    unit, ux, uy = frame
    count, norm = index(len(indices)), norm / unit ** (dim + 1)
    for k in range(count):
        j = index(indices[k])
        m, inv_h = columns[j, MASS], columns[j, INV_H] * unit
        pack[MASS * STRIDE + k], pack[INV_H * STRIDE + k] = m, inv_h
        pack[NORM_H * STRIDE + k] = m * norm * (inv_h * inv_h * inv_h if dim == 2 else inv_h * inv_h)
        pack[PRESS * STRIDE + k] = columns[j, PRESS]
        if moving:
            pack[VX * STRIDE + k], pack[VY * STRIDE + k] = columns[j, VX] - ux, columns[j, VY] - uy
        if viscous != NO_VISCOSITY or conductive or shearing:
            pack[INV_RHO * STRIDE + k] = columns[j, INV_RHO]
        if viscous != NO_VISCOSITY:
            pack[SOUND * STRIDE + k], pack[SWITCH * STRIDE + k] = columns[j, SOUND], columns[j, SWITCH]
        if viscous == RECONSTRUCTED:
            pack[SXX * STRIDE + k] = columns[j, SXX] * unit
            pack[SXY * STRIDE + k] = columns[j, SXY] * unit
            pack[SYY * STRIDE + k] = columns[j, SYY] * unit
        if conductive:
            pack[ENERGY * STRIDE + k], pack[P * STRIDE + k] = columns[j, ENERGY], columns[j, P]
        if shearing:
            pack[FLUIDITY * STRIDE + k] = columns[j, FLUIDITY]
    for k in range(count, index(padded_count(len(indices)) + LANES)):  # padding that windows may reach
        pack[MASS * STRIDE + k], pack[NORM_H * STRIDE + k] = 0.0, 0.0


@inline_sums
def prefetch_columns(begin, indices, columns):
    """Prefetch the rows of `columns` of the next cell's candidates, for `pack_columns`.

    begin: beginnings of the candidate lists in `indices`, from the next cell on. `begin` has one entry if there is
    no next cell.
    """
    if len(begin) > 1:
        for k in range(index(begin[0]), index(begin[1])):
            prefetch(columns, indices[k] * index(columns.shape[1]))


@inline_sums
def pack_distances(single, x, y, n, pack):
    """Write to `pack` the distances of its n candidates from (x, y), and the inverse distances."""
    real = pack.dtype.type
    x, y = real(x), real(y)
    for k in range(n):
        dx, dy = x - pack[X * STRIDE + k], y - pack[Y * STRIDE + k]
        r2 = dx * dx + (dy * dy + NEAREST2)
        inv_r = inverse_sqrt(single, r2)
        pack[INV_R * STRIDE + k] = inv_r
        pack[R * STRIDE + k] = r2 * inv_r


@inline_sums
def pack_gradients(kernel, dim, inv_h, n, pack):
    """Write to `pack` two dW/dr for each pair: with the particle's 1/h, `inv_h`, and with that of the candidate.

    Masses are included. The norm is included only in the candidate's dW/dr; `force_sums` multiplies by the norm for
    the particle.
    """
    inv_h = pack.dtype.type(inv_h)
    for k in range(n):
        r = pack[R * STRIDE + k]
        _, own, _ = scaled_shape(kernel, dim, r * inv_h)
        _, other, _ = scaled_shape(kernel, dim, r * pack[INV_H * STRIDE + k])
        pack[OWN * STRIDE + k] = own * pack[MASS * STRIDE + k]
        pack[OTHER * STRIDE + k] = other * pack[NORM_H * STRIDE + k]


@inline_sums
def bounded_sum(uneven, own, other, inv_rho_i, inv_rho_j):
    """Return own + other, the sum of the terms by the two kernels of a pair.

    uneven: whether masses may differ; a lower bound with the factor MOST_UNEVEN then applies to the sum.
    """
    if uneven:
        return max(own + other, MOST_UNEVEN * (inv_rho_i * own + inv_rho_j * other) / (inv_rho_i + inv_rho_j))
    return own + other


@inline_sums
def harmonic(a, b):
    """Return the limiter of eq. (6): the harmonic mean 2 a b / (a + b) of two slopes, 0 where their signs differ."""
    return 2.0 * a * b / (a + b) if a * b > 0.0 else 0.0


@inline_sums
def limited_jump(viscous, slopes, dx, dy, inv_r, w, k, pack):
    """Return the relative velocity w of a pair along its separation, reduced by eq. (6) with reconstruction.

    slopes: xx, 2 xy and yy of the particle, in units of the pack. dx, dy, inv_r: separation. k: candidate in the pack.
    """
    if viscous != RECONSTRUCTED:
        return w
    xx, xy, yy = dx * dx * inv_r, dx * dy * inv_r, dy * dy * inv_r
    other = pack[SXX * STRIDE + k] * xx + pack[SXY * STRIDE + k] * xy + pack[SYY * STRIDE + k] * yy
    return w - harmonic(slopes[0] * xx + slopes[1] * xy + slopes[2] * yy, other)


@inline_sums
def force_sums(
    norm, dim, viscous, energetic, conductive, shearing, uneven, x, y, frame, i, columns, strengths, n, pack
):  # fmt: skip
    """Return five sums of the particle i, in cell order, over n packed candidates.

    The sums are acceleration along x and y, du/dt, div v, and the rate at which conduction relaxes u towards that of
    the neighbours. x, y: position of the particle in the units of the pack. frame: as in `pack_columns`.
    """
    real, inv_h, (unit, ux, uy) = pack.dtype.type, columns[i, INV_H], frame
    norm *= inv_h * inv_h * inv_h if dim == 2 else inv_h * inv_h
    press, norm, inv_h = real(columns[i, PRESS] * norm), real(norm), real(inv_h * unit)
    x, y, vx, vy = real(x), real(y), real(columns[i, VX] - ux), real(columns[i, VY] - uy)
    inv_rho_i, c_i, f_i = real(columns[i, INV_RHO]), real(columns[i, SOUND]), real(columns[i, SWITCH])
    u_i, p_i, fluidity = real(0.0), real(0.0), real(columns[i, FLUIDITY]) if shearing else real(0.0)
    if conductive:
        u_i, p_i = real(columns[i, ENERGY]), real(columns[i, P])
    slopes = real(0.0), real(0.0), real(0.0)
    if viscous == RECONSTRUCTED:
        slopes = real(columns[i, SXX] * unit), real(columns[i, SXY] * unit), real(columns[i, SYY] * unit)
    beta = real(strengths.beta * BETA)
    conducted = real(0.25 * math.sqrt(0.5) * strengths.conductivity)  # with the halves of the means over a pair
    sheared = real(strengths.shear / unit) * inv_rho_i
    ax, ay, rate, div, conduction = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(n):
        dx, dy = x - pack[X * STRIDE + k], y - pack[Y * STRIDE + k]
        inv_r, own, other = pack[INV_R * STRIDE + k], pack[OWN * STRIDE + k], pack[OTHER * STRIDE + k]
        force = press * own + pack[PRESS * STRIDE + k] * other
        if viscous != NO_VISCOSITY or energetic or shearing:
            w = ((vx - pack[VX * STRIDE + k]) * dx + (vy - pack[VY * STRIDE + k]) * dy) * inv_r
            div += w * own
            heat = press * own * w
            if viscous != NO_VISCOSITY or conductive or shearing:
                inv_rho_j = pack[INV_RHO * STRIDE + k]
                inv_rho, both = inv_rho_i + inv_rho_j, norm * own + other
                strength = inv_rho * both
                if uneven:
                    strength = max(strength, MOST_UNEVEN * (inv_rho_i * norm * own + inv_rho_j * other))  # below 0
            if viscous != NO_VISCOSITY:
                jump = limited_jump(viscous, slopes, dx, dy, inv_r, w, k, pack)
                mu = min(jump, 0.0)
                felt = mu if viscous == APPROACHING else jump
                pi = beta * mu * mu - (c_i + pack[SOUND * STRIDE + k]) * felt  # eq. (5)
                pi *= (f_i + pack[SWITCH * STRIDE + k]) * strength
                force += pi
                heat += 0.5 * pi * w
            if shearing:
                r, inv_mu = pack[R * STRIDE + k], fluidity + pack[FLUIDITY * STRIDE + k]
                q, q_j = r * inv_h, r * pack[INV_H * STRIDE + k]
                spread = bounded_sum(uneven, norm * own * q * q, other * q_j * q_j, inv_rho_i, inv_rho_j)
                stress = sheared * inv_rho_j / inv_mu * spread * inv_r * w
                force -= stress
                heat -= 0.5 * stress * w
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


@inline_sums
def larger_or_nan(a, b):
    """Return the larger of two numbers, or NaN if either is NaN."""
    return a if a >= b or a != a else b


@inline_sums
def add_sums(found, sums):
    """Add the results `found` of `force_sums` to `sums` (5,)."""
    sums[0] += found[0]
    sums[1] += found[1]
    sums[2] += found[2]
    sums[3] += found[3]
    sums[4] += found[4]


@inline_sums
def add_cell_sums(
    own, members, dim, energetic, columns, sums, sound, still, squeezed, strengths, units, order, acc, rate
):  # fmt: skip
    """Add the sums of a cell's particles to `acc` (n, d) and `rate` (n,), and return three rates that limit the step.

    own: index of the first particle of the cell in cell order. still (n,): particles whose acceleration does not limit
    the step; may be empty. units: units of acceleration and of heating in the pack, and one over the unit of speed.

    The results are maxima over the cell, in units of the pack: the rate at which h is crossed, the fourth power of the
    rate of free fall through h, |a|^2 / h^2, and the rate of conduction.
    """
    of_acc, of_heat, per_speed = units
    crossing, pulling, conduction = 0.0, 0.0, 0.0
    for p in range(members):
        i, inv_h, found = order[own + p], columns[own + p, INV_H] * squeezed, sums[p]
        acc[i, 0] += of_acc * found[0]
        if dim == 2:
            acc[i, 1] += of_acc * found[1]
        if energetic:
            rate[i] += of_heat * found[2]
        closing = strengths.closing * max(0.0, -found[3])
        pulled = (found[0] * found[0] + found[1] * found[1]) * inv_h * inv_h
        crossing = larger_or_nan(crossing, sound[i] * per_speed * strengths.signal * inv_h + closing)
        pulling = larger_or_nan(pulling, 0.0 if len(still) > 0 and still[i] else pulled)
        conduction = max(conduction, found[4])
    return crossing, pulling, conduction


@functools.cache
def force_driver(
    kernel: int, dim: int, viscous: int, energetic: bool, conductive: bool, shearing: bool, uneven: bool, single: bool
):  # fmt: skip
    """Return the kernel that computes eqs. (3-5), with only the terms that a scene has.

    viscous: kind of artificial viscosity. energetic, conductive, shearing: whether gas has an energy, artificial
    conductivity, and shear viscosity. uneven: whether masses may differ. single: whether packs are of single precision.

    The kernel adds to `acc` (n, d) and, for gas with an energy, to du/dt in `rate` (n,). The kernel processes the
    cells filled[first:last] whose entry of `marked` equals `wanted`. part: candidate lists, and `Scratch`. The
    kernel returns the largest rates of crossing h, signal c_s / h + closing max(0, -div v), of falling through h,
    sqrt(|a| / h), and of conduction.
    """
    moving = viscous != NO_VISCOSITY or energetic or shearing
    norm = NORM[dim - 1][kernel] * shape_factors.py_func(kernel)[1]
    squeezed = SQUEEZED[kernel]

    @jit_sums
    def forces(first, last, part, columns, sound, still, acc, rate, strengths, scale, cells, marked, wanted):
        order, start, bounds = cells.order, cells.start, cells.bounds
        lists, work = part
        begin, indices, pack, sums = lists.begin, lists.indices, work.pack, work.sums
        cx, cy = pack[X * STRIDE :], pack[Y * STRIDE :]
        of_rate = scale.speed / scale.length
        units = scale.speed * of_rate, scale.speed * scale.speed * of_rate, 1.0 / scale.speed
        crossing, pulling, conduction = 0.0, 0.0, 0.0
        for c in range(first, last):
            cell = cells.filled[c]
            if marked[cell] != wanted:
                continue
            ox, oy, per_unit, own = bounds[cell, 0], bounds[cell, 1], 1.0 / bounds[cell, 4], start[cell]
            ux, uy = (columns[own, VX], columns[own, VY]) if moving else (0.0, 0.0)
            unit, members = bounds[cell, 4] / scale.length, start[cell + 1] - own
            frame, per_length = (unit, ux, uy), slabs_per_length(bounds[cell, 2], bounds[cell, 4])
            clear(sums, members)
            prefetch_columns(begin[c - first + 1 :], indices, columns)
            for listed in range(begin[c - first], begin[c - first + 1], CHUNK):
                end = min(listed + CHUNK, begin[c - first + 1])
                pack_positions(c - first, listed, end, lists, ox, oy, per_unit, cells, cx, cy)
                some = indices[listed:end]
                pack_columns(dim, moving, viscous, conductive, shearing, some, norm, frame, columns, pack)
                for p in range(members):
                    k = own + p
                    x, y = (cells.x[k] - ox) * per_unit, (cells.y[k] - oy) * per_unit
                    near, n = 0, padded_count(end - listed)
                    if not single:
                        reach = max(cells.radius[k], lists.largest_radius[c - first])
                        near, n = find_window(c - first, cells.x[k] - ox, reach, per_length, listed, end, lists)
                    seen = pack[near:]
                    pack_distances(single, x, y, n, seen)
                    pack_gradients(kernel, dim, columns[k, INV_H] * unit, n, seen)
                    found = force_sums(
                        norm, dim, viscous, energetic, conductive, shearing, uneven, x, y, frame, k, columns,
                        strengths, n, seen,
                    )  # fmt: skip
                    add_sums(found, sums[p])
            crossed, pulled, passed = add_cell_sums(
                own, members, dim, energetic, columns, sums, sound, still, squeezed, strengths, units, order, acc, rate
            )
            crossing, pulling = larger_or_nan(crossing, crossed), larger_or_nan(pulling, pulled)
            conduction = max(conduction, passed)
        return of_rate * crossing, of_rate * math.sqrt(math.sqrt(pulling)), of_rate * conduction

    return forces
