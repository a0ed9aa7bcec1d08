"""Gather from the particles of each cell to its nine nodes, and the sums at nodes, eq. (1) of `nodes.py`."""

import numpy as np

from discsim.jit.decorators import inline_jit, jit, jit_no_alloc
from discsim.kernels.common.simd import LANES, extract, horizontal_sums, load, store, zeros
from discsim.kernels.drag.tsc.columns import (
    NORMS,
    ROOM,
    fetch_columns,
    fetch_next,
    filled,
    is_ragged,
    most_in,
    renormalise_weights,
    take,
    weigh,
)
from discsim.kernels.drag.tsc.nodes import FIELDS, NORM, ONE, VX, X, Y


@inline_jit
def sum_columns(half, more, n, k, begin, column, room, given, at):
    """Write a cell's contributions to the nodes k, k + 1 and k + 2.

    `half` is ONE for mass, position and density, VX for velocity and source. `more`: whether there is a density or
    source.
    """
    a, b, c, d = zeros(), zeros(), zeros(), zeros()
    e, f, g, h = zeros(), zeros(), zeros(), zeros()
    i, j, l, m = zeros(), zeros(), zeros(), zeros()
    for p in range(0, n, LANES):
        u, v, w = load(room, k * n + p), load(room, (k + 1) * n + p), load(room, (k + 2) * n + p)
        one = zeros() + 1.0  # the weights include the mass
        if half != ONE:
            one = load(column, begin + half * n + p)
        a += u * one
        e += v * one
        i += w * one
        one = load(column, begin + (half + 1) * n + p)
        b += u * one
        f += v * one
        j += w * one
        if half == ONE or more:
            one = load(column, begin + (half + 2) * n + p)
            c += u * one
            g += v * one
            l += w * one
        if more:
            one = load(column, begin + (half + 3) * n + p)
            d += u * one
            h += v * one
            m += w * one
    store(given, at + half + k * FIELDS, horizontal_sums(a, b, c, d))
    store(given, at + half + (k + 1) * FIELDS, horizontal_sums(e, f, g, h))
    store(given, at + half + (k + 2) * FIELDS, horizontal_sums(i, j, l, m))


@inline_jit
def give(n, dense, sources, begin, column, room, given, at):
    """Write a cell's contributions to its nine nodes: weighted sums over its particles, 0 for absent fields."""
    for k in range(0, 9, 3):  # np.int64: numba compiles one specialisation per literal
        sum_columns(np.int64(ONE), dense, n, k, begin, column, room, given, at)
        sum_columns(np.int64(VX), sources, n, k, begin, column, room, given, at)


@inline_jit
def own_moments(given, at, own, into):
    """Write a cell's own moments, from its contributions to nodes.

    The weights of a particle sum to 1, and the mean position of the nodes with these weights is that of the particle.
    """
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


@inline_jit
def gather_species(block, part, kind, cells, nodes, frame, law, begin, column, room, square):
    """Write the columns of one population in a block, its contributions to nodes and its own moments."""
    flat, s, home = kind.pos.shape[1] == 1, kind.first + part, cells.home[block]
    cell, first = cells.slot[block, s], kind.start[block * kind.number + part]
    count = kind.start[block * kind.number + part + 1] - first
    if cell < 0:
        return
    n = filled(count)
    if count > 0:  # a block without gas has a slot for gas
        take(block, first, count, n, kind, cells, frame, law, begin, column, room)
        fetch_columns(n, len(kind.own) > 0, begin, column)
        fetch_next(first + count, count, kind)
        weigh(n, flat, begin, column, room)
    if len(square) > 0:
        square_of(block, n, begin, column, room, square)
    ragged = kind.first > 0 and is_ragged(home, flat, nodes.about, nodes.sums)
    for again in range(2 if ragged else 1):
        if again:
            renormalise_weights(home, n, nodes.about, nodes.sums, begin, column, room)
        give(n, len(kind.density) > 0, len(kind.own) > 0, begin, column, room, cells.given, cell * 9 * FIELDS)
        if not again:  # before nodes without gas are left out
            own_moments(cells.given, cell * 9 * FIELDS, cells.own, cell * 3 * FIELDS)
    if ragged:
        for at in range(0, n, LANES):
            store(column, begin + NORM * n + at, load(room, NORMS * n + at))


@inline_jit
def square_of(block, n, begin, column, room, square):
    """Write the contributions of the gas of a cell to sum m w x^2 at its nine nodes."""
    a, b, c, d, e, f = zeros(), zeros(), zeros(), zeros(), zeros(), zeros()
    g, h, i = zeros(), zeros(), zeros()
    for at in range(0, n, LANES):
        x, y = load(column, begin + X * n + at), load(column, begin + Y * n + at)
        r2 = x * x + y * y
        a += load(room, at) * r2
        b += load(room, at + n) * r2
        c += load(room, at + 2 * n) * r2
        d += load(room, at + 3 * n) * r2
        e += load(room, at + 4 * n) * r2
        f += load(room, at + 5 * n) * r2
        g += load(room, at + 6 * n) * r2
        h += load(room, at + 7 * n) * r2
        i += load(room, at + 8 * n) * r2
    store(square, block * 9, horizontal_sums(a, b, c, d))
    store(square, block * 9 + LANES, horizontal_sums(e, f, g, h))
    square[block, 8] = extract(horizontal_sums(i, i, i, i), 0)


@jit
def gather(block_from, block_to, kind, cells, nodes, frame, law, begin, column, square):
    """Write the columns of each population in the blocks, and the contributions and own moments of each cell.

    Columns start at the elements `begin` (blocks times populations,) of `column`. Contributions go to `cells.given`,
    own moments to `cells.own`. `square` (blocks, 9), if it has entries, gets the gas's contributions to sum m w x^2.
    """
    room = np.empty(ROOM * most_in(block_from, block_to, kind))
    for block in range(block_from, block_to):
        for part in range(kind.number):
            at = begin[block * kind.number + part]
            gather_species(block, part, kind, cells, nodes, frame, law, at, column, room, square)


@inline_jit
def collect_species(n, s, near, slot, given, sums):
    """Write the sums of eq. (1) for a species at a node, positions from the node."""
    places, motion, x, y = zeros(), zeros(), 0.0, 0.0
    for k in range(9):
        block, j = near[n, k], 8 - k
        cell = slot[block, s] if block >= 0 else -1
        if cell >= 0:
            at = (cell * 9 + j) * FIELDS
            one = load(given, at)
            places += one
            motion += load(given, at + LANES)
            # The node lies at (-i, -j) from the cell's centre.
            x += (k // 3 - 1) * extract(one, ONE)
            y += (k % 3 - 1) * extract(one, ONE)
    store(sums, (n * sums.shape[1] + s) * FIELDS, places)
    store(sums, (n * sums.shape[1] + s) * FIELDS + LANES, motion)
    sums[n, s, X] += x
    sums[n, s, Y] += y


@inline_jit
def collect_square(n, near, given, square):
    """Return sum m w x^2 of the gas at a node, x from the node."""
    total = 0.0
    for k in range(9):
        block, i, j = near[n, k], k // 3 - 1, k % 3 - 1
        if block >= 0:
            x, y = given[block, 8 - k, X], given[block, 8 - k, Y]
            total += square[block, 8 - k] + 2.0 * (i * x + j * y) + (i * i + j * j) * given[block, 8 - k, ONE]
    return total


@jit_no_alloc
def collect(node_from, node_to, kind, cells, nodes, square):
    """Write the sums of eq. (1) at each node, for the gas or for all dust species."""
    for n in range(node_from, node_to):
        for s in range(kind.first, kind.first + kind.number):
            collect_species(n, s, nodes.near, cells.slot, cells.given, nodes.sums)
        if len(square) > 0:
            nodes.square[n] = collect_square(n, nodes.near, cells.given, square)
