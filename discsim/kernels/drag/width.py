"""Limited smoothing lengths, which determine the sides of drag cells (`drag/width.py`)."""

import math

from discsim.jit.decorators import jit
from discsim.jit.index import index

ONE, TWO = index(1), index(2)


@jit
def limit_lengths(begin, end, pos, h, least, table, nodes, out):
    """Write the limited smoothing lengths min(h, max(limit(r), least h)) of the positions `pos` (n, 2) to `out` (n,).

    h (n,): smoothing lengths. table: the limit at the radii r = 0, 1 / nodes, 2 / nodes, ...
    """
    flat, last = pos.reshape(-1), float(len(table) - 2)
    for i in range(index(begin), index(end)):
        x, y = flat[TWO * i], flat[TWO * i + ONE]
        place = nodes * math.sqrt(x * x + y * y)
        place = place if place < last + 1.0 else last + 1.0  # also for NaN
        node = int(min(place, last))
        limit = table[node] + (place - node) * (table[node + 1] - table[node])
        out[i] = min(h[i], max(limit, least * h[i]))
