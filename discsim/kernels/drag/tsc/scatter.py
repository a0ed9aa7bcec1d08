"""Scatter from nodes to particles, eq. (3) of `nodes.py`, and the decay of deviations from the linear fit.

The linear fit is that to the velocities of the particles of one species in a cell.
"""

import numpy as np

from discsim.jit.decorators import inline_jit, jit
from discsim.jit.index import index
from discsim.kernels.common.simd import LANES, extract, horizontal_sums, load, prefetch, store, zeros
from discsim.kernels.drag.lines import solve
from discsim.kernels.drag.relax import response
from discsim.kernels.drag.tsc.columns import fetch_columns, filled, is_ragged, most_in
from discsim.kernels.drag.tsc.heat import particle_heat, turns_about
from discsim.kernels.drag.tsc.nodes import BX, DX, DY, FIELDS, MASS, NORM, ONE, RATE, SPIN, VX, VY, WHOLE, X, Y
from discsim.kernels.drag.tsc.weights import evaluate_lane, to_polynomial


@inline_jit
def values_about(block, s, cells, nodes, value, turns, table):
    """Write the values of the nodes about a cell for a species, as polynomials."""
    home = cells.home[block]
    for k in range(9):
        n, row = nodes.about[home, k], zeros()
        if n >= 0:
            row = load(value, (n * value.shape[1] + s) * LANES)
        store(table, k * LANES, row)
        if turns:  # rotation about the cell's centre instead of the node
            table[k, DX] += (k % 3 - 1) * extract(row, SPIN)
            table[k, DY] -= (k // 3 - 1) * extract(row, SPIN)


@inline_jit
def place_of(block, part, kind, cells, begin, column, held):
    """Return the element of `held` at which the columns of a population in a block begin.

    These columns are those of the gather. Grains that nodes take one by one were gathered as rows, which are copied
    to columns here.
    """
    seat = block * kind.number + part
    if not by_grain(kind, cells):
        return begin[seat]
    first, count = kind.start[seat], kind.start[seat + 1] - kind.start[seat]
    n = filled(count)
    for at in range(n):
        k = first + (at if at < count else count - 1)
        for f in range(FIELDS):
            held[f * n + at] = column[k * FIELDS + f]
        m = kind.mass[kind.order[k]]
        held[MASS * n + at], held[NORM * n + at] = m if at < count else 0.0, cells.share[k] / m
    return 0


@inline_jit
def by_grain(kind, cells):
    """Return whether nodes take these particles one by one (`nodes_grains`)."""
    return kind.first > 0 and len(cells.total) > 0


@inline_jit
def has_norms(block, kind, cells, nodes):
    """Return whether the weights of particles in a block do not add up to 1."""
    return kind.first > 0 and (
        by_grain(kind, cells) or is_ragged(cells.home[block], kind.pos.shape[1] == 1, nodes.about, nodes.sums)
    )


@inline_jit
def rate_in(block, s, cells, nodes, value):
    """Return the mean rate of drag of a species in a cell."""
    rate, cell = 0.0, cells.slot[block, s]
    for k in range(9):
        n = nodes.about[cells.home[block], k]
        if n >= 0:
            rate += cells.given[cell, k, ONE] * value[n, s, RATE]
    return rate / cells.own[cell, WHOLE, ONE]


@inline_jit
def rate_of(count, n, begin, column, table):
    """Return the mean rate of drag over the particles of a species in a cell."""
    rate, mass = 0.0, 0.0
    for at in range(begin, begin + count):
        m = column[at + MASS * n]
        rate += m * column[at + NORM * n] * evaluate_lane(table, RATE, column[at + X * n], column[at + Y * n])
        mass += m
    return rate / mass


@inline_jit
def curvature(home, about, sums, slope, bend):
    """Write the second derivatives of the velocity to `bend` (2, 3): half of xx, xy, and half of yy.

    They are in sides of the cell, from the slopes at neighbouring nodes.
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


@inline_jit
def own_line(count, n, begin, column, at_value, value, x0, y0, pooled, dim):
    """Return the linear fit of particles to two columns of `value`, from `at_value` on: centroid, means and slopes.

    The columns of the particles begin at `begin`, and (x0, y0) is near their centroid. One particle more than a
    linear fit needs is enough: the deviations of few particles are small, but not wrong. With fewer particles the
    slopes are `pooled` plus a rotation of their own. The deviations therefore never have angular momentum.
    """
    sx, sy, su, sv = zeros(), zeros(), zeros(), zeros()
    xx, xy, yy, m = zeros(), zeros(), zeros(), zeros()
    xu, xv, yu, yv = zeros(), zeros(), zeros(), zeros()
    u0, v0 = value[at_value], value[at_value + n]
    for p in range(0, n, LANES):
        at = begin + p
        one, x, y = load(column, at + MASS * n), load(column, at + X * n) - x0, load(column, at + Y * n) - y0
        u, v = load(value, at_value + p) - u0, load(value, at_value + n + p) - v0
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
    first, inertia, moment = (
        horizontal_sums(sx, sy, su, sv),
        horizontal_sums(xx, xy, yy, m),
        horizontal_sums(xu, xv, yu, yv),
    )
    return line(count, x0, y0, u0, v0, first, inertia, moment, pooled, dim)


@inline_jit
def line(count, x0, y0, u0, v0, first, inertia, moment, pooled, dim):
    """Return the linear fit of `own_line` from sums of its particles.

    The sums are of m times x, y, u, v; of m times xx, xy, yy, 1; and of m times xu, xv, yu, yv. All are relative to
    x0, y0, u0, v0.
    """
    m, sx, sy = extract(inertia, 3), extract(first, 0), extract(first, 1)
    xx, xy, yy = extract(inertia, 0), extract(inertia, 1), extract(inertia, 2)
    x0, y0, su, sv = x0 + sx / m, y0 + sy / m, extract(first, 2) / m, extract(first, 3) / m
    # The distance of coincident particles from (x0, y0) is rounding, and must not be multiplied by a mean velocity.
    xu, xv = extract(moment, 0) - sx * su, extract(moment, 1) - sx * sv
    yu, yv = extract(moment, 2) - sy * su, extract(moment, 3) - sy * sv
    if count > dim + 1:
        found, uu, uv, vu, vv = solve(xx, xy, yy, xu, xv, yu, yv, dim, 1.0)
        if found:
            return x0, y0, u0 + su, v0 + sv, uu, uv, vu, vv
    uu, uv, vu, vv = pooled
    if dim == 2 and xx + yy > 0.0:
        torque = xv - yu - uv * xx - (vv - uu) * xy + vu * yy
        uv += torque / (xx + yy)
        vu -= torque / (xx + yy)
    return x0, y0, u0 + su, v0 + sv, uu, uv, vu, vv


@inline_jit
def add_changes(n, begin, column, table, turns, normed, bend, new):
    """Write particle velocities with the changes by the nodes, and these changes, to `new`.

    From column 0 on `new` has the velocity less its quadratic part (2), then the change (2).
    """
    for p in range(0, n, LANES):
        at = begin + p
        x, y = load(column, at + X * n), load(column, at + Y * n)
        xx, xy, yy = x * x, x * y, y * y
        dx, dy = evaluate_lane(table, DX, x, y), evaluate_lane(table, DY, x, y)
        if turns:
            spin = evaluate_lane(table, SPIN, x, y)
            dx, dy = dx - spin * y, dy + spin * x
        elif normed:
            norm = load(column, at + NORM * n)
            dx, dy = norm * dx, norm * dy
        u, v = load(column, at + VX * n) + dx, load(column, at + VY * n) + dy
        store(new, p, u - (bend[0, 0] * xx + bend[0, 1] * xy + bend[0, 2] * yy))
        store(new, p + n, v - (bend[1, 0] * xx + bend[1, 1] * xy + bend[1, 2] * yy))
        store(new, p + 2 * n, dx)
        store(new, p + 3 * n, dy)


@inline_jit
def damp(count, n, begin, column, x0, y0, pooled, sources, f, g, dim, new):
    """Replace the velocity in `new` by its change through the decay of deviations from the linear fit.

    Returns the mean of the velocity.
    """
    motion, even, source = np.int64(0), (0.0, 0.0, 0.0, 0.0), begin + BX * n  # a literal would be compiled separately
    x0, y0, u, v, uu, uv, vu, vv = own_line(count, n, begin, column, motion, new, x0, y0, pooled, dim)
    if not sources:
        for p in range(0, n, LANES):
            x, y = load(column, begin + X * n + p) - x0, load(column, begin + Y * n + p) - y0
            store(new, p, f * (load(new, p) - u - uu * x - vu * y))
            store(new, p + n, f * (load(new, p + n) - v - uv * x - vv * y))
        return u, v
    _, _, a, b, au, av, bu, bv = own_line(count, n, begin, column, source, column, x0, y0, even, dim)
    for p in range(0, n, LANES):
        x, y = load(column, begin + X * n + p) - x0, load(column, begin + Y * n + p) - y0
        left, right = load(new, p) - u - uu * x - vu * y, load(new, p + n) - v - uv * x - vv * y
        beside, along = (
            load(column, source + p) - a - au * x - bu * y,
            load(column, source + n + p) - b - av * x - bv * y,
        )
        store(new, p, f * left + g * beside)
        store(new, p + n, f * right + g * along)
    return u, v


@inline_jit
def fetch_motion(first, count, kind):
    """Prefetch the particles that `kick` changes: they are scattered in memory, which no processor predicts."""
    start, dim = index(first), index(kind.vel.shape[1])
    for at in range(index(count)):
        i = dim * kind.order[start + at]
        prefetch(kind.vel, i)
        prefetch(kind.acc, i)


@inline_jit
def kick(first, count, n, kind, dt, new):
    start, along, across, more = index(first), index(n), index(2 * n), index(3 * n)
    for at in range(index(count)):
        i = kind.order[start + at]
        kind.vel[i, 0] += dt * kind.acc[i, 0] + (new[across + at] + new[at])
        if kind.vel.shape[1] == 2:
            kind.vel[i, 1] += dt * kind.acc[i, 1] + (new[more + at] + new[along + at])


@inline_jit
def scatter_species(block, part, kind, cells, nodes, sharp, begin, column, dt, exponential, new, table, work, bend):
    """Kick one population in a block, and return its mean rate of drag.

    Adds the energy lost to the heat of the block's own node, where heat has entries.
    """
    dim, s, home = kind.pos.shape[1], kind.first + part, cells.home[block]
    first = kind.start[block * kind.number + part]
    count = kind.start[block * kind.number + part + 1] - first
    if count == 0:
        return 0.0
    n, turns = filled(count), len(nodes.square) > 0 and s == 0
    fetch_motion(first, count, kind)
    fetch_columns(n, len(kind.own) > 0, begin, column)
    values_about(block, s, cells, nodes, sharp.value, turns, table)
    to_polynomial(table, 0, dim == 1)
    if by_grain(kind, cells):
        rate = rate_of(count, n, begin, column, table)
    else:
        rate = rate_in(block, s, cells, nodes, sharp.value)
    add_changes(n, begin, column, table, turns, has_norms(block, kind, cells, nodes), bend, new)
    u, v = 0.0, 0.0
    if rate > 0.0:
        pooled = (sharp.slope[home, 0], sharp.slope[home, 1], sharp.slope[home, 2], sharp.slope[home, 3])
        cell = cells.slot[block, s]
        own = cells.own[cell, WHOLE, ONE]
        x0, y0 = cells.own[cell, WHOLE, X] / own, cells.own[cell, WHOLE, Y] / own
        f, g = response(rate, dt, exponential)
        u, v = damp(count, n, begin, column, x0, y0, pooled, len(kind.own) > 0, f, g, dim, new)
    else:
        for p in range(0, n, LANES):
            store(new, p, zeros())
            store(new, p + n, zeros())
    if len(sharp.heat) > 0:
        sharp.heat[home] += particle_heat(first, count, n, kind, begin, column, work, turns, u, v, dt, new)
    kick(first, count, n, kind, dt, new)
    return rate


@inline_jit
def scatter_block(block, kind, cells, nodes, sharp, begin, column, held, dt, exponential, met, new, table, work, bend):
    """Kick the particles of a block, and write the mean rate of each population."""
    curvature(cells.home[block], nodes.about, nodes.sums, sharp.slope, bend)
    if len(sharp.turn) > 0 and kind.first == 0:
        turns_about(cells.home[block], nodes.about, sharp.turn, work)
    for part in range(kind.number):
        at = place_of(block, part, kind, cells, begin, column, held)
        met[block, part] = scatter_species(
            block, part, kind, cells, nodes, sharp, at, held, dt, exponential, new, table, work, bend
        )


@jit
def scatter(block_from, block_to, kind, cells, nodes, sharp, begin, column, dt, exponential, met):
    """Kick the particles in each block, from columns as `gather` leaves them.

    A kick is free motion, eq. (3), the rotation of the gas that cancels eq. (4), and the decay of deviations from the
    linear fit. Writes the mean rate of each population in each block, `met` (blocks, number), and adds to
    `sharp.heat` where it has entries.
    """
    most = most_in(block_from, block_to, kind)
    held, new, bend = np.empty(FIELDS * most) if by_grain(kind, cells) else column, np.empty(4 * most), np.empty((2, 3))
    table, work = np.empty((9, LANES)), np.empty((2, 9, LANES))
    for block in range(block_from, block_to):
        scatter_block(
            block, kind, cells, nodes, sharp, begin, column, held, dt, exponential, met, new, table, work, bend
        )


@inline_jit
def times_in(block, part, kind, cells, nodes, value, begin, column, table, time):
    """Write the stopping times of one population in a block."""
    if cells.slot[block, kind.first + part] < 0:
        return
    values_about(block, kind.first + part, cells, nodes, value, False, table)
    to_polynomial(table, 0, kind.pos.shape[1] == 1)
    first = kind.start[block * kind.number + part]
    count = kind.start[block * kind.number + part + 1] - first
    n = filled(count)
    normed = has_norms(block, kind, cells, nodes)
    for p in range(count):
        at = begin + p
        rate = evaluate_lane(table, RATE, column[at + X * n], column[at + Y * n])
        if normed:
            rate *= column[at + NORM * n]
        time[kind.order[first + p]] = 1.0 / rate if rate > 0.0 else np.inf


@jit
def stopping_times(block_from, block_to, kind, cells, nodes, value, begin, column, time):
    """Write the stopping time of each dust particle, one over the rate interpolated from the nodes.

    It is inf where the rate is 0.
    """
    held, table = (
        np.empty(FIELDS * most_in(block_from, block_to, kind)) if by_grain(kind, cells) else column,
        np.empty((9, LANES)),
    )
    for block in range(block_from, block_to):
        for part in range(kind.number):
            at = place_of(block, part, kind, cells, begin, column, held)
            times_in(block, part, kind, cells, nodes, value, at, held, table, time)
