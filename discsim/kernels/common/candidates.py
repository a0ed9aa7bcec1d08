"""Neighbour lists by cell. The candidates of a cell are all particles that may interact with a particle of the cell.

The list of a cell may be sorted into slabs across x. The sum for one particle then takes only the candidates in the
slabs that may be within its reach along x, its window. The longer cells are along x, the smaller is the fraction of
candidates in a window.

Particles are given by their indices in cell order (`Cells` of `neighbours.py`). The reach of a cell is the largest
support radius of its particles. A run is a sequence of particles that are consecutive in cell order. In periodic space
an image of a run is `turns` (runs, 2) box lengths away.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from discsim.jit.decorators import inline_jit, inline_sums, jit_alloc
from discsim.jit.index import index
from discsim.kernels.common.neighbours import ALL_X, ALL_Y, FIRST, FROM_X, FROM_Y, NX, NY, REACH, SIDE_X, SIDE_Y

BLOCK = 256  # particles of a run that are tested together
INITIAL_PER_CELL = 128  # candidates per cell for which the first arrays have room
SLABS = 32  # slabs across a cell and its reach on both sides
ALIGNED = 4  # a window begins at a multiple of this
LANES = 8  # lists of candidates are padded to multiples of this with massless ones, as loop remainders are slow
ONE, TWO, THREE, ONE_MORE = index(1), index(2), index(3), np.int32(1)


class Candidates(NamedTuple):
    """Lists of the candidates of several cells. The list of the n-th cell is indices[begin[n]:begin[n + 1]].

    `slab_starts` and `largest_radius` are filled only for lists sorted into slabs, and are empty otherwise.
    """

    begin: np.ndarray  # (cells + 1,)
    indices: np.ndarray  # index of each candidate in cell order
    has_images: np.ndarray  # (cells,): whether the list of a cell has periodic images
    image_shift: np.ndarray  # (2, candidates): how many box lengths away the image is along x and y
    slab_starts: np.ndarray  # (cells, SLABS + 2): slab k of the n-th cell starts at begin[n] + slab_starts[n, k]
    largest_radius: np.ndarray  # (cells,): largest support radius of the candidates


class BlockScratch(NamedTuple):
    """Scratch arrays (BLOCK,) for the particles of a run that are tested together."""

    excess: np.ndarray  # squared distance from the box of the cell, less the squared reach
    slab: np.ndarray


class CellScratch(NamedTuple):
    """Scratch arrays for the candidates of one cell, in the order in which they are found."""

    indices: np.ndarray  # in cell order
    slabs: np.ndarray
    runs: np.ndarray  # number of the run that has the candidate


@inline_jit
def padded_count(n):
    """Return n, rounded up to a multiple of LANES."""
    return (n + LANES - 1) & -LANES


@inline_jit
def find_runs(box, reach, mutual, cells, runs, turns):
    """Write the runs of particles that may be within `reach` of a box to `runs` (n, 2), as first index and last + 1.

    box: x and y of its centre, and its half widths. With `mutual`, runs of particles whose own support may overlap the
    box are included. turns (n, 2) is written, too: how many box lengths each run is away, if it is a periodic image.

    Returns the number of runs, and the number of particles in them. If there are more than n runs, the contents of
    `runs` and `turns` are invalid.
    """
    grids, start, low, width = cells.grids, cells.start, cells.low, cells.width
    count, particles = 0, 0
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
                    particles += runs[to, 1] - runs[to, 0]
                    count += runs[to, 1] > runs[to, 0]
    return count, particles


@inline_jit
def slabs_per_length(half_x, reach):
    """Return the number of slabs per unit length of x, for a cell of half width `half_x`.

    SLABS slabs span the cell and its `reach` on both sides. Returns 0 if the cell and its reach have no extent along
    x.
    """
    width = half_x + reach
    return 0.5 * SLABS / width if width > 0.0 else 0.0


@inline_jit
def slab_of(dx, per_length):
    """Return the slab of a particle at a distance dx along x from the middle of a cell.

    per_length: slabs per unit length. Particles beyond the first or the last slab belong to that slab.
    """
    position = dx * per_length + 0.5 * SLABS
    position = position if position > 0.0 else 0.0  # also for NaN
    return np.int32(position if position < SLABS - 1.0 else SLABS - 1.0)


@inline_jit
def find_in_runs(runs, turns, count, crossing, box, reach, mutual, cells, block, indices, scratch):
    """Write the candidates among the particles of the first `count` runs to `indices`, and return their number.

    Candidates are the particles within `reach` of the box and, with `mutual`, particles whose own support overlaps
    the box. runs, turns, box: as in `find_runs`. Also written: the slab of each candidate to `scratch.slabs` and, if
    `crossing` (any run is a periodic image), the run of each candidate to `scratch.runs`. block: overwritten.
    """
    x, y, radius = cells.x, cells.y, cells.radius
    ox, oy, half_x, half_y = box[0], box[1], box[2], box[3]
    per_length, found = slabs_per_length(half_x, reach), np.int64(0)
    for run in range(count):
        sx, sy = turns[run, 0] * cells.width[0] - ox, turns[run, 1] * cells.width[1] - oy
        before = found
        # Two loops over a block: the first is vectorised. The second has no branch, which would be mispredicted half of
        # the time. Indices are unsigned, as tests for negative ones would prevent vectorisation.
        for first in range(runs[run, 0], runs[run, 1], BLOCK):
            begin, many = index(first), index(min(runs[run, 1] - first, BLOCK))
            for k in range(index(padded_count(many))):  # entries beyond `many` are not used
                i = begin + k
                from_x = x[i] + sx
                dx, dy = max(abs(from_x) - half_x, 0.0), max(abs(y[i] + sy) - half_y, 0.0)
                far = max(reach, radius[i]) if mutual else reach
                block.excess[k] = dx * dx + dy * dy - far * far
                block.slab[k] = slab_of(from_x, per_length)
            at = index(found)
            for k in range(many):
                indices[at], scratch.slabs[at] = begin + k, block.slab[k]
                at += index(block.excess[k] <= 0.0)
            found = np.int64(at)
        if crossing:
            for k in range(before, found):
                scratch.runs[k] = run
    return found


@inline_jit
def any_image(turns, count):
    """Return whether any of the first `count` runs is a periodic image, by `turns` (runs, 2)."""
    found = False
    for run in range(count):
        found |= turns[run, 0] != 0 or turns[run, 1] != 0
    return found


@inline_jit
def max_radius(found, indices, radius):
    """Return the largest entry of `radius` for the first `found` entries of `indices`.

    The three entries of `indices` after these are overwritten. Four maxima are computed independently, because each
    comparison for a single maximum would wait for the comparison before.
    """
    for beyond in range(found, found + 3):
        indices[beyond] = indices[0]
    a = b = c = d = 0.0
    for quarter in range(index((found + 3) >> 2)):
        k = quarter << TWO
        a, b = max(a, radius[indices[k]]), max(b, radius[indices[k + ONE]])
        c, d = max(c, radius[indices[k + TWO]]), max(d, radius[indices[k + THREE]])
    return max(max(a, b), max(c, d))


@inline_jit
def count_slabs(found, slab, begin):
    """Write to begin[k + 1], of `begin` (SLABS + 2,), where slab k starts in a list of `found` candidates.

    slab (found,): slab of each candidate. `list_until_full` increases begin[k + 1] by 1 for each candidate that it
    writes into slab k, so that in the end begin[k] is the start of slab k.
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
def list_until_full(resume_at, first, last, filled, bounds, extent, mutual, in_slabs, cells, listed, work):
    """Write the lists of the cells filled[resume_at:last] to `listed`, until an array of `listed` or `work` is full.

    work: the scratch arrays (runs, turns, block, scratch) of `find_runs` and `find_in_runs`. For the other arguments
    see `list_candidates`.

    Returns the index of the first cell that was not listed (`last` if all were listed), and the array lengths that
    this cell needs: of `runs`, of the arrays in `scratch`, and of the arrays in `listed`.
    """
    runs, turns, block, scratch = work
    shift = listed.image_shift
    for c in range(resume_at, last):
        cell, begin = filled[c], listed.begin[c - first]
        box = bounds[cell, 0], bounds[cell, 1], bounds[cell, 2], bounds[cell, 3]
        reach = extent * bounds[cell, 4]
        # All runs are found before their particles are read, so that no loop waits for its length.
        count, particles = find_runs(box, reach, mutual, cells, runs, turns)
        if count > len(runs) or particles + 3 > len(scratch.indices) or begin + particles > len(listed.indices):
            return c, count, particles + 3, begin + particles
        crossing = any_image(turns, count)
        listed.has_images[c - first] = crossing
        indices = scratch.indices if in_slabs else listed.indices[begin:]
        found = find_in_runs(runs, turns, count, crossing, box, reach, mutual, cells, block, indices, scratch)
        listed.begin[c - first + 1] = begin + found
        if in_slabs:
            listed.largest_radius[c - first] = max_radius(found, indices, cells.radius)
            slabs = listed.slab_starts[c - first]
            count_slabs(found, scratch.slabs, slabs)
            for k in range(index(found)):
                slab, to = index(scratch.slabs[k]) + ONE, index(begin)
                to += index(slabs[slab])
                slabs[slab] += ONE_MORE
                listed.indices[to] = indices[k]
                if crossing:
                    shift[0, to], shift[1, to] = turns[scratch.runs[k], 0], turns[scratch.runs[k], 1]
        elif crossing:
            for k in range(found):
                to = index(begin + k)
                shift[0, to], shift[1, to] = turns[scratch.runs[k], 0], turns[scratch.runs[k], 1]
    return last, 0, 0, 0


@jit_alloc
def list_candidates(first, last, filled, bounds, extent, mutual, in_slabs, cells):
    """Return the candidates of the cells filled[first:last] among the particles of `cells`, a `Candidates`.

    filled, bounds (all cells, 5): the listed cells, as in `Cells`, which may be cells of another species. The reach
    of a listed cell is `extent` times its largest support radius. With `mutual`, particles whose own support
    overlaps the cell are candidates too. in_slabs: whether lists are sorted into slabs.
    """
    begin, has_images = np.zeros(last - first + 1, np.int64), np.zeros(last - first, np.bool_)
    sorted_cells = last - first if in_slabs else 0
    slab_starts, largest_radius = np.empty((sorted_cells, SLABS + 2), np.int32), np.empty(sorted_cells)
    length, images = 1024 + INITIAL_PER_CELL * (last - first), 1 if cells.periodic else 0
    indices, shift = np.empty(length, np.uint32), np.empty((2, images * length), np.int32)
    listed = Candidates(begin, indices, has_images, shift, slab_starts, largest_radius)
    runs, turns = np.empty((64, 2), np.int64), np.empty((64, 2), np.int64)
    block = BlockScratch(np.empty(BLOCK), np.empty(BLOCK, np.int32))
    scratch = CellScratch(np.empty(1024, np.uint32), np.empty(1024, np.int32), np.empty(1024, np.int32))
    done = first
    while done < last:
        done, count, held, length = list_until_full(
            done, first, last, filled, bounds, extent, mutual, in_slabs, cells, listed, (runs, turns, block, scratch)
        )
        if count > len(runs):
            runs, turns = np.empty((2 * count, 2), np.int64), np.empty((2 * count, 2), np.int64)
        if held > len(scratch.indices):
            held *= 2
            scratch = CellScratch(np.empty(held, np.uint32), np.empty(held, np.int32), np.empty(held, np.int32))
        if length > len(listed.indices):
            indices, shift = np.empty(2 * length, np.uint32), np.empty((2, 2 * images * length), np.int32)
            # By loops: an assignment to a slice would also compile numba's error messages, for seconds.
            for k in range(len(listed.indices)):
                indices[k] = listed.indices[k]
            for k in range(listed.image_shift.shape[1]):
                shift[0, k], shift[1, k] = listed.image_shift[0, k], listed.image_shift[1, k]
            listed = Candidates(begin, indices, has_images, shift, slab_starts, largest_radius)
    return listed


@njit(nogil=True, inline="always")
def max_candidates(begin):
    """Return the length of the longest of the lists that `begin` (lists + 1,) delimits, rounded up to whole vectors."""
    most = 0
    for c in range(len(begin) - 1):
        most = max(most, begin[c + 1] - begin[c])
    return padded_count(most)


@inline_sums
def find_window(n, dx, reach, per_length, begin, end, listed):
    """Return the window of a particle, at a distance dx along x from the middle of the n-th cell.

    The window contains all candidates from `begin` to `end` in `listed.indices` that may be within `reach` along x.
    Returns the index of the first candidate in the window, counted from `begin`, and the length of the window,
    rounded up to whole vectors.
    """
    slabs, start = listed.slab_starts, listed.begin[n]
    first = start + slabs[n, slab_of(dx - reach, per_length)] - begin
    last = start + slabs[n, slab_of(dx + reach, per_length) + 1] - begin
    first, last = min(max(first, 0), end - begin), min(max(last, 0), end - begin)
    first &= -ALIGNED
    return first, padded_count(last - first)


@inline_sums
def pack_positions(c, begin, end, listed, ox, oy, per_length, cells, cx, cy):
    """Write to `cx` and `cy` the positions of the candidates `begin` to `end` from the list of the c-th cell.

    Positions are relative to (ox, oy), and multiplied by `per_length`.
    """
    x, y, indices, shift = cells.x, cells.y, listed.indices, listed.image_shift
    first, count = index(begin), index(end - begin)
    if listed.has_images[c]:
        for k in range(count):
            i = indices[first + k]
            sx, sy = shift[0, first + k] * cells.width[0] - ox, shift[1, first + k] * cells.width[1] - oy
            cx[k], cy[k] = (x[i] + sx) * per_length, (y[i] + sy) * per_length
    else:
        for k in range(count):
            i = indices[first + k]
            cx[k], cy[k] = (x[i] - ox) * per_length, (y[i] - oy) * per_length
