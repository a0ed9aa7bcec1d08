"""Heat of the drag at nodes: the energy that the particles of a cell lose, and its transfer to the gas."""

import numpy as np

from discsim.jit.decorators import inline_jit, jit, jit_no_alloc
from discsim.kernels.common.simd import LANES, extract, load, store, zeros
from discsim.kernels.drag.tsc.columns import padded_count
from discsim.kernels.drag.tsc.nodes import BX, BY, DX, MASS, ONE, VX, VY, X, Y
from discsim.kernels.drag.tsc.weights import evaluate, evaluate_lane, to_polynomial

# Two vectors for the rotation at a node, with its angular velocity omega and its centre (x, y). First: omega, omega x,
# omega y. Second: omega u, omega v, omega (y u - x v), with the mean velocity (u, v) of the gas half-way through the
# kick, on which the rotation does no work.
SPIN_X, SPIN_Y = 1, 2
U, V, TORQUE = range(3)


@inline_jit
def node_heat(n, nodes, value, dt):
    """Return the energy that eq. (3) removes at node n, to first order in the changes; `particle_heat` has the rest."""
    heat = 0.0
    for s in range(nodes.sums.shape[1]):
        for c in range(2):
            heat -= value[n, s, DX + c] * (nodes.sums[n, s, VX + c] + 0.5 * dt * nodes.sums[n, s, BX + c])
    return heat


@inline_jit
def write_rotation(n, omega, nodes, dt, rotation):
    """Write the rotation `omega` at node n, and the motion on which it does no work, to `rotation` (nodes, 2, LANES).

    The two vectors are described at the head of this module; positions are relative to the node.
    """
    for k in range(2):
        store(rotation, (2 * n + k) * LANES, zeros())
    if omega == 0.0:
        return
    m, gas = nodes.sums[n, 0, ONE], nodes.sums
    x, y = gas[n, 0, X] / m, gas[n, 0, Y] / m
    u, v = (gas[n, 0, VX] + 0.5 * dt * gas[n, 0, BX]) / m, (gas[n, 0, VY] + 0.5 * dt * gas[n, 0, BY]) / m
    rotation[n, 0, 0], rotation[n, 0, SPIN_X], rotation[n, 0, SPIN_Y] = omega, omega * x, omega * y
    rotation[n, 1, U], rotation[n, 1, V] = omega * u, omega * v
    rotation[n, 1, TORQUE] = omega * (y * u - x * v)


@inline_jit
def rotation_polynomials(centre_node, stencil, rotation, table):
    """Write the vectors of `write_rotation` about a cell to `table` (2, 9, LANES), as polynomials of the position.

    Positions are relative to the centre of the cell.
    """
    for k in range(9):
        n, i, j = stencil[centre_node, k], k // 3 - 1.0, k % 3 - 1.0
        for r in range(2):
            row = zeros()
            if n >= 0:
                row = load(rotation, (2 * n + r) * LANES)
            store(table, (9 * r + k) * LANES, row)
        table[0, k, SPIN_X] += i * table[0, k, 0]
        table[0, k, SPIN_Y] += j * table[0, k, 0]
        table[1, k, TORQUE] += j * table[1, k, U] - i * table[1, k, V]
    for r in range(2):
        to_polynomial(table, 9 * r * LANES, False)


@inline_jit
def particle_heat(first, count, n, kind, begin, column, rotation_table, rotates, u, v, dt, new):
    """Return the energy that the packed particles of a cell lose and that `node_heat` does not include.

    In the loop, `frame` is the velocity that columns leave out: the Keplerian velocity, and half the kick by
    accelerations that gas and dust share. A transfer of momentum between orbits changes the energy. (u, v): mean
    velocity of the linear fit. Changes by the decay of residuals have no mean, so a velocity common to the cell does no
    work. new: result of `write_changes` and `damp_residuals`.
    """
    lost, sources = 0.0, len(kind.source) > 0
    for p in range(count):
        i, at = kind.order[first + p], begin + p
        m, x, y = column[at + MASS * n], column[at + X * n], column[at + Y * n]
        if rotates:
            spin, idle = evaluate(rotation_table, 0, x, y), evaluate(rotation_table, 9 * LANES, x, y)
            along, across = extract(spin, SPIN_Y) - extract(spin, 0) * y, extract(spin, 0) * x - extract(spin, SPIN_X)
            half_x = 0.5 * dt * column[at + BX * n] if sources else 0.0
            half_y = 0.5 * dt * column[at + BY * n] if sources else 0.0
            done = along * (column[at + VX * n] + half_x) + across * (column[at + VY * n] + half_y)
            done += y * extract(idle, U) - x * extract(idle, V) - extract(idle, TORQUE)
            lost -= m * done
        for c in range(kind.vel.shape[1]):
            more, change, mean = new[c * n + p], new[(2 + c) * n + p], u if c == 0 else v
            relative, source = column[at + (VX + c) * n], column[at + (BX + c) * n] if sources else 0.0
            frame = kind.vel[i, c] - relative + 0.5 * dt * (kind.acc[i, c] - source)
            lost -= m * change * (0.5 * change + frame)
            lost -= m * more * (relative + change - mean + frame + 0.5 * (dt * source + more))
    return lost


@jit_no_alloc
def move_heat_to_gas(nodes, heat):
    """Move the heat of each node without gas in equal parts to neighbouring nodes with gas; heat (nodes,) changes."""
    for n in range(len(heat)):
        if heat[n] == 0.0 or nodes.sums[n, 0, ONE] > 0.0:
            continue
        receivers = 0
        for k in range(9):
            receivers += 1 if nodes.stencil[n, k] >= 0 and nodes.sums[nodes.stencil[n, k], 0, ONE] > 0.0 else 0
        for k in range(9):
            if nodes.stencil[n, k] >= 0 and nodes.sums[nodes.stencil[n, k], 0, ONE] > 0.0:
                heat[nodes.stencil[n, k]] += heat[n] / receivers


@inline_jit
def heat_block(block, kind, cells, nodes, node_heats, begin, column, table, heat):
    """Write the heat per mass of the gas particles of a block to `heat`, as `spread_heat`."""
    for k in range(9):
        node = nodes.stencil[cells.centre_node[block], k]
        has_gas = node >= 0 and nodes.sums[node, 0, ONE] > 0.0
        store(table, k * LANES, zeros())
        table[k, 0] = node_heats[node] / nodes.sums[node, 0, ONE] if has_gas else 0.0
    to_polynomial(table, 0, kind.pos.shape[1] == 1)
    first, count, at = kind.start[block], kind.start[block + 1] - kind.start[block], begin[block]
    n = padded_count(count)
    for p in range(count):
        heat[kind.order[first + p]] = evaluate_lane(table, 0, column[at + X * n + p], column[at + Y * n + p])


@jit
def spread_heat(block_from, block_to, kind, cells, nodes, node_heats, begin, column, heat):
    """Write the heat per mass of each gas particle to `heat` (n,), interpolated from the nodes.

    node_heats (nodes,): heat of each node. begin, column: columns of the gas.
    """
    table = np.empty((9, LANES))
    for block in range(block_from, block_to):
        heat_block(block, kind, cells, nodes, node_heats, begin, column, table, heat)
