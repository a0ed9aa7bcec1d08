"""Heat of the drag between nodes: the energy lost by the particles of a cell, and its transfer to the gas."""

import numpy as np

from discsim.jit.decorators import inline_jit, jit, jit_no_alloc
from discsim.kernels.common.simd import LANES, extract, load, store, zeros
from discsim.kernels.drag.tsc.columns import filled
from discsim.kernels.drag.tsc.nodes import BX, BY, DX, MASS, ONE, VX, VY, X, Y
from discsim.kernels.drag.tsc.weights import evaluate, evaluate_lane, to_polynomial

# Two vectors for the rotation at a node. First: its rate, and the rate times the centre of rotation (2). Second: the
# rate times the gas's mean velocity half-way through the kick (2), on which the rotation does no work, and the rate
# times y u - x v of that velocity at the centre.
SPIN_X, SPIN_Y = 1, 2
U, V, TURN = range(3)


@inline_jit
def heat_of(n, nodes, value, dt):
    """Return the energy that eq. (3) removes at a node, to first order in the changes; `loss` has the rest."""
    heat = 0.0
    for s in range(nodes.sums.shape[1]):
        for c in range(2):
            heat -= value[n, s, DX + c] * (nodes.sums[n, s, VX + c] + 0.5 * dt * nodes.sums[n, s, BX + c])
    return heat


@inline_jit
def work_of_turn(n, spin, nodes, dt, turn):
    """Write the rotation at a node and the motion on which it does no work, positions from the node."""
    for k in range(2):
        store(turn, (2 * n + k) * LANES, zeros())
    if spin == 0.0:
        return
    m, gas = nodes.sums[n, 0, ONE], nodes.sums
    x, y = gas[n, 0, X] / m, gas[n, 0, Y] / m
    u, v = (gas[n, 0, VX] + 0.5 * dt * gas[n, 0, BX]) / m, (gas[n, 0, VY] + 0.5 * dt * gas[n, 0, BY]) / m
    turn[n, 0, 0], turn[n, 0, SPIN_X], turn[n, 0, SPIN_Y] = spin, spin * x, spin * y
    turn[n, 1, U], turn[n, 1, V], turn[n, 1, TURN] = spin * u, spin * v, spin * (y * u - x * v)


@inline_jit
def turns_about(home, about, turn, table):
    """Write the vectors of `work_of_turn` about a cell as polynomials (2, 9, LANES).

    Positions are from the cell's centre.
    """
    for k in range(9):
        n, i, j = about[home, k], k // 3 - 1.0, k % 3 - 1.0
        for r in range(2):
            row = zeros()
            if n >= 0:
                row = load(turn, (2 * n + r) * LANES)
            store(table, (9 * r + k) * LANES, row)
        table[0, k, SPIN_X] += i * table[0, k, 0]
        table[0, k, SPIN_Y] += j * table[0, k, 0]
        table[1, k, TURN] += j * table[1, k, U] - i * table[1, k, V]
    for r in range(2):
        to_polynomial(table, 9 * r * LANES, False)


@inline_jit
def particle_heat(first, count, n, kind, begin, column, work, turns, u, v, dt, new):
    """Return the energy lost by the particles of a cell that the nodes do not count, `heat_of`.

    `frame` is the velocity that columns leave out: Kepler's, and half a kick by accelerations that gas and dust
    share. Between two orbits equal momentum is not equal energy. (u, v) is the mean velocity of the linear fit:
    changes by the decay of deviations have no mean, so a velocity common to the cell does no work.
    """
    lost, sources = 0.0, len(kind.own) > 0
    for p in range(count):
        i, at = kind.order[first + p], begin + p
        m, x, y = column[at + MASS * n], column[at + X * n], column[at + Y * n]
        if turns:
            does, idle = evaluate(work, 0, x, y), evaluate(work, 9 * LANES, x, y)
            along, across = extract(does, SPIN_Y) - extract(does, 0) * y, extract(does, 0) * x - extract(does, SPIN_X)
            half_x = 0.5 * dt * column[at + BX * n] if sources else 0.0
            half_y = 0.5 * dt * column[at + BY * n] if sources else 0.0
            done = along * (column[at + VX * n] + half_x) + across * (column[at + VY * n] + half_y)
            done += y * extract(idle, U) - x * extract(idle, V) - extract(idle, TURN)
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
    """Pass the heat of nodes without gas to the nodes about them, in equal parts to each that has gas."""
    for n in range(len(heat)):
        if heat[n] == 0.0 or nodes.sums[n, 0, ONE] > 0.0:
            continue
        takers = 0
        for k in range(9):
            takers += 1 if nodes.about[n, k] >= 0 and nodes.sums[nodes.about[n, k], 0, ONE] > 0.0 else 0
        for k in range(9):
            if nodes.about[n, k] >= 0 and nodes.sums[nodes.about[n, k], 0, ONE] > 0.0:
                heat[nodes.about[n, k]] += heat[n] / takers


@inline_jit
def heat_in(block, kind, cells, nodes, node_heats, begin, column, table, heat):
    """Write the heat per mass of the gas particles of a block."""
    for k in range(9):
        node = nodes.about[cells.home[block], k]
        there = node >= 0 and nodes.sums[node, 0, ONE] > 0.0
        store(table, k * LANES, zeros())
        table[k, 0] = node_heats[node] / nodes.sums[node, 0, ONE] if there else 0.0
    to_polynomial(table, 0, kind.pos.shape[1] == 1)
    first, count, at = kind.start[block], kind.start[block + 1] - kind.start[block], begin[block]
    n = filled(count)
    for p in range(count):
        heat[kind.order[first + p]] = evaluate_lane(table, 0, column[at + X * n + p], column[at + Y * n + p])


@jit
def spread(block_from, block_to, kind, cells, nodes, node_heats, begin, column, heat):
    """Write the heat per mass of each gas particle, interpolated from the nodes."""
    table = np.empty((9, LANES))
    for block in range(block_from, block_to):
        heat_in(block, kind, cells, nodes, node_heats, begin, column, table, heat)
