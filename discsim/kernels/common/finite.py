"""Test for NaN and infinity in arrays."""

import numpy as np

from discsim.jit.decorators import NO_ALLOC, cached_njit
from discsim.jit.index import index


@cached_njit(**NO_ALLOC, fastmath={"reassoc", "nsz"})  # a sum in any order is vectorised; NaN must be kept
def are_finite(begin, end, values):
    """Return whether the rows `begin` to `end` of `values` (n, d) have only finite entries.

    The function tests whether the sum of the entries is finite, and so also returns False if a sum of finite entries
    overflows.
    """
    total, flat, width = 0.0, values.reshape(-1), values.shape[1]
    for i in range(index(begin * width), index(end * width)):
        total += flat[i]
    return abs(total) < np.inf
