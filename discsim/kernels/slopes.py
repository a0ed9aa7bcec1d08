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


@functools.cache
def slope_driver(kernel: int, dim: int):
    """Compile the pass that writes d v_c / d x_a of each particle to slope[i, a, c]; 0 where neighbours lack."""
    support = SUPPORT[kernel]

    @njit(nogil=True, cache=True, error_model="numpy")
    def fit(first, last, pos, vel, mass, h, slope, filled, grids, order, start, bounds, low, width, periodic):
        for c in range(first, last):
            cell = filled[c]
            index, shift = find_candidates(
                bounds[cell], bounds[cell, 4], False, pos, h, grids, order, start, bounds, low, width, periodic
            )
            for m in range(start[cell], start[cell + 1]):
                i = order[m]
                inertia, moment = np.zeros((dim, dim)), np.zeros((dim, dim))
                x = np.zeros(2)
                for n in range(len(index)):
                    k = index[n]
                    r2 = 0.0
                    for a in range(dim):
                        x[a] = pos[k, a] + shift[n, a] - pos[i, a]
                        r2 += x[a] * x[a]
                    w, _ = shape(kernel, dim, min(math.sqrt(r2) / h[i], support))
                    for a in range(dim):
                        for b in range(dim):
                            inertia[a, b] += mass[k] * w * x[a] * x[b]
                            moment[a, b] += mass[k] * w * x[a] * (vel[k, b] - vel[i, b])
                slope[i] = 0.0
                solve_slope(inertia, moment, dim, slope[i])

    return fit
