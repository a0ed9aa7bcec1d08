"""Test for entries that are not finite. For `discsim.numerics.threads.parallel_for_ranges`."""

import numpy as np

from discsim.jit.decorators import NO_ALLOC, kept
from discsim.jit.index import index


@kept(**NO_ALLOC, fastmath={"reassoc", "nsz"})  # sums in any order are vectorised; NaN must survive
def are_finite(begin, end, values):
    """Return whether all entries of rows (n, d) are finite, by their sum; False also if the sum overflows."""
    total, flat, width = 0.0, values.reshape(-1), values.shape[1]
    for i in range(index(begin * width), index(end * width)):
        total += flat[i]
    return abs(total) < np.inf
