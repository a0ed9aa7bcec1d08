"""Velocity slopes of one population of particles, by least squares over each particle's neighbours.

    G_i = [sum_k m_k W(r_ik, h_i) x_ik x_ik^T]^-1 [sum_k m_k W(r_ik, h_i) x_ik v_ik^T],   x_ik = x_k - x_i

It is exact for a linear velocity field on any particles, so that neither a boost nor a rotation changes it.
"""

import functools
import math

import numpy as np
from numba import njit

from discsim.kernels.drag import solve_slope
from discsim.kernels.neighbours import find_candidates
from discsim.kernels.smoothing import SUPPORT, shape

FAST = {"reassoc", "contract", "arcp", "nsz"}


@njit(inline="always")
def moment_sums(kernel, dim, x, y, vx, vy, h, cx, cy, cm, cvx, cvy):
    """Second moments of the neighbours of one particle: of place with place, and with velocity."""
    support, inv_h = SUPPORT[kernel], 1.0 / h
    xx, xy, yy, xvx, xvy, yvx, yvy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(len(cx)):
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
    """Compile the pass that writes d v_c / d x_a of each particle to slope[i, a, c]; 0 where neighbours lack."""

    @njit(nogil=True, cache=True, fastmath=FAST, error_model="numpy")
    def fit(first, last, pos, vel, mass, h, slope, filled, grids, order, start, bounds, low, width, periodic):
        inertia, moment = np.empty((2, 2)), np.empty((2, 2))
        for c in range(first, last):
            cell = filled[c]
            ox = 0.5 * (bounds[cell, 0] + bounds[cell, 1])
            oy = 0.5 * (bounds[cell, 2] + bounds[cell, 3])
            index, shift = find_candidates(
                bounds[cell], bounds[cell, 4], False, pos, h, grids, order, start, bounds, low, width, periodic
            )
            n = len(index)
            cx, cy, cm, cvx, cvy = np.empty(n), np.zeros(n), np.empty(n), np.empty(n), np.zeros(n)
            for k in range(n):
                j = index[k]
                cx[k], cvx[k], cm[k] = pos[j, 0] + (shift[k, 0] - ox), vel[j, 0], mass[j]
                if dim == 2:
                    cy[k], cvy[k] = pos[j, 1] + (shift[k, 1] - oy), vel[j, 1]
            for m in range(start[cell], start[cell + 1]):
                i = order[m]
                y, vy = 0.0, 0.0
                if dim == 2:
                    y, vy = pos[i, 1] - oy, vel[i, 1]
                xx, xy, yy, xvx, xvy, yvx, yvy = moment_sums(
                    kernel, dim, pos[i, 0] - ox, y, vel[i, 0], vy, h[i], cx, cy, cm, cvx, cvy
                )
                inertia[0, 0], inertia[0, 1], inertia[1, 0], inertia[1, 1] = xx, xy, xy, yy
                moment[0, 0], moment[0, 1], moment[1, 0], moment[1, 1] = xvx, xvy, yvx, yvy
                slope[i] = 0.0
                solve_slope(inertia, moment, dim, slope[i])

    return fit
