"""Viscous forces on gas in polar cells: the full stress of a shear viscosity nu, as fluxes through the sides.

    T_rphi = mu (r d(v_phi/r)/dr + (1/r) dv_r/dphi),                                                      (1)
    T_rr = mu (2 dv_r/dr - (2/3) div v),   T_phiphi = mu (2 v_r/r + (2/r) dv_phi/dphi - (2/3) div v)      (2)

mu at a side is the harmonic mean of Sigma nu of both cells, which keeps the stress continuous at steps. The torque on a
cell is the difference of r^2 T_rphi dphi between its radial sides, and of r T_phiphi dr between the others, so that
angular momentum is conserved to rounding. Gas that holds heat gains the energy that the motion loses. No stress acts at
the edges of the grid.
"""

import numpy as np

from discsim.jit.decorators import inline_jit, jit, jit_subroutine
from discsim.kernels.polar.geometry import GHOSTS


@inline_jit
def harmonic_mean(a, b):
    """Return the harmonic mean of two numbers that are not negative."""
    return 2.0 * a * b / (a + b) if a + b > 0.0 else 0.0


@jit_subroutine
def stress_between_rings(side, radial, around, mu, geometry, out):
    """Write T_rr, T_rphi, v_r and v_phi / r at a side between two rings to `out` (4, angles)."""
    n, r = around.shape[1], geometry.sides[side]
    low, high = geometry.radius[side - 1], geometry.radius[side]
    apart, in_angle = 1.0 / (high - low), 0.25 / geometry.angle
    v_in, v_out, w_in, w_out = radial[side - 1 + GHOSTS], radial[side + GHOSTS], around[side - 1], around[side]
    for j in range(n):
        left, right = (j - 1 if j > 0 else n - 1), (j + 1 if j < n - 1 else 0)
        strength = harmonic_mean(mu[side - 1, j], mu[side, j])
        v = 0.5 * (v_in[j] + v_out[j])
        along = (v_out[j] - v_in[j]) * apart
        turn = (w_out[right] - w_out[left] + w_in[right] - w_in[left]) * in_angle
        third = (along + (v + turn) / r) / 3.0
        twist = r * (w_out[j] / high - w_in[j] / low) * apart
        twist += (v_out[right] - v_out[left] + v_in[right] - v_in[left]) * in_angle / r
        out[0, j], out[1, j] = 2.0 * strength * (along - third), strength * twist
        out[2, j], out[3, j] = v, 0.5 * (w_out[j] / high + w_in[j] / low)


@jit_subroutine
def stress_along_ring(i, radial, around, mu, geometry, out):
    """Write T_phiphi, T_rphi, v_r and v_phi / r at the side before each cell of ring `i` to `out` (4, angles)."""
    n, rings = around.shape[1], len(geometry.radius)
    low, high = max(i - 1, 0), min(i + 1, rings - 1)
    r, r_low, r_high = geometry.radius[i], geometry.radius[low], geometry.radius[high]
    apart = 0.5 / (r_high - r_low)
    v, v_low, v_high, w = radial[i + GHOSTS], radial[low + GHOSTS], radial[high + GHOSTS], around[i]
    for j in range(n):
        k = j - 1 if j > 0 else n - 1
        strength = harmonic_mean(mu[i, k], mu[i, j])
        speed = 0.5 * (v[k] + v[j])
        along = (v_high[k] - v_low[k] + v_high[j] - v_low[j]) * apart
        stretch = (speed + (w[j] - w[k]) / geometry.angle) / r
        third = (along + stretch) / 3.0
        twist = r * ((around[high, k] + around[high, j]) / r_high - (around[low, k] + around[low, j]) / r_low) * apart
        twist += (v[j] - v[k]) / (geometry.angle * r)
        out[0, j], out[1, j] = 2.0 * strength * (stretch - third), strength * twist
        out[2, j], out[3, j] = speed, 0.5 * (w[k] + w[j]) / r


@jit
def accelerate(first, last, radial, around, mu, density, geometry, acc, heating):
    """Add the viscous acceleration of the rings `first` to `last` to `acc` (own rings, angles, 2).

    radial (rings + 4, angles), around (rings, angles): velocities. mu (rings, angles): Sigma nu. density (own rings,
    angles). heating (own rings, angles): the heating rate is added; (0, 0) for gas without an energy equation.
    """
    n, rings, heated = around.shape[1], len(around), heating.size > 0
    sides, along = np.zeros((2, 4, n)), np.empty((4, n))
    for side in range(first, last + 1):
        old, now = sides[(side + 1) % 2], sides[side % 2]
        now[:] = 0.0
        if 0 < side < rings:
            stress_between_rings(side, radial, around, mu, geometry, now)
        if side == first:
            continue
        i, own = side - 1, side - 1 - geometry.first
        stress_along_ring(i, radial, around, mu, geometry, along)
        inner, outer, r = geometry.sides[i], geometry.sides[i + 1], geometry.radius[i]
        middle, wide = 0.5 * (inner + outer), (outer - inner) / geometry.angle
        for j in range(n):
            k = j + 1 if j < n - 1 else 0
            per_mass = 1.0 / (density[own, j] * geometry.volume[i])
            v, turning = radial[i + GHOSTS, j], around[i, j] / r
            hoop = 0.5 * (along[0, j] + along[0, k]) * (outer - inner)
            push = outer * now[0, j] - inner * old[0, j] + wide * (along[1, k] - along[1, j]) - hoop
            torque = outer**2 * now[1, j] - inner**2 * old[1, j] + middle * wide * (along[0, k] - along[0, j])
            a_r, a_phi = push * per_mass, torque * per_mass / r
            acc[own, j, 0] += a_r * geometry.cos[j] - a_phi * geometry.sin[j]
            acc[own, j, 1] += a_r * geometry.sin[j] + a_phi * geometry.cos[j]
            if heated:
                work = outer * now[0, j] * now[2, j] - inner * old[0, j] * old[2, j]
                work += wide * (along[1, k] * along[2, k] - along[1, j] * along[2, j])
                work += outer**2 * now[1, j] * now[3, j] - inner**2 * old[1, j] * old[3, j]
                work += middle * wide * (along[0, k] * along[3, k] - along[0, j] * along[3, j])
                heating[own, j] += (work - v * push - turning * torque) * per_mass
