"""Motion of gas through the sides of polar cells: mass, momenta and energy, one direction at a time.

In a sweep, gas that passes a side has moved by

    s = u dt / (1 + dt du/dx),                                                                          (1)

exact for free motion in a velocity u(x) that is linear about the side. Its mass is the integral of the parabola of the
surface density (`parabola.py`) over the volume that is swept, and it carries the means of radial velocity, angular
momentum and energy per mass over this volume. Mass and angular momentum are therefore conserved to rounding. u is
continuous in smooth flow; at jumps it is close to the velocity of the contact in an acoustic Riemann problem,

    u = (u_L + u_R) / 2 - (p_R - p_L) / (Z_L + Z_R),   Z = Sigma c_s = (gamma P Sigma)^(1/2).            (2)

(Weights Z of u_L and u_R would let the velocity of a ring push the mass of the next one backwards, where velocities
alternate and the density has a gradient: epicycles of cold gas then grow.)

In azimuth the mean rotation of a ring moves the gas by a whole number of cells, which is exact, and by the rest
together with the velocity relative to the mean (FARGO, Masset 2000, A&AS 141, 165). u in (1) is then that on the
parabola upwind, at the distance of the rest from the side. With u at the side one of two opposite sound waves would
grow and the other decay. The centrifugal acceleration l^2 / r^3 is applied over half of dt before the sweeps and half
after them. With gravity in the kick this is a leapfrog in polar coordinates: circular orbits are exact at any step.

Mixing of gas in a cell conserves momentum and loses kinetic energy, of the motion along the sweep and across it: of
both in shocks that are oblique to the rings. Gas that holds heat gains this energy, so that shocks have the right heat.
With the velocities w = (v_r, l/r) before the sweep, and w_k of the gas m_k that enters (m_k < 0: that leaves), it is

    sum_k m_k |w_k - w|^2 / 2 - m' |w' - w|^2 / 2,   m', w' after the sweep.                            (3)
"""

import math

import numpy as np

from discsim.jit.decorators import inline_jit, jit, jit_subroutine
from discsim.kernels.polar.geometry import DENSITY, ENERGY, GHOSTS, PRESSURE, RADIAL, SPIN, pad_row
from discsim.kernels.polar.parabola import change_within, part_mean, sides_along_ring, sides_of_ring

# Rows of fluxes through the sides of a ring, and of the means of the gas that passes: radial velocity, and spin.
MASS, MOMENTUM, ANGULAR, HEAT, PASSING_RADIAL, PASSING_SPIN = range(6)
MOST = 0.7  # largest fraction of a cell that leaves it in a sweep
LEAST_STRETCH = 0.5  # lower bound of 1 + dt du/dx
# Smallest energy per mass after a sweep, over that without the gain from mixing, which is at least this fraction of the
# energy before.
LEAST_ENERGY = 0.5


@jit
def unpack(first, last, mass, vel, pressure, u, dt, geometry, fields):
    """Write the fields of the rings `first` to `last` after the first half of the centrifugal acceleration over dt.

    mass, pressure, u (own rings, angles); vel (own rings, angles, 2). u is empty for gas without an energy equation.
    """
    for i in range(first, last):
        r, row, k = geometry.radius[i], i + GHOSTS, i - geometry.first
        per_mass = 1.0 / (geometry.volume[i] * geometry.angle)
        half = 0.5 * dt / r**3
        for j in range(mass.shape[1]):
            c, s, vx, vy = geometry.cos[j], geometry.sin[j], vel[k, j, 0], vel[k, j, 1]
            spin = r * (c * vy - s * vx)
            fields[DENSITY, row, j] = mass[k, j] * per_mass
            fields[RADIAL, row, j] = c * vx + s * vy + half * spin * spin
            fields[SPIN, row, j] = spin
            fields[PRESSURE, row, j] = pressure[k, j]
        if len(fields) > ENERGY:
            fields[ENERGY, row] = u[k]


@jit
def pack(first, last, fields, dt, geometry, mass, vel, u):
    """Set mass, velocity and energy from the fields, after the second half of the centrifugal acceleration over dt.

    mass, vel, u: as in `unpack`.
    """
    for i in range(first, last):
        r, row, k = geometry.radius[i], i + GHOSTS, i - geometry.first
        area = geometry.volume[i] * geometry.angle
        half = 0.5 * dt / r**3
        for j in range(mass.shape[1]):
            c, s, spin = geometry.cos[j], geometry.sin[j], fields[SPIN, row, j]
            radial, around = fields[RADIAL, row, j] + half * spin * spin, spin / r
            mass[k, j] = fields[DENSITY, row, j] * area
            vel[k, j, 0] = radial * c - around * s
            vel[k, j, 1] = radial * s + around * c
        if len(fields) > ENERGY:
            u[k] = fields[ENERGY, row]


@inline_jit
def contact_speed(j, ahead, behind_cells, ahead_cells, direction, gamma, unit):
    """Return u of eq. (2) at the side between the columns `j` and `ahead` of cells behind and ahead (`upwind_mean`).

    direction: field of the velocity across the side. unit: velocities are in units of 1 / unit.
    """
    z_left = math.sqrt(gamma * behind_cells[2][PRESSURE, j] * behind_cells[2][DENSITY, j])
    z_right = math.sqrt(gamma * ahead_cells[2][PRESSURE, ahead] * ahead_cells[2][DENSITY, ahead])
    jump = unit * (ahead_cells[0][PRESSURE, ahead] - behind_cells[1][PRESSURE, j])
    return 0.5 * (behind_cells[1][direction, j] + ahead_cells[0][direction, ahead]) - jump / (z_left + z_right)


@inline_jit
def upwind_mean(k, j, ahead, up, y, behind_cells, ahead_cells):
    """Return the mean of the field `k` over the fraction `y` of the upwind cell next to a side.

    j, ahead: columns of the cells behind and ahead of the side. up: whether gas comes from behind. behind_cells,
    ahead_cells: tuples of arrays (fields, columns): lower sides, upper sides and means.
    """
    low, high, mean = behind_cells[0][k, j], behind_cells[1][k, j], behind_cells[2][k, j]
    low_ahead, high_ahead, mean_ahead = ahead_cells[0][k, ahead], ahead_cells[1][k, ahead], ahead_cells[2][k, ahead]
    near, far = (high if up else low_ahead), (low if up else high_ahead)
    return part_mean(near, far, mean if up else mean_ahead, y)


@jit_subroutine
def carry_through(swept, volumes, behind, ahead, shift, flux):
    """Write the fluxes (6, n) through a row of sides; of gas without an energy equation the first three rows.

    swept (n,): fraction of the cell behind a side that passes it, or -1 times that of the cell ahead. volumes: of the
    cells behind and ahead. behind, ahead: cells as in `upwind_mean`; the side j is behind column j + shift of `ahead`.
    """
    heated = len(behind[2]) > ENERGY
    for j in range(len(swept)):
        up, y = swept[j] > 0.0, abs(swept[j])
        mass = swept[j] * (volumes[0] if up else volumes[1])
        mass *= upwind_mean(DENSITY, j, j + shift, up, y, behind, ahead)
        radial = upwind_mean(RADIAL, j, j + shift, up, y, behind, ahead)
        spin = upwind_mean(SPIN, j, j + shift, up, y, behind, ahead)
        flux[MASS, j], flux[MOMENTUM, j], flux[ANGULAR, j] = mass, mass * radial, mass * spin
        if heated:
            flux[HEAT, j] = mass * upwind_mean(ENERGY, j, j + shift, up, y, behind, ahead)
            flux[PASSING_RADIAL, j], flux[PASSING_SPIN, j] = radial, spin


@inline_jit
def squared_change(flux, j, radial, spin, scale):
    """Return |w_k - w|^2 of eq. (3) of the gas that passes the side j; scale: (l/r)^2 over the squared spin."""
    along, around = flux[PASSING_RADIAL, j] - radial, flux[PASSING_SPIN, j] - spin
    return along * along + scale * around * around


@jit_subroutine
def add_fluxes(inward, outward, shift, volume, means, first, scale, new):
    """Write the fields `new` (fields, n) of cells after fluxes through both sides.

    inward, outward (6, m): fluxes through the lower and the upper sides; the cell j has the columns j and j + shift.
    means: fields before, of the cell j in the column j + first. scale: (l/r)^2 over the squared field SPIN.
    """
    heated = len(means) > ENERGY
    for j in range(new.shape[1]):
        k, i = j + shift, j + first
        before = means[DENSITY, i] * volume
        mass = before + inward[MASS, j] - outward[MASS, k]
        radial = (before * means[RADIAL, i] + inward[MOMENTUM, j] - outward[MOMENTUM, k]) / mass
        spin = (before * means[SPIN, i] + inward[ANGULAR, j] - outward[ANGULAR, k]) / mass
        new[DENSITY, j] = mass / volume
        new[RADIAL, j], new[SPIN, j], new[PRESSURE, j] = radial, spin, means[PRESSURE, i]
        if heated:
            heat = (before * means[ENERGY, i] + inward[HEAT, j] - outward[HEAT, k]) / mass
            own = means[RADIAL, i], means[SPIN, i]
            entering = inward[MASS, j] * squared_change(inward, j, own[0], own[1], scale)
            leaving = outward[MASS, k] * squared_change(outward, k, own[0], own[1], scale)
            kept = (radial - own[0]) ** 2 + scale * (spin - own[1]) ** 2
            least = LEAST_ENERGY * max(heat, LEAST_ENERGY * means[ENERGY, i])
            new[ENERGY, j] = max(heat + 0.5 * ((entering - leaving) / mass - kept), least)


@jit_subroutine
def swept_between_rings(side, behind, ahead, gamma, geometry, dt, swept):
    """Write the swept fraction (angles,) of the cells behind the side `side`, or -1 times that of the cells ahead.

    behind, ahead: rings behind and ahead of the side, as in `upwind_mean`. gamma: adiabatic index. At an open edge gas
    only leaves, with the velocity of the parabola there; no gas passes a closed edge.
    """
    rings, r = len(geometry.radius), geometry.sides[side]
    at_inner, at_outer = side == 0, side == rings
    if at_inner or at_outer:
        if geometry.closed:
            swept[:] = 0.0
            return
        sign = 1.0 if at_outer else -1.0
        volume = geometry.volume[side - 1 if at_outer else 0]
        for j in range(len(swept)):
            s = dt * max(sign * (behind[1][RADIAL, j] if at_outer else ahead[0][RADIAL, j]), 0.0)
            swept[j] = sign * min((r * s - sign * 0.5 * s * s) / volume, 1.0)
        return
    before, after = geometry.volume[side - 1], geometry.volume[side]
    over = dt / (geometry.radius[side] - geometry.radius[side - 1])
    for j in range(len(swept)):
        u = contact_speed(j, j, behind, ahead, RADIAL, gamma, 1.0)
        s = u * dt / max(1.0 + over * (ahead[2][RADIAL, j] - behind[2][RADIAL, j]), LEAST_STRETCH)
        y = (r * s - 0.5 * s * s) / (before if s > 0.0 else after)
        swept[j] = min(max(y, -1.0), 1.0)


@jit_subroutine
def read_ring(fields, ring, weights, left_out, low, high, means):
    """Copy the fields of a ring to `means` (fields, angles), and write both sides of their radial parabolas.

    left_out: field whose parabolas are not written.
    """
    for k in range(len(fields)):
        means[k] = fields[k, ring]
        if k != left_out:
            sides_of_ring(fields[k], ring, weights, low[k], high[k])


@jit
def find_swept(first, last, fields, gamma, dt, geometry, swept):
    """Write what passes the lower sides of the rings `first` to `last`, and the outer edge after the last ring.

    swept (rings + 1, angles): fraction of the cell behind a side that passes it, or -1 times that of the cell ahead.
    """
    angles, rings = fields.shape[2], len(geometry.radius)
    cells = np.zeros((2, 3, PRESSURE + 1, angles))  # of two rings: lower sides, upper sides and means of the fields
    known = fields[: PRESSURE + 1]
    for side in range(max(first - 1, 0), last + 1 if last == rings else last):
        old, now = (side + 1) % 2, side % 2
        if side < rings:
            read_ring(known, side + GHOSTS, geometry.weights, SPIN, cells[now, 0], cells[now, 1], cells[now, 2])
        if side >= first:
            behind, ahead = (cells[old, 0], cells[old, 1], cells[old, 2]), (cells[now, 0], cells[now, 1], cells[now, 2])
            swept_between_rings(side, behind, ahead, gamma, geometry, dt, swept[side])


@inline_jit
def limited_part(swept, other):
    """Return the fraction `swept` of a cell that passes one side, if the fraction `other` passes the opposite side.

    Together they are at most MOST of the cell, so that its mass stays positive.
    """
    both = abs(swept) + max(other, 0.0)
    return swept * (MOST / both) if both > MOST else swept


@jit_subroutine
def limit_swept(side, swept, out):
    """Write the swept fractions (angles,) at a side, limited so that the upwind cells keep a part of their mass.

    swept (rings + 1, angles): fractions before the limit.
    """
    for j in range(len(out)):
        y = swept[side, j]
        other = -swept[side - 1, j] if y > 0.0 else swept[min(side + 1, len(swept) - 1), j]
        out[j] = limited_part(y, other if y != 0.0 else 0.0)


@jit_subroutine
def add_leaving(flux, sign, r, geometry, lost):
    """Add mass, momentum and angular momentum of the fluxes (6, angles) through an edge at `r` to `lost` (4,)."""
    for j in range(flux.shape[1]):
        radial, around = flux[MOMENTUM, j], flux[ANGULAR, j] / r
        lost[0] += sign * flux[MASS, j]
        lost[1] += sign * (radial * geometry.cos[j] - around * geometry.sin[j])
        lost[2] += sign * (radial * geometry.sin[j] + around * geometry.cos[j])
        lost[3] += sign * flux[ANGULAR, j]


@jit
def sweep_radially(first, last, fields, swept, geometry, new, passed):
    """Write the fields of the rings `first` to `last` after a radial sweep; return what leaves the edges.

    swept (rings + 1, angles): result of `find_swept`. passed: `tracer.Passed`, written if it has entries; chunks on
    both sides of a side write the same values. The result (2, 4): mass, momentum along x and y, and angular momentum
    that leave through the inner and the outer edge.
    """
    count, angles, rings = len(fields), fields.shape[2], len(geometry.radius)
    cells = np.zeros((2, 3, count, angles))  # of two rings: lower sides, upper sides and means of the fields
    flux, limited, row = np.zeros((2, 6, angles)), np.empty(angles), np.empty((count, angles))
    lost = np.zeros((2, 4))
    for side in range(first, last + 1):
        old, now = (side + 1) % 2, side % 2
        if side == first and side > 0:
            read_ring(
                fields, side + GHOSTS - 1, geometry.weights, PRESSURE, cells[old, 0], cells[old, 1], cells[old, 2]
            )
        if side < rings:
            read_ring(fields, side + GHOSTS, geometry.weights, PRESSURE, cells[now, 0], cells[now, 1], cells[now, 2])
        behind, ahead = (cells[old, 0], cells[old, 1], cells[old, 2]), (cells[now, 0], cells[now, 1], cells[now, 2])
        limit_swept(side, swept, limited)
        volumes = geometry.volume[max(side - 1, 0)], geometry.volume[min(side, rings - 1)]
        carry_through(limited, volumes, behind, ahead, 0, flux[now])
        if len(passed.shift) > 0:
            for j in range(angles):
                passed.mass[side, j], passed.part[side, j] = flux[now, MASS, j], limited[j]
        if side > first:
            scale = 1.0 / geometry.radius[side - 1] ** 2
            add_fluxes(flux[old], flux[now], 0, volumes[0], cells[old, 2], 0, scale, row)
            for k in range(count):
                new[k, side - 1 + GHOSTS] = row[k]
        for edge in range(2):
            if side == edge * rings:
                add_leaving(flux[now], (2.0 * edge - 1.0) * geometry.angle, geometry.sides[side], geometry, lost[edge])
    return lost


@jit_subroutine
def swept_along_ring(cells, gamma, dt, unit, rest, swept):
    """Write the swept fraction (n + 1,) of the cells behind each side of a ring, or -1 times that of the cell ahead.

    cells: lower sides, upper sides and means (fields, n + 2) of the cells, with one more at both ends; the field SPIN
    has the velocity relative to the mean, in cells per time. gamma: adiabatic index. unit: cells per length. rest: part
    of a cell by which the mean rotation moves the gas beyond whole cells.
    """
    low, high, means = cells
    for j in range(len(swept)):
        u = contact_speed(j, j + 1, cells, cells, SPIN, gamma, unit)
        behind = change_within(high[SPIN, j], low[SPIN, j], means[SPIN, j], abs(rest))
        ahead = change_within(low[SPIN, j + 1], high[SPIN, j + 1], means[SPIN, j + 1], abs(rest))
        u += behind if rest > 0.0 else ahead
        stretch = 1.0 + dt * (means[SPIN, j + 1] - means[SPIN, j])
        swept[j] = min(max(rest + u * dt / max(stretch, LEAST_STRETCH), -1.0), 1.0)


@jit
def sweep_around(first, last, fields, gamma, dt, geometry, new, passed):
    """Write the fields of the rings `first` to `last` after an azimuthal sweep over dt.

    passed: `tracer.Passed`, written if it has entries.
    """
    count, angles = len(fields), fields.shape[2]
    padded, row = np.empty((count, angles + 6)), np.empty((count, angles))
    # Separate arrays: with parts of one array, LLVM's run-time test for overlap would take the scalar loops.
    low, high, means = np.empty((count, angles + 2)), np.empty((count, angles + 2)), np.empty((count, angles + 2))
    flux, swept, limited = np.zeros((6, angles + 1)), np.empty(angles + 1), np.empty(angles + 1)
    for i in range(first, last):
        ring, r = i + GHOSTS, geometry.radius[i]
        to_cells = 1.0 / (r * r * geometry.angle)  # angular momentum per mass to cells per time
        mean = fields[SPIN, ring].mean()
        moved = mean * to_cells * dt
        whole = math.floor(moved + 0.5)
        for k in range(count):
            pad_row(fields[k, ring], mean if k == SPIN else 0.0, padded[k])
        padded[SPIN] *= to_cells
        for k in range(count):
            sides_along_ring(padded[k], low[k], high[k])
            for j in range(angles + 2):
                means[k, j] = padded[k, j + 2]
        cells = low, high, means
        swept_along_ring(cells, gamma, dt, r * to_cells, moved - whole, swept)
        for j in range(angles + 1):
            y = swept[j]
            other = -swept[j - 1 if j > 0 else angles - 1] if y > 0.0 else swept[j + 1 if j < angles else 1]
            limited[j] = limited_part(y, other)
        carry_through(limited, (1.0, 1.0), cells, cells, 1, flux)
        add_fluxes(flux, flux, 1, 1.0, means, 1, (r * geometry.angle) ** 2, row)
        for j in range(angles):
            row[SPIN, j] = row[SPIN, j] / to_cells + mean
        begin = int(whole % angles)
        if len(passed.shift) > 0:
            passed.shift[i] = begin
            for j in range(angles + 1):
                passed.mass[i, j], passed.part[i, j] = flux[MASS, j], limited[j]
        for k in range(count):
            for j in range(angles - begin):
                new[k, ring, begin + j] = row[k, j]
            for j in range(begin):
                new[k, ring, j] = row[k, angles - begin + j]
