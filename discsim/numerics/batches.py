"""Bounding boxes of batches of BATCH consecutive particles, computed on several threads."""

import numpy as np

from discsim.kernels.mpi import batches as kernels
from discsim.kernels.mpi.batches import BATCH
from discsim.numerics.threads import parallel_for

Array = np.ndarray
LEAST = 64  # least number of batches in a chunk


def bounds_of(pos: Array) -> Array:
    """Return the bounding boxes (batches, 4) of the batches of positions `pos` (n, d).

    The columns are the smallest x, the largest x, the smallest y and the largest y.
    """
    return update_bounds(np.empty((0, 4)), pos, np.empty(0, np.int64))


def update_bounds(bounds: Array, pos: Array, rows: Array) -> Array:
    """Return the bounding boxes of `pos`, as `bounds_of`, from `bounds`, the boxes of earlier positions.

    rows: rows whose positions have changed since. The number of positions may have changed too.
    """
    out = np.empty((-(-len(pos) // BATCH), 4))
    same = min(len(bounds), len(out))
    out[:same] = bounds[:same]
    changed = np.zeros(len(out), bool)
    changed[rows[rows < len(pos)] // BATCH] = True
    changed[max(same - 1, 0) :] = True  # the last batch may have had another number of rows
    some = np.flatnonzero(changed)
    parallel_for(kernels.bounds_of, len(some), some, pos, out, least=LEAST)
    return out
