"""Bounding boxes of batches, each of BATCH consecutive particles, computed on several threads."""

import numpy as np

from discsim.kernels.mpi import batches as kernels
from discsim.kernels.mpi.batches import BATCH
from discsim.numerics.threads import parallel_for

Array = np.ndarray
LEAST = 64  # least number of batches in a chunk


def bounds_of(pos: Array) -> Array:
    """Return the bounding box of each batch of positions (n, d): smallest x, largest x, smallest y, largest y.

    The result is (batches, 4).
    """
    return update_bounds(np.empty((0, 4)), pos, np.empty(0, np.int64))


def update_bounds(bounds: Array, pos: Array, rows: Array) -> Array:
    """Return new bounds (batches, 4) of positions (n, d), from the former `bounds`.

    rows: rows whose positions have changed. The number of rows may have changed too.
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
