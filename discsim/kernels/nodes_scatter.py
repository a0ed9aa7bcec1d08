"""What a particle gets of the nodes about it, eq. (3) of `kernels/nodes.py`; what is left beside its own line; heat."""

import numpy as np
from numba import njit

from discsim.kernels.lines import solve_slope
from discsim.kernels.nodes import C0, C1, C2, C3, C4, C5, cloud
from discsim.kernels.nodes_fit import curvature
from discsim.kernels.relax import response


@njit(nogil=True, cache=True, error_model="numpy")
def node_heat(node_from, node_to, nodes, change, dt, heat):
    """Energy that eq. (3) takes at each node, to first order in the changes (the rest is the particles')."""
    for n in range(node_from, node_to):
        for s in range(change.shape[1]):
            for c in range(change.shape[2]):
                heat[n] -= change[n, s, c] * (nodes[n, s, 3 + c] + 0.5 * dt * nodes[n, s, 5 + c])


@njit(nogil=True, cache=True, error_model="numpy")
def pass_on(nodes, about, heat):
    """Heat of nodes without gas to those about them, in equal parts to each that has."""
    for n in range(len(heat)):
        if heat[n] == 0.0 or nodes[n, 0, 0] > 0.0:
            continue
        takers = 0
        for k in range(9):
            takers += 1 if about[n, k] >= 0 and nodes[about[n, k], 0, 0] > 0.0 else 0
        for k in range(9):
            if about[n, k] >= 0 and nodes[about[n, k], 0, 0] > 0.0:
                heat[about[n, k]] += heat[n] / takers


@njit(nogil=True, cache=True, error_model="numpy")
def spread_heat(block_from, block_to, home, about, order, start, flat, packed, nodes, node_heats, heat):
    """Heat per mass of each gas particle from that of the nodes."""
    table = np.zeros((9, 1))
    for block in range(block_from, block_to):
        near = about[home[block]]
        for k in range(9):
            n = near[k]
            table[k, 0] = node_heats[n] / nodes[n, 0, 0] if n >= 0 and nodes[n, 0, 0] > 0.0 else 0.0
        for p in range(start[block], start[block + 1]):
            u0, u1, u2 = cloud(packed[p, 1], False)
            t0, t1, t2 = cloud(packed[p, 2], flat)
            heat[order[p]] = blend(table, C0, u0, u1, u2, t0, t1, t2)


@njit(nogil=True, cache=True, error_model="numpy")
def own_line(first, last, packed, field, pooled, dim, inertia, moment, slope):
    """Mean place and mean of fields `field` and the next of some particles, and their slope.

    Any more than a line needs will do: with few of them little is left beside it, but nothing false. Those too few
    have the pooled slope and a rotation of their own: what is beside their line never has angular momentum.
    """
    m, sx, sy, sv, sw = 0.0, 0.0, 0.0, 0.0, 0.0
    for p in range(first, last):
        m += packed[p, 0]
        sx += packed[p, 0] * packed[p, 1]
        sy += packed[p, 0] * packed[p, 2]
        sv += packed[p, 0] * packed[p, field]
        sw += packed[p, 0] * packed[p, field + 1]
    sx, sy, sv, sw = sx / m, sy / m, sv / m, sw / m
    xx, xy, yy, xv, xw, yv, yw = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for p in range(first, last):
        x, y, v, w = packed[p, 1] - sx, packed[p, 2] - sy, packed[p, field] - sv, packed[p, field + 1] - sw
        mx, my = packed[p, 0] * x, packed[p, 0] * y
        xx += mx * x
        xy += mx * y
        yy += my * y
        xv += mx * v
        xw += mx * w
        yv += my * v
        yw += my * w
    own = last - first > dim + 1
    if own:
        inertia[0, 0], inertia[0, 1], inertia[1, 0], inertia[1, 1] = xx, xy, xy, yy
        moment[0, 0], moment[0, 1], moment[1, 0], moment[1, 1] = xv, xw, yv, yw
        own = solve_slope(inertia, moment, dim, slope)
    if not own:
        for a in range(dim):
            for c in range(dim):
                slope[a, c] = pooled[a, c]
        if dim == 2 and xx + yy > 0.0:
            torque = xw - yv - pooled[0, 1] * xx - (pooled[1, 1] - pooled[0, 0]) * xy + pooled[1, 0] * yy
            slope[0, 1] += torque / (xx + yy)
            slope[1, 0] -= torque / (xx + yy)
    return sx, sy, sv, sw


@njit(nogil=True, cache=True, error_model="numpy")
def apply_nodes(
    block_from, block_to, home, about, order, start, first, species, packed, sources, norm,
    nodes, slopes, change, spin, rate, dt, exponential, vel, acc, time, heat,
):  # fmt: skip
    """The kick of the particles in each block: free motion, eq. (3), the rotation of `spin` where it has entries, and
    the decay of what is left beside the line.

    Writes stopping times of dust into `time` and adds the energy lost to that of a block's own node in `heat`, where
    they have entries; packed velocities are overwritten. `frame` is what these leave out of a velocity, Kepler's and
    half a kick of what gas and dust share: from one orbit to another the same momentum is not the same energy.
    """
    dim = vel.shape[1]
    flat = dim == 1
    inertia, moment, even = np.empty((2, 2)), np.empty((2, 2)), np.zeros((2, 2))
    slope, slope_source, bend = np.zeros((2, 2)), np.zeros((2, 2)), np.zeros((3, 2))
    table, turns = np.zeros((9, 3)), np.zeros((9, 6))
    base = start[block_from * species]
    frame = np.zeros((start[block_to * species] - base if len(heat) > 0 else 0, 2))
    for block in range(block_from, block_to):
        near = about[home[block]]
        if len(spin) > 0:
            for k in range(9):
                n = near[k]
                for f in range(6):
                    turns[k, f] = 0.0
                if n >= 0 and spin[n] != 0.0:
                    gas = nodes[n, 0]
                    x, y = gas[1] / gas[0] + k // 3 - 1, gas[2] / gas[0] + k % 3 - 1
                    vx, vy = (gas[3] + 0.5 * dt * gas[5]) / gas[0], (gas[4] + 0.5 * dt * gas[6]) / gas[0]
                    turns[k, 0], turns[k, 1], turns[k, 2] = spin[n], spin[n] * x, spin[n] * y
                    turns[k, 3], turns[k, 4], turns[k, 5] = spin[n] * vx, spin[n] * vy, spin[n] * (y * vx - x * vy)
        for s in range(species):
            lo, hi = start[block * species + s], start[block * species + s + 1]
            if hi == lo:
                continue
            for k in range(9):
                n = near[k]
                table[k, 0] = rate[n, first + s] if n >= 0 else 0.0
                for c in range(dim):
                    table[k, 1 + c] = change[n, first + s, c] if n >= 0 else 0.0
            met, lost = 0.0, 0.0
            for p in range(lo, hi):
                i = order[p]
                u0, u1, u2 = cloud(packed[p, 1], False)
                t0, t1, t2 = cloud(packed[p, 2], flat)
                scale = norm[p] if len(norm) > 0 else 1.0
                local = scale * blend(table, C0, u0, u1, u2, t0, t1, t2)
                d = scale * blend(table, C1, u0, u1, u2, t0, t1, t2)
                spin_x, spin_y = 0.0, 0.0
                if len(spin) > 0:
                    omega = blend(turns, C0, u0, u1, u2, t0, t1, t2)
                    spin_x = blend(turns, C2, u0, u1, u2, t0, t1, t2) - omega * packed[p, 2]
                    spin_y = omega * packed[p, 1] - blend(turns, C1, u0, u1, u2, t0, t1, t2)
                if len(heat) > 0:
                    for c in range(dim):
                        frame[p - base, c] = vel[i, c] - packed[p, 3 + c] + 0.5 * dt * (acc[i, c] - packed[p, 5 + c])
                    if len(spin) > 0:
                        # `node_heat` has the work of eq. (3) alone. A rotation does none on the mean velocity.
                        work = spin_x * (packed[p, 3] + 0.5 * dt * packed[p, 5])
                        work += spin_y * (packed[p, 4] + 0.5 * dt * packed[p, 6])
                        work += packed[p, 2] * blend(turns, C3, u0, u1, u2, t0, t1, t2)
                        work -= packed[p, 1] * blend(turns, C4, u0, u1, u2, t0, t1, t2)
                        work -= blend(turns, C5, u0, u1, u2, t0, t1, t2)
                        lost -= packed[p, 0] * work
                d += spin_x
                packed[p, 3] += d
                lost -= 0.5 * packed[p, 0] * d * d
                if len(heat) > 0:
                    lost -= packed[p, 0] * d * frame[p - base, 0]
                vel[i, 0] += dt * acc[i, 0] + d
                if not flat:
                    d = scale * blend(table, C2, u0, u1, u2, t0, t1, t2) + spin_y
                    packed[p, 4] += d
                    lost -= 0.5 * packed[p, 0] * d * d
                    if len(heat) > 0:
                        lost -= packed[p, 0] * d * frame[p - base, 1]
                    vel[i, 1] += dt * acc[i, 1] + d
                met += local / (hi - lo)
                if len(time) > 0:
                    time[i] = 1.0 / local if local > 0.0 else np.inf
            if met > 0.0:
                f, g = response(met, dt, exponential)
                curvature(near, nodes, slopes, dim, bend)
                for p in range(lo, hi):
                    bx, by = bent(bend, packed[p, 1], packed[p, 2])
                    packed[p, 3] -= bx
                    packed[p, 4] -= by
                sx, sy, sv, sw = own_line(lo, hi, packed, C3, slopes[home[block]], dim, inertia, moment, slope)
                tx, ty, tv, tw = 0.0, 0.0, 0.0, 0.0
                if sources:
                    tx, ty, tv, tw = own_line(lo, hi, packed, C5, even, dim, inertia, moment, slope_source)
                for p in range(lo, hi):
                    i = order[p]
                    x, y = packed[p, 1] - sx, packed[p, 2] - sy
                    rest = packed[p, 3] - sv - slope[0, 0] * x - slope[1, 0] * y
                    rest_y = packed[p, 4] - sw - slope[0, 1] * x - slope[1, 1] * y
                    more, more_y = f * rest, f * rest_y
                    if sources:
                        x, y = packed[p, 1] - tx, packed[p, 2] - ty
                        more += g * (packed[p, 5] - tv - slope_source[0, 0] * x - slope_source[1, 0] * y)
                        more_y += g * (packed[p, 6] - tw - slope_source[0, 1] * x - slope_source[1, 1] * y)
                    vel[i, 0] += more
                    if not flat:
                        vel[i, 1] += more_y
                    if len(heat) > 0:
                        # The changes have no mean: what is common to the cell does no work.
                        bx, by = bent(bend, packed[p, 1], packed[p, 2])
                        along = frame[p - base, 0] + 0.5 * (dt * packed[p, 5] + more)
                        lost -= packed[p, 0] * more * (packed[p, 3] - sv + bx + along)
                        if not flat:
                            along = frame[p - base, 1] + 0.5 * (dt * packed[p, 6] + more_y)
                            lost -= packed[p, 0] * more_y * (packed[p, 4] - sw + by + along)
            if len(heat) > 0:
                heat[home[block]] += lost


@njit(cache=True, error_model="numpy", forceinline=True)
def bent(bend, x, y):
    """The quadratic part of a velocity at (x, y) from its second derivatives."""
    xx, xy, yy = 0.5 * x * x, x * y, 0.5 * y * y
    return bend[0, 0] * xx + bend[1, 0] * xy + bend[2, 0] * yy, bend[0, 1] * xx + bend[1, 1] * xy + bend[2, 1] * yy


@njit(cache=True, error_model="numpy", forceinline=True)
def blend(table, c, u0, u1, u2, t0, t1, t2):
    """Sum of column c over the nine nodes with the products of the weights."""
    low = t0 * table[0, c] + t1 * table[1, c] + t2 * table[2, c]
    middle = t0 * table[3, c] + t1 * table[4, c] + t2 * table[5, c]
    high = t0 * table[6, c] + t1 * table[7, c] + t2 * table[8, c]
    return u0 * low + u1 * middle + u2 * high
