"""Kick and drift: y += dt x, and the wrap into a periodic box. For `discsim.threads.share`."""

from numba import njit


@njit(nogil=True, cache=True, error_model="numpy")
def add_scaled(begin, end, y, x, dt):
    """y += dt x for arrays (n, d)."""
    for i in range(begin, end):
        for k in range(y.shape[1]):
            y[i, k] += dt * x[i, k]


@njit(nogil=True, cache=True, error_model="numpy")
def wrap(begin, end, pos, size):
    """Bring positions (n, d) back into [0, size)."""
    for i in range(begin, end):
        for k in range(pos.shape[1]):
            x = pos[i, k]
            if x < 0.0 or x >= size[k]:
                x -= size[k] * (x // size[k])
                pos[i, k] = x if x < size[k] else 0.0  # a tiny negative x rounds up to the edge
