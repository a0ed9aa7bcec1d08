"""Between what coordinates the places of each BATCH of rows lie. Rows of arrays are sorted by place, so that those of a
batch are near each other, and most batches need not be looked at row by row. For `discsim.numerics.threads.share`.
"""

import numpy as np

from discsim.kernels.inner import compiled

BATCH = 128  # rows
WIDE = np.uint64(64)  # entries that do not wait for each other: vectors


@compiled
def bounds_of(first, last, some, pos, out):
    """Write to `out` (batches, 4) the least and the largest x, and then y, of `some` batches of places (n, d), 0 where
    there is no y; NaN where any is not finite.
    """
    flat, dim = pos.reshape(-1), pos.shape[1]
    least, most, total, whole = np.empty(WIDE), np.empty(WIDE), np.empty(WIDE), np.uint64(BATCH * dim)
    for number in range(first, last):
        batch = np.uint64(some[number])
        begin, end = batch * whole, min((batch + np.uint64(1)) * whole, np.uint64(len(flat)))
        least[:], most[:], total[:] = np.inf, -np.inf, 0.0
        if end - begin == whole:  # loops of a length that is known
            for at in range(begin, end, WIDE):
                for k in range(WIDE):
                    value = flat[at + k]
                    least[k] = value if value < least[k] else least[k]
                    most[k] = value if value > most[k] else most[k]
                    total[k] += value
        else:
            for k in range(end - begin):
                value, column = flat[begin + k], k % np.uint64(dim)
                least[column], most[column] = min(least[column], value), max(most[column], value)
                total[column] += value
        half = WIDE // np.uint64(2)
        while half >= np.uint64(dim):  # until there is one entry a column
            for k in range(half):
                least[k] = least[k + half] if least[k + half] < least[k] else least[k]
                most[k] = most[k + half] if most[k + half] > most[k] else most[k]
                total[k] += total[k + half]
            half //= np.uint64(2)
        row = out[batch]
        row[:] = 0.0
        row[0], row[1] = least[0], most[0]
        if dim == 2:
            row[2], row[3] = least[1], most[1]
        if not abs(total[0] + total[dim - 1]) < np.inf:  # unless an entry is not finite, or the sums overflow
            row[:] = np.nan
