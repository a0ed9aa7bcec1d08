"""Density of SPH with its smoothing length: eqs. (1, 2) of `sph.py`.

h goes from step to step by so little that one sum over the neighbours is nearly always enough: with its first two
derivatives in h the root of (1) is known to third order in the change, and rho and Omega follow by their series.
"""

import functools
import math
from typing import NamedTuple

import numpy as np
from numba import njit

from discsim.kernels.candidates import per_slab, place, window
from discsim.kernels.inner import FAST, WITHIN, lean_sums, lean_sums_in_single
from discsim.kernels.neighbours import LANES, whole
from discsim.kernels.smoothing import NORM, SUPPORT, factors, terms
from discsim.kernels.sph_packs import (
    CHUNK,
    INV_R,
    MASS,
    NEAREST2,
    STRIDE,
    VX,
    VY,
    R,
    X,
    Y,
    clear,
    inverse_root,
    relative,
)

TOLERANCE = 4e-3  # of h, on the last step; the error left is some times its cube
ITERATIONS = 60
# Where nearly all of rho is that of particles at one place, h hangs on the edge of its support: pressure felt through
# it would be stiffer by 1 / Omega than the step allows. Discs, shocks and collapses have .16 and more.
LEAST_OMEGA = 0.05
OUTGROWN = -1.0  # in place of Omega, where h is still to be found with a longer list


class Given(NamedTuple):
    """Of n particles: positions and velocities (n, d), masses (n,)."""

    pos: np.ndarray
    vel: np.ndarray
    mass: np.ndarray


class Found(NamedTuple):
    """What density finds (n,): h, rho and Omega of eqs. (1, 2); for a switch |div v| and |curl v|, else empty."""

    h: np.ndarray
    rho: np.ndarray
    gradh: np.ndarray
    div: np.ndarray
    curl: np.ndarray


class Work(NamedTuple):
    """What sums over candidates work in: their pack, and of a cell's particles the search for h (3, members), which is
    its bounds and whether it has settled (1 or 0), and sums (members, 7).
    """

    pack: np.ndarray
    search: np.ndarray
    sums: np.ndarray


class Wanted(NamedTuple):
    """How h is chosen: eta of eq. (1), the least and the largest h, and whether it stays as it is."""

    eta: float
    least: float
    most: float
    fixed: bool


@njit(inline="always")
def add_density(single, kernel, dim, shear, x, y, vx, vy, inv_h, n, pack, sums):
    """Add n packed candidates' share of what `in_units_of_density` takes to `sums` (7,)."""
    real = pack.dtype.type
    x, y, vx, vy, inv_h = real(x), real(y), real(vx), real(vy), real(inv_h)
    total, first, second, div, curl, more_div, more_curl = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(n):
        dx, dy = x - pack[X * STRIDE + k], y - pack[Y * STRIDE + k]
        r2 = dx * dx + (dy * dy + NEAREST2)
        inv_r = inverse_root(single, r2)
        if shear:
            pack[INV_R * STRIDE + k] = inv_r
        pack[R * STRIDE + k] = r2 * inv_r
    for k in range(n):
        r, m = pack[R * STRIDE + k], pack[MASS * STRIDE + k]
        w, dw, ddw = terms(kernel, dim, r * inv_h)
        ddw *= r
        total += m * w
        first += m * r * dw
        second += m * r * ddw
        if shear:
            dx, dy, m_per_r = x - pack[X * STRIDE + k], y - pack[Y * STRIDE + k], m * pack[INV_R * STRIDE + k]
            dvx, dvy = vx - pack[VX * STRIDE + k], vy - pack[VY * STRIDE + k]
            along, across = m_per_r * (dvx * dx + dvy * dy), m_per_r * (dvy * dx - dvx * dy)
            div += dw * along
            curl += dw * across
            more_div += ddw * along
            more_curl += ddw * across
    # Factors, and those of q = r / h, are taken in at the end.
    of_w, of_dw, of_ddw = factors(kernel)
    sums[0] += of_w * total
    sums[1] += of_dw * inv_h * first
    sums[2] += of_ddw * inv_h * inv_h * second
    if shear:
        sums[3] += of_dw * div
        sums[4] += of_dw * curl
        sums[5] += of_ddw * inv_h * more_div
        sums[6] += of_ddw * inv_h * more_curl


# These are of double precision whatever the packs are.
in_double = njit(**WITHIN, fastmath=FAST)


@in_double
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


@in_double
def improve(dim, m, h, wanted, low, high, rho, slope, curve):
    """(settled, step, h, rho, Omega, low, high): a third-order step to the root of eq. (1), between its bounds.

    Where it is short enough, rho and Omega are taken along by their series. `step` is relative to h.
    """
    inv_h, eta, h_least, h_most = 1.0 / h, wanted.eta, wanted.least, wanted.most
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


@njit(inline="always")
def begin_cell(wanted, own, members, order, again, h, gradh, low, high, settled):
    """Let the search for h begin within its limits: `again` of those alone that outgrew their list. What others of
    their cell find does not hang on them.
    """
    for p in range(members):
        i = order[own + p]
        settled[p], low[p], high[p] = 1.0 if again and gradh[i] != OUTGROWN else 0.0, 0.0, np.inf
        if not wanted.fixed and settled[p] == 0.0:
            h[i] = min(max(h[i], wanted.least), wanted.most)


@njit(inline="always")
def pack_masses(dim, shear, begin, end, slots, order, vel, mass, ux, uy, per_mass, pack):
    """Pack masses, and with `shear` velocities less (ux, uy), of the candidates from `begin` to `end`."""
    first, count = np.uint64(begin), np.uint64(end - begin)
    masses, vx, vy = pack[MASS * STRIDE :], pack[VX * STRIDE :], pack[VY * STRIDE :]
    for k in range(count):
        j = order[slots[first + k]]
        masses[k] = mass[j] * per_mass
        if shear:
            vx[k] = vel[j, 0] - ux
            if dim == 2:
                vy[k] = vel[j, 1] - uy
    for k in range(count, np.uint64(whole(end - begin) + LANES)):  # and what a window is filled up with
        masses[k] = 0.0


@functools.cache
def density_driver(kernel: int, dim: int, shear: bool, single: bool):
    """Compile the pass that gives each particle its h, density and Omega, and with `shear` |div v| and |curl v|.

    With `single` packs are of single precision, with masses in units of `unit_mass`, a power of two.
    `outgrown` (cells,) says where a particle wants an h that its list of candidates does not reach for: `again`.
    """
    support = SUPPORT[kernel]

    @lean_sums_in_single if single else lean_sums
    def density(first, last, part, filled, given, found, wanted, unit_mass, cells, again, outgrown):
        order, start, radius, bounds = cells.order, cells.start, cells.radius, cells.bounds
        pos, vel, mass = given.pos, given.vel, given.mass
        h, rho, gradh, div, curl = found.h, found.rho, found.gradh, found.div, found.curl
        (lists, work), begin, slots = part, part[0].begin, part[0].slots
        pack, sums, low, high, settled = work.pack, work.sums, work.search[0], work.search[1], work.search[2]
        cx, cy, per_mass = pack[X * STRIDE :], pack[Y * STRIDE :], 1.0 / unit_mass
        for c in range(first, last):
            cell = filled[c]
            ox, oy, unit, own = bounds[cell, 0], bounds[cell, 1], bounds[cell, 4], start[cell]
            per_unit, per_length, members = 1.0 / unit, per_slab(bounds[cell, 2], unit), start[cell + 1] - own
            ux, uy = (vel[order[own], 0], vel[order[own], 1] if dim == 2 else 0.0) if shear else (0.0, 0.0)
            begin_cell(wanted, own, members, order, again, h, gradh, low, high, settled)
            for _ in range(ITERATIONS):
                clear(members, sums)
                for listed in range(begin[c - first], begin[c - first + 1], CHUNK):
                    end = min(listed + CHUNK, begin[c - first + 1])
                    place(c - first, listed, end, lists, ox, oy, per_unit, cells, cx, cy)
                    pack_masses(dim, shear, listed, end, slots, order, vel, mass, ux, uy, per_mass, pack)
                    for p in range(members):
                        if settled[p] > 0.0:
                            continue
                        k, i = own + p, order[own + p]
                        near, n = 0, whole(end - listed)
                        if not single:
                            near, n = window(c - first, cells.x[k] - ox, radius[k], per_length, listed, end, lists)
                        x, y = relative(dim, pos, i, ox, oy, per_unit)
                        vx, vy = relative(dim, vel, i, ux, uy, 1.0) if shear else (0.0, 0.0)
                        add_density(single, kernel, dim, shear, x, y, vx, vy, unit / h[i], n, pack[near:], sums[p])
                # Apart from the sums, whose loop need not wait for all these divisions.
                left = False
                for p in range(members):
                    if settled[p] > 0.0:
                        continue
                    i = order[own + p]
                    per_h, step = 1.0 / h[i], 0.0
                    total, slope, curve, div_v, curl_v, more_div, more_curl = in_units_of_density(kernel, dim, sums[p])
                    rho[i], gradh[i], settled[p] = total * unit_mass * per_h**dim, 1.0, 1.0
                    if not wanted.fixed:
                        settled[p], step, h[i], rho[i], gradh[i], low[p], high[p] = improve(
                            dim, mass[i], h[i], wanted, low[p], high[p], rho[i], slope, curve
                        )
                    if shear:
                        div[i], curl[i] = abs(div_v + step * more_div) * per_h, abs(curl_v + step * more_curl) * per_h
                    if support * h[i] > radius[own + p]:
                        outgrown[c], settled[p], gradh[i] = True, 1.0, OUTGROWN
                    left |= settled[p] == 0.0
                if not left:
                    break

    return density
