"""Element-wise loops over particle arrays: copies, kicks and drifts (y += dt x), and the wrap into a periodic box.

Each kernel processes the rows `begin` to `end`, for `discsim.numerics.threads.parallel_for`.
"""

from discsim.jit.decorators import jit
from discsim.jit.index import index


@jit
def take_rows(begin, end, source, rows, out):
    """Set out[i] = source[rows[i]]; `source` and `out` are (n, d), `rows` (n,) are indices."""
    if out.shape[1] == 2:
        for i in range(index(begin), index(end)):
            out[i, 0], out[i, 1] = source[rows[i], 0], source[rows[i], 1]
        return
    for i in range(begin, end):
        for k in range(out.shape[1]):
            out[i, k] = source[rows[i], k]


@jit
def copy(begin, end, out, source):
    """Set out = source; both are (n, ...)."""
    target, origin, width = out.reshape(-1), source.reshape(-1), max(1, out.size // max(1, len(out)))
    for i in range(index(begin * width), index(end * width)):
        target[i] = origin[i]


@jit
def set_to_zero(begin, end, out):
    """Set `out` (n, d) to 0."""
    target, width = out.reshape(-1), out.shape[1]
    for i in range(index(begin * width), index(end * width)):
        target[i] = 0.0


@jit
def rate_of_change(begin, end, after, before, dt, out):
    """Set out = (after - before) / dt; all arrays are (n, d)."""
    target, new, old, dim = out.reshape(-1), after.reshape(-1), before.reshape(-1), out.shape[1]
    for i in range(index(begin * dim), index(end * dim)):
        target[i] = (new[i] - old[i]) / dt


@jit
def add_scaled(begin, end, y, x, dt):
    """Add dt * x to y in place; both are (n, d)."""
    out, source, dim = y.reshape(-1), x.reshape(-1), y.shape[1]  # flat arrays: one loop, which is vectorised
    for i in range(index(begin * dim), index(end * dim)):
        out[i] += dt * source[i]


@jit
def sum_scaled(begin, end, y, x, dt, out):
    """Set out = y + dt * x; all arrays are (n, d)."""
    target, first, second, dim = out.reshape(-1), y.reshape(-1), x.reshape(-1), y.shape[1]
    for i in range(index(begin * dim), index(end * dim)):
        target[i] = first[i] + dt * second[i]


@jit
def wrap(begin, end, pos, size):
    """Bring the positions `pos` (n, d) back into the periodic box [0, size), in place."""
    for i in range(begin, end):
        for k in range(pos.shape[1]):
            x = pos[i, k]
            if x < 0.0 or x >= size[k]:
                x -= size[k] * (x // size[k])
                pos[i, k] = x if x < size[k] else 0.0  # a tiny negative x rounds up to the edge
