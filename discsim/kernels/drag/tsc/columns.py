"""Columns of the particles of a cell for the nodes (`kernels/drag/tsc/nodes.py`): LANES particles at once.

The FIELDS of a population in a block are consecutive columns of n entries, n the number of its particles padded to
whole vectors. Padding copies the last particle, with mass 0. The columns of all blocks exceed the caches. A
population without sources therefore has no columns for them, and that of a density or norm is touched only where
there is one. Loops are few because a block may have few particles: processors mispredict the end of each loop.
"""

import math

from discsim.formulas.laws import EPSTEIN
from discsim.jit.decorators import inline_jit, jit_no_alloc
from discsim.jit.index import index
from discsim.kernels.common.simd import LANES, LINE, load, prefetch, store, zeros
from discsim.kernels.drag.frame import kepler, sense_at
from discsim.kernels.drag.tsc.nodes import BX, BY, FIELDS, MASS, ONE, RHO, VX, VY, X, Y
from discsim.kernels.drag.tsc.weights import cloud

# Scratch columns of a block: the weights on the nine nodes times the mass, then one for the sense of orbits and later
# for the norms of weights.
SENSE, NORMS, ROOM = 9, 9, 10


@inline_jit
def filled(count):
    """Return the length of a column of `count` particles, padded to whole vectors."""
    return (count + LANES - 1) & -LANES


@jit_no_alloc
def find_slots(gas_start, dust_start, slot, gas_rows, dust_rows):
    """Find the sums and columns of blocks, from the starts of their gas and, by population, of their dust.

    Writes the row of each species of a block in the sums, `slot` (blocks, species): first the gas of all blocks, then
    the dust that is present, -1 where there is none. Writes how many vectors of LANES particles precede those of each
    population in each block: `gas_rows` (blocks + 1,) and `dust_rows` (blocks times populations + 1,). Returns the
    number of slots.
    """
    count, kinds = slot.shape[0], slot.shape[1] - 1
    slots, gas_rows[0], dust_rows[0] = count, 0, 0
    for block in range(count):
        slot[block, 0] = block
        gas_rows[block + 1] = gas_rows[block] + filled(gas_start[block + 1] - gas_start[block]) // LANES
        for part in range(kinds):
            at = block * kinds + part
            held = dust_start[at + 1] - dust_start[at]
            dust_rows[at + 1] = dust_rows[at] + filled(held) // LANES
            slot[block, 1 + part] = slots if held > 0 else -1
            slots += held > 0
    return slots


@inline_jit
def most_in(block_from, block_to, kind):
    """Return the length of the longest column of a population in the blocks."""
    most = 0
    for part in range(block_from * kind.number, block_to * kind.number):
        most = max(most, kind.start[part + 1] - kind.start[part])
    return filled(most)


@inline_jit
def take_plane(first, count, n, kind, dense, begin, column):
    """Copy particles in two dimensions from their arrays to columns."""
    start, last, sources = index(first), index(count - 1), len(kind.own) > 0
    mass, x, y = index(begin + MASS * n), index(begin + X * n), index(begin + Y * n)
    u, v, rho = index(begin + VX * n), index(begin + VY * n), index(begin + RHO * n)
    a, b = index(begin + BX * n), index(begin + BY * n)
    for at in range(index(n)):
        i = kind.order[start + (at if at < last else last)]
        column[mass + at] = kind.mass[i] if at <= last else 0.0
        column[x + at], column[y + at] = kind.pos[i, 0], kind.pos[i, 1]
        column[u + at], column[v + at] = kind.vel[i, 0], kind.vel[i, 1]
        if sources:
            column[a + at], column[b + at] = kind.own[i, 0], kind.own[i, 1]
        if dense:
            column[rho + at] = kind.density[i]


@inline_jit
def fetch_next(first, count, kind):
    """Prefetch the particles that `take` copies next, as many as in this block: they are scattered in memory."""
    start, end, dim = index(first), index(min(first + count, len(kind.order))), index(kind.vel.shape[1])
    for k in range(start, end):
        i = dim * kind.order[k]
        prefetch(kind.pos, i)
        prefetch(kind.vel, i)


@inline_jit
def take_line(first, count, n, kind, dense, begin, column):
    """Copy particles in one dimension from their arrays to columns; second components are 0."""
    for at in range(n):
        i, into = kind.order[first + (at if at < count else count - 1)], begin + at
        column[into + MASS * n] = kind.mass[i] if at < count else 0.0
        column[into + X * n], column[into + Y * n] = kind.pos[i, 0], 0.0
        column[into + VX * n], column[into + VY * n] = kind.vel[i, 0], 0.0
        if len(kind.own) > 0:
            column[into + BX * n], column[into + BY * n] = kind.own[i, 0], 0.0
        if dense:
            column[into + RHO * n] = kind.density[i]


@inline_jit
def fetch_columns(n, sources, begin, column):
    """Prefetch the memory behind the columns of a block, as much as they take: the columns of the next block.

    Columns exceed the caches, and a write that misses the cache waits as long as a read.
    """
    length = (FIELDS if sources else BX) * n
    for at in range(index(begin + length), index(begin + 2 * length), LINE):
        prefetch(column, at)


@inline_jit
def wrap(f, n, corner, period, begin, column):
    """Shift positions in a periodic space to less than a period above the corner of the cell."""
    for at in range(begin + f * n, begin + (f + 1) * n):
        column[at] -= period * math.floor((column[at] - corner) / period)


@inline_jit
def to_cell(block, n, cells, flat, begin, column):
    """Convert positions to sides of the cell, from its centre."""
    inverse, x0, y0 = 1.0 / cells.side[block], cells.corner[block, 0], cells.corner[block, 1]
    for at in range(begin, begin + n, LANES):
        store(column, at + X * n, inverse * (load(column, at + X * n) - x0) - 0.5)
        if not flat:
            store(column, at + Y * n, inverse * (load(column, at + Y * n) - y0) - 0.5)


@inline_jit
def leave_orbits(block, n, cells, frame, begin, column, room):
    """Convert velocities to those relative to Kepler's in the `frame`."""
    side, several, sense = cells.side[block], len(frame.sense) > 1, zeros() + frame.sense[0]
    x0, y0 = cells.corner[block, 0] + 0.5 * side, cells.corner[block, 1] + 0.5 * side
    if several:
        for at in range(n):
            x, y = x0 + side * column[begin + X * n + at], y0 + side * column[begin + Y * n + at]
            room[SENSE * n + at] = sense_at(x * x + y * y, frame)
    for p in range(0, n, LANES):
        at = begin + p
        x, y = x0 + side * load(column, at + X * n), y0 + side * load(column, at + Y * n)
        if several:
            sense = load(room, SENSE * n + p)
        omega = sense * kepler(x * x + y * y, frame.star, frame.softening)
        store(column, at + VX * n, load(column, at + VX * n) + omega * y)
        store(column, at + VY * n, load(column, at + VY * n) - omega * x)


@inline_jit
def take(block, first, count, n, kind, cells, frame, law, begin, column, room):
    """Write the columns of `count` particles of a block, from element `begin` on."""
    flat, dense = kind.pos.shape[1] == 1, len(kind.density) > 0
    if flat:
        take_line(first, count, n, kind, dense, begin, column)
    else:
        take_plane(first, count, n, kind, dense, begin, column)
    if dense and law == EPSTEIN and frame.star == 0.0 and kind.first == 0:
        for at in range(count):
            column[begin + RHO * n + at] *= kind.sound[kind.order[first + at]]
    if cells.period[0] < math.inf:
        wrap(X, n, cells.corner[block, 0], cells.period[0], begin, column)
        if not flat:
            wrap(Y, n, cells.corner[block, 1], cells.period[1], begin, column)
    to_cell(block, n, cells, flat, begin, column)
    if frame.star > 0.0:
        leave_orbits(block, n, cells, frame, begin, column, room)


@inline_jit
def weigh(n, flat, begin, column, room):
    """Write the weights on the nine nodes times the mass to `room`."""
    for into in range(0, n, LANES):
        m = load(column, begin + MASS * n + into)
        u0, u1, u2 = cloud(load(column, begin + X * n + into))
        t0, t1, t2 = zeros(), m, zeros()
        if not flat:
            t0, t1, t2 = cloud(load(column, begin + Y * n + into))
            t0, t1, t2 = m * t0, m * t1, m * t2
        store(room, into, u0 * t0)
        store(room, into + n, u0 * t1)
        store(room, into + 2 * n, u0 * t2)
        store(room, into + 3 * n, u1 * t0)
        store(room, into + 4 * n, u1 * t1)
        store(room, into + 5 * n, u1 * t2)
        store(room, into + 6 * n, u2 * t0)
        store(room, into + 7 * n, u2 * t1)
        store(room, into + 8 * n, u2 * t2)


@inline_jit
def is_ragged(home, flat, about, sums):
    """Return whether any of the nodes about the node `home` has no gas."""
    for k in range(9):
        n = about[home, k]
        if (n < 0 or sums[n, 0, ONE] <= 0.0) and not (flat and k % 3 != 1):
            return True
    return False


@inline_jit
def renormalise_weights(home, n, about, sums, begin, column, room):
    """Set the weights on nodes without gas to 0, and normalise the others.

    The norm of a particle's weights is one over their sum on nodes with gas. It is 0 for padding, and where no node
    has gas.
    """
    for at in range(n):
        whole = 0.0
        for k in range(9):
            node = about[home, k]
            if node < 0 or sums[node, 0, ONE] <= 0.0:
                room[k * n + at] = 0.0
            whole += room[k * n + at]
        norm = column[begin + MASS * n + at] / whole if whole > 0.0 else 0.0
        room[NORMS * n + at] = norm
        for k in range(9):
            room[k * n + at] *= norm
