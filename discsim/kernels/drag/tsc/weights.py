"""Weights of a triangular-shaped cloud, and as polynomials within a cell.

Within a cell the weights are quadratic in the position, and so is the interpolation of the nodes' values N_ij:

    sum_ij w_i(x) w_j(y) N_ij = sum_ab P_ab x^a y^b,    P = T' N T                                        (5)

with T the coefficients of w_-1, w_0 and w_1: (1/8, -1/2, 1/2), (3/4, 0, -1), (1/8, 1/2, 1/2).
"""

from discsim.jit.decorators import inline_jit
from discsim.kernels.common.simd import LANES, load, store, zeros


@inline_jit
def cloud(x):
    """Return the weights on the nodes -1, 0 and 1 from a particle's own, at x in [-1/2, 1/2], a number or a vector."""
    low, high = 0.5 - x, 0.5 + x
    return 0.5 * low * low, 0.75 - x * x, 0.5 * high * high


@inline_jit
def tsc_coefficients(low, middle, high):
    """Return the coefficients of 1, x and x^2 in the interpolation from three nodes in a line."""
    both = low + high
    return 0.125 * both + 0.75 * middle, 0.5 * (high - low), 0.5 * both - middle


@inline_jit
def to_polynomial(table, begin, flat):
    """Apply eq. (5) in place to all lanes of the nine rows of `table` from element `begin` on.

    Row 3 i + j has the value of node (i, j) before, and row 3 a + b the coefficient of x^a y^b afterwards; `flat`: of
    x alone.
    """
    for i in range(3):
        at = begin + 3 * i * LANES
        a, b, c = load(table, at + LANES), zeros(), zeros()
        if not flat:
            a, b, c = tsc_coefficients(load(table, at), a, load(table, at + 2 * LANES))
        store(table, at, a)
        store(table, at + LANES, b)
        store(table, at + 2 * LANES, c)
    for j in range(3):
        at, next_row = begin + j * LANES, 3 * LANES
        a, b, c = tsc_coefficients(load(table, at), load(table, at + next_row), load(table, at + 2 * next_row))
        store(table, at, a)
        store(table, at + next_row, b)
        store(table, at + 2 * next_row, c)


@inline_jit
def quadratic(table, at, y):
    """Return the quadratic polynomials at y whose coefficients begin at element `at`."""
    return load(table, at) + y * (load(table, at + LANES) + y * load(table, at + 2 * LANES))


@inline_jit
def evaluate(table, begin, x, y):
    """Return the values of the polynomials at (x, y), in all lanes."""
    middle, high = quadratic(table, begin + 3 * LANES, y), quadratic(table, begin + 6 * LANES, y)
    return quadratic(table, begin, y) + x * (middle + x * high)


@inline_jit
def evaluate_lane(table, k, x, y):
    """Return lane k of the polynomials at (x, y), numbers or vectors."""
    low = table[0, k] + y * (table[1, k] + y * table[2, k])
    middle = table[3, k] + y * (table[4, k] + y * table[5, k])
    high = table[6, k] + y * (table[7, k] + y * table[8, k])
    return low + x * (middle + x * high)
