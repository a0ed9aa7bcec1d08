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

import numpy as np
from numba import njit

LEVELS = 5  # a block is at most 2^LEVELS leaves wide
DONE, LONELY, SMALL, FEW, LACKING = range(5)
IGNORE, NEAR, INSIDE = range(3)  # where a block wants dust


@njit(nogil=True, cache=True)
def leaf_keys(first, last, pos, origin, shift, inverse, nx, ny, periodic, out):
    """Write the leaf of each particle; nx ny where it lies outside the lattice. `shift` (2,) in leaves."""
    for i in range(first, last):
        sx = (pos[i, 0] - origin[0]) * inverse + shift[0]
        sy = (pos[i, 1] - origin[1]) * inverse + shift[1] if pos.shape[1] == 2 else 0.0
        if periodic:
            sx -= nx * np.floor(sx / nx)
            sy -= ny * np.floor(sy / ny)
            sx, sy = (sx if sx < nx else 0.0), (sy if sy < ny else 0.0)
        inside = 0.0 <= sx < nx and 0.0 <= sy < ny
        out[i] = int(sx) * ny + int(sy) if inside else nx * ny


@njit(cache=True)
def leaf_counts(key, weight, count):
    """Particles in each leaf, and the sum of `weight` over them."""
    number, total = np.zeros(count + 1, np.int64), np.zeros(count + 1)
    for i in range(len(key)):
        number[key[i]] += 1
        if len(weight) > 0:
            total[key[i]] += weight[i]
    return number, total


@njit(cache=True)
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


@njit(cache=True)
def merge(gas, dust, h_sum, nx, ny, leaf, size, length, least_gas, least_dust, soft, hard, dust_wanted):
    """Block of each leaf, and of each block its first leaf (ix, iy), its level and whether want of particles
    enlarged it. `gas`, `dust`, `h_sum` (nx ny,): particles in each leaf and the sum of the gas's h.
    """
    width, height = np.empty(LEVELS + 1, np.int64), np.empty(LEVELS + 1, np.int64)
    first = np.zeros(LEVELS + 2, np.int64)
    for level in range(LEVELS + 1):
        width[level], height[level] = (nx - 1 >> level) + 1, (ny - 1 >> level) + 1
        first[level + 1] = first[level] + width[level] * height[level]
    status = np.zeros(first[LEVELS + 1], np.int8)
    final = np.zeros(first[LEVELS + 1], np.bool_)
    enlarged = np.zeros(first[LEVELS + 1], np.bool_)
    g, d, s = np.zeros(len(status), np.int64), np.zeros(len(status), np.int64), np.zeros(len(status))
    for level in range(LEVELS + 1):
        side = leaf * 2.0**level
        for bx in range(width[level]):
            for by in range(height[level]):
                b = first[level] + bx * height[level] + by
                worst = DONE
                if level == 0:
                    g[b], d[b], s[b] = gas[b], dust[b], h_sum[b]
                else:
                    for cx in range(2 * bx, min(2 * bx + 2, width[level - 1])):
                        for cy in range(2 * by, min(2 * by + 2, height[level - 1])):
                            c = first[level - 1] + cx * height[level - 1] + cy
                            g[b] += g[c]
                            d[b] += d[c]
                            s[b] += s[c]
                            worst = max(worst, status[c])
                            enlarged[b] |= enlarged[c]
                    if worst == DONE:
                        continue
                    if g[b] > 0 and worst != SMALL:
                        wanted = size * s[b] / g[b] if length == 0.0 else length
                        limit = (soft if worst == FEW else hard) * wanted
                        if side > limit or (worst == LONELY and d[b] > 0):
                            for cx in range(2 * bx, min(2 * bx + 2, width[level - 1])):
                                for cy in range(2 * by, min(2 * by + 2, height[level - 1])):
                                    c = first[level - 1] + cx * height[level - 1] + cy
                                    final[c] |= status[c] != DONE
                            continue
                    enlarged[b] |= worst != SMALL
                status[b] = _status(g[b], d[b], s[b], side, size, length, least_gas, least_dust, dust_wanted)
                if g[b] + d[b] > 0 and (status[b] == DONE or level == LEVELS):
                    final[b] = True
    return _number(final, enlarged, g, d, width, height, first, nx, ny)


@njit(cache=True)
def _number(final, enlarged, g, d, width, height, first, nx, ny):
    """Number the blocks from the top down: the largest final ancestor of a leaf is its block."""
    number = np.full(len(final), -1, np.int64)
    corner = np.empty((nx * ny, 2), np.int64)
    flag, height_of = np.empty(nx * ny, np.bool_), np.empty(nx * ny, np.int64)
    count = 0
    for level in range(LEVELS, -1, -1):
        for bx in range(width[level]):
            for by in range(height[level]):
                b = first[level] + bx * height[level] + by
                if level < LEVELS:
                    number[b] = number[first[level + 1] + (bx >> 1) * height[level + 1] + (by >> 1)]
                if number[b] < 0 and final[b]:
                    number[b] = count
                    corner[count, 0], corner[count, 1] = bx << level, by << level
                    flag[count], height_of[count] = enlarged[b], level
                    count += 1
    return number[: nx * ny], corner[:count], height_of[:count], flag[:count]
