"""SPH density with its smoothing length, and derivatives of the velocity: eqs. (1, 2, 7) of `forces.py`.

h changes so little from step to step that one sum over the neighbours is nearly always enough. The first two
derivatives of the sum in h give the root of (1) to third order in the change, and rho and Omega follow by their
series.
"""

import functools
import math
from typing import NamedTuple

import numpy as np

from discsim.jit.decorators import inline_sums, jit_sums
from discsim.jit.index import index
from discsim.kernels.common.candidates import pack_positions, per_slab, window
from discsim.kernels.common.neighbours import LANES, whole
from discsim.kernels.sph.packs import (
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
    all_of,
    inverse_root,
    relative,
)
from discsim.kernels.sph.smoothing import factors, terms

TOLERANCE = 4e-3  # relative to h, of the last change; the remaining error is a few times its cube
ITERATIONS = 60
# Where coincident particles have nearly all of rho, h depends on the edge of its support: the pressure force would be
# stiffer by 1 / Omega than the time step allows. Discs, shocks and collapses have 0.16 and more.
LEAST_OMEGA = 0.05
OUTGROWN = -1.0  # in place of Omega, where the search for h needs a longer list
NO_DERIVATIVES, DIV_CURL, SLOPES = range(3)  # of the velocity: none, |div v| and |curl v|, or the gradient of eq. (7)
PLANE = 1e-6  # least det T over its trace squared: neighbours on one line have no gradient across it
# Rows for a cell's particles (members): sums, state of the search for h, and results. Each TILE of members has its rows
# one after the other, so that loops over members are vectorised.
TILE, ROWS = 64, 22
SUMS, SUMS_OF_SLOPES = 7, 14
(
    TOTAL, FIRST, SECOND, DIV, CURL, MORE_DIV, MORE_CURL, TXX, TXY, TYY, AXX, AXY, AYX, AYY,
    M, REACH, LOW, HIGH, STATE, H, RHO, OMEGA,
) = (index(row * TILE) for row in range(ROWS))  # fmt: skip
SEARCHED, FOUND, NOT_ASKED = 0.0, 1.0, 2.0
IN_ALL, LAST = index(ROWS), index(TILE - 1)


class Given(NamedTuple):
    """Velocities (n, d) and masses (n,) of n particles."""

    vel: np.ndarray
    mass: np.ndarray


class Found(NamedTuple):
    """Results of the density pass (n,): h, and rho and Omega of eqs. (1, 2).

    div, curl (n,): |div v| and |curl v| for a switch, else empty. slopes (n, 3): xx, xy and yy of the symmetric part
    of eq. (7), for reconstruction, else empty.
    """

    h: np.ndarray
    rho: np.ndarray
    gradh: np.ndarray
    div: np.ndarray
    curl: np.ndarray
    slopes: np.ndarray


class Work(NamedTuple):
    """Scratch memory of sums over candidates.

    pack: that of the candidates. members: rows of a cell's particles, by tiles. sums (members, 5): of forces.
    """

    pack: np.ndarray
    members: np.ndarray
    sums: np.ndarray


class Wanted(NamedTuple):
    """Rule for h: eta of eq. (1), the least and the largest h, whether h is fixed, norm and support of the kernel."""

    eta: float
    least: float
    most: float
    fixed: bool
    norm: float
    support: float


@inline_sums
def add_density(single, kernel, dim, derived, x, y, vx, vy, inv_h, n, pack, members, at):
    """Add the contributions of n packed candidates to the sums of the member at `at`."""
    real = pack.dtype.type
    x, y, vx, vy, inv_h = real(x), real(y), real(vx), real(vy), real(inv_h)
    total, first, second, div, curl, more_div, more_curl = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    txx, txy, tyy, axx, axy, ayx, ayy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(n):
        dx, dy = x - pack[X * STRIDE + k], y - pack[Y * STRIDE + k]
        r2 = dx * dx + (dy * dy + NEAREST2)
        inv_r = inverse_root(single, r2)
        if derived == DIV_CURL:
            pack[INV_R * STRIDE + k] = inv_r
        pack[R * STRIDE + k] = r2 * inv_r
    for k in range(n):
        r, m = pack[R * STRIDE + k], pack[MASS * STRIDE + k]
        w, dw, ddw = terms(kernel, dim, r * inv_h)
        ddw *= r
        total += m * w
        first += m * r * dw
        second += m * r * ddw
        if derived == SLOPES:
            dx, dvx, weight = x - pack[X * STRIDE + k], vx - pack[VX * STRIDE + k], m * w
            txx += weight * dx * dx
            axx += weight * dvx * dx
            if dim == 2:
                dy, dvy = y - pack[Y * STRIDE + k], vy - pack[VY * STRIDE + k]
                txy += weight * dx * dy
                tyy += weight * dy * dy
                axy += weight * dvx * dy
                ayx += weight * dvy * dx
                ayy += weight * dvy * dy
        if derived == DIV_CURL:
            dx, dy, m_per_r = x - pack[X * STRIDE + k], y - pack[Y * STRIDE + k], m * pack[INV_R * STRIDE + k]
            dvx, dvy = vx - pack[VX * STRIDE + k], vy - pack[VY * STRIDE + k]
            along, across = m_per_r * (dvx * dx + dvy * dy), m_per_r * (dvy * dx - dvx * dy)
            div += dw * along
            curl += dw * across
            more_div += ddw * along
            more_curl += ddw * across
    # Constant factors, and those of q = r / h, are applied at the end.
    of_w, of_dw, of_ddw = factors(kernel)
    members[at + TOTAL] += of_w * total
    members[at + FIRST] += of_dw * inv_h * first
    members[at + SECOND] += of_ddw * inv_h * inv_h * second
    if derived == SLOPES:
        members[at + TXX] += txx
        members[at + TXY] += txy
        members[at + TYY] += tyy
        members[at + AXX] += axx
        members[at + AXY] += axy
        members[at + AYX] += ayx
        members[at + AYY] += ayy
    if derived == DIV_CURL:
        members[at + DIV] += of_dw * div
        members[at + CURL] += of_dw * curl
        members[at + MORE_DIV] += of_ddw * inv_h * more_div
        members[at + MORE_CURL] += of_ddw * inv_h * more_curl


@inline_sums
def in_units_of_density(norm, dim, derived, total, first, second, div, curl, more_div, more_curl):
    """Return h^d rho, (h / rho) drho/dh, (h^2 / rho) d2rho/dh2, h div v and h curl v from a particle's sums.

    Two more values are h d(div v)/d ln h and h d(curl v)/d ln h.
    """
    rate = 1.0 / total
    first *= rate
    curve = dim * (dim + 1) + 2 * (dim + 1) * first + second * rate
    if derived == DIV_CURL:
        div, curl = div * rate, curl * rate
        more_div, more_curl = (first - 1.0) * div - more_div * rate, (first - 1.0) * curl - more_curl * rate
    return norm * total, -(dim + first), curve, div, curl, more_div, more_curl


@inline_sums
def improve(dim, m, h, wanted, low, high, rho, slope, curve):
    """Take a third-order step to the root of eq. (1); return (found, step, h, rho, Omega, low, high).

    The root is between the bounds `low` and `high`. `step` is relative to h. Where it is short enough, rho and Omega
    follow by their series. All possible results are computed and then selected, so that the calling loop is
    vectorised.
    """
    inv_h, eta, h_least, h_most = 1.0 / h, wanted.eta, wanted.least, wanted.most
    # eq. (1) is t = 1 with t = (eta / h) (m / rho)^(1/d); h - t h has the slope `rise`.
    t = eta * inv_h * (m / rho if dim == 1 else math.sqrt(m / rho))
    rise = 1.0 + t * slope / dim
    step = (t - 1.0) / rise
    # For a lone particle, or many at one position, (1) has no root: h stays at its limit, as if fixed. h also stays
    # where the step is NaN, instead of growing to its limit; the time-step limit then becomes NaN and stops the run.
    stays = ((t >= 1.0) & (h >= h_most)) | ((t <= 1.0) & (h <= h_least)) | (step != step) | wanted.fixed
    near = (abs(step) <= TOLERANCE) & (h + h * step > h_least)
    last = step * (1.0 - 0.5 * step * t / dim * (curve - (1.0 + 1.0 / dim) * slope * slope) / rise)
    last = 0.0 if stays else min(last, h_most * inv_h - 1.0)
    grown = 1.0 + last * (slope + 0.5 * last * curve)
    omega = max(1.0 + (1.0 + last) * (slope + last * curve) / (dim * grown), LEAST_OMEGA)
    low, high = (low if t < 1.0 else h), (h if t < 1.0 else high)
    new = min(max(h + h * min(max(step, -0.3), 0.5), h_least), h_most)
    half = 0.5 * (low + high) if high < np.inf else min(1.5 * low, h_most)
    new = new if (low < new) & (new < high) else half
    found = stays | near
    h, rho = (h * (1.0 + last), rho * grown) if found else (new, rho)
    return found, last, h, rho, 1.0 if stays else omega if near else 1.0 + slope / dim, low, high


@inline_sums
def improve_all(dim, derived, wanted, unit_mass, n, some):
    """Advance the search for h of n members by one iteration, from their sums in the rows `some`.

    |div v| and |curl v| replace their sums. Returns the number of members that continue, and of members that need an
    h beyond the reach of their list.
    """
    left, beyond = 0.0, 0.0
    for k in range(index(n)):
        searched, h = some[k + STATE] == SEARCHED, some[k + H]
        per_h = 1.0 / h
        total, slope, curve, div, curl, more_div, more_curl = in_units_of_density(
            wanted.norm, dim, derived, some[k + TOTAL], some[k + FIRST], some[k + SECOND], some[k + DIV],
            some[k + CURL], some[k + MORE_DIV], some[k + MORE_CURL],
        )  # fmt: skip
        rho = total * unit_mass * (per_h * per_h if dim == 2 else per_h)
        found, step, new, rho, omega, low, high = improve(
            dim, some[k + M], h, wanted, some[k + LOW], some[k + HIGH], rho, slope, curve
        )
        outgrown = wanted.support * new > some[k + REACH]
        some[k + LOW], some[k + HIGH] = low, high
        some[k + H] = new if searched else h
        some[k + RHO] = rho if searched else some[k + RHO]
        some[k + OMEGA] = (OUTGROWN if outgrown else omega) if searched else some[k + OMEGA]
        if derived == DIV_CURL:
            some[k + DIV] = abs(div + step * more_div) * per_h if searched else some[k + DIV]
            some[k + CURL] = abs(curl + step * more_curl) * per_h if searched else some[k + CURL]
        goes_on = searched & (not (found | outgrown))
        some[k + STATE] = FOUND if searched & (not goes_on) else some[k + STATE]
        left += 1.0 if goes_on else 0.0
        beyond += 1.0 if searched & outgrown else 0.0
    return left, beyond


@inline_sums
def seat(p):
    """Return the index of the p-th member of a cell in the rows."""
    lane = index(p) & LAST
    return (index(p) - lane) * IN_ALL + lane


@inline_sums
def begin_cell(wanted, own, count, cells, again, mass, h, gradh, members):
    """Start the search for h of a cell's members within its limits.

    With `again` it is only for members that outgrew their list. The results of others are unaffected by a second
    search.
    """
    for p in range(whole(count)):
        at, k = seat(p), own + min(p, count - 1)
        i = cells.order[k]
        members[at + STATE] = NOT_ASKED if p >= count or (again and gradh[i] != OUTGROWN) else SEARCHED
        members[at + M], members[at + REACH], members[at + H] = mass[i], cells.radius[k], h[i]
        members[at + LOW], members[at + HIGH] = 0.0, np.inf
        if not wanted.fixed:
            members[at + H] = min(max(h[i], wanted.least), wanted.most)


@inline_sums
def clear_sums(sums, count, members):
    """Set the sums of members in the search to 0."""
    for p in range(count):
        at = seat(p)
        if members[at + STATE] == SEARCHED:
            for row in range(sums):
                members[at + index(row * TILE)] = 0.0


@inline_sums
def slopes_of(dim, at, members):
    """Return xx, xy and yy of the symmetric part of eq. (7) from a member's sums, per unit of length of the pack."""
    txx, txy, tyy = members[at + TXX], members[at + TXY], members[at + TYY]
    axx, axy, ayx, ayy = members[at + AXX], members[at + AXY], members[at + AYX], members[at + AYY]
    if dim == 1:
        return (axx / txx if txx > 0.0 else 0.0), 0.0, 0.0
    det = txx * tyy - txy * txy
    rate = 1.0 / det if det > PLANE * (txx + tyy) * (txx + tyy) else 0.0
    across = axy * txx - axx * txy + ayx * tyy - ayy * txy
    return (axx * tyy - axy * txy) * rate, 0.5 * across * rate, (ayy * txx - ayx * txy) * rate


@inline_sums
def end_cell(dim, derived, own, count, order, per_unit, found, members):
    """Write the results of a cell's members."""
    for p in range(count):
        at, i = seat(p), order[own + p]
        if members[at + STATE] == NOT_ASKED:
            continue
        found.h[i], found.rho[i], found.gradh[i] = members[at + H], members[at + RHO], members[at + OMEGA]
        if derived == DIV_CURL:
            found.div[i], found.curl[i] = members[at + DIV], members[at + CURL]
        if derived == SLOPES:
            xx, xy, yy = slopes_of(dim, at, members)
            found.slopes[i, 0], found.slopes[i, 1], found.slopes[i, 2] = xx * per_unit, xy * per_unit, yy * per_unit


@inline_sums
def pack_masses(dim, moving, begin, end, slots, order, vel, mass, ux, uy, per_mass, pack):
    """Pack masses and, with `moving`, velocities relative to (ux, uy) of the candidates from `begin` to `end`."""
    first, count = index(begin), index(end - begin)
    masses, vx, vy = pack[MASS * STRIDE :], pack[VX * STRIDE :], pack[VY * STRIDE :]
    for k in range(count):
        j = order[slots[first + k]]
        masses[k] = mass[j] * per_mass
        if moving:
            vx[k] = vel[j, 0] - ux
            if dim == 2:
                vy[k] = vel[j, 1] - uy
    for k in range(count, index(whole(end - begin) + LANES)):  # padding of windows and `all_of`
        masses[k] = 0.0


@functools.cache
def density_driver(kernel: int, dim: int, derived: int, single: bool):
    """Compile the loop that computes h, density, Omega and derivatives of the velocity for each particle.

    With `single` packs are of single precision, with masses in units of `unit_mass`, a power of two. `outgrown`
    (cells,) marks the cells in which a particle needs an h beyond the reach of its candidate list, for a second pass,
    `again`.
    """
    moving = derived != NO_DERIVATIVES
    sums = SUMS_OF_SLOPES if derived == SLOPES else SUMS

    @jit_sums
    def density(first, last, part, filled, given, found, wanted, unit_mass, cells, again, outgrown):
        order, start, bounds = cells.order, cells.start, cells.bounds
        vel, mass, h, (lists, work) = given.vel, given.mass, found.h, part
        begin, slots, pack, members = lists.begin, lists.slots, work.pack, work.members
        cx, cy, per_mass = pack[X * STRIDE :], pack[Y * STRIDE :], 1.0 / unit_mass
        for c in range(first, last):
            cell = filled[c]
            ox, oy, unit, own = bounds[cell, 0], bounds[cell, 1], bounds[cell, 4], start[cell]
            per_unit, per_length, count = 1.0 / unit, per_slab(bounds[cell, 2], unit), start[cell + 1] - own
            ux, uy = (vel[order[own], 0], vel[order[own], 1] if dim == 2 else 0.0) if moving else (0.0, 0.0)
            begin_cell(wanted, own, count, cells, again, mass, h, found.gradh, members)
            for _ in range(ITERATIONS):
                clear_sums(sums, count, members)
                for listed in range(begin[c - first], begin[c - first + 1], CHUNK):
                    end = min(listed + CHUNK, begin[c - first + 1])
                    pack_positions(c - first, listed, end, lists, ox, oy, per_unit, cells, cx, cy)
                    pack_masses(dim, moving, listed, end, slots, order, vel, mass, ux, uy, per_mass, pack)
                    for p in range(count):
                        at, k, near, n = seat(p), own + p, 0, all_of(end - listed)
                        if members[at + STATE] != SEARCHED:
                            continue
                        from_x, from_y = cells.x[k] - ox, cells.y[k] - oy
                        if not single:
                            near, n = window(c - first, from_x, members[at + REACH], per_length, listed, end, lists)
                        x, y, per_h = from_x * per_unit, from_y * per_unit, unit / members[at + H]
                        vx, vy = relative(dim, vel, order[k], ux, uy, 1.0) if moving else (0.0, 0.0)
                        add_density(single, kernel, dim, derived, x, y, vx, vy, per_h, n, pack[near:], members, at)
                # A separate loop: that of the sums does not wait for these divisions.
                left = 0.0
                for p in range(0, count, TILE):
                    n, some = whole(min(TILE, count - p)), members[seat(p) :]
                    going, beyond = improve_all(dim, derived, wanted, unit_mass, n, some)
                    left += going
                    outgrown[c] |= beyond > 0.0
                if left == 0.0:
                    break
            end_cell(dim, derived, own, count, order, per_unit, found, members)

    return density
