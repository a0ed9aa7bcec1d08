"""Gather for cells with one or two grains of each class: nodes sum over single grains (`nodes.py`).

The contributions of a cell to its nine nodes would be many more numbers than its grains. A node therefore sums over the
grains of nine cells directly, with weights that are polynomials of the position in a cell (`weights.py`). For the fit
of slopes, a cell stores the first moments of each class, and the second moments of all its dust together. The second
moments about the centroids of the classes are

    sum_s sum m x y - sum_s M_s X_s Y_s.                                                                  (6)
"""

import numpy as np

from discsim.jit.decorators import inline_jit, jit, jit_no_alloc
from discsim.jit.index import index
from discsim.kernels.common.simd import LANES, extract, load, store, zeros
from discsim.kernels.drag.tsc import columns
from discsim.kernels.drag.tsc.columns import NORMS, SCRATCH_COLUMNS
from discsim.kernels.drag.tsc.nodes import BX, BY_Y, FIELDS, MASS, ONE, RHO, X, Y
from discsim.kernels.drag.tsc.weights import slope_weight


@inline_jit
def largest_grain_count(block_from, block_to, kind):
    """Return the largest number of grains in one of the blocks."""
    most = 0
    for block in range(block_from, block_to):
        most = max(most, kind.start[(block + 1) * kind.number] - kind.start[block * kind.number])
    return most


@inline_jit
def first_moments(cell, first, last, kind, row, moments):
    """Write the mass and the first moments of one class of grains in a cell to `moments`.

    cell: row of the class in the tables. first, last: range of its grains. row (grains, FIELDS): packed grains.
    """
    places, motion = zeros(), zeros()
    for k in range(first, last):
        m = kind.mass[kind.order[k]]
        places += m * load(row, k * FIELDS)
        motion += m * load(row, k * FIELDS + LANES)
    store(moments, cell * 3 * FIELDS, places)
    store(moments, cell * 3 * FIELDS + LANES, motion)


@inline_jit
def moments_of_all(block, first, last, kind, row, dust_moments):
    """Write the mass and the first and second moments of all dust of a block to `dust_moments`.

    The arguments are those of `first_moments`.
    """
    for half in (0, LANES):
        whole, by_x, by_y = zeros(), zeros(), zeros()
        for k in range(first, last):
            one, m = load(row, k * FIELDS + half), kind.mass[kind.order[k]]
            whole += m * one
            by_x += (m * row[k, X]) * one
            by_y += (m * row[k, Y]) * one
        at = block * 3 * FIELDS + half
        store(dust_moments, at, whole)
        store(dust_moments, at + FIELDS, by_x)
        store(dust_moments, at + 2 * FIELDS, by_y)


@inline_jit
def write_grain_rows(block, first, count, kind, cells, nodes, frame, law, row, scaled_mass, column, scratch):
    """Write the `count` grains of a block, from `first` on, to `row` (grains, FIELDS), and to `scaled_mass` (grains,).

    column, scratch: overwritten. The other arguments are those of `gather_grains`.
    """
    n, centre_node, flat = columns.padded_count(count), cells.centre_node[block], kind.pos.shape[1] == 1
    columns.write_columns(block, first, count, n, kind, cells, frame, law, 0, column, scratch)
    for at in range(count):
        scaled_mass[first + at] = column[MASS * n + at]
        for f in range(FIELDS):
            there = f < BX and (f != RHO or len(kind.density) > 0)  # single grains have no sources
            row[first + at, f] = column[f * n + at] if there else 0.0
        row[first + at, ONE] = 1.0
    if columns.has_gasless_nodes(centre_node, flat, nodes.stencil, nodes.sums):
        columns.weigh_by_mass(n, flat, 0, column, scratch)
        columns.renormalise_weights(centre_node, n, nodes.stencil, nodes.sums, 0, column, scratch)
        for at in range(count):
            scaled_mass[first + at] *= scratch[NORMS * n + at]


@inline_jit
def gather_block(block, kind, cells, nodes, frame, law, row, scaled_mass, column, scratch):
    """Write the packed grains and the moments of one block, as `gather_grains`."""
    first, last = kind.start[block * kind.number], kind.start[(block + 1) * kind.number]
    if last > first:
        write_grain_rows(block, first, last - first, kind, cells, nodes, frame, law, row, scaled_mass, column, scratch)
    moments_of_all(block, first, last, kind, row, cells.dust_moments)
    for part in range(kind.number):
        cell, last = cells.species_row[block, kind.first + part], kind.start[block * kind.number + part + 1]
        if cell >= 0:
            first_moments(cell, first, last, kind, row, cells.moments)
        first = last


@jit
def gather_grains(block_from, block_to, kind, cells, nodes, frame, law, row, scaled_mass):
    """Write the packed grains of the blocks to `row` (grains, FIELDS), and the moments of their cells to `cells`.

    The grains have the order of `kind.order`.

    scaled_mass (grains,): output, mass of each grain divided by the sum of its weights on nodes with gas.
    """
    most = columns.padded_count(largest_grain_count(block_from, block_to, kind))
    column, scratch = np.empty(FIELDS * most), np.empty(SCRATCH_COLUMNS * most)
    for block in range(block_from, block_to):
        gather_block(block, kind, cells, nodes, frame, law, row, scaled_mass, column, scratch)


@inline_jit
def coefficients(step, flat):
    """Return the coefficients of 1, x and x^2 in the weight of a particle on the node `step` cells from its own node.

    flat: whether the weight is 1, for the second axis in one dimension.
    """
    if flat:
        return 1.0, 0.0, 0.0
    return (0.75, 0.0, -1.0) if step == 0 else (0.125, 0.5 * step, 0.5)


@inline_jit
def add_grains(n, k, block, kind, row, scaled_mass, sums):
    """Add the contributions of the grains in the cell `block` to the sums `sums` of node n, eq. (1).

    k: index of the cell among the nine about the node. row, scaled_mass: results of `gather_grains`.
    """
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
            w = scaled_mass[g] * (a0 + x * (a1 + x * a2)) * (b0 + y * (b1 + y * b2))
            places += w * load(row, g * FIELDS)
            motion += w * load(row, g * FIELDS + LANES)
        s = kind.first + part
        at = (n * sums.shape[1] + s) * FIELDS
        store(sums, at, load(sums, at) + places)
        store(sums, at + LANES, load(sums, at + LANES) + motion)
        sums[n, s, X] -= i * extract(places, ONE)
        sums[n, s, Y] -= j * extract(places, ONE)


@jit_no_alloc
def collect_grains(node_from, node_to, kind, nodes, row, scaled_mass):
    """Write the sums of eq. (1) of each class of grains at each node; the sums are 0 at nodes without gas.

    row, scaled_mass: results of `gather_grains`.
    """
    for n in range(node_from, node_to):
        for s in range(kind.first, kind.first + kind.number):
            for f in range(FIELDS):
                nodes.sums[n, s, f] = 0.0
        if nodes.sums[n, 0, ONE] <= 0.0:
            continue
        for k in range(9):
            if nodes.node_cells[n, k] >= 0:
                add_grains(n, k, nodes.node_cells[n, k], kind, row, scaled_mass, nodes.sums)


@inline_jit
def subtract_class(n, s, node_cells, species_row, moments, xx, xy, yy, along, across):
    """Return the second moments about node n, less the term of class s in eq. (6).

    xx, xy, yy, along, across: second moments, as in `moments_within`.
    """
    places, motion, i, j = zeros(), zeros(), 0.0, 0.0
    for k in range(9):
        block = node_cells[n, k]
        cell = species_row[block, s] if block >= 0 else -1
        if cell >= 0:
            w = slope_weight(k)
            row = w * load(moments, cell * 3 * FIELDS)
            places += row
            motion += w * load(moments, cell * 3 * FIELDS + LANES)
            i += (k // 3 - 1) * extract(row, ONE)
            j += (k % 3 - 1) * extract(row, ONE)
    m = extract(places, ONE)
    if m <= 0.0:
        return xx, xy, yy, along, across
    mx, my = extract(places, X) + i, extract(places, Y) + j
    x, y = mx / m, my / m
    return xx - mx * x, xy - mx * y, yy - my * y, along - x * motion, across - y * motion


@inline_jit
def moments_within(n, node_cells, species_row, moments, dust_moments):
    """Return six moments of all dust in the nine cells about node n, about the centroids of the classes, eq. (6).

    The moments are the mass, the second moments of position xx, xy and yy, and two vectors: the moments of x, and of
    y, with velocity.
    """
    mass, xx, xy, yy, along, across = 0.0, 0.0, 0.0, 0.0, zeros(), zeros()
    for k in range(9):
        block = node_cells[n, k]
        if block < 0:
            continue
        # Relative to the node, which lies at (-i, -j) from the cell's centre.
        i, j, w, at = k // 3 - 1.0, k % 3 - 1.0, slope_weight(k), block * 3 * FIELDS
        row, moves, by_x = (
            w * load(dust_moments, at),
            w * load(dust_moments, at + LANES),
            w * load(dust_moments, at + FIELDS),
        )
        m, x, y = extract(row, ONE), extract(row, X), extract(row, Y)
        mass += m
        xx += extract(by_x, X) + 2.0 * i * x + i * i * m
        xy += extract(by_x, Y) + i * y + j * x + i * j * m
        yy += w * dust_moments[block, BY_Y, Y] + 2.0 * j * y + j * j * m
        along += w * load(dust_moments, at + FIELDS + LANES) + i * moves
        across += w * load(dust_moments, at + 2 * FIELDS + LANES) + j * moves
    for s in range(1, species_row.shape[1]):
        xx, xy, yy, along, across = subtract_class(n, s, node_cells, species_row, moments, xx, xy, yy, along, across)
    return mass, xx, xy, yy, along, across
