"""Drag cells as blocks of a lattice: small where particles are many, merged in 2 x 2 where they are too few.

Leaves of a regular lattice are merged upwards as in a quadtree (in pairs in one dimension). A block waits for
more

    while its side is below the wanted one (a number of mean smoothing lengths of its gas, or a length), SMALL;
    while it holds fewer particles than asked for, but both species, FEW, up to `soft` times the wanted side;
    while it lacks gas, LACKING, up to `hard` times the wanted side;
    while it lacks dust, if it is to have both: LACKING too, or, if dust next to it will do, LONELY until its parent
    has some.

If any of its children waits, all particles of a parent make one block; where the parent would be larger than
its limit, the children stay as they are, and dust without gas stays uncoupled (and is reported).
"""

from typing import Any

import numpy as np
from numba import njit

ONE, TWO = np.uint64(1), np.uint64(2)
NOUGHT: Any = np.int64(0)  # a literal 0 given to a function would make a version of it
LEVELS = 5  # a block is at most 2^LEVELS leaves wide
DONE, LONELY, SMALL, FEW, LACKING = range(5)
IGNORE, NEAR, INSIDE = range(3)  # where a block wants dust


@njit(nogil=True, cache=True, error_model="numpy")
def leaf_keys(first, last, pos, origin, shift, low, high, inverse, nx, ny, periodic, out):
    """Write the leaf of each particle; nx ny where it is not from `low` to `high` of an open lattice. These and `shift`
    (2,) in leaves.
    """
    ox, oy, dx, dy = origin[0], origin[1], shift[0], shift[1]
    low_x, low_y, high_x, high_y = low[0], low[1], high[0], high[1]
    outside, rows = np.uint32(nx * ny), np.int32(ny)
    if pos.shape[1] == 2 and not periodic:
        flat = pos.reshape(-1)  # steps of two and unsigned numbers: vectorised
        for i in range(np.uint64(first), np.uint64(last)):
            sx, sy = (flat[TWO * i] - ox) * inverse + dx, (flat[TWO * i + ONE] - oy) * inverse + dy
            inside = (sx >= low_x) & (sx < high_x) & (sy >= low_y) & (sy < high_y)
            out[i] = np.uint32(np.int32(sx) * rows + np.int32(sy)) if inside else outside
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
        out[i] = np.uint32(int(sx) * ny + int(sy)) if inside else outside


@njit(nogil=True, cache=True, error_model="numpy")
def block_keys(first, last, key, number, species, populations):
    """Turn the leaf of each particle into its block and population as one number, those of a block together.

    `number` is each leaf's block; `species` is read where there are several populations.
    """
    for i in range(first, last):
        block = number[key[i]]
        key[i] = block * populations + species[i] if populations > 1 else block


@njit(nogil=True, cache=True, error_model="numpy")
def mass_in(mass, order, start, chosen, time):
    """Mass of the particles in the blocks `chosen`, and, if `time` has entries, with a stopping time."""
    total = 0.0
    for block in range(len(chosen)):
        if chosen[block]:
            for k in range(start[block], start[block + 1]):
                total += mass[order[k]] if len(time) == 0 or time[order[k]] < np.inf else 0.0
    return total


@njit(nogil=True, cache=True, error_model="numpy")
def times_of_members(times, order, start):
    """The stopping time of each particle (n,) from those of its block and population."""
    out = np.empty(len(order))
    for block in range(times.shape[0]):
        for s in range(times.shape[1]):
            for k in range(start[block * times.shape[1] + s], start[block * times.shape[1] + s + 1]):
                out[order[k]] = times[block, s]
    return out


@njit(nogil=True, cache=True, error_model="numpy")
def _status(gas, dust, h_sum, side, size, length, least_gas, least_dust, dust_wanted):
    """What a block still waits for."""
    if gas + dust == 0:
        return DONE
    if gas == 0:
        return LACKING
    wanted = size * h_sum / gas if length == 0.0 else length
    if side < wanted * (1.0 - 1e-9):
        return SMALL
    if dust == 0:
        return LACKING if dust_wanted == INSIDE else LONELY if dust_wanted == NEAR else DONE
    return FEW if gas < least_gas or dust < least_dust else DONE


@njit(nogil=True, cache=True, error_model="numpy")
def merge(
    first, last, gas, dust, h_sum, leaf, size, length, least_gas, least_dust, soft, hard, dust_wanted,
    begin, width, height, final, enlarged, count,
):  # fmt: skip
    """Blocks within the largest possible ones, and how many there are in each of these: count (largest,).

    `gas`, `dust`, `h_sum` (leaves,): particles in each leaf and the sum of the gas's h. The blocks of a level, width by
    height, start at begin[level] of `final` and `enlarged`: whether it is one, unless it lies in a larger one, and
    whether want of particles enlarged it. Both come as False.
    """
    most = 1 << LEVELS
    # Of the blocks of one level within a largest one, in place of what was there of the level below.
    g, d, s = np.empty((most, most), np.int64), np.empty((most, most), np.int64), np.empty((most, most))
    status = np.empty((most, most), np.int8)
    for top in range(first, last):
        tx, ty = top // height[LEVELS] << LEVELS, top % height[LEVELS] << LEVELS
        held = 0
        for ix in range(tx, min(tx + most, width[0])):
            for iy in range(ty, min(ty + most, height[0])):
                b, x, y = ix * height[0] + iy, ix - tx, iy - ty
                g[x, y], d[x, y], s[x, y] = gas[b], dust[b], h_sum[b]
                held += g[x, y] + d[x, y]
                status[x, y] = _status(
                    g[x, y], d[x, y], s[x, y], leaf, size, length, least_gas, least_dust, dust_wanted
                )  # fmt: skip
                final[b] = g[x, y] + d[x, y] > 0 and status[x, y] == DONE
        if held == 0:
            continue
        for level in range(1, LEVELS + 1):
            side = leaf * 2.0**level
            for bx in range(tx >> level, min(tx + most >> level, width[level])):
                for by in range(ty >> level, min(ty + most >> level, height[level])):
                    b, x, y = begin[level] + bx * height[level] + by, bx - (tx >> level), by - (ty >> level)
                    below = begin[level - 1] + 2 * (bx * height[level - 1] + by)
                    along_x = 2 if 2 * bx + 1 < width[level - 1] else 1
                    along_y = 2 if 2 * by + 1 < height[level - 1] else 1
                    gas_held, dust_held, h_held, worst = NOUGHT, NOUGHT, 0.0, DONE
                    for cx in range(along_x):
                        for cy in range(along_y):
                            gas_held += g[2 * x + cx, 2 * y + cy]
                            dust_held += d[2 * x + cx, 2 * y + cy]
                            h_held += s[2 * x + cx, 2 * y + cy]
                            worst = max(worst, status[2 * x + cx, 2 * y + cy])
                            enlarged[b] |= enlarged[below + cx * height[level - 1] + cy]
                    waits, too_large = worst != DONE, False
                    if waits and gas_held > 0 and worst != SMALL:
                        wanted = size * h_held / gas_held if length == 0.0 else length
                        limit = (soft if worst == FEW else hard) * wanted
                        too_large = side > limit or (worst == LONELY and dust_held > 0)
                    if too_large:
                        for cx in range(along_x):
                            for cy in range(along_y):
                                final[below + cx * height[level - 1] + cy] |= status[2 * x + cx, 2 * y + cy] != DONE
                    g[x, y], d[x, y], s[x, y], status[x, y] = gas_held, dust_held, h_held, DONE
                    if waits and not too_large:
                        enlarged[b] |= worst != SMALL
                        status[x, y] = _status(
                            gas_held, dust_held, h_held, side, size, length, least_gas, least_dust, dust_wanted
                        )  # fmt: skip
                        final[b] = gas_held + dust_held > 0 and (status[x, y] == DONE or level == LEVELS)
        z = NOUGHT
        while z < 1 << 2 * LEVELS:
            _, _, level, found = _block_at(z, tx, ty, begin, width, height, final)
            count[top] += found
            z += 1 << 2 * level


@njit(nogil=True, cache=True, error_model="numpy")
def _block_at(z, tx, ty, begin, width, height, final):
    """First leaf and level of the largest block that starts at place z of the Z-curve in the largest possible one that
    starts at leaf (tx, ty), and whether there is one; else as far as there is none for certain.
    """
    ix, iy, level = tx, ty, LEVELS
    for k in range(LEVELS):
        ix += (z >> 2 * k + 1 & 1) << k
        iy += (z >> 2 * k & 1) << k
    while z & (1 << 2 * level) - 1 != 0:
        level -= 1
    if ix >= width[0] or iy >= height[0]:
        return ix, iy, level, False
    while level > 0 and not final[begin[level] + (ix >> level) * height[level] + (iy >> level)]:
        level -= 1
    return ix, iy, level, final[begin[level] + (ix >> level) * height[level] + (iy >> level)]


@njit(nogil=True, cache=True, error_model="numpy")
def number_blocks(first, last, start, begin, width, height, final, enlarged, number, corner, level_of, flag):
    """Number the blocks of each largest possible one, from `start` on, along a Z-curve: those in one place follow each
    other at whatever level. Writes the number of each leaf, and first leaf, level and `enlarged` of each block.
    """
    for top in range(first, last):
        tx, ty = top // height[LEVELS] << LEVELS, top % height[LEVELS] << LEVELS
        z, n = NOUGHT, start[top]
        while n < start[top + 1]:
            ix, iy, level, found = _block_at(z, tx, ty, begin, width, height, final)
            if found:
                for jx in range(ix, min(ix + (1 << level), width[0])):
                    for jy in range(iy, min(iy + (1 << level), height[0])):
                        number[jx * height[0] + jy] = n
                corner[n, 0], corner[n, 1], level_of[n] = ix, iy, level
                flag[n] = enlarged[begin[level] + (ix >> level) * height[level] + (iy >> level)]
                n += 1
            z += 1 << 2 * level
