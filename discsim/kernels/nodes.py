"""Implicit drag between nodes of a lattice: gathered, relaxed and scattered with one set of weights.

Nodes J are the centres of cells, w the weights of the triangular-shaped cloud (Hockney & Eastwood 1988, ch. 5) in
units of the cell. Of each species s a node holds

    M_s = sum m w,   X_s = sum m w x / M_s,   V_s = sum m w y / M_s,   A_s = sum m w b / M_s              (1)

with y velocities (relative to Kepler's about a star) and b sources. The slip is that at the gas's centroid,

    V_s + G (X_g - X_s) - V_g,                                                                           (2)

G the slope pooled within species over the nine cells about the node; that of the sources is at the node itself,

    A_s - B_s X_s - (A_g - B_g X_g),                                                                     (2b)

B_s the slope of a species' own sources there (`fit_slopes`): where t_stop << dt the drag takes back nearly all that
they do in a step, and sources linear in space leave no error then. The slip relaxes exactly with the sources inside,
which changes the velocities by D_s, sum_s M_s D_s = 0, and a particle's by

    sum_J w_J D_s,J,                                                                                     (3)

so that momentum is exact. In two dimensions what the offset of the two centroids makes of angular momentum,

    sum_s M_s X_s x D_s,                                                                                 (4)

is taken from the gas about the node as a rotation about its centroid, scattered with the same weights. What is left
of a particle beside the line of its own species in its cell decays at the species' own rate (`rest`).
"""

import numpy as np
from numba import njit

from discsim.formulas.laws import EPSTEIN
from discsim.kernels.frame import kepler, sense_at

# A packed particle: mass, place from the middle of its cell in sides (2), velocity (2), source (2), and what the law
# of the drag needs of the gas; unused axes are 0. A species at a node: sums of w m times 1, each of these, and x^2.
FIELDS = 8
SQUARE = 8
LEAST_INERTIA = 0.01  # over mass times side^2: the least for gas about a node to be turned, and for a slope of sources
ROUNDING = 1e-9  # the same of particles at one place, but for rounding
# Of a species in a cell: m, m x (2), m xx, m xy, m yy, then m v (2), m x v (2), m y v (2), and the same of the sources.
VELOCITIES, SOURCES, MOMENTS = 6, 12, 18
# Columns as they are given to functions: each literal would compile anew.
C0, C1, C2, C3, C4, C5 = (np.int64(column) for column in range(6))


@njit(nogil=True, cache=True, error_model="numpy")
def pack(
    block_from, block_to, order, start, stride, pos, vel, own, mass, density, sound, law,
    corners, sides, size, periodic, frame, out,
):  # fmt: skip
    """Copy the members of the blocks in their order into out (n, FIELDS)."""
    dim, star = pos.shape[1], frame.star
    for block in range(block_from, block_to):
        inverse = 1.0 / sides[block]
        for k in range(start[block * stride], start[(block + 1) * stride]):
            i = order[k]
            out[k, 0] = mass[i]
            for a in range(dim):
                d = pos[i, a] - corners[block, a]
                if periodic:
                    d -= size[a] * np.floor(d / size[a])
                out[k, 1 + a] = d * inverse - 0.5
                out[k, 3 + a] = vel[i, a]
                if len(own) > 0:
                    out[k, 5 + a] = own[i, a]
            if star > 0.0:
                r2 = pos[i, 0] * pos[i, 0] + pos[i, 1] * pos[i, 1]
                omega = sense_at(r2, frame) * kepler(r2, star, frame.softening)
                out[k, 3] += omega * pos[i, 1]
                out[k, 4] -= omega * pos[i, 0]
            if len(density) > 0:
                out[k, 7] = density[i] * (sound[i] if law == EPSTEIN and star == 0.0 else 1.0)


@njit(cache=True, error_model="numpy", forceinline=True)
def cloud(x, flat):
    """Weights on the nodes -1, 0 and 1 from its own of a particle at x in [-1/2, 1/2]; `flat`: all on its own."""
    low, high = 0.5 - x, 0.5 + x
    if flat:
        return 0.0, 1.0, 0.0
    return 0.5 * low * low, 0.75 - x * x, 0.5 * high * high


@njit(nogil=True, cache=True, error_model="numpy")
def deposit(
    block_from, block_to, home, about, start, species, first, flat, sources, packed, nodes, norm, cells, clouds,
):  # fmt: skip
    """What each block gives to the nodes about it, clouds (blocks, all species, 9, SQUARE + 1), and its own moments,
    cells (blocks, all species, MOMENTS).

    `norm`, where it has entries, receives one over a particle's weights on nodes that have gas; 0 where none has.
    """
    value, w = np.empty(SQUARE + 1), np.empty(9)
    for block in range(block_from, block_to):
        near = about[home[block]]
        whole = True
        for k in range(9):
            if len(norm) > 0 and (near[k] < 0 or nodes[near[k], 0, 0] <= 0.0):
                whole = whole and flat and k % 3 != 1
        for s in range(species):
            o, c = clouds[block, first + s], cells[block, first + s]
            for p in range(start[block * species + s], start[block * species + s + 1]):
                m, x, y, vx, vy = packed[p, 0], packed[p, 1], packed[p, 2], packed[p, 3], packed[p, 4]
                c[0] += m
                c[1] += m * x
                c[2] += m * y
                c[3] += m * x * x
                c[4] += m * x * y
                c[5] += m * y * y
                c[6] += m * vx
                c[7] += m * vy
                c[8] += m * x * vx
                c[9] += m * x * vy
                c[10] += m * y * vx
                c[11] += m * y * vy
                if sources:
                    bx, by = packed[p, 5], packed[p, 6]
                    c[12] += m * bx
                    c[13] += m * by
                    c[14] += m * x * bx
                    c[15] += m * x * by
                    c[16] += m * y * bx
                    c[17] += m * y * by
                u0, u1, u2 = cloud(x, False)
                t0, t1, t2 = cloud(y, flat)
                w[0], w[1], w[2] = u0 * t0, u0 * t1, u0 * t2
                w[3], w[4], w[5] = u1 * t0, u1 * t1, u1 * t2
                w[6], w[7], w[8] = u2 * t0, u2 * t1, u2 * t2
                scale = 1.0
                if len(norm) > 0:
                    if not whole:
                        total = 0.0
                        for k in range(9):
                            if near[k] >= 0 and nodes[near[k], 0, 0] > 0.0:
                                total += w[k]
                            else:
                                w[k] = 0.0
                        scale = 1.0 / total if total > 0.0 else 0.0
                    norm[p] = scale
                m *= scale
                value[0] = m
                for f in range(1, FIELDS):
                    value[f] = m * packed[p, f]
                value[SQUARE] = m * (x * x + y * y)
                for k in range(9):
                    for f in range(SQUARE + 1):
                        o[k, f] += w[k] * value[f]


@njit(nogil=True, cache=True, error_model="numpy")
def collect(node_from, node_to, blocks, first, last, clouds, out):
    """Eq. (1): sums over species `first` to `last` at each node, places from it: out (nodes, species, SQUARE + 1)."""
    for n in range(node_from, node_to):
        for k in range(9):
            block = blocks[n, k]
            if block < 0:
                continue
            i, j = k // 3 - 1, k % 3 - 1
            for s in range(first, last):
                o, given = out[n, s], clouds[block, s, 8 - k]
                for f in range(SQUARE + 1):
                    o[f] += given[f]
                o[SQUARE] += 2.0 * (i * given[1] + j * given[2]) + (i * i + j * j) * given[0]
                o[1] += i * given[0]
                o[2] += j * given[0]
