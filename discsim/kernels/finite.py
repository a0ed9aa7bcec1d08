"""Whether numbers are finite. For `discsim.numerics.threads.share_all`."""

import numpy as np

from discsim.jit.decorators import LEAN, kept


@kept(**LEAN, fastmath={"reassoc", "nsz"})  # summed in any order, in vectors; not without NaN
def are_finite(begin, end, values):
    """Whether all entries of rows (n, d) are: their sum is so, unless they overflow, which is as bad."""
    total, flat, width = 0.0, values.reshape(-1), values.shape[1]
    for i in range(np.uint64(begin * width), np.uint64(end * width)):
        total += flat[i]
    return abs(total) < np.inf
