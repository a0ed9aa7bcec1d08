"""Drag cells as blocks of a lattice: small where there are many particles, merged 2 x 2 where there are too few.

The leaves of a regular lattice are merged upwards as in a quadtree (in pairs in one dimension), up to top-level blocks
of 2^LEVELS by 2^LEVELS leaves. The status of a block says why it should be merged further:

    SMALL    its side is below the wanted side (a number of mean smoothing lengths of its gas, or a length)
    FEW      it holds both species but fewer particles than required; up to `soft` times the wanted side
    LACKING  it has no gas, or no dust although dust is required INSIDE it; up to `hard` times the wanted side
    LONELY   it has no dust, and dust is required NEAR it; up to `hard` times the wanted side, or until its parent
             has dust
    DONE     no reason

If any child is not DONE, all particles of its parent make one block. If the parent would exceed its limit, the children
stay as they are; dust without gas is then uncoupled (and reported).
"""

from typing import Any, NamedTuple

import numpy as np

from discsim.jit.decorators import inline_jit, jit, jit_no_alloc
from discsim.jit.index import index
from discsim.kernels.common.zcurve import at_place

ONE, TWO, FOUR = index(1), index(2), index(4)
NOUGHT: Any = np.int64(0)  # a literal 0 as an argument would compile one more specialisation
LEVELS = 5  # a block is at most 2^LEVELS leaves wide
MOST = 1 << LEVELS
DONE, LONELY, SMALL, FEW, LACKING = range(5)
TIE = 1e-6  # of a side: sums of h are right to some 1e-9 of the largest, and a side often equals the wanted side
IGNORE, NEAR, INSIDE = range(3)  # where dust is required: nowhere, in the parent of a block, or in the block


@jit
def leaf_keys(first, last, pos, origin, shift, low, high, inverse, whole, begin, shape, periodic, out):
    """Write the leaf of each particle (n,): its index in a part of the `whole` lattice, of `shape` leaves from the leaf
    `begin` on. A particle outside [low, high) of an open lattice gets the number of leaves of the part.

    `inverse` is one over the side of a leaf; `low`, `high` and `shift` (2,) are in leaves.
    """
    ox, oy, dx, dy = origin[0], origin[1], shift[0], shift[1]
    low_x, low_y, high_x, high_y = low[0], low[1], high[0], high[1]
    (nx, ny), (begin_x, begin_y) = whole, begin
    outside, rows, from_x, from_y = (
        np.uint32(shape[0] * shape[1]),
        np.int32(shape[1]),
        np.int32(begin_x),
        np.int32(begin_y),
    )
    if pos.shape[1] == 2 and not periodic:
        flat = pos.reshape(-1)  # a flat array and unsigned indices, so that the loop is vectorised
        for i in range(index(first), index(last)):
            sx, sy = (flat[TWO * i] - ox) * inverse + dx, (flat[TWO * i + ONE] - oy) * inverse + dy
            inside = (sx >= low_x) & (sx < high_x) & (sy >= low_y) & (sy < high_y)
            out[i] = np.uint32((np.int32(sx) - from_x) * rows + np.int32(sy) - from_y) if inside else outside
        return
    for i in range(first, last):
        sx = (pos[i, 0] - ox) * inverse + dx
        sy = (pos[i, 1] - oy) * inverse + dy if pos.shape[1] == 2 else 0.0
        if periodic:
            sx -= nx * np.floor(sx / nx)
            sy -= ny * np.floor(sy / ny)
            sx, sy = (sx if sx < nx else 0.0), (sy if sy < ny else 0.0)
            inside = 0.0 <= sx < nx and 0.0 <= sy < ny
        else:
            inside = low_x <= sx < high_x and low_y <= sy < high_y
        out[i] = np.uint32((int(sx) - begin_x) * shape[1] + int(sy) - begin_y) if inside else outside


@jit
def add_in_units(key, values, per_unit, out):
    """Add to `out` (keys,) the values (n,) of each key (n,), times `per_unit` and rounded to whole numbers."""
    quarter = index(len(key)) // FOUR  # as in `count_keys`: successive additions to one element are slow
    for i in range(quarter):
        for k in range(FOUR):
            at = i + k * quarter
            out[index(key[at])] += np.rint(values[at] * per_unit)
    for i in range(FOUR * quarter, index(len(key))):
        out[index(key[i])] += np.rint(values[i] * per_unit)


@jit
def block_keys(first, last, key, number, species, populations):
    """Replace the leaf of each particle in `key` (n,) by block * populations + population.

    `number` is the block of each leaf; `species` (n,) is read only if there are several populations.
    """
    for i in range(index(first), index(last)):
        block = number[key[i]]
        key[i] = block * populations + species[i] if populations > 1 else block


@jit_no_alloc
def squares_of(first, last, leaf, level, origin, begin, leaf_side, corner, side):
    """Write the lower corner (blocks, 2) and the side (blocks,) of each block.

    `leaf` (blocks, 2): first leaf of each block, in the part of the lattice that begins at the leaf `begin`.
    """
    for block in range(first, last):
        for axis in range(2):
            corner[block, axis] = origin[axis] + (leaf[block, axis] + begin[axis]) * leaf_side
        side[block] = leaf_side * 2.0 ** level[block]


@jit
def members_of(order, start, chosen):
    """Return the indices of the particles in the blocks `chosen` (blocks,)."""
    count = 0
    for block in range(len(chosen)):
        if chosen[block]:
            count += start[block + 1] - start[block]
    out = np.empty(count, order.dtype)
    count = 0
    for block in range(len(chosen)):
        if chosen[block]:
            for k in range(start[block], start[block + 1]):
                out[count] = order[k]
                count += 1
    return out


@jit
def members_alone(order, start, rates, enlarged, count):
    """Return the indices of uncoupled particles: those outside all blocks, and those in blocks that are `enlarged`
    (blocks,) or whose mean rate in `rates` (blocks, populations) is 0.

    Only the first `count` blocks, the local ones of this process, are searched.
    """
    blocks, populations = rates.shape
    chosen = np.ones((blocks + 2) * populations, np.bool_)
    for block in range(blocks):
        for part in range(populations):
            alone = enlarged[block] or rates[block, part] == 0.0
            chosen[block * populations + part] = alone and block < count
    return members_of(order, start, chosen)


@jit
def times_of_members(times, order, start):
    """Return the stopping time of each particle (n,) from `times` (blocks, populations)."""
    out = np.empty(len(order))
    for block in range(times.shape[0]):
        for s in range(times.shape[1]):
            for k in range(start[block * times.shape[1] + s], start[block * times.shape[1] + s + 1]):
                out[order[k]] = times[block, s]
    return out


class Wanted(NamedTuple):
    """Requirements for blocks.

    leaf: side of a leaf. size: wanted side in mean h of the gas of a block. length: wanted side, in place of `size`
    unless 0. gas, dust: least number of particles. soft, hard: limits in wanted sides. dust_in: IGNORE, NEAR or INSIDE.
    """

    leaf: float
    size: float
    length: float
    gas: int
    dust: int
    soft: float
    hard: float
    dust_in: int


class Tree(NamedTuple):
    """Blocks of all levels; a level has `width` by `height` blocks, from index `begin` on.

    final: whether a block is used, unless it lies in a larger final one. enlarged: whether lack of particles enlarged
    it. Both are False on input.
    """

    begin: np.ndarray
    width: np.ndarray
    height: np.ndarray
    final: np.ndarray
    enlarged: np.ndarray


class Held(NamedTuple):
    """Blocks of one level within a top-level block, overwritten by the next level.

    gas, dust: number of particles. h_sum: sum of the gas's h. status: as in the module docstring. blocks: number of
    final blocks inside.
    """

    gas: np.ndarray
    dust: np.ndarray
    h_sum: np.ndarray
    status: np.ndarray
    blocks: np.ndarray


@inline_jit
def _wanted_side(gas, h_sum, wanted):
    return wanted.size * h_sum / gas if wanted.length == 0.0 else wanted.length


@inline_jit
def _status(gas, dust, h_sum, side, wanted):
    """Return the status of a block: why it should be merged further, or DONE."""
    if gas + dust == 0:
        return DONE
    if gas == 0:
        return LACKING
    if side < _wanted_side(gas, h_sum, wanted) * (1.0 - TIE):
        return SMALL
    if dust == 0:
        return LACKING if wanted.dust_in == INSIDE else LONELY if wanted.dust_in == NEAR else DONE
    return FEW if gas < wanted.gas or dust < wanted.dust else DONE


@inline_jit
def _take_leaves(tx, ty, gas, dust, h_sum, wanted, tree, held):
    """Fill `held` with the leaves of the top-level block at leaf (tx, ty); return whether any holds a particle."""
    anybody = False
    for ix in range(tx, min(tx + MOST, tree.width[0])):
        for iy in range(ty, min(ty + MOST, tree.height[0])):
            b, x, y = ix * tree.height[0] + iy, ix - tx, iy - ty
            held.gas[x, y], held.dust[x, y], held.h_sum[x, y] = gas[b], dust[b], 0.0
            held.status[x, y], held.blocks[x, y] = DONE, 0
            if gas[b] + dust[b] > 0:
                anybody = True
                held.h_sum[x, y], held.blocks[x, y] = h_sum[b], 1
                held.status[x, y] = _status(held.gas[x, y], held.dust[x, y], h_sum[b], wanted.leaf, wanted)
                tree.final[b] = held.status[x, y] == DONE
    return anybody


@inline_jit
def _take_children(level, bx, by, tx, ty, wanted, tree, held):
    """Merge four, two or one children into one block if any is not DONE and the block would not be too large."""
    height = tree.height[level - 1]
    along_x = 2 if 2 * bx + 1 < tree.width[level - 1] else 1
    along_y = 2 if 2 * by + 1 < height else 1
    x, y = bx - (tx >> level), by - (ty >> level)
    gas, dust, h_sum, worst, blocks = NOUGHT, NOUGHT, 0.0, DONE, NOUGHT
    for cx in range(2 * x, 2 * x + along_x):
        for cy in range(2 * y, 2 * y + along_y):
            gas += held.gas[cx, cy]
            dust += held.dust[cx, cy]
            h_sum += held.h_sum[cx, cy]
            worst = max(worst, held.status[cx, cy])
            blocks += held.blocks[cx, cy]
    if gas + dust > 0:
        b, below = tree.begin[level] + bx * tree.height[level] + by, tree.begin[level - 1] + 2 * (bx * height + by)
        side, waits, too_large = wanted.leaf * 2.0**level, worst != DONE, False
        if waits and gas > 0 and worst != SMALL:
            limit = (wanted.soft if worst == FEW else wanted.hard) * _wanted_side(gas, h_sum, wanted)
            too_large = side > limit * (1.0 + TIE) or (worst == LONELY and dust > 0)
        for cx in range(along_x):
            for cy in range(along_y):
                tree.enlarged[b] |= tree.enlarged[below + cx * height + cy]
                if too_large:
                    tree.final[below + cx * height + cy] |= held.status[2 * x + cx, 2 * y + cy] != DONE
        worst_now = DONE
        if waits and not too_large:
            # Leaves without one species may be finer than the wanted side; merging these is no enlargement.
            wide = gas > 0 and 0.5 * side > _wanted_side(gas, h_sum, wanted) * (1.0 - TIE)
            tree.enlarged[b] |= wide and worst != SMALL
            worst_now, blocks = _status(gas, dust, h_sum, side, wanted), 1
            tree.final[b] = worst_now == DONE or level == LEVELS
        worst = worst_now
    held.gas[x, y], held.dust[x, y], held.h_sum[x, y] = gas, dust, h_sum
    held.status[x, y], held.blocks[x, y] = worst, blocks


@inline_jit
def _merge_one(top, gas, dust, h_sum, wanted, tree, held):
    """Make the blocks within the top-level block of index `top`; return their number."""
    tx, ty = top // tree.height[LEVELS] << LEVELS, top % tree.height[LEVELS] << LEVELS
    if not _take_leaves(tx, ty, gas, dust, h_sum, wanted, tree, held):
        return 0
    for level in range(1, LEVELS + 1):
        for bx in range(tx >> level, min(tx + MOST >> level, tree.width[level])):
            for by in range(ty >> level, min(ty + MOST >> level, tree.height[level])):
                _take_children(level, bx, by, tx, ty, wanted, tree, held)
    return held.blocks[0, 0]


@jit
def merge(first, last, gas, dust, h_sum, wanted, tree, count):
    """Make the blocks within each top-level block, and write their number to `count` (top-level blocks,).

    `gas`, `dust`, `h_sum` (leaves,): number of particles in each leaf, and the sum of the gas's h.
    """
    numbers = np.empty((3, MOST, MOST), np.int64)
    held = Held(numbers[0], numbers[1], np.empty((MOST, MOST)), np.empty((MOST, MOST), np.int8), numbers[2])
    for top in range(first, last):
        count[top] = _merge_one(top, gas, dust, h_sum, wanted, tree, held)


@inline_jit
def _block_at(z, tx, ty, tree):
    """Find the largest final block that starts at position z of the Z-curve, in the top-level block at leaf (tx, ty).

    Returns (ix, iy, level, found): its first leaf, its level and whether there is one. If not, no final block starts
    within the square of that level.
    """
    x, y = at_place(z)
    ix, iy, level = tx + x, ty + y, LEVELS
    while z & (1 << 2 * level) - 1 != 0:
        level -= 1
    if ix >= tree.width[0] or iy >= tree.height[0]:
        return ix, iy, level, False
    while level > 0 and not tree.final[tree.begin[level] + (ix >> level) * tree.height[level] + (iy >> level)]:
        level -= 1
    found = tree.final[tree.begin[level] + (ix >> level) * tree.height[level] + (iy >> level)]
    return ix, iy, level, found


@jit_no_alloc
def number_blocks(first, last, start, tree, number, corner, level_of, flag):
    """Number the blocks of each top-level block, from `start` on, along a Z-curve: nearby blocks of any level have
    nearby numbers. Writes the number of each leaf, and first leaf, level and `enlarged` of each block.
    """
    for top in range(first, last):
        tx, ty = top // tree.height[LEVELS] << LEVELS, top % tree.height[LEVELS] << LEVELS
        z, n = NOUGHT, start[top]
        while n < start[top + 1]:
            ix, iy, level, found = _block_at(z, tx, ty, tree)
            if found:
                for jx in range(ix, min(ix + (1 << level), tree.width[0])):
                    for jy in range(iy, min(iy + (1 << level), tree.height[0])):
                        number[jx * tree.height[0] + jy] = n
                corner[n, 0], corner[n, 1], level_of[n] = ix, iy, level
                flag[n] = tree.enlarged[tree.begin[level] + (ix >> level) * tree.height[level] + (iy >> level)]
                n += 1
            z += 1 << 2 * level
