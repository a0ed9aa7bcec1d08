"""Weights of the triangular-shaped cloud (TSC), and interpolation with them as a polynomial within a cell.

Within a cell, the interpolation of values N_ij at the nodes is a polynomial of second degree in x and in y:

    sum_ij w_i(x) w_j(y) N_ij = sum_ab P_ab x^a y^b,    P = T' N T                                        (5)

where the rows of T are the coefficients of w_-1, w_0 and w_1: (1/8, -1/2, 1/2), (3/4, 0, -1), (1/8, 1/2, 1/2).
"""

from discsim.jit.decorators import inline_jit
from discsim.kernels.common.simd import LANES, load, store, zeros


@inline_jit
def tsc_weights(x):
    """Return the weights of a particle on the nodes -1, 0 and 1; x in [-1/2, 1/2] is its position from node 0.

    x may be a number or a vector.
    """
    low, high = 0.5 - x, 0.5 + x
    return 0.5 * low * low, 0.75 - x * x, 0.5 * high * high


@inline_jit
def tsc_coefficients(low, middle, high):
    """Return the coefficients of 1, x and x^2 of the interpolation from the values at the nodes -1, 0 and 1."""
    both = low + high
    return 0.125 * both + 0.75 * middle, 0.5 * (high - low), 0.5 * both - middle


@inline_jit
def to_polynomial(table, begin, flat):
    """Replace the values of nine nodes by the coefficients of eq. (5), in place, in all lanes of nine rows of `table`.

    The rows begin at element `begin`. Row 3 i + j has the value of node (i, j) on input, and the coefficient of x^i y^j
    on output. flat: whether the polynomial depends on x alone.
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
    """Return the quadratic polynomials at y in all lanes; the three rows of coefficients begin at element `at`."""
    return load(table, at) + y * (load(table, at + LANES) + y * load(table, at + 2 * LANES))


@inline_jit
def evaluate(table, begin, x, y):
    """Return the polynomials of eq. (5) at (x, y) in all lanes; their nine rows begin at element `begin` of `table`."""
    middle, high = quadratic(table, begin + 3 * LANES, y), quadratic(table, begin + 6 * LANES, y)
    return quadratic(table, begin, y) + x * (middle + x * high)


@inline_jit
def evaluate_lane(table, k, x, y):
    """Return the polynomial of eq. (5) in lane k of `table` (9, LANES) at (x, y), which are numbers or vectors."""
    low = table[0, k] + y * (table[1, k] + y * table[2, k])
    middle = table[3, k] + y * (table[4, k] + y * table[5, k])
    high = table[6, k] + y * (table[7, k] + y * table[8, k])
    return low + x * (middle + x * high)


@inline_jit
def slope_weight(k):
    """Return the weight of the cell k of the nine cells about a node in fits of slopes; nearer cells weigh more."""
    return (0.5 if k // 3 == 1 else 0.25) * (0.5 if k % 3 == 1 else 0.25)
