"""Gather: contributions of particles to the nine nodes of their cell, and the sums at nodes, eq. (1) of `nodes.py`."""

import numpy as np

from discsim.jit.decorators import inline_jit, jit, jit_no_alloc
from discsim.kernels.common.simd import LANES, extract, horizontal_sums, load, store, zeros
from discsim.kernels.drag.tsc import columns
from discsim.kernels.drag.tsc.columns import NORMS, SCRATCH_COLUMNS
from discsim.kernels.drag.tsc.nodes import FIELDS, NORM, ONE, VX, X, Y


@inline_jit
def sum_columns(half, more, n, k, begin, column, scratch, contributions, at):
    """Write to `contributions` what a cell adds to the nodes k, k + 1 and k + 2, one vector of fields for each node.

    half: first field of the vector, ONE (mass, position, density) or VX (velocity, source). more: whether there is a
    density or source. scratch: mass times weights. at: element at which the contributions of the cell begin.
    """
    a, b, c, d = zeros(), zeros(), zeros(), zeros()
    e, f, g, h = zeros(), zeros(), zeros(), zeros()
    i, j, l, m = zeros(), zeros(), zeros(), zeros()
    for p in range(0, n, LANES):
        u, v, w = load(scratch, k * n + p), load(scratch, (k + 1) * n + p), load(scratch, (k + 2) * n + p)
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
    store(contributions, at + half + k * FIELDS, horizontal_sums(a, b, c, d))
    store(contributions, at + half + (k + 1) * FIELDS, horizontal_sums(e, f, g, h))
    store(contributions, at + half + (k + 2) * FIELDS, horizontal_sums(i, j, l, m))


@inline_jit
def write_contributions(n, dense, sources, begin, column, scratch, contributions, at):
    """Write the contributions of a cell to its nine nodes: weighted sums over its particles, 0 for absent fields.

    Arguments as in `sum_columns`. dense, sources: whether the particles have a density, and sources.
    """
    for k in range(0, 9, 3):  # np.int64: numba compiles one specialisation per literal
        sum_columns(np.int64(ONE), dense, n, k, begin, column, scratch, contributions, at)
        sum_columns(np.int64(VX), sources, n, k, begin, column, scratch, contributions, at)


@inline_jit
def sum_of_three(table, begin, step):
    """Return the sum of the vectors at the elements `begin`, begin + step and begin + 2 step of `table`."""
    return load(table, begin) + load(table, begin + step) + load(table, begin + 2 * step)


@inline_jit
def own_moments(contributions, at, moments, into):
    """Write the moments of a cell, computed from its contributions to nodes, to `moments`.

    at: element of `contributions` at which those of the cell begin. into: element of `moments` at which the result
    begins. The weights of a particle add up to 1, and the mean of the node positions with these weights is its own
    position.
    """
    for half in (0, LANES):
        begin = at + half
        low = sum_of_three(contributions, begin, FIELDS)
        middle = sum_of_three(contributions, begin + 3 * FIELDS, FIELDS)
        high = sum_of_three(contributions, begin + 6 * FIELDS, FIELDS)
        below = sum_of_three(contributions, begin, 3 * FIELDS)
        above = sum_of_three(contributions, begin + 2 * FIELDS, 3 * FIELDS)
        store(moments, into + half, low + middle + high)
        store(moments, into + half + FIELDS, high - low)
        store(moments, into + half + 2 * FIELDS, above - below)


@inline_jit
def gather_species(block, part, kind, cells, nodes, frame, law, begin, column, scratch, square):
    """Write the columns of one population in a block, its contributions to nodes, and its moments.

    part: index of the population. begin: element of `column` at which the columns of this population begin. The
    other arguments are those of `gather`.
    """
    flat, s, centre_node = kind.pos.shape[1] == 1, kind.first + part, cells.centre_node[block]
    cell, first = cells.species_row[block, s], kind.start[block * kind.number + part]
    count = kind.start[block * kind.number + part + 1] - first
    if cell < 0:
        return
    n, dense, sources = columns.padded_count(count), len(kind.density) > 0, len(kind.source) > 0
    start = cell * 9 * FIELDS
    if count > 0:  # a block without gas has a row for gas
        columns.write_columns(block, first, count, n, kind, cells, frame, law, begin, column, scratch)
        columns.prefetch_columns(n, sources, begin, column)
        columns.prefetch_next(first + count, count, kind)
        columns.weigh_by_mass(n, flat, begin, column, scratch)
    if len(square) > 0:
        write_squares(block, n, begin, column, scratch, square)
    gasless = kind.first > 0 and columns.has_gasless_nodes(centre_node, flat, nodes.stencil, nodes.sums)
    for again in range(2 if gasless else 1):
        if again:
            columns.renormalise_weights(centre_node, n, nodes.stencil, nodes.sums, begin, column, scratch)
        write_contributions(n, dense, sources, begin, column, scratch, cells.contributions, start)
        if not again:  # moments need the weights before renormalisation
            own_moments(cells.contributions, start, cells.moments, cell * 3 * FIELDS)
    if gasless:
        for at in range(0, n, LANES):
            store(column, begin + NORM * n + at, load(scratch, NORMS * n + at))


@inline_jit
def write_squares(block, n, begin, column, scratch, square):
    """Write to `square` (blocks, 9) the contributions of the gas of a cell to sum m w x^2 at its nine nodes."""
    a, b, c, d, e, f = zeros(), zeros(), zeros(), zeros(), zeros(), zeros()
    g, h, i = zeros(), zeros(), zeros()
    for at in range(0, n, LANES):
        x, y = load(column, begin + X * n + at), load(column, begin + Y * n + at)
        r2 = x * x + y * y
        a += load(scratch, at) * r2
        b += load(scratch, at + n) * r2
        c += load(scratch, at + 2 * n) * r2
        d += load(scratch, at + 3 * n) * r2
        e += load(scratch, at + 4 * n) * r2
        f += load(scratch, at + 5 * n) * r2
        g += load(scratch, at + 6 * n) * r2
        h += load(scratch, at + 7 * n) * r2
        i += load(scratch, at + 8 * n) * r2
    store(square, block * 9, horizontal_sums(a, b, c, d))
    store(square, block * 9 + LANES, horizontal_sums(e, f, g, h))
    square[block, 8] = extract(horizontal_sums(i, i, i, i), 0)


@jit
def gather(block_from, block_to, kind, cells, nodes, frame, law, begin, column, square):
    """Write the columns of each population in the blocks, and the contributions and the moments of each cell.

    The columns of a population in a block start at an element of `column`, given in `begin` (blocks * populations +
    1,). Contributions and moments are written to `cells`. square (blocks, 9): output, contributions of gas to sum m w
    x^2; empty if it is not needed. law: form of the drag law.
    """
    scratch = np.empty(SCRATCH_COLUMNS * columns.longest_column(block_from, block_to, kind))
    for block in range(block_from, block_to):
        for part in range(kind.number):
            at = begin[block * kind.number + part]
            gather_species(block, part, kind, cells, nodes, frame, law, at, column, scratch, square)


@inline_jit
def collect_species(n, s, node_cells, species_row, contributions, sums):
    """Write the sums of eq. (1) for species s at node n to `sums`; positions are relative to the node."""
    places, motion, x, y = zeros(), zeros(), 0.0, 0.0
    for k in range(9):
        block, j = node_cells[n, k], 8 - k
        cell = species_row[block, s] if block >= 0 else -1
        if cell >= 0:
            at = (cell * 9 + j) * FIELDS
            one = load(contributions, at)
            places += one
            motion += load(contributions, at + LANES)
            # The node lies at (-i, -j) from the cell's centre.
            x += (k // 3 - 1) * extract(one, ONE)
            y += (k % 3 - 1) * extract(one, ONE)
    store(sums, (n * sums.shape[1] + s) * FIELDS, places)
    store(sums, (n * sums.shape[1] + s) * FIELDS + LANES, motion)
    sums[n, s, X] += x
    sums[n, s, Y] += y


@inline_jit
def collect_square(n, node_cells, contributions, square):
    """Return sum m w x^2 over the gas at node n, with x relative to the node."""
    total = 0.0
    for k in range(9):
        block, i, j = node_cells[n, k], k // 3 - 1, k % 3 - 1
        if block >= 0:
            x, y = contributions[block, 8 - k, X], contributions[block, 8 - k, Y]
            total += square[block, 8 - k] + 2.0 * (i * x + j * y) + (i * i + j * j) * contributions[block, 8 - k, ONE]
    return total


@jit_no_alloc
def collect(node_from, node_to, kind, cells, nodes, square):
    """Write the sums of eq. (1) at each node to `nodes.sums`, for the gas or for all dust species.

    If `square` has entries, also writes sum m w x^2 over the gas to `nodes.square`.
    """
    for n in range(node_from, node_to):
        for s in range(kind.first, kind.first + kind.number):
            collect_species(n, s, nodes.node_cells, cells.species_row, cells.contributions, nodes.sums)
        if len(square) > 0:
            nodes.square[n] = collect_square(n, nodes.node_cells, cells.contributions, square)
