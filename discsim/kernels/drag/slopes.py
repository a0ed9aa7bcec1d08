"""Velocity slopes G_i at the particles of one species, by least squares over the neighbours of each particle.

    G_i = [sum_k m_k W(r_ik, h_i) x_ik x_ik^T]^-1 [sum_k m_k W(r_ik, h_i) x_ik v_ik^T],   x_ik = x_k - x_i

The slope is exact for a linear velocity field, at any positions of the particles. Boosts and rotations add no error.
"""

import functools
import math

import numpy as np
from numba import njit

from discsim.jit.decorators import FAST, KERNEL, cached_njit
from discsim.kernels.common.candidates import max_candidates, pack_positions
from discsim.kernels.drag.linear_fit import solve
from discsim.kernels.sph.smoothing import SUPPORT, shape


@njit(inline="always")
def moment_sums(kernel, dim, x, y, vx, vy, h, n, cx, cy, cm, cvx, cvy):
    """Return seven moments of the neighbours of one particle: of position with position (3), and with velocity (4).

    (x, y), (vx, vy), h: position, velocity and smoothing length of the particle. cx, cy, cm, cvx, cvy: positions,
    masses and velocities of the `n` candidate neighbours. kernel, dim: smoothing kernel and number of dimensions.
    """
    support, inv_h = SUPPORT[kernel], 1.0 / h
    xx, xy, yy, xvx, xvy, yvx, yvy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(n):
        dx, dy = cx[k] - x, cy[k] - y
        w, _ = shape(kernel, dim, min(math.sqrt(dx * dx + dy * dy) * inv_h, support))
        w *= cm[k]
        dvx, dvy = cvx[k] - vx, cvy[k] - vy
        wx, wy = w * dx, w * dy
        xx += wx * dx
        xy += wx * dy
        yy += wy * dy
        xvx += wx * dvx
        xvy += wx * dvy
        yvx += wy * dvx
        yvy += wy * dvy
    return xx, xy, yy, xvx, xvy, yvx, yvy


@functools.cache
def slope_driver(kernel: int, dim: int):
    """Return the compiled loop that writes the velocity slopes of particles, d v_c / d x_a, to slope[i, a, c].

    The slope is 0 where a particle has too few neighbours.
    """

    @cached_njit(**KERNEL, fastmath=FAST)
    def fit(first, last, lists, pos, vel, mass, h, slope, cells):
        order, start = cells.order, cells.start
        begin, slots = lists.begin, lists.indices
        room = max_candidates(begin)
        cx, cy, cm, cvx, cvy = np.zeros(room), np.zeros(room), np.zeros(room), np.zeros(room), np.zeros(room)
        for c in range(first, last):
            cell, listed, end = cells.filled[c], begin[c - first], begin[c - first + 1]
            ox, oy = cells.bounds[cell, 0], cells.bounds[cell, 1]
            n = end - listed
            pack_positions(c - first, listed, end, lists, ox, oy, 1.0, cells, cx, cy)
            for k in range(n):
                j = order[slots[listed + k]]
                cvx[k], cm[k] = vel[j, 0], mass[j]
                if dim == 2:
                    cvy[k] = vel[j, 1]
            for m in range(start[cell], start[cell + 1]):
                i = order[m]
                y, vy = 0.0, 0.0
                if dim == 2:
                    y, vy = pos[i, 1] - oy, vel[i, 1]
                xx, xy, yy, xvx, xvy, yvx, yvy = moment_sums(
                    kernel, dim, pos[i, 0] - ox, y, vel[i, 0], vy, h[i], n, cx, cy, cm, cvx, cvy
                )
                _, uu, uv, vu, vv = solve(xx, xy, yy, xvx, xvy, yvx, yvy, dim, 1.0)
                slope[i, 0, 0] = uu
                if dim == 2:
                    slope[i, 0, 1], slope[i, 1, 0], slope[i, 1, 1] = uv, vu, vv

    return fit
