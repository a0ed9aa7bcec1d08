"""Scatter: what a particle gets of the nodes about it, eq. (3) of `kernels/nodes.py`; what is left beside its line."""

import numpy as np
from numba import njit

from discsim.kernels.inner import inner
from discsim.kernels.lines import solve
from discsim.kernels.nodes import BX, BY, DX, DY, MASS, NORM, ONE, RATE, SPIN, VX, VY, WHOLE, X, Y
from discsim.kernels.nodes_gather import most_in
from discsim.kernels.nodes_heat import loss, turns_about
from discsim.kernels.nodes_weights import to_polynomial, value_at
from discsim.kernels.relax import response
from discsim.kernels.rows import LANES, empty_row, lane, load, store

V, A = np.int64(0), np.int64(BX)  # each literal given to a function would compile anew


@inner
def values_about(block, s, cells, nodes, value, turns, table):
    """What the nodes about a cell bring to a species, as polynomials."""
    home = cells.home[block]
    for k in range(9):
        n, row = nodes.about[home, k], empty_row()
        if n >= 0:
            row = load(value, (n * value.shape[1] + s) * LANES)
        store(table, k * LANES, row)
        if turns:  # about the cell's middle, not the node
            table[k, DX] += (k % 3 - 1) * lane(row, SPIN)
            table[k, DY] -= (k // 3 - 1) * lane(row, SPIN)


@inner
def weigh_grains(first, last, kind, share, row):
    """Mass and norm of weights of grains, where nodes took them one by one."""
    for k in range(first, last):
        row[k, MASS] = kind.mass[kind.order[k]]
        row[k, NORM] = share[k] / row[k, MASS]


@inner
def rate_in(block, s, cells, nodes, value):
    """Mean rate of a species in a cell."""
    rate, cell = 0.0, cells.slot[block, s]
    for k in range(9):
        n = nodes.about[cells.home[block], k]
        if n >= 0:
            rate += cells.given[cell, k, ONE] * value[n, s, RATE]
    return rate / cells.own[cell, WHOLE, ONE]


@inner
def rate_of(first, last, row, table):
    """The same of its particles."""
    rate, mass = 0.0, 0.0
    for k in range(first, last):
        m = row[k, MASS]
        rate += m * row[k, NORM] * lane(value_at(table, 0, row[k, X], row[k, Y]), RATE)
        mass += m
    return rate / mass


@inner
def curvature(home, about, sums, slope, bend):
    """Half the second derivatives of the velocity along xx, xy (whole) and yy, in sides, from the slopes at the next
    nodes: bend (2, 3).
    """
    for c in range(2):
        bend[c, 0], bend[c, 1], bend[c, 2] = 0.0, 0.0, 0.0
    for axis in range(2):
        step = 3 if axis == 0 else 1
        low, high = about[home, 4 - step], about[home, 4 + step]
        if low < 0 or high < 0 or min(sums[low, 0, ONE], sums[high, 0, ONE]) <= 0.0:
            continue
        for c in range(2):
            along = 0.5 * (slope[high, 2 * axis + c] - slope[low, 2 * axis + c])
            across = 0.5 * (slope[high, 2 - 2 * axis + c] - slope[low, 2 - 2 * axis + c])
            bend[c, 2 * axis] += 0.5 * along
            bend[c, 1] += 0.5 * across  # the mixed derivative is the mean of both


@inner
def own_line(first, last, row, value, base, f, x0, y0, pooled, dim):
    """Centroid of some particles, near (x0, y0), mean of columns f and f + 1 of `value` (row `base` there is row 0),
    and their slope.

    Any more than a line needs will do: with few of them little is left beside it, but nothing false. Those too few
    have the slope `pooled` and a rotation of their own: what is beside their line never has angular momentum.
    """
    m, sx, sy, su, sv = 0.0, 0.0, 0.0, 0.0, 0.0
    xx, xy, yy, xu, xv, yu, yv = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    u0, v0 = value[first - base, f], value[first - base, f + 1]
    for k in range(first, last):
        one, x, y = row[k, MASS], row[k, X] - x0, row[k, Y] - y0
        u, v = value[k - base, f] - u0, value[k - base, f + 1] - v0
        mx, my = one * x, one * y
        m += one
        sx += mx
        sy += my
        su += one * u
        sv += one * v
        xx += mx * x
        xy += mx * y
        yy += my * y
        xu += mx * u
        xv += mx * v
        yu += my * u
        yv += my * v
    x0, y0, su, sv = x0 + sx / m, y0 + sy / m, su / m, sv / m
    # Where all are at one place their distance from (x0, y0) is its rounding, and has to meet no mean velocity.
    xu, xv, yu, yv = xu - sx * su, xv - sx * sv, yu - sy * su, yv - sy * sv
    if last - first > np.uint64(dim + 1):
        found, uu, uv, vu, vv = solve(xx, xy, yy, xu, xv, yu, yv, dim, 1.0)
        if found:
            return x0, y0, u0 + su, v0 + sv, uu, uv, vu, vv
    uu, uv, vu, vv = pooled
    if dim == 2 and xx + yy > 0.0:
        torque = xv - yu - uv * xx - (vv - uu) * xy + vu * yy
        uv += torque / (xx + yy)
        vu -= torque / (xx + yy)
    return x0, y0, u0 + su, v0 + sv, uu, uv, vu, vv


@inner
def add_changes(first, last, row, table, turns, bend, new):
    """new (n, 4): velocity of each particle with what the nodes bring, less its quadratic part, and what they bring."""
    for k in range(first, last):
        x, y, p = row[k, X], row[k, Y], k - first
        xx, xy, yy = x * x, x * y, y * y
        value = value_at(table, 0, x, y)
        dx, dy = lane(value, DX), lane(value, DY)
        if turns:
            dx -= lane(value, SPIN) * y
            dy += lane(value, SPIN) * x
        else:
            dx, dy = row[k, NORM] * dx, row[k, NORM] * dy
        new[p, 0] = row[k, VX] + dx - (bend[0, 0] * xx + bend[0, 1] * xy + bend[0, 2] * yy)
        new[p, 1] = row[k, VY] + dy - (bend[1, 0] * xx + bend[1, 1] * xy + bend[1, 2] * yy)
        new[p, 2], new[p, 3] = dx, dy


@inner
def damp(first, last, row, x0, y0, pooled, sources, f, g, dim, new):
    """Turn the velocity in `new` into what the decay of what is left beside the own line changes; returns the mean of
    the velocity.
    """
    x0, y0, u, v, uu, uv, vu, vv = own_line(first, last, row, new, first, V, x0, y0, pooled, dim)
    for k in range(first, last):
        x, y, p = row[k, X] - x0, row[k, Y] - y0, k - first
        new[p, 0] = f * (new[p, 0] - u - uu * x - vu * y)
        new[p, 1] = f * (new[p, 1] - v - uv * x - vv * y)
    if sources:
        even, base = (0.0, 0.0, 0.0, 0.0), np.uint64(0)
        x0, y0, a, b, uu, uv, vu, vv = own_line(first, last, row, row, base, A, x0, y0, even, dim)
        for k in range(first, last):
            x, y, p = row[k, X] - x0, row[k, Y] - y0, k - first
            new[p, 0] += g * (row[k, BX] - a - uu * x - vu * y)
            new[p, 1] += g * (row[k, BY] - b - uv * x - vv * y)
    return u, v


@inner
def kick(first, last, kind, dt, new):
    for k in range(first, last):
        i, p = kind.order[k], k - first
        kind.vel[i, 0] += dt * kind.acc[i, 0] + (new[p, 2] + new[p, 0])
        if kind.vel.shape[1] == 2:
            kind.vel[i, 1] += dt * kind.acc[i, 1] + (new[p, 3] + new[p, 1])


@inner
def scatter_species(block, part, kind, cells, nodes, sharp, row, dt, exponential, new, table, work, bend):
    """The kick of one population in a block; adds the energy lost to that of the block's own node where heat has
    entries. Returns its mean rate.
    """
    dim, s, home = kind.pos.shape[1], kind.first + part, cells.home[block]
    first = np.uint64(kind.start[block * kind.number + part])
    last = np.uint64(kind.start[block * kind.number + part + 1])
    if first == last:
        return 0.0
    turns = len(nodes.square) > 0 and s == 0
    values_about(block, s, cells, nodes, sharp.value, turns, table)
    to_polynomial(table, 0, dim == 1)
    if s > 0 and len(cells.total) > 0:
        weigh_grains(first, last, kind, cells.share, row)
        rate = rate_of(first, last, row, table)
    else:
        rate = rate_in(block, s, cells, nodes, sharp.value)
    add_changes(first, last, row, table, turns, bend, new)
    u, v = 0.0, 0.0
    if rate > 0.0:
        pooled = (sharp.slope[home, 0], sharp.slope[home, 1], sharp.slope[home, 2], sharp.slope[home, 3])
        cell = cells.slot[block, s]
        own = cells.own[cell, WHOLE, ONE]
        x0, y0 = cells.own[cell, WHOLE, X] / own, cells.own[cell, WHOLE, Y] / own
        f, g = response(rate, dt, exponential)
        u, v = damp(first, last, row, x0, y0, pooled, len(kind.own) > 0, f, g, dim, new)
    else:
        for p in range(last - first):
            new[p, 0], new[p, 1] = 0.0, 0.0
    if len(sharp.heat) > 0:
        sharp.heat[home] += loss(first, last, kind, row, work, turns, u, v, dt, new)
    kick(first, last, kind, dt, new)
    return rate


@inner
def scatter_block(block, kind, cells, nodes, sharp, row, dt, exponential, met, new, table, work, bend):
    """The kick of the particles of a block, and the mean rate of each population."""
    curvature(cells.home[block], nodes.about, nodes.sums, sharp.slope, bend)
    if len(sharp.turn) > 0 and kind.first == 0:
        turns_about(cells.home[block], nodes.about, sharp.turn, work)
    for part in range(kind.number):
        met[block, part] = scatter_species(
            block, part, kind, cells, nodes, sharp, row, dt, exponential, new, table, work, bend
        )


@njit(nogil=True, cache=True, error_model="numpy")
def scatter(block_from, block_to, kind, cells, nodes, sharp, row, dt, exponential, met):
    """The kick of the particles in each block: free motion, eq. (3), the gas's rotation, eq. (4) taken back, and the
    decay of what is left beside the line. Writes the mean rate of each population in each block, `met`
    (blocks, number), and adds to `sharp.heat` where it has entries.
    """
    new, bend = np.empty((most_in(block_from, block_to, kind), 4)), np.empty((2, 3))
    table, work = np.empty((9, LANES)), np.empty((2, 9, LANES))
    for block in range(block_from, block_to):
        scatter_block(block, kind, cells, nodes, sharp, row, dt, exponential, met, new, table, work, bend)


@inner
def times_in(block, part, kind, cells, nodes, value, row, table, time):
    """Stopping times of one population in a block."""
    if cells.slot[block, kind.first + part] < 0:
        return
    values_about(block, kind.first + part, cells, nodes, value, False, table)
    to_polynomial(table, 0, kind.pos.shape[1] == 1)
    for k in range(kind.start[block * kind.number + part], kind.start[block * kind.number + part + 1]):
        rate = row[k, NORM] * lane(value_at(table, 0, row[k, X], row[k, Y]), RATE)
        time[kind.order[k]] = 1.0 / rate if rate > 0.0 else np.inf


@njit(nogil=True, cache=True, error_model="numpy")
def stopping_times(block_from, block_to, kind, cells, nodes, value, row, time):
    """Stopping time of each dust particle, one over the rate that the nodes bring it; inf where there is none."""
    table = np.empty((9, LANES))
    for block in range(block_from, block_to):
        for part in range(kind.number):
            times_in(block, part, kind, cells, nodes, value, row, table, time)
