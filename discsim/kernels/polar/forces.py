"""Pressure forces on gas in polar cells, and the heat of their work.

At each side parabolas of both cells (`parabola.py`) give pressures p and velocities u across the side, which differ
only at jumps. The pressure and velocity of an acoustic Riemann problem there are

    p* = (Z_R p_L + Z_L p_R + Z_L Z_R (u_L - u_R)) / (Z_L + Z_R),
    u* = (u_L + u_R) / 2 + (p_L - p_R) / (Z_L + Z_R),   Z = Sigma (c_s + s max(u_L - u_R, 0)),           (1)

with the speed of strong shocks in Z: s = (gamma + 1) / 4 (as in Toro 2009, sec. 9.3; for isothermal gas 1/2). c_s in Z
is at least Omega dr. Rings of colder gas exchange mass, but hardly pressure; at m dr / r of about 4/3 their epicycles,
Doppler-shifted by the shear between the rings, would amplify each other. Resolved discs have dr < H. The
acceleration and the heating rate of a cell of mass m with sides of length A and outward direction n are

    a = -(1/m) sum_sides A (p* - p) n,   du/dt = (1/m) sum_sides A p* (v - u*) . n - p v_r dr dphi / m,   (2)

p being the mean of p* at the two radial sides: uniform pressure has no force, and the sum of kinetic and internal
energy changes only by what leaves the edges.
"""

import math

import numpy as np

from discsim.jit.decorators import inline_jit, jit, jit_subroutine
from discsim.kernels.polar.geometry import GHOSTS, pad_row
from discsim.kernels.polar.parabola import sides_along_ring, sides_of_ring


@jit
def to_polar(first, last, vel, kick_acc, lag, geometry, radial, around, mean):
    """Write the radial and the azimuthal velocity of the rings `first` to `last` after the time `lag`.

    vel, kick_acc (own rings, angles, 2): velocity and its rate of change. radial (rings + 4, angles), around (rings,
    angles). mean (rings,): of the azimuthal velocities of a ring.
    """
    for i in range(first, last):
        k = i - geometry.first
        for j in range(around.shape[1]):
            x, y = vel[k, j, 0] + lag * kick_acc[k, j, 0], vel[k, j, 1] + lag * kick_acc[k, j, 1]
            c, s = geometry.cos[j], geometry.sin[j]
            radial[i + GHOSTS, j], around[i, j] = c * x + s * y, c * y - s * x
        mean[i] = around[i].mean()


@inline_jit
def least_sound(i, mean, geometry):
    """Return the lower bound of c_s of ring `i` in eq. (1)."""
    return abs(mean[i]) / geometry.radius[i] * (geometry.sides[i + 1] - geometry.sides[i])


@inline_jit
def side_state(z_left, z_right, rho_left, rho_right, p_left, p_right, u_left, u_right, stiff):
    """Return (p*, u*) of eq. (1); z_left, z_right: Sigma c_s of both cells."""
    closing = stiff * max(u_left - u_right, 0.0)
    left, right = z_left + rho_left * closing, z_right + rho_right * closing
    over = 1.0 / (left + right)
    p = (right * p_left + left * p_right + left * right * (u_left - u_right)) * over
    return max(p, 0.0), 0.5 * (u_left + u_right) + (p_left - p_right) * over


@jit_subroutine
def states_between_rings(side, old, now, density, sound, mean, stiff, geometry, out):
    """Write p* and u* (2, angles) at the side `side` between two rings, or at an edge.

    old, now (4, angles): lower and upper sides of p, then of u, of the rings within and beyond the side. At a closed
    edge the velocity is reflected; at an open edge p* and u* are those of the parabolas.
    """
    rings = len(density)
    least = least_sound(max(side - 1, 0), mean, geometry), least_sound(min(side, rings - 1), mean, geometry)
    for j in range(density.shape[1]):
        if 0 < side < rings:
            rho = density[side - 1, j], density[side, j]
            z = rho[0] * max(sound[side - 1, j], least[0]), rho[1] * max(sound[side, j], least[1])
            p, u = side_state(z[0], z[1], rho[0], rho[1], old[1, j], now[0, j], old[3, j], now[2, j], stiff)
        else:
            outer = side == rings
            p, u = (old[1, j], old[3, j]) if outer else (now[0, j], now[2, j])
            if geometry.closed:
                row, towards = (rings - 1, u) if outer else (0, -u)
                rho = density[row, j]
                speed = max(sound[row, j], least[0]) + stiff * max(2.0 * towards, 0.0)
                p = max(p + rho * speed * towards, 0.0)
                u = 0.0
        out[0, j], out[1, j] = p, u


@jit
def accelerate(first, last, pressure, radial, around, mean, density, sound, stiff, geometry, acc, heating):
    """Add the acceleration by pressure, eq. (2), to `acc` (own rings, angles, 2); return the largest rate of a step.

    pressure, radial (rings + 4, angles): with ghosts. around, density, sound (rings, angles). mean (rings,): means of
    `around`. stiff: s of eq. (1). heating (own rings, angles): set to the heating rate; (0, 0) for gas without an
    energy equation. The rate is the inverse of a cell's step limit (`ring_rate`).
    """
    angles = around.shape[1]
    sides, states = np.zeros((2, 4, angles)), np.zeros((2, 2, angles))
    padded, along = np.empty((2, angles + 6)), np.empty((4, angles + 2))
    p_around, u_around = np.empty(angles + 1), np.empty(angles + 1)
    fastest, heated = 0.0, heating.size > 0
    for side in range(first, last + 1):
        old, now = (side + 1) % 2, side % 2
        if side == first and side > 0:
            sides_of_ring(pressure, side + GHOSTS - 1, geometry.weights, sides[old, 0], sides[old, 1])
            sides_of_ring(radial, side + GHOSTS - 1, geometry.weights, sides[old, 2], sides[old, 3])
        if side < len(density):
            sides_of_ring(pressure, side + GHOSTS, geometry.weights, sides[now, 0], sides[now, 1])
            sides_of_ring(radial, side + GHOSTS, geometry.weights, sides[now, 2], sides[now, 3])
        states_between_rings(side, sides[old], sides[now], density, sound, mean, stiff, geometry, states[now])
        if side == first:
            continue
        i, own = side - 1, side - 1 - geometry.first
        least = least_sound(i, mean, geometry)
        pad_row(pressure[i + GHOSTS], 0.0, padded[0])
        pad_row(around[i], 0.0, padded[1])
        sides_along_ring(padded[0], along[0], along[1])
        sides_along_ring(padded[1], along[2], along[3])
        for j in range(angles + 1):
            left, right = (j - 1 if j > 0 else angles - 1), (j if j < angles else 0)
            rho, other = density[i, left], density[i, right]
            p_around[j], u_around[j] = side_state(
                rho * max(sound[i, left], least), other * max(sound[i, right], least), rho, other,
                along[1, j], along[0, j + 1], along[3, j], along[2, j + 1], stiff,
            )  # fmt: skip
        fastest = max(fastest, ring_rate(i, radial[i + GHOSTS], around[i], mean[i], sound[i], geometry))
        inner, outer = geometry.sides[i], geometry.sides[i + 1]
        middle, volume, wide = 0.5 * (inner + outer), geometry.volume[i], outer - inner
        for j in range(angles):
            per_mass = 1.0 / (density[i, j] * volume)
            around_per_mass = per_mass * wide / geometry.angle
            p_in, u_in, p_out, u_out = states[old, 0, j], states[old, 1, j], states[now, 0, j], states[now, 1, j]
            push = (p_out - p_in) * middle
            a_r, a_phi = -push * per_mass, (p_around[j] - p_around[j + 1]) * around_per_mass
            acc[own, j, 0] += a_r * geometry.cos[j] - a_phi * geometry.sin[j]
            acc[own, j, 1] += a_r * geometry.sin[j] + a_phi * geometry.cos[j]
            if heated:
                work = radial[i + GHOSTS, j] * push - p_out * outer * u_out + p_in * inner * u_in
                v = around[i, j]
                turning = p_around[j + 1] * (v - u_around[j + 1]) - p_around[j] * (v - u_around[j])
                heating[own, j] = work * per_mass + turning * around_per_mass
    return fastest


@jit_subroutine
def ring_rate(i, radial, around, mean, sound, geometry):
    """Return the largest of c_s |(1/dr, 1/(r dphi))| + |v_r| / dr + 2 |v_phi - mean| / (r dphi) in ring `i`.

    mean: of the azimuthal velocities `around` (angles,).
    """
    per_r = 1.0 / (geometry.sides[i + 1] - geometry.sides[i])
    per_phi = 1.0 / (geometry.radius[i] * geometry.angle)
    both, most = math.sqrt(per_r * per_r + per_phi * per_phi), 0.0
    for j in range(len(around)):
        rate = sound[j] * both + abs(radial[j]) * per_r + 2.0 * abs(around[j] - mean) * per_phi
        if not rate <= most:  # also keeps NaN
            most = rate
    return most
