"""Bounds of batches of rows: `kernels/mpi/batches.py`, shared among threads."""

import numpy as np

from discsim.kernels.mpi import batches as kernels
from discsim.kernels.mpi.batches import BATCH
from discsim.numerics.threads import share

Array = np.ndarray
LEAST = 64  # batches that a thread takes at once


def bounds_of(pos: Array) -> Array:
    """Bounds (batches, 4) of places (n, d)."""
    return bounds_anew(np.empty((0, 4)), pos, np.empty(0, np.int64))


def bounds_anew(bounds: Array, pos: Array, rows: Array) -> Array:
    """Bounds of places (n, d) of which some `rows`, and all beyond those that there were, are others than before."""
    out = np.empty((-(-len(pos) // BATCH), 4))
    same = min(len(bounds), len(out))
    out[:same] = bounds[:same]
    changed = np.zeros(len(out), bool)
    changed[rows[rows < len(pos)] // BATCH] = True
    changed[max(same - 1, 0) :] = True  # the last one may have had fewer rows, or more
    some = np.flatnonzero(changed)
    share(kernels.bounds_of, len(some), some, pos, out, least=LEAST)
    return out
