"""SPH density with its smoothing length, and derivatives of the velocity: eqs. (1, 2, 7) of `forces.py`.

h changes so little from step to step that one sum over the neighbours is nearly always enough. The first and second
derivatives of this sum with respect to h give the root of (1) to third order in the change of h. rho and Omega at the
new h follow from their Taylor series.

The members of a cell are its particles. The candidates of a cell are all particles that its members may interact with.
"""

import functools
import math
from typing import NamedTuple

import numpy as np

from discsim.jit.decorators import inline_sums, jit_sums
from discsim.jit.index import index
from discsim.kernels.common.candidates import LANES, find_window, pack_positions, padded_count, slabs_per_length
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
    inverse_sqrt,
    relative,
)
from discsim.kernels.sph.smoothing import scaled_shape, shape_factors

TOLERANCE = 4e-3  # largest last change of h, relative to h; the error that remains is a few times its cube
ITERATIONS = 60
# Lower bound of Omega. Where coincident particles provide nearly all of rho, h depends on the particles at the edge of
# the support, and Omega goes to 0. The pressure force would be stiffer by 1 / Omega than the time step allows. Discs,
# shocks and collapses have 0.16 and more.
LEAST_OMEGA = 0.05
OUTGROWN = -1.0  # in place of Omega, for particles whose h needs a longer list of candidates
NO_DERIVATIVES, DIV_CURL, SLOPES = range(3)  # of the velocity: none, |div v| and |curl v|, or the gradient of eq. (7)
PLANE = 1e-6  # least det T over its trace squared: neighbours on one line give no gradient across the line
# Rows of data of a cell's members: sums, state of the search for h, and results. The members are divided into tiles of
# TILE members. The array has all rows of the first tile, then all rows of the second, so that loops over the members of
# a tile are vectorised.
TILE, ROWS = 64, 22
SUMS, SUMS_OF_SLOPES = 7, 14
(
    TOTAL, FIRST, SECOND, DIV, CURL, MORE_DIV, MORE_CURL, TXX, TXY, TYY, AXX, AXY, AYX, AYY,
    M, REACH, LOW, HIGH, STATE, H, RHO, OMEGA,
) = (index(row * TILE) for row in range(ROWS))  # fmt: skip
SEARCHING, FOUND, EXCLUDED = 0.0, 1.0, 2.0
IN_ALL, LAST = index(ROWS), index(TILE - 1)


class DensityInput(NamedTuple):
    """Velocities (n, d) and masses (n,) of the particles."""

    vel: np.ndarray
    mass: np.ndarray


class DensityOutput(NamedTuple):
    """Results of the density pass."""

    h: np.ndarray  # (n,): also the first guess
    rho: np.ndarray  # (n,)
    gradh: np.ndarray  # (n,): Omega of eq. (2)
    div: np.ndarray  # (n,): |div v| for Balsara's switch, else empty
    curl: np.ndarray  # (n,): |curl v| for the switch, else empty
    slopes: np.ndarray  # (n, 3): xx, xy and yy of the symmetric part of eq. (7) for reconstruction, else empty


class Scratch(NamedTuple):
    """Scratch memory for the sums of one cell after the other."""

    pack: np.ndarray  # data of the candidates, see `packs.py`
    members: np.ndarray  # data of the members in the density pass, in tiles
    sums: np.ndarray  # (members, 5): sums of the members in the force pass


class SmoothingRule(NamedTuple):
    """Rule for h, and constants of the kernel."""

    eta: float  # of eq. (1)
    least: float  # smallest h
    most: float  # largest h
    fixed: bool  # whether h is given
    norm: float  # sigma of the kernel
    support: float  # radius of the support in h


@inline_sums
def add_density(single, kernel, dim, derived, x, y, vx, vy, inv_h, n, pack, members, at):
    """Add the contributions of n packed candidates to the sums of one member, at index `at` of `members`.

    x, y, vx, vy, inv_h: position, velocity and 1 / h of the member, in the units of the pack.
    """
    real = pack.dtype.type
    x, y, vx, vy, inv_h = real(x), real(y), real(vx), real(vy), real(inv_h)
    total, first, second, div, curl, more_div, more_curl = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    txx, txy, tyy, axx, axy, ayx, ayy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(n):
        dx, dy = x - pack[X * STRIDE + k], y - pack[Y * STRIDE + k]
        r2 = dx * dx + (dy * dy + NEAREST2)
        inv_r = inverse_sqrt(single, r2)
        if derived == DIV_CURL:
            pack[INV_R * STRIDE + k] = inv_r
        pack[R * STRIDE + k] = r2 * inv_r
    for k in range(n):
        r, m = pack[R * STRIDE + k], pack[MASS * STRIDE + k]
        w, dw, ddw = scaled_shape(kernel, dim, r * inv_h)
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
    # Constant factors, and the factors of q = r / h, are applied at the end.
    of_w, of_dw, of_ddw = shape_factors(kernel)
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
def normalise_sums(norm, dim, derived, total, first, second, div, curl, more_div, more_curl):
    """Return seven quantities of a member from its sums.

    The quantities are h^d rho, (h / rho) drho/dh, (h^2 / rho) d2rho/dh2, h div v, h curl v, h d(div v)/d ln h and h
    d(curl v)/d ln h. rho is in units of the mass unit of the pack.
    """
    rate = 1.0 / total
    first *= rate
    curve = dim * (dim + 1) + 2 * (dim + 1) * first + second * rate
    if derived == DIV_CURL:
        div, curl = div * rate, curl * rate
        more_div, more_curl = (first - 1.0) * div - more_div * rate, (first - 1.0) * curl - more_curl * rate
    return norm * total, -(dim + first), curve, div, curl, more_div, more_curl


@inline_sums
def improve_h(dim, m, h, rule, low, high, rho, slope, curve):
    """Take one step towards the root h of eq. (1); return (found, step, h, rho, Omega, low, high).

    m: mass. slope, curve: (h / rho) drho/dh and (h^2 / rho) d2rho/dh2. low, high: bounds between which the root
    lies, which are returned closer. found: whether the step is the last one. The last step is of third order in
    `step`, the change relative to h, and rho and Omega are those of the new h. All possible results are computed and
    then selected, so that the calling loop is vectorised.
    """
    inv_h, eta, h_least, h_most = 1.0 / h, rule.eta, rule.least, rule.most
    # eq. (1) is t = 1 with t = (eta / h) (m / rho)^(1/d); h - t h has the slope `rise`.
    t = eta * inv_h * (m / rho if dim == 1 else math.sqrt(m / rho))
    rise = 1.0 + t * slope / dim
    step = (t - 1.0) / rise
    # For a lone particle, or many at one position, (1) has no root: h stays at its limit, as if fixed. h also stays
    # where the step is NaN, instead of growing to its limit; the time-step limit then becomes NaN and stops the run.
    stays = ((t >= 1.0) & (h >= h_most)) | ((t <= 1.0) & (h <= h_least)) | (step != step) | rule.fixed
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
def improve_all_h(dim, derived, rule, unit_mass, n, tile):
    """Advance the search for h of n members of a tile by one iteration, from their sums.

    tile: the rows of the tile, changed in place: h, rho, Omega and the state of the search are updated, and the sums
    DIV and CURL are replaced by |div v| and |curl v|. Returns the number of members that continue to search, and the
    number that need a longer list of candidates, as their support exceeds REACH.
    """
    left, beyond = 0.0, 0.0
    for k in range(index(n)):
        searched, h = tile[k + STATE] == SEARCHING, tile[k + H]
        per_h = 1.0 / h
        total, slope, curve, div, curl, more_div, more_curl = normalise_sums(
            rule.norm, dim, derived, tile[k + TOTAL], tile[k + FIRST], tile[k + SECOND], tile[k + DIV],
            tile[k + CURL], tile[k + MORE_DIV], tile[k + MORE_CURL],
        )  # fmt: skip
        rho = total * unit_mass * (per_h * per_h if dim == 2 else per_h)
        found, step, new, rho, omega, low, high = improve_h(
            dim, tile[k + M], h, rule, tile[k + LOW], tile[k + HIGH], rho, slope, curve
        )
        outgrown = rule.support * new > tile[k + REACH]
        tile[k + LOW], tile[k + HIGH] = low, high
        tile[k + H] = new if searched else h
        tile[k + RHO] = rho if searched else tile[k + RHO]
        tile[k + OMEGA] = (OUTGROWN if outgrown else omega) if searched else tile[k + OMEGA]
        if derived == DIV_CURL:
            tile[k + DIV] = abs(div + step * more_div) * per_h if searched else tile[k + DIV]
            tile[k + CURL] = abs(curl + step * more_curl) * per_h if searched else tile[k + CURL]
        goes_on = searched & (not (found | outgrown))
        tile[k + STATE] = FOUND if searched & (not goes_on) else tile[k + STATE]
        left += 1.0 if goes_on else 0.0
        beyond += 1.0 if searched & outgrown else 0.0
    return left, beyond


@inline_sums
def member_index(p):
    """Return the index of the p-th member of a cell in the array of the members.

    Callers add the constant of a row to this index.
    """
    lane = index(p) & LAST
    return (index(p) - lane) * IN_ALL + lane


@inline_sums
def begin_search(rule, own, count, cells, again, mass, h, gradh, members):
    """Write the initial state of the search for h to `members`, for the `count` members of a cell.

    own: index of the first member in cell order. With `again` only members that need a longer list are searched for,
    so that the results of the other members do not change.
    """
    for p in range(padded_count(count)):
        at, k = member_index(p), own + min(p, count - 1)
        i = cells.order[k]
        members[at + STATE] = EXCLUDED if p >= count or (again and gradh[i] != OUTGROWN) else SEARCHING
        members[at + M], members[at + REACH], members[at + H] = mass[i], cells.radius[k], h[i]
        members[at + LOW], members[at + HIGH] = 0.0, np.inf
        if not rule.fixed:
            members[at + H] = min(max(h[i], rule.least), rule.most)


@inline_sums
def clear_sums(sums, count, members):
    """Set the first `sums` rows of `members` to 0, for those of the `count` members whose search continues."""
    for p in range(count):
        at = member_index(p)
        if members[at + STATE] == SEARCHING:
            for row in range(sums):
                members[at + index(row * TILE)] = 0.0


@inline_sums
def velocity_slopes(dim, at, members):
    """Return xx, xy and yy of the symmetric part of eq. (7), from the sums of the member at index `at`.

    The unit of length is that of the pack.
    """
    txx, txy, tyy = members[at + TXX], members[at + TXY], members[at + TYY]
    axx, axy, ayx, ayy = members[at + AXX], members[at + AXY], members[at + AYX], members[at + AYY]
    if dim == 1:
        return (axx / txx if txx > 0.0 else 0.0), 0.0, 0.0
    det = txx * tyy - txy * txy
    rate = 1.0 / det if det > PLANE * (txx + tyy) * (txx + tyy) else 0.0
    across = axy * txx - axx * txy + ayx * tyy - ayy * txy
    return (axx * tyy - axy * txy) * rate, 0.5 * across * rate, (ayy * txx - ayx * txy) * rate


@inline_sums
def write_results(dim, derived, own, count, order, per_unit, found, members):
    """Write the results of a cell's members to `found`, a `DensityOutput`."""
    for p in range(count):
        at, i = member_index(p), order[own + p]
        if members[at + STATE] == EXCLUDED:
            continue
        found.h[i], found.rho[i], found.gradh[i] = members[at + H], members[at + RHO], members[at + OMEGA]
        if derived == DIV_CURL:
            found.div[i], found.curl[i] = members[at + DIV], members[at + CURL]
        if derived == SLOPES:
            xx, xy, yy = velocity_slopes(dim, at, members)
            found.slopes[i, 0], found.slopes[i, 1], found.slopes[i, 2] = xx * per_unit, xy * per_unit, yy * per_unit


@inline_sums
def pack_masses(dim, moving, begin, end, indices, order, vel, mass, ux, uy, per_mass, pack):
    """Write masses and, with `moving`, velocities relative to (ux, uy) of the candidates `begin` to `end` to `pack`."""
    first, count = index(begin), index(end - begin)
    masses, vx, vy = pack[MASS * STRIDE :], pack[VX * STRIDE :], pack[VY * STRIDE :]
    for k in range(count):
        j = order[indices[first + k]]
        masses[k] = mass[j] * per_mass
        if moving:
            vx[k] = vel[j, 0] - ux
            if dim == 2:
                vy[k] = vel[j, 1] - uy
    for k in range(count, index(padded_count(end - begin) + LANES)):  # padding that windows may reach
        masses[k] = 0.0


@functools.cache
def density_driver(kernel: int, dim: int, derived: int, single: bool):
    """Return the kernel that computes h, density, Omega and derivatives of the velocity for each particle.

    derived: which derivatives are computed. single: whether packs are of single precision. The kernel processes the
    cells filled[first:last]. Its results go to `found`, a `DensityOutput`. part: candidate lists, and `Scratch`.
    unit_mass: a power of two, the unit of masses in packs. outgrown (cells,), written: whether a member needs a
    longer list. The marked cells need a second pass with longer lists; again: whether this is a second pass.
    """
    moving = derived != NO_DERIVATIVES
    sums = SUMS_OF_SLOPES if derived == SLOPES else SUMS

    @jit_sums
    def density(first, last, part, filled, given, found, rule, unit_mass, cells, again, outgrown):
        order, start, bounds = cells.order, cells.start, cells.bounds
        vel, mass, h, (lists, work) = given.vel, given.mass, found.h, part
        begin, indices, pack, members = lists.begin, lists.indices, work.pack, work.members
        cx, cy, per_mass = pack[X * STRIDE :], pack[Y * STRIDE :], 1.0 / unit_mass
        for c in range(first, last):
            cell = filled[c]
            ox, oy, unit, own = bounds[cell, 0], bounds[cell, 1], bounds[cell, 4], start[cell]
            per_unit, per_length, count = 1.0 / unit, slabs_per_length(bounds[cell, 2], unit), start[cell + 1] - own
            ux, uy = (vel[order[own], 0], vel[order[own], 1] if dim == 2 else 0.0) if moving else (0.0, 0.0)
            begin_search(rule, own, count, cells, again, mass, h, found.gradh, members)
            for _ in range(ITERATIONS):
                clear_sums(sums, count, members)
                for listed in range(begin[c - first], begin[c - first + 1], CHUNK):
                    end = min(listed + CHUNK, begin[c - first + 1])
                    pack_positions(c - first, listed, end, lists, ox, oy, per_unit, cells, cx, cy)
                    pack_masses(dim, moving, listed, end, indices, order, vel, mass, ux, uy, per_mass, pack)
                    for p in range(count):
                        at, k, near, n = member_index(p), own + p, 0, padded_count(end - listed)
                        if members[at + STATE] != SEARCHING:
                            continue
                        from_x, from_y = cells.x[k] - ox, cells.y[k] - oy
                        if not single:
                            reach = members[at + REACH]
                            near, n = find_window(c - first, from_x, reach, per_length, listed, end, lists)
                        x, y, per_h = from_x * per_unit, from_y * per_unit, unit / members[at + H]
                        vx, vy = relative(dim, vel, order[k], ux, uy, 1.0) if moving else (0.0, 0.0)
                        add_density(single, kernel, dim, derived, x, y, vx, vy, per_h, n, pack[near:], members, at)
                # A separate loop, so that the loop of the sums does not wait for these divisions.
                left = 0.0
                for p in range(0, count, TILE):
                    n, tile = padded_count(min(TILE, count - p)), members[member_index(p) :]
                    going, beyond = improve_all_h(dim, derived, rule, unit_mass, n, tile)
                    left += going
                    outgrown[c] |= beyond > 0.0
                if left == 0.0:
                    break
            write_results(dim, derived, own, count, order, per_unit, found, members)

    return density
