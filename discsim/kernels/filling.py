"""Arrays of particles' numbers whose length is found while they are filled."""

import numpy as np

from discsim.jit.decorators import subroutine

SOME = np.uint64(4096)  # particles that are looked through before there has to be room for more of them


@subroutine
def with_room(rows, count):
    """`rows` with room for SOME more behind the first `count` (np.uint64) of them."""
    if count + SOME <= np.uint64(len(rows)):
        return rows
    out = np.empty(2 * len(rows), rows.dtype)
    for k in range(count):
        out[k] = rows[k]
    return out
