"""Drag cells as blocks of a lattice: small where there are many particles, merged 2 x 2 where there are too few.

The leaves of a regular lattice are merged upwards as in a quadtree (in one dimension, in pairs), up to top-level blocks
of 2^LEVELS by 2^LEVELS leaves. The smallest side of a block is a multiple of the mean smoothing length of its gas, or a
length. The status of a block is the reason why it should be merged further:

    SMALL    its side is below the smallest side
    FEW      it has gas and dust, but fewer particles than required; merged up to `soft` smallest sides
    LACKING  it has no gas, or no dust although dust is required INSIDE it; merged up to `hard` smallest sides
    LONELY   it has no dust, and dust is required NEAR it; merged up to `hard` smallest sides, or until its parent has
             dust
    DONE     no reason

If any child is not DONE, its parent becomes one block. If the parent would exceed its limit, the children stay as they
are; their dust is then uncoupled if they have no gas.
"""

from typing import Any, NamedTuple

import numpy as np

from discsim.jit.decorators import inline_jit, jit, jit_no_alloc
from discsim.jit.index import index
from discsim.kernels.common.zcurve import z_position

ONE, TWO, FOUR = index(1), index(2), index(4)
NOUGHT: Any = np.int64(0)  # a literal 0 as an argument would compile one more specialisation
LEVELS = 5  # a block is at most 2^LEVELS leaves wide
MOST = 1 << LEVELS
DONE, LONELY, SMALL, FEW, LACKING = range(5)
TIE = 1e-6  # relative tolerance of sides: sums of h have errors of some 1e-9, and a side often equals the smallest side
IGNORE, NEAR, INSIDE = range(3)  # where dust is required: nowhere, in the parent of a block, or in the block


@jit
def leaf_keys(first, last, pos, origin, shift, low, high, inverse, whole, begin, shape, periodic, out):
    """Write to `out` (n,) the index of the leaf in which each position lies, as np.uint32.

    The index is that in a part of the lattice, which has `shape` leaves along x and y and begins at the leaf `begin` of
    the `whole` lattice. In open space, a particle outside [low, high) gets the number of leaves of the part.

    pos (n, d): positions. origin (2,): position of the lattice before its shift. shift, low, high (2,): in leaves.
    inverse: one over the side of a leaf.
    """
    ox, oy, dx, dy = origin[0], origin[1], shift[0], shift[1]
    low_x, low_y, high_x, high_y = low[0], low[1], high[0], high[1]
    (nx, ny), (begin_x, begin_y) = whole, begin
    outside, rows = np.uint32(shape[0] * shape[1]), np.int32(shape[1])
    from_x, from_y = np.int32(begin_x), np.int32(begin_y)
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
    """Add the values (n,) to the sums of their keys in `out` (keys,), each value as a whole number of units.

    key (n,): key of each value. per_unit: factor of the values before they are rounded to whole numbers.
    """
    quarter = index(len(key)) // FOUR  # four interleaved parts: successive additions to one element are slow
    for i in range(quarter):
        for k in range(FOUR):
            at = i + k * quarter
            out[index(key[at])] += np.rint(values[at] * per_unit)
    for i in range(FOUR * quarter, index(len(key))):
        out[index(key[i])] += np.rint(values[i] * per_unit)


@jit
def block_keys(first, last, key, number, species, populations):
    """Replace the leaf of each particle in `key` (n,), in place, by block * populations + population.

    number (leaves + 1,): block of each leaf. species (n,): population of each particle, read only if there are several.
    """
    for i in range(index(first), index(last)):
        block = number[key[i]]
        key[i] = block * populations + species[i] if populations > 1 else block


@jit_no_alloc
def block_squares(first, last, leaf, level, origin, begin, leaf_side, corner, side):
    """Write the lower corner `corner` (blocks, 2) and the side `side` (blocks,) of each block.

    leaf (blocks, 2): first leaf of each block, in the part of the lattice that begins at the leaf `begin` (2,). level
    (blocks,): log2 of the side of each block in leaves. origin (2,): position of the lattice. leaf_side: side of a
    leaf.
    """
    for block in range(first, last):
        for axis in range(2):
            corner[block, axis] = origin[axis] + (leaf[block, axis] + begin[axis]) * leaf_side
        side[block] = leaf_side * 2.0 ** level[block]


@jit
def particles_in_blocks(order, start, chosen):
    """Return the indices of the particles in the blocks that are `chosen` (blocks,).

    The particles of block b have the indices order[start[b] : start[b + 1]].
    """
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
def uncoupled_particles(order, start, rates, enlarged, count):
    """Return the indices of the dust particles that are not coupled to gas in a kick.

    These are particles outside all blocks, in blocks that are `enlarged` (blocks,), or of a population whose mean drag
    rate in the block, in `rates` (blocks, populations), is 0. Only the first `count` blocks are searched, which have
    the local particles of this process. order, start: particles sorted by block and population, as in `Blocks`.
    """
    blocks, populations = rates.shape
    chosen = np.ones((blocks + 2) * populations, np.bool_)
    for block in range(blocks):
        for part in range(populations):
            alone = enlarged[block] or rates[block, part] == 0.0
            chosen[block * populations + part] = alone and block < count
    return particles_in_blocks(order, start, chosen)


@jit
def particle_stopping_times(times, order, start):
    """Return the stopping time of each particle (n,), which is that of its population in its block.

    times (blocks, populations): stopping times. order, start: particles sorted by block and population, as in `Blocks`.
    """
    out = np.empty(len(order))
    for block in range(times.shape[0]):
        for s in range(times.shape[1]):
            for k in range(start[block * times.shape[1] + s], start[block * times.shape[1] + s + 1]):
                out[order[k]] = times[block, s]
    return out


class BlockRequirements(NamedTuple):
    """Requirements for the size and the content of blocks.

    leaf: side of a leaf. size: smallest side of a block, divided by the mean h of its gas. length: smallest side of all
    blocks; if it is 0, `size` determines the smallest side. gas, dust: smallest numbers of particles. soft, hard:
    largest sides of blocks that are enlarged, in smallest sides (module docstring). dust_in: where dust is required,
    IGNORE, NEAR or INSIDE.
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
    """Blocks of all levels of the lattice; a block of level l is 2^l leaves wide.

    begin, width, height (levels,): level l has width[l] by height[l] blocks, from index begin[l] of the following
    arrays on. final (blocks,): whether a block is used; a final block inside a larger final block is not used. enlarged
    (blocks,): whether a block was enlarged for lack of particles. `final` and `enlarged` are False on input to `merge`.
    """

    begin: np.ndarray
    width: np.ndarray
    height: np.ndarray
    final: np.ndarray
    enlarged: np.ndarray


class LevelBlocks(NamedTuple):
    """Blocks of one level within a top-level block, as arrays (x, y); each level overwrites the level below.

    gas, dust: numbers of particles. h_sum: sum of h of the gas. status: DONE, or why the block should be merged further
    (module docstring). blocks: number of final blocks inside.
    """

    gas: np.ndarray
    dust: np.ndarray
    h_sum: np.ndarray
    status: np.ndarray
    blocks: np.ndarray


@inline_jit
def _least_side(gas, h_sum, required):
    """Return the smallest allowed side of a block with `gas` gas particles, whose h add up to `h_sum`."""
    return required.size * h_sum / gas if required.length == 0.0 else required.length


@inline_jit
def _block_status(gas, dust, h_sum, side, required):
    """Return DONE, or the reason why a block should be merged further.

    gas, dust: numbers of particles in the block. h_sum: sum of h of the gas. side: side of the block.
    """
    if gas + dust == 0:
        return DONE
    if gas == 0:
        return LACKING
    if side < _least_side(gas, h_sum, required) * (1.0 - TIE):
        return SMALL
    if dust == 0:
        return LACKING if required.dust_in == INSIDE else LONELY if required.dust_in == NEAR else DONE
    return FEW if gas < required.gas or dust < required.dust else DONE


@inline_jit
def _load_leaves(tx, ty, gas, dust, h_sum, required, tree, squares):
    """Write the leaves of the top-level block at leaf (tx, ty) to `squares`; return whether it has any particle.

    gas, dust, h_sum (leaves,): as in `merge`. Leaves that need not be merged are marked in `tree.final`.
    """
    has_particles = False
    for ix in range(tx, min(tx + MOST, tree.width[0])):
        for iy in range(ty, min(ty + MOST, tree.height[0])):
            b, x, y = ix * tree.height[0] + iy, ix - tx, iy - ty
            squares.gas[x, y], squares.dust[x, y], squares.h_sum[x, y] = gas[b], dust[b], 0.0
            squares.status[x, y], squares.blocks[x, y] = DONE, 0
            if gas[b] + dust[b] > 0:
                has_particles = True
                squares.h_sum[x, y], squares.blocks[x, y] = h_sum[b], 1
                squares.status[x, y] = _block_status(
                    squares.gas[x, y], squares.dust[x, y], h_sum[b], required.leaf, required
                )
                tree.final[b] = squares.status[x, y] == DONE
    return has_particles


@inline_jit
def _merge_children(level, bx, by, tx, ty, required, tree, squares):
    """Merge up to four children in `squares` to the block (bx, by), if one is not DONE and the block not too large.

    The result overwrites `squares`, and marks blocks in `tree.final` and `tree.enlarged`. (tx, ty): first leaf of the
    top-level block.
    """
    height = tree.height[level - 1]
    along_x = 2 if 2 * bx + 1 < tree.width[level - 1] else 1
    along_y = 2 if 2 * by + 1 < height else 1
    x, y = bx - (tx >> level), by - (ty >> level)
    gas, dust, h_sum, worst, blocks = NOUGHT, NOUGHT, 0.0, DONE, NOUGHT
    for cx in range(2 * x, 2 * x + along_x):
        for cy in range(2 * y, 2 * y + along_y):
            gas += squares.gas[cx, cy]
            dust += squares.dust[cx, cy]
            h_sum += squares.h_sum[cx, cy]
            worst = max(worst, squares.status[cx, cy])
            blocks += squares.blocks[cx, cy]
    if gas + dust > 0:
        b, below = tree.begin[level] + bx * tree.height[level] + by, tree.begin[level - 1] + 2 * (bx * height + by)
        side, must_merge, too_large = required.leaf * 2.0**level, worst != DONE, False
        if must_merge and gas > 0 and worst != SMALL:
            limit = (required.soft if worst == FEW else required.hard) * _least_side(gas, h_sum, required)
            too_large = side > limit * (1.0 + TIE) or (worst == LONELY and dust > 0)
        for cx in range(along_x):
            for cy in range(along_y):
                tree.enlarged[b] |= tree.enlarged[below + cx * height + cy]
                if too_large:
                    tree.final[below + cx * height + cy] |= squares.status[2 * x + cx, 2 * y + cy] != DONE
        worst_now = DONE
        if must_merge and not too_large:
            # Leaves without gas or without dust may be below the smallest side; to merge them is no enlargement.
            wide = gas > 0 and 0.5 * side > _least_side(gas, h_sum, required) * (1.0 - TIE)
            tree.enlarged[b] |= wide and worst != SMALL
            worst_now, blocks = _block_status(gas, dust, h_sum, side, required), 1
            tree.final[b] = worst_now == DONE or level == LEVELS
        worst = worst_now
    squares.gas[x, y], squares.dust[x, y], squares.h_sum[x, y] = gas, dust, h_sum
    squares.status[x, y], squares.blocks[x, y] = worst, blocks


@inline_jit
def _merge_top_block(top, gas, dust, h_sum, required, tree, squares):
    """Merge the leaves of the top-level block `top`, and return the number of blocks. Writes `tree` and `squares`."""
    tx, ty = top // tree.height[LEVELS] << LEVELS, top % tree.height[LEVELS] << LEVELS
    if not _load_leaves(tx, ty, gas, dust, h_sum, required, tree, squares):
        return 0
    for level in range(1, LEVELS + 1):
        for bx in range(tx >> level, min(tx + MOST >> level, tree.width[level])):
            for by in range(ty >> level, min(ty + MOST >> level, tree.height[level])):
                _merge_children(level, bx, by, tx, ty, required, tree, squares)
    return squares.blocks[0, 0]


@jit
def merge(first, last, gas, dust, h_sum, required, tree, count):
    """Merge the leaves of the top-level blocks `first` to `last`, and write the number of blocks in each to `count`.

    The blocks are marked in `tree.final` and `tree.enlarged`. gas, dust, h_sum (leaves,): numbers of gas and dust
    particles in each leaf, and the sum of h of its gas. count (top-level blocks,).
    """
    numbers = np.empty((3, MOST, MOST), np.int64)
    squares = LevelBlocks(numbers[0], numbers[1], np.empty((MOST, MOST)), np.empty((MOST, MOST), np.int8), numbers[2])
    for top in range(first, last):
        count[top] = _merge_top_block(top, gas, dust, h_sum, required, tree, squares)


@inline_jit
def _largest_block_at(z, tx, ty, tree):
    """Return (ix, iy, level, found) of the largest final block that begins at the index z along the Z-curve.

    (tx, ty): first leaf of the top-level block. ix, iy: leaf at index z. found: whether a final block begins there;
    if not, `level` is that of a square in which no final block begins.
    """
    x, y = z_position(z)
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
    """Number the blocks of each top-level block along a Z-curve: nearby blocks of any level have nearby numbers.

    start (top-level blocks + 1,): first number in each top-level block. Writes the number of the block of each leaf,
    `number` (leaves + 1,), and of each block its first leaf, `corner` (blocks, 2), its level, `level_of` (blocks,), and
    whether it is enlarged, `flag` (blocks,).
    """
    for top in range(first, last):
        tx, ty = top // tree.height[LEVELS] << LEVELS, top % tree.height[LEVELS] << LEVELS
        z, n = NOUGHT, start[top]
        while n < start[top + 1]:
            ix, iy, level, found = _largest_block_at(z, tx, ty, tree)
            if found:
                for jx in range(ix, min(ix + (1 << level), tree.width[0])):
                    for jy in range(iy, min(iy + (1 << level), tree.height[0])):
                        number[jx * tree.height[0] + jy] = n
                corner[n, 0], corner[n, 1], level_of[n] = ix, iy, level
                flag[n] = tree.enlarged[tree.begin[level] + (ix >> level) * tree.height[level] + (iy >> level)]
                n += 1
            z += 1 << 2 * level
