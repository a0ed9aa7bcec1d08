"""Kick and drift (y += dt x), wrap into a periodic box, copies, reordering and rates of change of arrays.

For `discsim.numerics.threads.parallel_for`.
"""

from discsim.jit.decorators import jit
from discsim.jit.index import index


@jit
def take_rows(begin, end, source, rows, out):
    """Set out[i] = source[rows[i]] for arrays (n, d)."""
    if out.shape[1] == 2:
        for i in range(index(begin), index(end)):
            out[i, 0], out[i, 1] = source[rows[i], 0], source[rows[i], 1]
        return
    for i in range(begin, end):
        for k in range(out.shape[1]):
            out[i, k] = source[rows[i], k]


@jit
def assign(begin, end, out, source):
    """Set out = source for arrays (n, ...)."""
    to, of, width = out.reshape(-1), source.reshape(-1), max(1, out.size // max(1, len(out)))
    for i in range(index(begin * width), index(end * width)):
        to[i] = of[i]


@jit
def blank(begin, end, out):
    """Set out = 0 for an array (n, d)."""
    to, width = out.reshape(-1), out.shape[1]
    for i in range(index(begin * width), index(end * width)):
        to[i] = 0.0


@jit
def rate_of_change(begin, end, after, before, dt, out):
    """Set out = (after - before) / dt for arrays (n, d)."""
    to, new, old, dim = out.reshape(-1), after.reshape(-1), before.reshape(-1), out.shape[1]
    for i in range(index(begin * dim), index(end * dim)):
        to[i] = (new[i] - old[i]) / dt


@jit
def add_scaled(begin, end, y, x, dt):
    """Add dt x to y, arrays (n, d)."""
    out, source, dim = y.reshape(-1), x.reshape(-1), y.shape[1]  # one loop: vectorised
    for i in range(index(begin * dim), index(end * dim)):
        out[i] += dt * source[i]


@jit
def sum_scaled(begin, end, y, x, dt, out):
    """Set out = y + dt x for arrays (n, d)."""
    to, first, second, dim = out.reshape(-1), y.reshape(-1), x.reshape(-1), y.shape[1]
    for i in range(index(begin * dim), index(end * dim)):
        to[i] = first[i] + dt * second[i]


@jit
def wrap(begin, end, pos, size):
    """Bring positions (n, d) back into [0, size)."""
    for i in range(begin, end):
        for k in range(pos.shape[1]):
            x = pos[i, k]
            if x < 0.0 or x >= size[k]:
                x -= size[k] * (x // size[k])
                pos[i, k] = x if x < size[k] else 0.0  # a tiny negative x rounds up to the edge
