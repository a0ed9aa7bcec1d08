"""Gather: particles as nodes see them, what each cell gives to its nine nodes, and eq. (1) of `kernels/nodes.py`."""

import math

import numpy as np
from numba import njit

from discsim.formulas.laws import EPSTEIN
from discsim.kernels.frame import kepler, sense_at
from discsim.kernels.inner import inner, lean
from discsim.kernels.nodes import BX, BY, FIELDS, MASS, NORM, ONE, RHO, VX, VY, X, Y
from discsim.kernels.nodes_weights import cloud
from discsim.kernels.rows import LANES, empty_row, lane, load, store

# Of a particle: its weights on the nine nodes times its mass, and this.
MASSES, WEIGHTS = 9, 10


@inner
def pack(block, first, count, kind, cells, law, about_star, row, r2):
    """Particles of a block as rows from `first` on, and the squares of their distances from the origin."""
    dim, inverse = kind.pos.shape[1], 1.0 / cells.side[block]
    x0, y0, period_x, period_y = cells.corner[block, 0], cells.corner[block, 1], cells.period[0], cells.period[1]
    sources, dense, with_sound = (
        len(kind.own) > 0,
        len(kind.density) > 0,
        law == EPSTEIN and not about_star and kind.first == 0,
    )
    for at in range(count):
        k = first + at
        i = kind.order[k]
        x, y, vy, by = kind.pos[i, 0], 0.0, 0.0, 0.0
        if dim == 2:
            y, vy = kind.pos[i, 1], kind.vel[i, 1]
            if sources:
                by = kind.own[i, 1]
        r2[at] = x * x + y * y
        x, y = x - x0, y - y0
        if period_x < math.inf:
            x -= period_x * math.floor(x / period_x)
            y -= period_y * math.floor(y / period_y)
        row[k, ONE] = 1.0
        row[k, X] = x * inverse - 0.5
        row[k, Y] = y * inverse - 0.5 if dim == 2 else 0.0
        row[k, VX], row[k, VY] = kind.vel[i, 0], vy
        row[k, BX], row[k, BY] = kind.own[i, 0] if sources else 0.0, by
        row[k, RHO] = 0.0
        if dense:
            row[k, RHO] = kind.density[i] * (kind.sound[i] if with_sound else 1.0)


@inner
def leave_orbits(block, first, count, cells, frame, row, r2):
    """Velocities relative to Kepler's, `frame`; r2 is overwritten with its Omega."""
    if len(frame.sense) == 1:
        sense = frame.sense[0]
        for at in range(count):
            r2[at] = sense * kepler(r2[at], frame.star, frame.softening)
    else:
        for at in range(count):
            r2[at] = sense_at(r2[at], frame) * kepler(r2[at], frame.star, frame.softening)
    side = cells.side[block]
    x0, y0 = cells.corner[block, 0] + 0.5 * side, cells.corner[block, 1] + 0.5 * side
    for at in range(count):
        row[first + at, VX] += r2[at] * (y0 + side * row[first + at, Y])
        row[first + at, VY] -= r2[at] * (x0 + side * row[first + at, X])


@inner
def weigh(k, at, m, flat, row, weight):
    """Weights of row k on the nine nodes times its mass m."""
    u0, u1, u2 = cloud(row[k, X], False)
    t0, t1, t2 = cloud(row[k, Y], flat)
    t0, t1, t2 = m * t0, m * t1, m * t2
    weight[at, 0], weight[at, 1], weight[at, 2] = u0 * t0, u0 * t1, u0 * t2
    weight[at, 3], weight[at, 4], weight[at, 5] = u1 * t0, u1 * t1, u1 * t2
    weight[at, 6], weight[at, 7], weight[at, 8] = u2 * t0, u2 * t1, u2 * t2


@inner
def leave_out(at, home, m, about, sums, weight):
    """Weights on nodes that have gas alone; returns one over their sum as it was, 0 where none has."""
    total = 0.0
    for j in range(9):
        n = about[home, j]
        if n < 0 or sums[n, 0, ONE] <= 0.0:
            weight[at, j] = 0.0
        total += weight[at, j]
    norm = m / total if total > 0.0 else 0.0
    for j in range(9):
        weight[at, j] *= norm
    return norm


@inner
def is_ragged(home, flat, about, sums):
    """Whether some of the nodes about a cell's have no gas."""
    for k in range(9):
        n = about[home, k]
        if (n < 0 or sums[n, 0, ONE] <= 0.0) and not (flat and k % 3 != 1):
            return True
    return False


@inner
def sum_rows(first, count, weight, row, half, given, at):
    """What a cell gives to the nine nodes of one half of the fields: sums of its particles with their weights."""
    a, b, c, d, e, f = empty_row(), empty_row(), empty_row(), empty_row(), empty_row(), empty_row()
    g, h, i = empty_row(), empty_row(), empty_row()
    for k in range(count):
        one = load(row, (first + k) * FIELDS + half)
        a += weight[k, 0] * one
        b += weight[k, 1] * one
        c += weight[k, 2] * one
        d += weight[k, 3] * one
        e += weight[k, 4] * one
        f += weight[k, 5] * one
        g += weight[k, 6] * one
        h += weight[k, 7] * one
        i += weight[k, 8] * one
    store(given, at, a)
    store(given, at + FIELDS, b)
    store(given, at + 2 * FIELDS, c)
    store(given, at + 3 * FIELDS, d)
    store(given, at + 4 * FIELDS, e)
    store(given, at + 5 * FIELDS, f)
    store(given, at + 6 * FIELDS, g)
    store(given, at + 7 * FIELDS, h)
    store(given, at + 8 * FIELDS, i)


@inner
def own_moments(given, at, own, into):
    """A cell's own moments: its weights add up to 1, and with the nodes' places to its particles' own."""
    for half in (0, LANES):
        begin = at + half
        low = load(given, begin) + load(given, begin + FIELDS) + load(given, begin + 2 * FIELDS)
        middle = load(given, begin + 3 * FIELDS) + load(given, begin + 4 * FIELDS) + load(given, begin + 5 * FIELDS)
        high = load(given, begin + 6 * FIELDS) + load(given, begin + 7 * FIELDS) + load(given, begin + 8 * FIELDS)
        below = load(given, begin) + load(given, begin + 3 * FIELDS) + load(given, begin + 6 * FIELDS)
        above = load(given, begin + 2 * FIELDS) + load(given, begin + 5 * FIELDS) + load(given, begin + 8 * FIELDS)
        store(own, into + half, low + middle + high)
        store(own, into + half + FIELDS, high - low)
        store(own, into + half + 2 * FIELDS, above - below)


@inner
def gather_species(block, part, kind, cells, nodes, frame, law, row, weight, norm):
    """Pack one population in a block, and sum what its cell gives."""
    flat, s, home = kind.pos.shape[1] == 1, kind.first + part, cells.home[block]
    cell = cells.slot[block, s]
    if cell < 0:
        return
    start, end = kind.start[block * kind.number + part], kind.start[block * kind.number + part + 1]
    first, count = np.uint64(start), np.uint64(end - start)
    pack(block, first, count, kind, cells, law, frame.star > 0.0, row, norm)
    if frame.star > 0.0:
        leave_orbits(block, first, count, cells, frame, row, norm)
    for at in range(count):
        weight[at, MASSES] = kind.mass[kind.order[first + at]]
        weigh(first + at, at, weight[at, MASSES], flat, row, weight)
        norm[at] = 1.0
    given, at_given, at_own = cells.given, cell * 9 * FIELDS, cell * 3 * FIELDS
    sum_rows(start, end - start, weight, row, 0, given, at_given)
    sum_rows(start, end - start, weight, row, LANES, given, at_given + LANES)
    own_moments(given, at_given, cells.own, at_own)
    if kind.first > 0 and is_ragged(home, flat, nodes.about, nodes.sums):
        for at in range(count):
            norm[at] = leave_out(at, home, weight[at, MASSES], nodes.about, nodes.sums, weight)
        sum_rows(start, end - start, weight, row, 0, given, at_given)
        sum_rows(start, end - start, weight, row, LANES, given, at_given + LANES)
    for at in range(count):
        row[first + at, MASS], row[first + at, NORM] = weight[at, MASSES], norm[at]


@inner
def square_of(block, kind, row, weight, square):
    """What the gas of a cell gives of m x^2."""
    begin, count = np.uint64(kind.start[block]), np.uint64(kind.start[block + 1] - kind.start[block])
    for j in range(9):
        square[block, j] = 0.0
    for at in range(count):
        x, y = row[begin + at, X], row[begin + at, Y]
        for j in range(9):
            square[block, j] += weight[at, j] * (x * x + y * y)


@njit(nogil=True, cache=True, error_model="numpy")
def gather(block_from, block_to, kind, cells, nodes, frame, law, row, square):
    """Pack the members of the blocks in their order into `row` (n, LANES), and what each cell gives into its part of
    `cells.given`; of the gas also what it gives of m x^2, `square` (blocks, 9), if that has entries.
    """
    most = most_in(block_from, block_to, kind)
    weight, norm = np.empty((most, WEIGHTS)), np.empty(most)
    for block in range(block_from, block_to):
        for part in range(kind.number):
            gather_species(block, part, kind, cells, nodes, frame, law, row, weight, norm)
        if len(square) > 0:
            square_of(block, kind, row, weight, square)


@inner
def most_in(block_from, block_to, kind):
    """The largest number of particles of a population in a block."""
    most = 0
    for part in range(block_from * kind.number, block_to * kind.number):
        most = max(most, kind.start[part + 1] - kind.start[part])
    return most


@inner
def collect_species(n, s, near, slot, given, sums):
    """Eq. (1) for a species at a node, places from it."""
    places, motion, x, y = empty_row(), empty_row(), 0.0, 0.0
    for k in range(9):
        block, j = near[n, k], 8 - k
        cell = slot[block, s] if block >= 0 else -1
        if cell >= 0:
            at = (cell * 9 + j) * FIELDS
            one = load(given, at)
            places += one
            motion += load(given, at + LANES)
            # The node lies at (-i, -j) from the cell's middle.
            x += (k // 3 - 1) * lane(one, ONE)
            y += (k % 3 - 1) * lane(one, ONE)
    store(sums, (n * sums.shape[1] + s) * FIELDS, places)
    store(sums, (n * sums.shape[1] + s) * FIELDS + LANES, motion)
    sums[n, s, X] += x
    sums[n, s, Y] += y


@inner
def collect_square(n, near, given, square):
    """Sum m w x^2 of the gas at a node, x from it."""
    total = 0.0
    for k in range(9):
        block, i, j = near[n, k], k // 3 - 1, k % 3 - 1
        if block >= 0:
            x, y = given[block, 8 - k, X], given[block, 8 - k, Y]
            total += square[block, 8 - k] + 2.0 * (i * x + j * y) + (i * i + j * j) * given[block, 8 - k, ONE]
    return total


@lean
def collect(node_from, node_to, kind, cells, nodes, square):
    """Sums over the species of one kind at each node."""
    for n in range(node_from, node_to):
        for s in range(kind.first, kind.first + kind.number):
            collect_species(n, s, nodes.near, cells.slot, cells.given, nodes.sums)
        if len(square) > 0:
            nodes.square[n] = collect_square(n, nodes.near, cells.given, square)
