"""Arrays of particle indices whose final length is not known before they are filled."""

import numpy as np

from discsim.jit.decorators import jit_subroutine
from discsim.jit.index import index

MARGIN = index(4096)  # entries that may be added after one call of `ensure_capacity`


@jit_subroutine
def ensure_capacity(rows, count):
    """Return `rows` (n,), or a copy twice as long, so that MARGIN entries fit after the first `count` ones.

    count: an unsigned integer, as all indices here.
    """
    if count + MARGIN <= index(len(rows)):
        return rows
    out = np.empty(2 * len(rows), rows.dtype)
    for k in range(count):
        out[k] = rows[k]
    return out
