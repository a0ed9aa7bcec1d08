"""Columns: packed copies of the particles of a cell, for loops over vectors of LANES particles (`nodes.py`).

Each of the FIELDS of a population in a block is a column of n entries, where n is the number of its particles rounded
up to whole vectors. The columns follow each other in memory. Padding copies the last particle, with mass 0. All columns
together exceed the caches. A population without sources therefore has no columns for them, and the column of density or
norm is used only if there is one. There are few loops, as a block may have few particles, and processors mispredict the
end of each loop.
"""

import math

from discsim.formulas.laws import EPSTEIN
from discsim.jit.decorators import inline_jit, jit_no_alloc
from discsim.jit.index import index
from discsim.kernels.common.simd import LANES, LINE, load, prefetch, store, zeros
from discsim.kernels.drag.frame import orbital_frequency, rotation_sign
from discsim.kernels.drag.tsc.nodes import BX, BY, FIELDS, MASS, ONE, RHO, VX, VY, X, Y
from discsim.kernels.drag.tsc.weights import tsc_weights

# Scratch columns of a block: mass times the weight on each of the nine nodes; then one column for the sense of
# rotation, and later for the norms of weights.
SENSE, NORMS, SCRATCH_COLUMNS = 9, 9, 10


@inline_jit
def padded_count(count):
    """Return the length of a column for `count` particles: `count` rounded up to whole vectors."""
    return (count + LANES - 1) & -LANES


@jit_no_alloc
def number_rows(gas_start, dust_start, species_row, gas_rows, dust_rows):
    """Number the rows of the tables of sums, and of the packed particles; return the number of rows of the tables.

    gas_start (blocks + 1,), dust_start (blocks * populations + 1,): first particle of each block, and of each
    population in each block. Writes `species_row` (blocks, species), as in `CellSums`: first the gas of all blocks,
    then all dust that is present. Writes to `gas_rows` (blocks + 1,) and `dust_rows` (blocks * populations + 1,) the
    number of vectors of LANES particles before each block, and before each population of each block.
    """
    count, kinds = species_row.shape[0], species_row.shape[1] - 1
    row_count, gas_rows[0], dust_rows[0] = count, 0, 0
    for block in range(count):
        species_row[block, 0] = block
        gas_rows[block + 1] = gas_rows[block] + padded_count(gas_start[block + 1] - gas_start[block]) // LANES
        for part in range(kinds):
            at = block * kinds + part
            held = dust_start[at + 1] - dust_start[at]
            dust_rows[at + 1] = dust_rows[at] + padded_count(held) // LANES
            species_row[block, 1 + part] = row_count if held > 0 else -1
            row_count += held > 0
    return row_count


@inline_jit
def longest_column(block_from, block_to, kind):
    """Return the length of the longest column of a population in the blocks from `block_from` to `block_to`."""
    most = 0
    for part in range(block_from * kind.number, block_to * kind.number):
        most = max(most, kind.start[part + 1] - kind.start[part])
    return padded_count(most)


@inline_jit
def copy_plane(first, count, n, kind, dense, begin, column):
    """Copy the particles kind.order[first : first + count], in two dimensions, to columns from element `begin` on.

    n: length of a column.

    dense: whether `kind.density` has entries.
    """
    start, last, sources = index(first), index(count - 1), len(kind.source) > 0
    mass, x, y = index(begin + MASS * n), index(begin + X * n), index(begin + Y * n)
    u, v, rho = index(begin + VX * n), index(begin + VY * n), index(begin + RHO * n)
    a, b = index(begin + BX * n), index(begin + BY * n)
    for at in range(index(n)):
        i = kind.order[start + (at if at < last else last)]
        column[mass + at] = kind.mass[i] if at <= last else 0.0
        column[x + at], column[y + at] = kind.pos[i, 0], kind.pos[i, 1]
        column[u + at], column[v + at] = kind.vel[i, 0], kind.vel[i, 1]
        if sources:
            column[a + at], column[b + at] = kind.source[i, 0], kind.source[i, 1]
        if dense:
            column[rho + at] = kind.density[i]


@inline_jit
def prefetch_next(first, count, kind):
    """Prefetch `count` particles from `first` on, which `write_columns` copies next.

    The particles are scattered in memory. `count` is the number of particles of the present block, as a guess of the
    next number.
    """
    start, end, dim = index(first), index(min(first + count, len(kind.order))), index(kind.vel.shape[1])
    for k in range(start, end):
        i = dim * kind.order[k]
        prefetch(kind.pos, i)
        prefetch(kind.vel, i)


@inline_jit
def copy_line(first, count, n, kind, dense, begin, column):
    """Copy particles in one dimension to columns, as `copy_plane`; second components are 0."""
    for at in range(n):
        i, into = kind.order[first + (at if at < count else count - 1)], begin + at
        column[into + MASS * n] = kind.mass[i] if at < count else 0.0
        column[into + X * n], column[into + Y * n] = kind.pos[i, 0], 0.0
        column[into + VX * n], column[into + VY * n] = kind.vel[i, 0], 0.0
        if len(kind.source) > 0:
            column[into + BX * n], column[into + BY * n] = kind.source[i, 0], 0.0
        if dense:
            column[into + RHO * n] = kind.density[i]


@inline_jit
def prefetch_columns(n, sources, begin, column):
    """Prefetch the memory behind the columns of a block, which the columns of the next block will fill.

    All columns together exceed the caches, and a write that misses the cache waits as long as a read. n: length of the
    columns. sources: whether they include sources.
    """
    length = (FIELDS if sources else BX) * n
    for at in range(index(begin + length), index(begin + 2 * length), LINE):
        prefetch(column, at)


@inline_jit
def wrap_positions(f, n, corner, period, begin, column):
    """Shift the positions in field f, in a periodic space, into the period that begins at the corner of the cell."""
    for at in range(begin + f * n, begin + (f + 1) * n):
        column[at] -= period * math.floor((column[at] - corner) / period)


@inline_jit
def to_cell_units(block, n, cells, flat, begin, column):
    """Convert positions in columns to positions from the centre of the cell, in sides of the cell."""
    inverse, x0, y0 = 1.0 / cells.side[block], cells.corner[block, 0], cells.corner[block, 1]
    for at in range(begin, begin + n, LANES):
        store(column, at + X * n, inverse * (load(column, at + X * n) - x0) - 0.5)
        if not flat:
            store(column, at + Y * n, inverse * (load(column, at + Y * n) - y0) - 0.5)


@inline_jit
def to_kepler_frame(block, n, cells, frame, begin, column, scratch):
    """Subtract the Keplerian velocity of the frame from the velocities in columns. scratch: overwritten."""
    side, several, sense = cells.side[block], len(frame.sense) > 1, zeros() + frame.sense[0]
    x0, y0 = cells.corner[block, 0] + 0.5 * side, cells.corner[block, 1] + 0.5 * side
    if several:
        for at in range(n):
            x, y = x0 + side * column[begin + X * n + at], y0 + side * column[begin + Y * n + at]
            scratch[SENSE * n + at] = rotation_sign(x * x + y * y, frame)
    for p in range(0, n, LANES):
        at = begin + p
        x, y = x0 + side * load(column, at + X * n), y0 + side * load(column, at + Y * n)
        if several:
            sense = load(scratch, SENSE * n + p)
        omega = sense * orbital_frequency(x * x + y * y, frame.star, frame.softening)
        store(column, at + VX * n, load(column, at + VX * n) + omega * y)
        store(column, at + VY * n, load(column, at + VY * n) - omega * x)


@inline_jit
def write_columns(block, first, count, n, kind, cells, frame, law, begin, column, scratch):
    """Write the columns of the particles kind.order[first : first + count] of a block, from element `begin` on.

    n: length of a column. law: form of the drag law. scratch: overwritten.
    """
    flat, dense = kind.pos.shape[1] == 1, len(kind.density) > 0
    if flat:
        copy_line(first, count, n, kind, dense, begin, column)
    else:
        copy_plane(first, count, n, kind, dense, begin, column)
    if dense and law == EPSTEIN and frame.star == 0.0 and kind.first == 0:
        for at in range(count):
            column[begin + RHO * n + at] *= kind.sound[kind.order[first + at]]
    if cells.period[0] < math.inf:
        wrap_positions(X, n, cells.corner[block, 0], cells.period[0], begin, column)
        if not flat:
            wrap_positions(Y, n, cells.corner[block, 1], cells.period[1], begin, column)
    to_cell_units(block, n, cells, flat, begin, column)
    if frame.star > 0.0:
        to_kepler_frame(block, n, cells, frame, begin, column, scratch)


@inline_jit
def weigh_by_mass(n, flat, begin, column, scratch):
    """Write to the first nine columns of `scratch` the mass of each particle times its weight on each of the nine
    nodes.
    """
    for into in range(0, n, LANES):
        m = load(column, begin + MASS * n + into)
        u0, u1, u2 = tsc_weights(load(column, begin + X * n + into))
        t0, t1, t2 = zeros(), m, zeros()
        if not flat:
            t0, t1, t2 = tsc_weights(load(column, begin + Y * n + into))
            t0, t1, t2 = m * t0, m * t1, m * t2
        store(scratch, into, u0 * t0)
        store(scratch, into + n, u0 * t1)
        store(scratch, into + 2 * n, u0 * t2)
        store(scratch, into + 3 * n, u1 * t0)
        store(scratch, into + 4 * n, u1 * t1)
        store(scratch, into + 5 * n, u1 * t2)
        store(scratch, into + 6 * n, u2 * t0)
        store(scratch, into + 7 * n, u2 * t1)
        store(scratch, into + 8 * n, u2 * t2)


@inline_jit
def has_gasless_nodes(centre_node, flat, stencil, sums):
    """Return whether any of the nine nodes about the node `centre_node` has no gas."""
    for k in range(9):
        n = stencil[centre_node, k]
        if (n < 0 or sums[n, 0, ONE] <= 0.0) and not (flat and k % 3 != 1):
            return True
    return False


@inline_jit
def renormalise_weights(centre_node, n, stencil, sums, begin, column, scratch):
    """Set the weights in `scratch` on nodes without gas to 0, and scale each particle's other weights to a sum of 1.

    Writes the factor to the column NORMS of `scratch`. The factor is 0 for padding, and for particles without any
    node with gas.
    """
    for at in range(n):
        whole = 0.0
        for k in range(9):
            node = stencil[centre_node, k]
            if node < 0 or sums[node, 0, ONE] <= 0.0:
                scratch[k * n + at] = 0.0
            whole += scratch[k * n + at]
        norm = column[begin + MASS * n + at] / whole if whole > 0.0 else 0.0
        scratch[NORMS * n + at] = norm
        for k in range(9):
            scratch[k * n + at] *= norm
