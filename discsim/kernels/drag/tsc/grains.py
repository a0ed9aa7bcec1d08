"""Gather for cells with one or two grains of each class: nodes sum over single grains (`kernels/drag/tsc/nodes.py`).

A cell's contributions to its nine nodes would be many more numbers than its grains. A node therefore sums over the
grains of nine cells directly, with weights that are polynomials of the position in a cell (`nodes_weights`). For
slopes a cell stores the first moments of each class and the second moments of all its dust together. The second
moments about the centroids of the classes are

    sum_s sum m x y - sum_s M_s X_s Y_s.                                                                  (6)
"""

import numpy as np

from discsim.jit.decorators import inline_jit, jit, jit_no_alloc
from discsim.jit.index import index
from discsim.kernels.common.simd import LANES, extract, load, store, zeros
from discsim.kernels.drag.tsc.columns import NORMS, ROOM, filled, is_ragged, renormalise_weights, take, weigh
from discsim.kernels.drag.tsc.nodes import BX, BY_Y, FIELDS, MASS, ONE, RHO, X, Y


@inline_jit
def most_of_all(block_from, block_to, kind):
    """Return the largest number of grains in a block."""
    most = 0
    for block in range(block_from, block_to):
        most = max(most, kind.start[(block + 1) * kind.number] - kind.start[block * kind.number])
    return most


@inline_jit
def first_moments(cell, first, last, kind, row, own):
    """Write the mass and first moments of a class in a cell."""
    places, motion = zeros(), zeros()
    for k in range(first, last):
        m = kind.mass[kind.order[k]]
        places += m * load(row, k * FIELDS)
        motion += m * load(row, k * FIELDS + LANES)
    store(own, cell * 3 * FIELDS, places)
    store(own, cell * 3 * FIELDS + LANES, motion)


@inline_jit
def moments_of_all(block, first, last, kind, row, total):
    """Write the mass, first and second moments of all the dust of a cell."""
    for half in (0, LANES):
        whole, by_x, by_y = zeros(), zeros(), zeros()
        for k in range(first, last):
            one, m = load(row, k * FIELDS + half), kind.mass[kind.order[k]]
            whole += m * one
            by_x += (m * row[k, X]) * one
            by_y += (m * row[k, Y]) * one
        at = block * 3 * FIELDS + half
        store(total, at, whole)
        store(total, at + FIELDS, by_x)
        store(total, at + 2 * FIELDS, by_y)


@inline_jit
def take_rows(block, first, count, kind, cells, nodes, frame, law, row, share, column, room):
    """Write the grains of a block as rows (n, FIELDS), and their shares."""
    n, home, flat = filled(count), cells.home[block], kind.pos.shape[1] == 1
    take(block, first, count, n, kind, cells, frame, law, 0, column, room)
    for at in range(count):
        share[first + at] = column[MASS * n + at]
        for f in range(FIELDS):
            there = f < BX and (f != RHO or len(kind.density) > 0)  # grains taken one by one have no sources
            row[first + at, f] = column[f * n + at] if there else 0.0
        row[first + at, ONE] = 1.0
    if is_ragged(home, flat, nodes.about, nodes.sums):
        weigh(n, flat, 0, column, room)
        renormalise_weights(home, n, nodes.about, nodes.sums, 0, column, room)
        for at in range(count):
            share[first + at] *= room[NORMS * n + at]


@inline_jit
def gather_block(block, kind, cells, nodes, frame, law, row, share, column, room):
    first, last = kind.start[block * kind.number], kind.start[(block + 1) * kind.number]
    if last > first:
        take_rows(block, first, last - first, kind, cells, nodes, frame, law, row, share, column, room)
    moments_of_all(block, first, last, kind, row, cells.total)
    for part in range(kind.number):
        cell, last = cells.slot[block, kind.first + part], kind.start[block * kind.number + part + 1]
        if cell >= 0:
            first_moments(cell, first, last, kind, row, cells.own)
        first = last


@jit
def gather_grains(block_from, block_to, kind, cells, nodes, frame, law, row, share):
    """Write the dust of the blocks in its order as `row` (n, FIELDS), and the moments of cells.

    Writes `share` (n,), the mass of a grain over the sum of its weights on nodes that have gas.
    """
    most = filled(most_of_all(block_from, block_to, kind))
    column, room = np.empty(FIELDS * most), np.empty(ROOM * most)
    for block in range(block_from, block_to):
        gather_block(block, kind, cells, nodes, frame, law, row, share, column, room)


@inline_jit
def coefficients(step, flat):
    """Return the coefficients of 1, x and x^2 in a particle's weight on the node `step` cells from its own."""
    if flat:
        return 1.0, 0.0, 0.0
    return (0.75, 0.0, -1.0) if step == 0 else (0.125, 0.5 * step, 0.5)


@inline_jit
def take_grains(n, k, block, kind, row, share, sums):
    """Add the contributions of the dust of a cell to the sums of eq. (1) at node n."""
    i, j, number = 1 - k // 3, 1 - k % 3, kind.number  # position of the node relative to the cell
    a0, a1, a2 = coefficients(i, False)
    b0, b1, b2 = coefficients(j, kind.pos.shape[1] == 1)
    last = index(kind.start[block * number])
    for part in range(number):
        first, last = last, index(kind.start[block * number + part + 1])
        if first == last:
            continue
        places, motion = zeros(), zeros()
        for g in range(first, last):
            x, y = row[g, X], row[g, Y]
            w = share[g] * (a0 + x * (a1 + x * a2)) * (b0 + y * (b1 + y * b2))
            places += w * load(row, g * FIELDS)
            motion += w * load(row, g * FIELDS + LANES)
        s = kind.first + part
        at = (n * sums.shape[1] + s) * FIELDS
        store(sums, at, load(sums, at) + places)
        store(sums, at + LANES, load(sums, at + LANES) + motion)
        sums[n, s, X] -= i * extract(places, ONE)
        sums[n, s, Y] -= j * extract(places, ONE)


@jit_no_alloc
def collect_grains(node_from, node_to, kind, nodes, row, share):
    """Write the sums of eq. (1) over the grain classes at each node that has gas."""
    for n in range(node_from, node_to):
        for s in range(kind.first, kind.first + kind.number):
            for f in range(FIELDS):
                nodes.sums[n, s, f] = 0.0
        if nodes.sums[n, 0, ONE] <= 0.0:
            continue
        for k in range(9):
            if nodes.near[n, k] >= 0:
                take_grains(n, k, nodes.near[n, k], kind, row, share, nodes.sums)


@inline_jit
def weight_of(k):
    """Return the weight of cell k about a node in slopes: nearer cells have larger weights."""
    return (0.5 if k // 3 == 1 else 0.25) * (0.5 if k % 3 == 1 else 0.25)


@inline_jit
def take_off(n, s, near, slot, own, xx, xy, yy, along, across):
    """Return second moments about a node, less a class's term of eq. (6)."""
    places, motion, i, j = zeros(), zeros(), 0.0, 0.0
    for k in range(9):
        block = near[n, k]
        cell = slot[block, s] if block >= 0 else -1
        if cell >= 0:
            w = weight_of(k)
            row = w * load(own, cell * 3 * FIELDS)
            places += row
            motion += w * load(own, cell * 3 * FIELDS + LANES)
            i += (k // 3 - 1) * extract(row, ONE)
            j += (k % 3 - 1) * extract(row, ONE)
    m = extract(places, ONE)
    if m <= 0.0:
        return xx, xy, yy, along, across
    mx, my = extract(places, X) + i, extract(places, Y) + j
    x, y = mx / m, my / m
    return xx - mx * x, xy - mx * y, yy - my * y, along - x * motion, across - y * motion


@inline_jit
def moments_within(n, near, slot, own, total):
    """Return the moments about the centroids of the classes, eq. (6), in the nine cells about a node.

    These are mass, second moments of position (xx, xy, yy), and two vectors: the moments of x and of y with velocity.
    """
    mass, xx, xy, yy, along, across = 0.0, 0.0, 0.0, 0.0, zeros(), zeros()
    for k in range(9):
        block = near[n, k]
        if block < 0:
            continue
        # Relative to the node, which lies at (-i, -j) from the cell's centre.
        i, j, w, at = k // 3 - 1.0, k % 3 - 1.0, weight_of(k), block * 3 * FIELDS
        row, moves, by_x = w * load(total, at), w * load(total, at + LANES), w * load(total, at + FIELDS)
        m, x, y = extract(row, ONE), extract(row, X), extract(row, Y)
        mass += m
        xx += extract(by_x, X) + 2.0 * i * x + i * i * m
        xy += extract(by_x, Y) + i * y + j * x + i * j * m
        yy += w * total[block, BY_Y, Y] + 2.0 * j * y + j * j * m
        along += w * load(total, at + FIELDS + LANES) + i * moves
        across += w * load(total, at + 2 * FIELDS + LANES) + j * moves
    for s in range(1, slot.shape[1]):
        xx, xy, yy, along, across = take_off(n, s, near, slot, own, xx, xy, yy, along, across)
    return mass, xx, xy, yy, along, across
