"""Arrays of particle indices that grow while they are filled."""

import numpy as np

from discsim.jit.decorators import jit_subroutine
from discsim.jit.index import index

SOME = index(4096)  # particles examined between two checks of the room in an array


@jit_subroutine
def with_room(rows, count):
    """Return `rows`, or a longer copy, with room for SOME entries after the first `count` (np.uint64)."""
    if count + SOME <= index(len(rows)):
        return rows
    out = np.empty(2 * len(rows), rows.dtype)
    for k in range(count):
        out[k] = rows[k]
    return out
