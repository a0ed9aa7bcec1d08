"""Between what coordinates the places of each BATCH of rows lie. Rows of arrays are sorted by place, so that those of a
batch are near each other, and most batches need not be looked at row by row. For `discsim.numerics.threads.share`.
"""

import numpy as np

from discsim.jit.decorators import compiled

BATCH = 128  # rows
ONE, WHOLE = np.uint64(1), np.uint64(BATCH)


@compiled
def bounds_of(first, last, some, pos, out):
    """Write to `out` (batches, 4) the least and the largest x, and then y, of `some` batches of places (n, d), 0 where
    there is no y; NaN where any is not finite.
    """
    # One number a bound: rows of partial ones, which are written all the time, took three times as long (2026-11).
    flat, dim = pos.reshape(-1), np.uint64(pos.shape[1])
    for number in range(first, last):
        batch = np.uint64(some[number])
        begin, end = batch * WHOLE, min((batch + ONE) * WHOLE, np.uint64(len(pos)))
        x0 = x1 = flat[dim * begin]
        y0 = y1 = flat[dim * begin + dim - ONE]
        total_x, total_y = 0.0, 0.0
        for i in range(begin, end):
            x, y = flat[dim * i], flat[dim * i + dim - ONE]
            x0, x1, y0, y1 = min(x0, x), max(x1, x), min(y0, y), max(y1, y)
            total_x += x
            total_y += y
        row = out[batch]
        row[0], row[1], row[2], row[3] = x0, x1, y0, y1
        if dim == ONE:
            row[2], row[3] = 0.0, 0.0
        if not abs(total_x + total_y) < np.inf:  # unless an entry is not finite, or the sums overflow
            row[:] = np.nan
