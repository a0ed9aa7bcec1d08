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

ONE, TWO = np.uint64(1), np.uint64(2)
LEVELS = 5  # a block is at most 2^LEVELS leaves wide
DONE, LONELY, SMALL, FEW, LACKING = range(5)
IGNORE, NEAR, INSIDE = range(3)  # where a block wants dust


@njit(nogil=True, cache=True, error_model="numpy")
def leaf_keys(first, last, pos, origin, shift, inverse, nx, ny, periodic, out):
    """Write the leaf of each particle; nx ny where it lies outside the lattice. `shift` (2,) in leaves."""
    ox, oy, dx, dy = origin[0], origin[1], shift[0], shift[1]
    outside, rows = np.uint32(nx * ny), np.int32(ny)
    if pos.shape[1] == 2 and not periodic:
        flat = pos.reshape(-1)  # steps of two and unsigned numbers: vectorised
        for i in range(np.uint64(first), np.uint64(last)):
            sx, sy = (flat[TWO * i] - ox) * inverse + dx, (flat[TWO * i + ONE] - oy) * inverse + dy
            inside = (sx >= 0.0) & (sx < nx) & (sy >= 0.0) & (sy < ny)
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
        out[i] = np.uint32(int(sx) * ny + int(sy)) if inside else outside


@njit(nogil=True, cache=True, error_model="numpy")
def leaf_counts(key, weight, count):
    """Particles in each leaf and outside, and the sum of `weight`, if it has entries, over them."""
    number, total = np.zeros(count + 1, np.uint32), np.zeros(count + 1 if len(weight) > 0 else 0)
    if len(weight) == 0:
        for i in range(len(key)):
            number[key[i]] += np.uint32(1)
    else:
        for i in range(len(key)):
            number[key[i]] += np.uint32(1)
            total[key[i]] += weight[i]
    return number, total


@njit(nogil=True, cache=True, error_model="numpy")
def sort_members(key, counts, number, species, populations, count):
    """Order of the particles by the block of their leaf and, within it, by population, and where each of them begins.

    `counts` are those of `leaf_counts`; `number` is each leaf's block out of `count`.
    """
    start = np.zeros(count * populations + 1, np.int64)
    if populations == 1:
        for leaf in range(len(counts)):
            if counts[leaf] > 0:
                start[number[leaf] + 1] += counts[leaf]
    else:
        for i in range(len(key)):
            start[number[key[i]] * populations + species[i] + 1] += 1
    for k in range(len(start) - 1):
        start[k + 1] += start[k]
    order, next_one = np.empty(len(key), np.uint32), start[:-1].astype(np.uint32)
    for i in range(len(key)):
        k = number[key[i]]
        if populations > 1:
            k = k * populations + species[i]
        order[next_one[k]] = i
        next_one[k] += np.uint32(1)
    return order, start


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
    g, d, s = np.zeros(len(status), np.uint32), np.zeros(len(status), np.uint32), np.zeros(len(status))
    for b in range(nx * ny):
        if gas[b] + dust[b] > 0:
            g[b], d[b], s[b] = gas[b], dust[b], h_sum[b]
            status[b] = _status(g[b], d[b], s[b], leaf, size, length, least_gas, least_dust, dust_wanted)
            final[b] = status[b] == DONE
    for level in range(1, LEVELS + 1):
        side = leaf * 2.0**level
        for bx in range(width[level]):
            for by in range(height[level]):
                b = first[level] + bx * height[level] + by
                worst = DONE
                for cx in range(2 * bx, min(2 * bx + 2, width[level - 1])):
                    low = first[level - 1] + cx * height[level - 1] + 2 * by
                    for c in range(low, low + min(2, height[level - 1] - 2 * by)):
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
                            low = first[level - 1] + cx * height[level - 1] + 2 * by
                            for c in range(low, low + min(2, height[level - 1] - 2 * by)):
                                final[c] |= status[c] != DONE
                        continue
                enlarged[b] |= worst != SMALL
                status[b] = _status(g[b], d[b], s[b], side, size, length, least_gas, least_dust, dust_wanted)
                if g[b] + d[b] > 0 and (status[b] == DONE or level == LEVELS):
                    final[b] = True
    return _number(final, enlarged, width, height, first)


@njit(nogil=True, cache=True, error_model="numpy")
def _number(final, enlarged, width, height, first):
    """Number the blocks, the largest final ones about each leaf, along a Z-curve in each of the largest possible, so
    that those in one place follow each other at whatever level.
    """
    nx, ny = width[0], height[0]
    number = np.full(nx * ny, -1, np.int32)
    corner = np.empty((nx * ny, 2), np.int32)
    flag, level_of = np.empty(nx * ny, np.bool_), np.empty(nx * ny, np.int64)
    count = 0
    for top in range(width[LEVELS] * height[LEVELS]):
        tx, ty = top // height[LEVELS] << LEVELS, top % height[LEVELS] << LEVELS
        z = 0
        while z < 1 << 2 * LEVELS:
            ix, iy, level = tx, ty, LEVELS
            for k in range(LEVELS):
                ix += (z >> 2 * k + 1 & 1) << k
                iy += (z >> 2 * k & 1) << k
            while z & (1 << 2 * level) - 1 != 0:
                level -= 1
            if ix < nx and iy < ny:
                while level > 0 and not final[first[level] + (ix >> level) * height[level] + (iy >> level)]:
                    level -= 1
                if final[first[level] + (ix >> level) * height[level] + (iy >> level)]:
                    for jx in range(ix, min(ix + (1 << level), nx)):
                        for jy in range(iy, min(iy + (1 << level), ny)):
                            number[jx * ny + jy] = count
                    corner[count, 0], corner[count, 1] = ix, iy
                    flag[count] = enlarged[first[level] + (ix >> level) * height[level] + (iy >> level)]
                    level_of[count] = level
                    count += 1
            z += 1 << 2 * level
    return number, corner[:count], level_of[:count], flag[:count]
