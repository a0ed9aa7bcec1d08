"""Lists of candidates: of each cell the particles that its own may meet, by their places in the order of the cells.

Sums of a particle look at those of them alone that may be within its reach along x, its `window`: lists come in slabs
across x. The longer cells are along x, and so the narrower along y, the fewer that leaves of a cell's candidates.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from discsim.jit.decorators import inner, making
from discsim.kernels.neighbours import ALL_X, ALL_Y, FIRST, FROM_X, FROM_Y, NX, NY, REACH, SIDE_X, SIDE_Y, whole

BLOCK = 256  # particles of a run that are looked at together
USUAL = 128  # candidates of a cell
SLABS = 32  # of a cell and what is within its reach
ALIGNED = 4  # a window begins with a whole vector of so many
ONE, TWO, THREE, ONE_MORE = np.uint64(1), np.uint64(2), np.uint64(3), np.int32(1)


class Candidates(NamedTuple):
    """Candidates of some cells, by their places in the order of the cells: those of the n-th from begin[n] on.

    Where it is `crossing` an edge of a periodic box, they are `turned` (2, candidates) times the box away.
    Those for windows come slab by slab along x (`slab_of`): those of the k-th slab of the n-th cell from begin[n] +
    slabs[n, k] on. No support of them is longer than widest[n].
    """

    begin: np.ndarray
    slots: np.ndarray
    crossing: np.ndarray
    turned: np.ndarray
    slabs: np.ndarray
    widest: np.ndarray


class Block(NamedTuple):
    """Of particles that are looked at together: the square of what is missing to keep them, and their slabs."""

    keep: np.ndarray
    slab: np.ndarray


class Some(NamedTuple):
    """Candidates of a cell as they are found, the slab of each, and its run."""

    slots: np.ndarray
    slabs: np.ndarray
    runs: np.ndarray


@inner
def find_runs(box, reach, mutual, cells, runs, turns):
    """Runs of particles in the order of the cells that may be within `reach` of a box (centre, half widths).

    With `mutual` also those whose own support may meet it. On periodic axes the images meant are `turns` (runs, 2)
    times the box away. Returns how many there are, and how many particles they hold; of more than `runs` has room for,
    what was written is of no use.
    """
    grids, start, low, width = cells.grids, cells.start, cells.low, cells.width
    count, held = 0, 0
    for level in range(len(grids)):
        first, nx, ny = int(grids[level, FIRST]), int(grids[level, NX]), int(grids[level, NY])
        from_x, from_y = int(grids[level, FROM_X]), int(grids[level, FROM_Y])
        all_x, all_y = int(grids[level, ALL_X]), int(grids[level, ALL_Y])
        per_x, per_y = 1.0 / grids[level, SIDE_X], 1.0 / grids[level, SIDE_Y]
        r = max(reach, grids[level, REACH]) if mutual else reach
        fx, fy = (box[0] - low[0]) * per_x, (box[1] - low[1]) * per_y
        rx, ry = (box[2] + r) * per_x, (box[3] + r) * per_y
        ix0, ix1 = math.floor(fx - rx), math.floor(fx + rx)
        iy0, iy1, tx0, tx1, ty0, ty1 = 0, 0, 0, 0, 0, 0
        if width[1] > 0.0:
            iy0, iy1 = math.floor(fy - ry), math.floor(fy + ry)
        if cells.periodic:
            tx0, tx1, ty0, ty1 = ix0 // all_x, ix1 // all_x, iy0 // all_y, iy1 // all_y
        for tx in range(tx0, tx1 + 1):
            for ty in range(ty0, ty1 + 1):
                sx, sy = tx * all_x + from_x, ty * all_y + from_y
                y0, y1 = max(iy0 - sy, 0), min(iy1 - sy, ny - 1)
                if y0 > y1:
                    continue
                for ix in range(max(ix0 - sx, 0), min(ix1 - sx, nx - 1) + 1):
                    column = first + ix * ny
                    to = min(count, len(runs) - 1)
                    runs[to, 0], runs[to, 1] = start[column + y0], start[column + y1 + 1]
                    turns[to, 0], turns[to, 1] = tx, ty
                    held += runs[to, 1] - runs[to, 0]
                    count += runs[to, 1] > runs[to, 0]
    return count, held


@inner
def per_slab(half_x, reach):
    """Slabs in a length, of a cell of half width `half_x`: they span what is within `reach` of it."""
    width = half_x + reach
    return 0.5 * SLABS / width if width > 0.0 else 0.0


@inner
def slab_of(dx, per_length):
    """The slab at a distance dx from the middle of a cell along x; the first and the last have all beyond."""
    at = dx * per_length + 0.5 * SLABS
    at = at if at > 0.0 else 0.0  # also what is no number
    return np.int32(at if at < SLABS - 1.0 else SLABS - 1.0)


@inner
def scan(runs, turns, count, crossing, box, reach, mutual, cells, block, slots, some):
    """Particles of `count` runs that are within `reach` of the box or, with `mutual`, meet it; how many.

    Writes them to `slots`, the slab of each and, where they are `crossing`, its run. `block` is overwritten.
    """
    x, y, radius = cells.x, cells.y, cells.radius
    ox, oy, half_x, half_y = box[0], box[1], box[2], box[3]
    per_length, found = per_slab(half_x, reach), np.int64(0)
    for run in range(count):
        sx, sy = turns[run, 0] * cells.width[0] - ox, turns[run, 1] * cells.width[1] - oy
        before = found
        # Two loops over blocks: the first is vectorised, and in the second a branch would be guessed wrong half of the
        # time. Signed numbers may be indices from the end, and would keep loops from being vectorised.
        for first in range(runs[run, 0], runs[run, 1], BLOCK):
            begin, many = np.uint64(first), np.uint64(min(runs[run, 1] - first, BLOCK))
            for k in range(np.uint64(whole(many))):  # beyond the end is whatever comes next
                i = begin + k
                from_x = x[i] + sx
                dx, dy = max(abs(from_x) - half_x, 0.0), max(abs(y[i] + sy) - half_y, 0.0)
                far = max(reach, radius[i]) if mutual else reach
                block.keep[k] = dx * dx + dy * dy - far * far
                block.slab[k] = slab_of(from_x, per_length)
            at = np.uint64(found)
            for k in range(many):
                slots[at], some.slabs[at] = begin + k, block.slab[k]
                at += np.uint64(block.keep[k] <= 0.0)
            found = np.int64(at)
        if crossing:
            for k in range(before, found):
                some.runs[k] = run
    return found


@inner
def crosses(turns, count):
    """Whether any of `count` runs is of an image."""
    found = False
    for run in range(count):
        found |= turns[run, 0] != 0 or turns[run, 1] != 0
    return found


@inner
def longest(found, slots, radius):
    """The longest support of the first `found` of `slots`, four at a time: one after another they would wait."""
    for beyond in range(found, found + 3):
        slots[beyond] = slots[0]
    a = b = c = d = 0.0
    for quarter in range(np.uint64((found + 3) >> 2)):
        k = quarter << TWO
        a, b = max(a, radius[slots[k]]), max(b, radius[slots[k + ONE]])
        c, d = max(c, radius[slots[k + TWO]]), max(d, radius[slots[k + THREE]])
    return max(max(a, b), max(c, d))


@inner
def count_slabs(found, slab, begin):
    """Where each slab of `found` candidates begins, one place late: begin (SLABS + 2,). Who puts each where that of
    its slab says, and moves it on, leaves there where the next one begins.
    """
    for k in range(SLABS + 2):
        begin[k] = 0
    for k in range(np.uint64(found)):
        begin[np.uint64(slab[k]) + TWO] += ONE_MORE
    total = np.int32(0)
    for k in range(2, SLABS + 2):
        total += begin[k]
        begin[k] = total


@inner
def turn(turns, run, turned, to):
    """Write by how much the box is turned for a candidate of a run."""
    turned[0, to], turned[1, to] = turns[run, 0], turns[run, 1]


@inner
def list_some(at, first, last, filled, bounds, extent, mutual, in_slabs, cells, listed, work):
    """List candidates of the cells from `at` on, as far as there is room for them.

    Returns the cell that there is no room for, or `last`, and how much it needs: runs and candidates.
    """
    runs, turns, block, some = work
    for c in range(at, last):
        cell, begin = filled[c], listed.begin[c - first]
        box = bounds[cell, 0], bounds[cell, 1], bounds[cell, 2], bounds[cell, 3]
        reach = extent * bounds[cell, 4]
        # Runs first, their particles after: what decides how long a loop is then never has to be waited for.
        count, held = find_runs(box, reach, mutual, cells, runs, turns)
        if count > len(runs) or held + 3 > len(some.slots) or begin + held > len(listed.slots):
            return c, count, held, begin + held
        crossing = crosses(turns, count)
        listed.crossing[c - first] = crossing
        slots = some.slots if in_slabs else listed.slots[begin:]
        found = scan(runs, turns, count, crossing, box, reach, mutual, cells, block, slots, some)
        listed.begin[c - first + 1] = begin + found
        if in_slabs:
            listed.widest[c - first] = longest(found, slots, cells.radius)
            slabs = listed.slabs[c - first]
            count_slabs(found, some.slabs, slabs)
            for k in range(np.uint64(found)):
                slab, to = np.uint64(some.slabs[k]) + ONE, np.uint64(begin)
                to += np.uint64(slabs[slab])
                slabs[slab] += ONE_MORE
                listed.slots[to] = slots[k]
                if crossing:
                    turn(turns, some.runs[k], listed.turned, to)
        elif crossing:
            for k in range(found):
                turn(turns, some.runs[k], listed.turned, np.uint64(begin + k))
    return last, 0, 0, 0


@making
def list_candidates(first, last, filled, bounds, extent, mutual, in_slabs, cells):
    """Candidates of the cells `filled` of some particles with `bounds` among those of `cells`.

    They reach as far as `extent` times their supports; with `mutual` there are also those whose own support meets a
    cell. `in_slabs`: for sums that look at windows of them.
    """
    begin, crossing = np.zeros(last - first + 1, np.int64), np.zeros(last - first, np.bool_)
    windowed = last - first if in_slabs else 0
    slabs, widest = np.empty((windowed, SLABS + 2), np.int32), np.empty(windowed)
    room, images = 1024 + USUAL * (last - first), 1 if cells.periodic else 0
    listed = Candidates(
        begin, np.empty(room, np.uint32), crossing, np.empty((2, images * room), np.int32), slabs, widest
    )
    runs, turns = np.empty((64, 2), np.int64), np.empty((64, 2), np.int64)
    block = Block(np.empty(BLOCK), np.empty(BLOCK, np.int32))
    some = Some(np.empty(1024, np.uint32), np.empty(1024, np.int32), np.empty(1024, np.int32))
    at = first
    while at < last:
        at, count, held, room = list_some(
            at, first, last, filled, bounds, extent, mutual, in_slabs, cells, listed, (runs, turns, block, some)
        )
        if count > len(runs):
            runs, turns = np.empty((2 * count, 2), np.int64), np.empty((2 * count, 2), np.int64)
        if held + 3 > len(some.slots):
            some = Some(
                np.empty(2 * held + 3, np.uint32), np.empty(2 * held + 3, np.int32), np.empty(2 * held + 3, np.int32)
            )
        if room > len(listed.slots):
            slots, turned = np.empty(2 * room, np.uint32), np.empty((2, 2 * images * room), np.int32)
            # Element by element: slices bring numba's formatted errors with them, seconds of compilation.
            for k in range(len(listed.slots)):
                slots[k] = listed.slots[k]
            for k in range(listed.turned.shape[1]):
                turned[0, k], turned[1, k] = listed.turned[0, k], listed.turned[1, k]
            listed = Candidates(begin, slots, crossing, turned, slabs, widest)
    return listed


@njit(nogil=True, inline="always")
def most_of(begin):
    """The largest number of candidates of a cell, in whole vectors."""
    most = 0
    for c in range(len(begin) - 1):
        most = max(most, begin[c + 1] - begin[c])
    return whole(most)


@njit(nogil=True, inline="always")
def window(n, dx, reach, per_length, begin, end, listed):
    """Candidates from `begin` to `end` of the n-th cell that may be within `reach` of dx from its middle along x: from
    which on, counted from `begin`, and how many when filled up to whole vectors.
    """
    slabs, start = listed.slabs, listed.begin[n]
    first = start + slabs[n, slab_of(dx - reach, per_length)] - begin
    last = start + slabs[n, slab_of(dx + reach, per_length) + 1] - begin
    first, last = min(max(first, 0), end - begin), min(max(last, 0), end - begin)
    first &= -ALIGNED
    return first, whole(last - first)


@njit(nogil=True, inline="always")
def place(c, begin, end, listed, ox, oy, per_length, cells, cx, cy):
    """Write where the candidates from `begin` to `end` of the c-th cell are, from (ox, oy) and times `per_length`."""
    x, y, slots, turned = cells.x, cells.y, listed.slots, listed.turned
    first, count = np.uint64(begin), np.uint64(end - begin)
    if listed.crossing[c]:
        for k in range(count):
            slot = slots[first + k]
            sx, sy = turned[0, first + k] * cells.width[0] - ox, turned[1, first + k] * cells.width[1] - oy
            cx[k], cy[k] = (x[slot] + sx) * per_length, (y[slot] + sy) * per_length
    else:
        for k in range(count):
            slot = slots[first + k]
            cx[k], cy[k] = (x[slot] - ox) * per_length, (y[slot] - oy) * per_length
