"""Scatter from nodes to particles, eq. (3) of `nodes.py`, and decay of residual velocities.

A residual is the velocity of a particle relative to a linear fit to the velocities of its species in the cell.
"""

import numpy as np

from discsim.jit.decorators import inline_jit, jit
from discsim.jit.index import index
from discsim.kernels.common.simd import LANES, extract, horizontal_sums, load, prefetch, store, zeros
from discsim.kernels.drag.linear_fit import solve
from discsim.kernels.drag.relax import response
from discsim.kernels.drag.tsc.columns import has_gasless_nodes, longest_column, padded_count, prefetch_columns
from discsim.kernels.drag.tsc.heat import particle_heat, rotation_polynomials
from discsim.kernels.drag.tsc.nodes import BX, DX, DY, FIELDS, MASS, NORM, ONE, RATE, SPIN, VX, VY, WHOLE, X, Y
from discsim.kernels.drag.tsc.weights import evaluate_lane, to_polynomial


@inline_jit
def node_value_polynomials(block, s, cells, nodes, value, rotates, table):
    """Write to `table` (9, LANES) the values that the nodes about a cell scatter to species s, for `to_polynomial`.

    rotates: whether the rotation has to be moved from the nodes to the centre of the cell.
    """
    centre_node = cells.centre_node[block]
    for k in range(9):
        n, row = nodes.stencil[centre_node, k], zeros()
        if n >= 0:
            row = load(value, (n * value.shape[1] + s) * LANES)
        store(table, k * LANES, row)
        if rotates:  # rotation about the cell's centre instead of the node
            table[k, DX] += (k % 3 - 1) * extract(row, SPIN)
            table[k, DY] -= (k // 3 - 1) * extract(row, SPIN)


@inline_jit
def history_columns(block, part, kind, cells, begin, column, unpacked):
    """Return the element of `column`, or of `unpacked` for single grains, at which a population in a block begins.

    The columns are those of the gather. If nodes sum single grains, the gather wrote rows, which are copied here to
    columns in `unpacked`.
    """
    class_index = block * kind.number + part
    if not has_single_grains(kind, cells):
        return begin[class_index]
    first, count = kind.start[class_index], kind.start[class_index + 1] - kind.start[class_index]
    n = padded_count(count)
    for at in range(n):
        k = first + (at if at < count else count - 1)
        for f in range(FIELDS):
            unpacked[f * n + at] = column[k * FIELDS + f]
        m = kind.mass[kind.order[k]]
        unpacked[MASS * n + at], unpacked[NORM * n + at] = m if at < count else 0.0, cells.scaled_mass[k] / m
    return 0


@inline_jit
def has_single_grains(kind, cells):
    """Return whether nodes sum single particles of these populations (`grains.py`)."""
    return kind.first > 0 and len(cells.dust_moments) > 0


@inline_jit
def has_norms(block, kind, cells, nodes):
    """Return whether the weights of particles in a block need a norm, because they do not add up to 1."""
    return kind.first > 0 and (
        has_single_grains(kind, cells)
        or has_gasless_nodes(cells.centre_node[block], kind.pos.shape[1] == 1, nodes.stencil, nodes.sums)
    )


@inline_jit
def mean_rate(block, s, cells, nodes, value):
    """Return the mean drag rate of species s in a cell."""
    rate, cell = 0.0, cells.species_row[block, s]
    for k in range(9):
        n = nodes.stencil[cells.centre_node[block], k]
        if n >= 0:
            rate += cells.contributions[cell, k, ONE] * value[n, s, RATE]
    return rate / cells.moments[cell, WHOLE, ONE]


@inline_jit
def mean_rate_of_particles(count, n, begin, column, table):
    """Return the mean drag rate over the `count` packed particles of a species in a cell."""
    rate, mass = 0.0, 0.0
    for at in range(begin, begin + count):
        m = column[at + MASS * n]
        rate += m * column[at + NORM * n] * evaluate_lane(table, RATE, column[at + X * n], column[at + Y * n])
        mass += m
    return rate / mass


@inline_jit
def curvature(centre_node, stencil, sums, slope, bend):
    """Write half of the second derivatives xx and yy, and the second derivative xy, of the velocity to `bend` (2, 3).

    The order is xx, xy, yy for each component. The derivatives are finite differences of the slopes at nodes, per
    side of the cell.
    """
    for c in range(2):
        bend[c, 0], bend[c, 1], bend[c, 2] = 0.0, 0.0, 0.0
    for axis in range(2):
        step = 3 if axis == 0 else 1
        low, high = stencil[centre_node, 4 - step], stencil[centre_node, 4 + step]
        if low < 0 or high < 0 or min(sums[low, 0, ONE], sums[high, 0, ONE]) <= 0.0:
            continue
        for c in range(2):
            along = 0.5 * (slope[high, 2 * axis + c] - slope[low, 2 * axis + c])
            across = 0.5 * (slope[high, 2 - 2 * axis + c] - slope[low, 2 - 2 * axis + c])
            bend[c, 2 * axis] += 0.5 * along
            bend[c, 1] += 0.5 * across  # the mixed derivative is the mean of both


@inline_jit
def fit_columns(count, n, begin, column, value_from, value, x0, y0, pooled, dim):
    """Return (x, y, u, v, uu, uv, vu, vv): centroid, means and slopes of the linear fit to a packed vector field.

    The two components are columns of `value`, the first from element `value_from` on. (x0, y0): a position near the
    centroid. One particle more than the fit needs is enough: the residuals of few particles are small, but not wrong.
    With fewer particles the slopes are `pooled` plus a rotation of their own, so that the residuals never have angular
    momentum.
    """
    sx, sy, su, sv = zeros(), zeros(), zeros(), zeros()
    xx, xy, yy, m = zeros(), zeros(), zeros(), zeros()
    xu, xv, yu, yv = zeros(), zeros(), zeros(), zeros()
    u0, v0 = value[value_from], value[value_from + n]
    for p in range(0, n, LANES):
        at = begin + p
        one, x, y = load(column, at + MASS * n), load(column, at + X * n) - x0, load(column, at + Y * n) - y0
        u, v = load(value, value_from + p) - u0, load(value, value_from + n + p) - v0
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
    first, inertia = horizontal_sums(sx, sy, su, sv), horizontal_sums(xx, xy, yy, m)
    moment = horizontal_sums(xu, xv, yu, yv)
    return fit_sums(count, x0, y0, u0, v0, first, inertia, moment, pooled, dim)


@inline_jit
def fit_sums(count, x0, y0, u0, v0, first, inertia, moment, pooled, dim):
    """Return the result of `fit_columns` from sums over its particles.

    first: sums of m times x, y, u, v. inertia: sums of m times xx, xy, yy, 1. moment: sums of m times xu, xv, yu, yv.
    All are relative to x0, y0, u0, v0.
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
def write_changes(n, begin, column, table, rotates, normed, bend, new):
    """Write to `new` the velocity of each packed particle after the change by the nodes, and the change.

    Columns 0 and 1 of `new` get the new velocity less its quadratic part `bend`, columns 2 and 3 the change. rotates:
    whether the change includes a rotation. normed: whether weights have norms.
    """
    for p in range(0, n, LANES):
        at = begin + p
        x, y = load(column, at + X * n), load(column, at + Y * n)
        xx, xy, yy = x * x, x * y, y * y
        dx, dy = evaluate_lane(table, DX, x, y), evaluate_lane(table, DY, x, y)
        if rotates:
            omega = evaluate_lane(table, SPIN, x, y)
            dx, dy = dx - omega * y, dy + omega * x
        elif normed:
            norm = load(column, at + NORM * n)
            dx, dy = norm * dx, norm * dy
        u, v = load(column, at + VX * n) + dx, load(column, at + VY * n) + dy
        store(new, p, u - (bend[0, 0] * xx + bend[0, 1] * xy + bend[0, 2] * yy))
        store(new, p + n, v - (bend[1, 0] * xx + bend[1, 1] * xy + bend[1, 2] * yy))
        store(new, p + 2 * n, dx)
        store(new, p + 3 * n, dy)


@inline_jit
def damp_residuals(count, n, begin, column, x0, y0, pooled, sources, f, g, dim, new):
    """Replace the velocity in `new` (columns 0 and 1) by its change due to the decay of residuals about the linear fit.

    f, g: result of `response` for the drag rate. (x0, y0): position near the centroid. Returns the mean velocity
    (u, v).
    """
    # np.int64: a literal 0 would be compiled separately.
    velocity, no_slope, source = np.int64(0), (0.0, 0.0, 0.0, 0.0), begin + BX * n
    x0, y0, u, v, uu, uv, vu, vv = fit_columns(count, n, begin, column, velocity, new, x0, y0, pooled, dim)
    if not sources:
        for p in range(0, n, LANES):
            x, y = load(column, begin + X * n + p) - x0, load(column, begin + Y * n + p) - y0
            store(new, p, f * (load(new, p) - u - uu * x - vu * y))
            store(new, p + n, f * (load(new, p + n) - v - uv * x - vv * y))
        return u, v
    _, _, a, b, au, av, bu, bv = fit_columns(count, n, begin, column, source, column, x0, y0, no_slope, dim)
    for p in range(0, n, LANES):
        x, y = load(column, begin + X * n + p) - x0, load(column, begin + Y * n + p) - y0
        residual_x, residual_y = load(new, p) - u - uu * x - vu * y, load(new, p + n) - v - uv * x - vv * y
        source_x = load(column, source + p) - a - au * x - bu * y
        source_y = load(column, source + n + p) - b - av * x - bv * y
        store(new, p, f * residual_x + g * source_x)
        store(new, p + n, f * residual_y + g * source_y)
    return u, v


@inline_jit
def prefetch_motion(first, count, kind):
    """Prefetch the velocities and accelerations that `kick` uses, which are scattered in memory."""
    start, dim = index(first), index(kind.vel.shape[1])
    for at in range(index(count)):
        i = dim * kind.order[start + at]
        prefetch(kind.vel, i)
        prefetch(kind.acc, i)


@inline_jit
def kick(first, count, n, kind, dt, new):
    """Kick the particles kind.order[first : first + count] in place, by accelerations and by the changes in `new`."""
    start, along, across, more = index(first), index(n), index(2 * n), index(3 * n)
    for at in range(index(count)):
        i = kind.order[start + at]
        kind.vel[i, 0] += dt * kind.acc[i, 0] + (new[across + at] + new[at])
        if kind.vel.shape[1] == 2:
            kind.vel[i, 1] += dt * kind.acc[i, 1] + (new[more + at] + new[along + at])


@inline_jit
def scatter_species(block, part, kind, cells, nodes, impulse, begin, column, dt, exponential, new, tables):
    """Kick one population in a block in place, and return its mean drag rate.

    With heating, adds the energy that is lost to `impulse.heat` at the node at the centre of the block. new, tables:
    scratch.
    """
    table, rotation_table, bend = tables
    dim, s, node = kind.pos.shape[1], kind.first + part, cells.centre_node[block]
    first = kind.start[block * kind.number + part]
    count = kind.start[block * kind.number + part + 1] - first
    if count == 0:
        return 0.0
    n, rotates = padded_count(count), len(nodes.square) > 0 and s == 0
    prefetch_motion(first, count, kind)
    prefetch_columns(n, len(kind.source) > 0, begin, column)
    node_value_polynomials(block, s, cells, nodes, impulse.value, rotates, table)
    to_polynomial(table, 0, dim == 1)
    if has_single_grains(kind, cells):
        rate = mean_rate_of_particles(count, n, begin, column, table)
    else:
        rate = mean_rate(block, s, cells, nodes, impulse.value)
    write_changes(n, begin, column, table, rotates, has_norms(block, kind, cells, nodes), bend, new)
    u, v = 0.0, 0.0
    if rate > 0.0:
        slope = impulse.slope
        pooled = slope[node, 0], slope[node, 1], slope[node, 2], slope[node, 3]
        cell = cells.species_row[block, s]
        mass = cells.moments[cell, WHOLE, ONE]
        x0, y0 = cells.moments[cell, WHOLE, X] / mass, cells.moments[cell, WHOLE, Y] / mass
        f, g = response(rate, dt, exponential)
        u, v = damp_residuals(count, n, begin, column, x0, y0, pooled, len(kind.source) > 0, f, g, dim, new)
    else:
        for p in range(0, n, LANES):
            store(new, p, zeros())
            store(new, p + n, zeros())
    if len(impulse.heat) > 0:
        given = first, count, n, kind, begin, column, rotation_table, rotates, u, v, dt, new
        impulse.heat[node] += particle_heat(*given)
    kick(first, count, n, kind, dt, new)
    return rate


@inline_jit
def scatter_block(block, kind, cells, nodes, impulse, begin, column, unpacked, dt, exponential, rates, new, tables):
    """Kick the particles of a block in place, and write the mean drag rate of each population to `rates`."""
    _, rotation_table, bend = tables
    curvature(cells.centre_node[block], nodes.stencil, nodes.sums, impulse.slope, bend)
    if len(impulse.rotation) > 0 and kind.first == 0:
        rotation_polynomials(cells.centre_node[block], nodes.stencil, impulse.rotation, rotation_table)
    for part in range(kind.number):
        at = history_columns(block, part, kind, cells, begin, column, unpacked)
        rate = scatter_species(block, part, kind, cells, nodes, impulse, at, unpacked, dt, exponential, new, tables)
        rates[block, part] = rate


@jit
def scatter(block_from, block_to, kind, cells, nodes, impulse, begin, column, dt, exponential, rates):
    """Kick the particles in each block in place, from the columns that `gather` wrote.

    A kick is the sum of accelerations over dt, eq. (3), the rotation of the gas that compensates eq. (4), and the decay
    of residual velocities about the linear fit. Writes the mean drag rate of each population in each block to `rates`
    (blocks, populations). With heating, adds the energy that is lost to `impulse.heat`.
    """
    most = longest_column(block_from, block_to, kind)
    unpacked, new = np.empty(FIELDS * most) if has_single_grains(kind, cells) else column, np.empty(4 * most)
    tables = np.empty((9, LANES)), np.empty((2, 9, LANES)), np.empty((2, 3))
    for block in range(block_from, block_to):
        scatter_block(block, kind, cells, nodes, impulse, begin, column, unpacked, dt, exponential, rates, new, tables)


@inline_jit
def block_stopping_times(block, part, kind, cells, nodes, value, begin, column, table, time):
    """Write the stopping times of the particles of one population in a block to `time`, as `stopping_times`."""
    if cells.species_row[block, kind.first + part] < 0:
        return
    node_value_polynomials(block, kind.first + part, cells, nodes, value, False, table)
    to_polynomial(table, 0, kind.pos.shape[1] == 1)
    first = kind.start[block * kind.number + part]
    count = kind.start[block * kind.number + part + 1] - first
    n = padded_count(count)
    normed = has_norms(block, kind, cells, nodes)
    for p in range(count):
        at = begin + p
        rate = evaluate_lane(table, RATE, column[at + X * n], column[at + Y * n])
        if normed:
            rate *= column[at + NORM * n]
        time[kind.order[first + p]] = 1.0 / rate if rate > 0.0 else np.inf


@jit
def stopping_times(block_from, block_to, kind, cells, nodes, value, begin, column, time):
    """Write the stopping time of each dust particle to `time` (n,): one over the drag rate interpolated from the nodes.

    The time is inf where the rate is 0. value: as in `NodeImpulses`. begin, column: results of the gather.
    """
    table, length = np.empty((9, LANES)), FIELDS * longest_column(block_from, block_to, kind)
    unpacked = np.empty(length) if has_single_grains(kind, cells) else column
    for block in range(block_from, block_to):
        for part in range(kind.number):
            at = history_columns(block, part, kind, cells, begin, column, unpacked)
            block_stopping_times(block, part, kind, cells, nodes, value, at, unpacked, table, time)
