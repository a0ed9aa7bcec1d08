"""The weights of a triangular-shaped cloud, and as polynomials within a cell.

There they are quadratic in the place, and so is what they bring of the nodes' values N_ij:

    sum_ij w_i(x) w_j(y) N_ij = sum_ab P_ab x^a y^b,    P = T' N T                                        (5)

with T the coefficients of w_-1, w_0 and w_1: (1/8, -1/2, 1/2), (3/4, 0, -1), (1/8, 1/2, 1/2).
"""

from discsim.jit.decorators import inner
from discsim.kernels.rows import LANES, empty_row, load, store


@inner
def cloud(x):
    """Weights on the nodes -1, 0 and 1 from its own of a particle, or of a row of them, at x in [-1/2, 1/2]."""
    low, high = 0.5 - x, 0.5 + x
    return 0.5 * low * low, 0.75 - x * x, 0.5 * high * high


@inner
def three(low, middle, high):
    """Coefficients of 1, x and x^2 of what three nodes in a row bring."""
    both = low + high
    return 0.125 * both + 0.75 * middle, 0.5 * (high - low), 0.5 * both - middle


@inner
def to_polynomial(table, begin, flat):
    """Eq. (5) in place, for all lanes of the nine rows of `table` from `begin` on: row 3 i + j the node's, 3 a + b the
    coefficient of x^a y^b; `flat`: of x alone.
    """
    for i in range(3):
        at = begin + 3 * i * LANES
        a, b, c = load(table, at + LANES), empty_row(), empty_row()
        if not flat:
            a, b, c = three(load(table, at), a, load(table, at + 2 * LANES))
        store(table, at, a)
        store(table, at + LANES, b)
        store(table, at + 2 * LANES, c)
    for j in range(3):
        at, next_row = begin + j * LANES, 3 * LANES
        a, b, c = three(load(table, at), load(table, at + next_row), load(table, at + 2 * next_row))
        store(table, at, a)
        store(table, at + next_row, b)
        store(table, at + 2 * next_row, c)


@inner
def quadratic(table, at, y):
    """The coefficients, from element `at` on, at y."""
    return load(table, at) + y * (load(table, at + LANES) + y * load(table, at + 2 * LANES))


@inner
def value_at(table, begin, x, y):
    """The polynomials' values."""
    middle, high = quadratic(table, begin + 3 * LANES, y), quadratic(table, begin + 6 * LANES, y)
    return quadratic(table, begin, y) + x * (middle + x * high)


@inner
def brought(table, k, x, y):
    """Lane k of the polynomials, of a row of places."""
    low = table[0, k] + y * (table[1, k] + y * table[2, k])
    middle = table[3, k] + y * (table[4, k] + y * table[5, k])
    high = table[6, k] + y * (table[7, k] + y * table[8, k])
    return low + x * (middle + x * high)
