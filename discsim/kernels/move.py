"""Kick and drift: y += dt x, the wrap into a periodic box, and reordering. For `discsim.numerics.threads.share`."""

import numpy as np

from discsim.kernels.inner import compiled


@compiled
def take_rows(begin, end, source, index, out):
    """out[i] = source[index[i]] for arrays (n, d)."""
    if out.shape[1] == 2:
        for i in range(np.uint64(begin), np.uint64(end)):
            out[i, 0], out[i, 1] = source[index[i], 0], source[index[i], 1]
        return
    for i in range(begin, end):
        for k in range(out.shape[1]):
            out[i, k] = source[index[i], k]


@compiled
def add_scaled(begin, end, y, x, dt):
    """y += dt x for arrays (n, d)."""
    out, source, dim = y.reshape(-1), x.reshape(-1), y.shape[1]  # one loop: vectorised
    for i in range(np.uint64(begin * dim), np.uint64(end * dim)):
        out[i] += dt * source[i]


@compiled
def wrap(begin, end, pos, size):
    """Bring positions (n, d) back into [0, size)."""
    for i in range(begin, end):
        for k in range(pos.shape[1]):
            x = pos[i, k]
            if x < 0.0 or x >= size[k]:
                x -= size[k] * (x // size[k])
                pos[i, k] = x if x < size[k] else 0.0  # a tiny negative x rounds up to the edge
