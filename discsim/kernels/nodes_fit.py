"""Slopes about a node (`kernels/nodes.py`): of velocities pooled within species, and of each species' sources."""

import numpy as np
from numba import njit

from discsim.kernels.lines import solve_slope
from discsim.kernels.nodes import LEAST_INERTIA, MOMENTS, ROUNDING, SOURCES, VELOCITIES


@njit(nogil=True, cache=True, error_model="numpy")
def pooled_slope(n, blocks, cells, first, last, field, dim, inertia, moment, part, slope):
    """Slope (d, d) of the moments' `field` about node n, in sides, pooled within each of the species `first` to
    `last`; nearer cells count more.
    """
    mass = 0.0
    for a in range(2):
        for c2 in range(2):
            inertia[a, c2], moment[a, c2] = 0.0, 0.0
    for s in range(first, last):
        for f in range(VELOCITIES + 6):
            part[f] = 0.0
        for k in range(9):
            block = blocks[n, k]
            if block < 0 or cells[block, s, 0] == 0.0:
                continue
            i, j = k // 3 - 1, k % 3 - 1
            w = (0.5 if i == 0 else 0.25) * (0.5 if j == 0 else 0.25)
            c = cells[block, s]
            # About the node, which lies at (-i, -j) from the cell's middle.
            part[0] += w * c[0]
            part[1] += w * (c[1] + i * c[0])
            part[2] += w * (c[2] + j * c[0])
            part[3] += w * (c[3] + i * (2.0 * c[1] + i * c[0]))
            part[4] += w * (c[4] + i * c[2] + j * (c[1] + i * c[0]))
            part[5] += w * (c[5] + j * (2.0 * c[2] + j * c[0]))
            part[6] += w * c[field]
            part[7] += w * c[field + 1]
            part[8] += w * (c[field + 2] + i * c[field])
            part[9] += w * (c[field + 3] + i * c[field + 1])
            part[10] += w * (c[field + 4] + j * c[field])
            part[11] += w * (c[field + 5] + j * c[field + 1])
        mass += part[0]
        if part[0] > 0.0:
            for a in range(dim):
                for c2 in range(dim):
                    inertia[a, c2] += part[3 + a + c2] - part[1 + a] * part[1 + c2] / part[0]
                    moment[a, c2] += part[8 + 2 * a + c2] - part[1 + a] * part[6 + c2] / part[0]
    for a in range(dim):
        for c2 in range(dim):
            slope[a, c2] = 0.0
    spread = inertia[0, 0] + inertia[1, 1]
    if spread <= ROUNDING * mass:
        return False
    return solve_slope(inertia, moment, dim, slope) and spread > LEAST_INERTIA * mass


@njit(nogil=True, cache=True, error_model="numpy")
def fit_slopes(node_from, node_to, blocks, cells, nodes, pooled, slopes, source_slopes, known):
    """Slopes about the nodes: (nodes, d, d) of the velocities, pooled within the first `pooled` species; (nodes,
    species, d, d) of each species' sources, and whether it has one there.
    """
    species, dim = nodes.shape[1], slopes.shape[1]
    inertia, moment, part = np.zeros((2, 2)), np.zeros((2, 2)), np.empty(MOMENTS)
    none, velocities, sources = np.int64(0), np.int64(VELOCITIES), np.int64(SOURCES)  # each literal would compile anew
    for n in range(node_from, node_to):
        if nodes[n, 0, 0] > 0.0:
            pooled_slope(n, blocks, cells, none, pooled, velocities, dim, inertia, moment, part, slopes[n])
        for s in range(species):
            known[n, s] = pooled_slope(
                n, blocks, cells, s, s + 1, sources, dim, inertia, moment, part, source_slopes[n, s]
            )


@njit(nogil=True, cache=True, error_model="numpy")
def slope_near(n, s, about, slopes, known, out):
    """The slope (d, d) of a species' sources at a node: its own, or the mean of those about it."""
    dim = len(out)
    count = 0
    for a in range(dim):
        for c in range(dim):
            out[a, c] = slopes[n, s, a, c] if known[n, s] else 0.0
    if known[n, s]:
        return
    for k in range(9):
        if about[n, k] >= 0 and known[about[n, k], s]:
            count += 1
            for a in range(dim):
                for c in range(dim):
                    out[a, c] += slopes[about[n, k], s, a, c]
    if count > 0:
        for a in range(dim):
            for c in range(dim):
                out[a, c] /= count


@njit(nogil=True, cache=True, error_model="numpy")
def curvature(about, nodes, slopes, dim, out):
    """Second derivatives (3, d) of the velocity along xx, xy and yy, in sides, from the slopes at the next nodes."""
    for a in range(3):
        for c in range(dim):
            out[a, c] = 0.0
    for a in range(dim):
        step = 3 if a == 0 else 1
        low, high = about[4 - step], about[4 + step]
        if low < 0 or high < 0 or min(nodes[low, 0, 0], nodes[high, 0, 0]) <= 0.0:
            continue
        for e in range(dim):
            for c in range(dim):
                d = 0.5 * (slopes[high, e, c] - slopes[low, e, c])
                # The mixed derivative is the mean of both.
                out[a + e, c] += d if a == e else 0.5 * d
