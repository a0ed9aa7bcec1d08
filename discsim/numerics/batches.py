"""Bounding boxes of batches of rows, computed by `kernels/mpi/batches.py` on several threads."""

import numpy as np

from discsim.kernels.mpi import batches as kernels
from discsim.kernels.mpi.batches import BATCH
from discsim.numerics.threads import parallel_for

Array = np.ndarray
LEAST = 64  # least number of batches in a chunk


def bounds_of(pos: Array) -> Array:
    """Return the bounds (batches, 4) of positions (n, d): least and largest x, then y."""
    return bounds_anew(np.empty((0, 4)), pos, np.empty(0, np.int64))


def bounds_anew(bounds: Array, pos: Array, rows: Array) -> Array:
    """Return `bounds` updated for positions (n, d) after a change of some `rows` and of the number of rows."""
    out = np.empty((-(-len(pos) // BATCH), 4))
    same = min(len(bounds), len(out))
    out[:same] = bounds[:same]
    changed = np.zeros(len(out), bool)
    changed[rows[rows < len(pos)] // BATCH] = True
    changed[max(same - 1, 0) :] = True  # the last batch may have had another number of rows
    some = np.flatnonzero(changed)
    parallel_for(kernels.bounds_of, len(some), some, pos, out, least=LEAST)
    return out
