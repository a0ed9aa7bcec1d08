"""Bounding boxes of batches of rows, where a batch is BATCH successive particles (`numerics/batches.py`).

Rows of arrays are sorted by position, so that the particles of a batch are near each other. For most batches a test of
the bounding box replaces a test of each row.
"""

import numpy as np

from discsim.jit.decorators import jit
from discsim.jit.index import index

BATCH = 128  # rows in a batch
ONE, WHOLE = index(1), index(BATCH)


@jit
def bounds_of(first, last, some, pos, out):
    """Write to `out` (batches, 4) the bounds of the batches `some`: smallest and largest x, smallest and largest y.

    some: indices of batches. first, last: range of `some` to write. pos (n, d): positions. In one dimension the bounds
    in y are 0. A batch with a position that is not finite gets NaN.
    """
    # One scalar per bound: arrays of partial bounds, written in each iteration, took three times as long (2026-11).
    flat, dim = pos.reshape(-1), index(pos.shape[1])
    for number in range(first, last):
        batch = index(some[number])
        begin, end = batch * WHOLE, min((batch + ONE) * WHOLE, index(len(pos)))
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
        if not abs(total_x + total_y) < np.inf:  # an entry is not finite, or a sum overflows
            row[:] = np.nan
