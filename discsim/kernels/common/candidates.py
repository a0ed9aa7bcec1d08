"""Neighbour lists by cell: the candidates that the particles of a cell may interact with, as indices in cell order.

A sum for one particle takes only the candidates that may be within its reach along x, its `window`; for this, lists are
sorted into slabs across x. The longer cells are along x, the smaller is the fraction of candidates in a window.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from discsim.jit.decorators import inline_jit, inline_sums, jit_alloc
from discsim.jit.index import index
from discsim.kernels.common.neighbours import ALL_X, ALL_Y, FIRST, FROM_X, FROM_Y, NX, NY, REACH, SIDE_X, SIDE_Y, whole

BLOCK = 256  # particles of a run that are tested together
USUAL = 128  # candidates of a cell in the first allocation
SLABS = 32  # slabs across a cell and its reach on both sides
ALIGNED = 4  # a window begins at a multiple of this
ONE, TWO, THREE, ONE_MORE = index(1), index(2), index(3), np.int32(1)


class Candidates(NamedTuple):
    """Candidates of some cells, as indices in cell order: those of the n-th cell from begin[n] to begin[n + 1].

    crossing (cells,): whether a list has periodic images, which are `turned` (2, candidates) box lengths away.
    slabs, widest: only of lists for windows, which are sorted by slab (`slab_of`). Slab k of the n-th cell starts at
    begin[n] + slabs[n, k]; widest[n] is the largest support radius of the candidates.
    """

    begin: np.ndarray
    slots: np.ndarray
    crossing: np.ndarray
    turned: np.ndarray
    slabs: np.ndarray
    widest: np.ndarray


class Block(NamedTuple):
    """Scratch for particles tested together: squared distance from the cell less the squared reach, and slab."""

    keep: np.ndarray
    slab: np.ndarray


class CellCandidates(NamedTuple):
    """Candidates of one cell in the order in which they are found, with the slab and the run of each."""

    slots: np.ndarray
    slabs: np.ndarray
    runs: np.ndarray


@inline_jit
def find_runs(box, reach, mutual, cells, runs, turns):
    """Find runs of consecutive particles in cell order that may be within `reach` of a box (centre, half widths).

    With `mutual` also those whose own support may overlap the box. On periodic axes the images are `turns` (runs, 2)
    box lengths away. Returns the number of runs, and of particles in them. If there are more runs than `runs` has room
    for, the written ones are invalid.
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


@inline_jit
def per_slab(half_x, reach):
    """Return the slabs per unit length of a cell of half width `half_x`; all SLABS span the cell and its `reach`."""
    width = half_x + reach
    return 0.5 * SLABS / width if width > 0.0 else 0.0


@inline_jit
def slab_of(dx, per_length):
    """Return the slab at dx from the middle of a cell along x; the first and the last slab hold all that is beyond."""
    at = dx * per_length + 0.5 * SLABS
    at = at if at > 0.0 else 0.0  # also for NaN
    return np.int32(at if at < SLABS - 1.0 else SLABS - 1.0)


@inline_jit
def scan(runs, turns, count, crossing, box, reach, mutual, cells, block, slots, some):
    """Find the particles of `count` runs within `reach` of the box, with `mutual` also those whose support overlaps it.

    Writes these to `slots`, and to `some` the slab of each and, if `crossing`, its run; returns their number. `block`
    is overwritten.
    """
    x, y, radius = cells.x, cells.y, cells.radius
    ox, oy, half_x, half_y = box[0], box[1], box[2], box[3]
    per_length, found = per_slab(half_x, reach), np.int64(0)
    for run in range(count):
        sx, sy = turns[run, 0] * cells.width[0] - ox, turns[run, 1] * cells.width[1] - oy
        before = found
        # Two loops over a block: the first is vectorised, and the second has no branch, which would be mispredicted
        # half of the time. Indices are unsigned: numba wraps negative ones, which prevents vectorisation.
        for first in range(runs[run, 0], runs[run, 1], BLOCK):
            begin, many = index(first), index(min(runs[run, 1] - first, BLOCK))
            for k in range(index(whole(many))):  # beyond the end: ignored below
                i = begin + k
                from_x = x[i] + sx
                dx, dy = max(abs(from_x) - half_x, 0.0), max(abs(y[i] + sy) - half_y, 0.0)
                far = max(reach, radius[i]) if mutual else reach
                block.keep[k] = dx * dx + dy * dy - far * far
                block.slab[k] = slab_of(from_x, per_length)
            at = index(found)
            for k in range(many):
                slots[at], some.slabs[at] = begin + k, block.slab[k]
                at += index(block.keep[k] <= 0.0)
            found = np.int64(at)
        if crossing:
            for k in range(before, found):
                some.runs[k] = run
    return found


@inline_jit
def crosses(turns, count):
    """Return whether any of `count` runs is a periodic image."""
    found = False
    for run in range(count):
        found |= turns[run, 0] != 0 or turns[run, 1] != 0
    return found


@inline_jit
def longest(found, slots, radius):
    """Return the largest support radius of the first `found` of `slots`, as four independent maxima: a single one
    would wait for each comparison.
    """
    for beyond in range(found, found + 3):
        slots[beyond] = slots[0]
    a = b = c = d = 0.0
    for quarter in range(index((found + 3) >> 2)):
        k = quarter << TWO
        a, b = max(a, radius[slots[k]]), max(b, radius[slots[k + ONE]])
        c, d = max(c, radius[slots[k + TWO]]), max(d, radius[slots[k + THREE]])
    return max(max(a, b), max(c, d))


@inline_jit
def count_slabs(found, slab, begin):
    """Write the start of slab k of `found` candidates to begin[k + 1], of begin (SLABS + 2,).

    `list_some` advances begin[k + 1] with each candidate that it places in slab k, so that in the end begin[k] is the
    start of slab k.
    """
    for k in range(SLABS + 2):
        begin[k] = 0
    for k in range(index(found)):
        begin[index(slab[k]) + TWO] += ONE_MORE
    total = np.int32(0)
    for k in range(2, SLABS + 2):
        total += begin[k]
        begin[k] = total


@inline_jit
def write_image_shift(turns, run, turned, to):
    """Write the periodic shift of a candidate of a run, in box lengths."""
    turned[0, to], turned[1, to] = turns[run, 0], turns[run, 1]


@inline_jit
def list_some(at, first, last, filled, bounds, extent, mutual, in_slabs, cells, listed, work):
    """List candidates of the cells from `at` on, as far as the arrays have room.

    Returns the first cell without room, or `last`, and the room that it needs: runs, particles in runs, candidates.
    """
    runs, turns, block, some = work
    for c in range(at, last):
        cell, begin = filled[c], listed.begin[c - first]
        box = bounds[cell, 0], bounds[cell, 1], bounds[cell, 2], bounds[cell, 3]
        reach = extent * bounds[cell, 4]
        # All runs are found before their particles are read, so that no loop waits for its length.
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
            for k in range(index(found)):
                slab, to = index(some.slabs[k]) + ONE, index(begin)
                to += index(slabs[slab])
                slabs[slab] += ONE_MORE
                listed.slots[to] = slots[k]
                if crossing:
                    write_image_shift(turns, some.runs[k], listed.turned, to)
        elif crossing:
            for k in range(found):
                write_image_shift(turns, some.runs[k], listed.turned, index(begin + k))
    return last, 0, 0, 0


@jit_alloc
def list_candidates(first, last, filled, bounds, extent, mutual, in_slabs, cells):
    """Return the candidates, among the particles of `cells`, of other cells `filled` with `bounds` (cells, 5).

    The reach of a cell is `extent` times its largest support radius; with `mutual`, particles whose own support
    overlaps the cell are candidates too. `in_slabs` sorts the lists for sums over windows.
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
    some = CellCandidates(np.empty(1024, np.uint32), np.empty(1024, np.int32), np.empty(1024, np.int32))
    at = first
    while at < last:
        at, count, held, room = list_some(
            at, first, last, filled, bounds, extent, mutual, in_slabs, cells, listed, (runs, turns, block, some)
        )
        if count > len(runs):
            runs, turns = np.empty((2 * count, 2), np.int64), np.empty((2 * count, 2), np.int64)
        if held + 3 > len(some.slots):
            some = CellCandidates(
                np.empty(2 * held + 3, np.uint32), np.empty(2 * held + 3, np.int32), np.empty(2 * held + 3, np.int32)
            )
        if room > len(listed.slots):
            slots, turned = np.empty(2 * room, np.uint32), np.empty((2, 2 * images * room), np.int32)
            # Element by element: an assignment of slices compiles numba's formatted errors too, for seconds.
            for k in range(len(listed.slots)):
                slots[k] = listed.slots[k]
            for k in range(listed.turned.shape[1]):
                turned[0, k], turned[1, k] = listed.turned[0, k], listed.turned[1, k]
            listed = Candidates(begin, slots, crossing, turned, slabs, widest)
    return listed


@njit(nogil=True, inline="always")
def most_of(begin):
    """Return the largest number of candidates of a cell, rounded up to whole vectors."""
    most = 0
    for c in range(len(begin) - 1):
        most = max(most, begin[c + 1] - begin[c])
    return whole(most)


@inline_sums
def window(n, dx, reach, per_length, begin, end, listed):
    """Find the candidates of the n-th cell, from `begin` to `end`, that may be within `reach` of dx from its middle
    along x. Returns the first, counted from `begin`, and their number, rounded up to whole vectors.
    """
    slabs, start = listed.slabs, listed.begin[n]
    first = start + slabs[n, slab_of(dx - reach, per_length)] - begin
    last = start + slabs[n, slab_of(dx + reach, per_length) + 1] - begin
    first, last = min(max(first, 0), end - begin), min(max(last, 0), end - begin)
    first &= -ALIGNED
    return first, whole(last - first)


@inline_sums
def pack_positions(c, begin, end, listed, ox, oy, per_length, cells, cx, cy):
    """Write the positions of the candidates `begin` to `end` of the c-th cell, from (ox, oy) and times `per_length`."""
    x, y, slots, turned = cells.x, cells.y, listed.slots, listed.turned
    first, count = index(begin), index(end - begin)
    if listed.crossing[c]:
        for k in range(count):
            slot = slots[first + k]
            sx, sy = turned[0, first + k] * cells.width[0] - ox, turned[1, first + k] * cells.width[1] - oy
            cx[k], cy[k] = (x[slot] + sx) * per_length, (y[slot] + sy) * per_length
    else:
        for k in range(count):
            slot = slots[first + k]
            cx[k], cy[k] = (x[slot] - ox) * per_length, (y[slot] - oy) * per_length
