"""Parabolas in cells: the piecewise-parabolic reconstruction of Colella & Woodward 1984 (CW84), one cell at a time.

A cell with the mean a and limited slope d (1.7, 1.8) has at its upper side the value (1.6)

    a_(i+1/2) = a_i + e_0 (a_(i+1) - a_i) + e_1 d_(i+1) + e_2 d_i                                       (1)

in terms of the cell volumes, and a parabola without an extremum inside (1.10). The mean of the parabola over the
fraction y of the volume next to a side is (1.12).
"""

import numpy as np

from discsim.jit.decorators import inline_jit, jit_subroutine

COEFFICIENTS = 12  # numbers per cell in `side_coefficients`
# Coefficients of cells of equal size: slopes of the cells i - 1, i and i + 1, then eq. (1) at the lower and upper side.
EVEN = (0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, -1.0 / 6.0, 1.0 / 6.0, 0.5, -1.0 / 6.0, 1.0 / 6.0)


def side_coefficients(volume: np.ndarray) -> np.ndarray:
    """Return the coefficients (n, 12) of cells with the volumes `volume` (n,) for `cell_sides`.

    Columns 0 to 5: weights of the differences a_(k+1) - a_k and a_k - a_(k-1) in the slopes of the cells k = i - 1, i
    and i + 1. Columns 6 to 11: e_0, e_1 and e_2 of eq. (1) at the lower and at the upper side of the cell i. The first
    two and the last two rows are not used.
    """
    v = volume
    up, down = np.full((2, len(v)), 0.5)
    both = v[:-2] + v[1:-1] + v[2:]
    up[1:-1] = v[1:-1] / both * (2.0 * v[:-2] + v[1:-1]) / (v[2:] + v[1:-1])
    down[1:-1] = v[1:-1] / both * (v[1:-1] + 2.0 * v[2:]) / (v[:-2] + v[1:-1])
    # Eq. (1) at the side between the cells b and c, with the cells a and d beyond them.
    side = np.tile([0.5, -1.0 / 6.0, 1.0 / 6.0], (len(v), 1))
    a, b, c, d = v[:-3], v[1:-2], v[2:-1], v[3:]
    below, above = (a + b) / (2.0 * b + c), (c + d) / (2.0 * c + b)
    side[1:-2, 0] = b / (b + c) + 2.0 * b * c / (b + c) * (below - above) / (a + b + c + d)
    side[1:-2, 1] = -b * below / (a + b + c + d)
    side[1:-2, 2] = c * above / (a + b + c + d)
    out = np.empty((len(v), COEFFICIENTS))
    for k in range(3):
        out[:, 2 * k], out[:, 2 * k + 1] = np.roll(up, 1 - k), np.roll(down, 1 - k)
    out[:, 6:9], out[:, 9:] = np.roll(side, 1, axis=0), side
    return out


@inline_jit
def limited_slope(slope, down, up):
    """Return the slope of a cell, limited by twice the differences to both neighbours; 0 at an extremum (1.8)."""
    size = min(abs(slope), 2.0 * min(abs(down), abs(up)))
    signed = size if up > 0.0 else -size
    return signed if down * up > 0.0 else 0.0


@inline_jit
def cell_sides(two_below, below, mean, above, two_above, k):
    """Return the values at the lower and the upper side of a cell's parabola, from the means of five cells.

    k: the 12 coefficients of the cell, a tuple.
    """
    d1, d2, d3, d4 = below - two_below, mean - below, above - mean, two_above - above
    lower = limited_slope(k[0] * d2 + k[1] * d1, d1, d2)
    own = limited_slope(k[2] * d3 + k[3] * d2, d2, d3)
    upper = limited_slope(k[4] * d4 + k[5] * d3, d3, d4)
    low = below + k[6] * d2 + k[7] * own + k[8] * lower
    high = mean + k[9] * d3 + k[10] * upper + k[11] * own
    jump, bulge = high - low, 6.0 * (mean - 0.5 * (low + high))
    steep_high = jump * bulge > jump * jump
    steep_low = -jump * jump > jump * bulge
    flat = (high - mean) * (mean - low) <= 0.0
    new_low = 3.0 * mean - 2.0 * high if steep_high else low
    new_high = 3.0 * mean - 2.0 * low if steep_low else high
    return (mean if flat else new_low), (mean if flat else new_high)


@inline_jit
def part_mean(near, far, mean, y):
    """Return the mean of a parabola over the fraction `y` of the cell next to the side with the value `near`.

    far: value at the opposite side. mean: mean of the cell.
    """
    bulge = 6.0 * (mean - 0.5 * (near + far))
    return near - 0.5 * y * ((near - far) - (1.0 - 2.0 / 3.0 * y) * bulge)


@jit_subroutine
def sides_of_ring(values, i, k, low, high):
    """Write the values at both sides of the radial parabolas of ring `i` to `low` and `high` (angles,).

    values (rings, angles): means of cells, with at least two rings on both sides of ring `i`. k (rings, 12):
    `side_coefficients`.
    """
    c = (k[i, 0], k[i, 1], k[i, 2], k[i, 3], k[i, 4], k[i, 5], k[i, 6], k[i, 7], k[i, 8], k[i, 9], k[i, 10], k[i, 11])
    v0, v1, v2, v3, v4 = values[i - 2], values[i - 1], values[i], values[i + 1], values[i + 2]
    for j in range(len(low)):
        low[j], high[j] = cell_sides(v0[j], v1[j], v2[j], v3[j], v4[j], c)


@jit_subroutine
def sides_along_ring(padded, low, high):
    """Write the values at both sides of the azimuthal parabolas of a ring to `low` and `high` (n,).

    padded (n + 4,): means of cells, with two more cells at both ends.
    """
    for j in range(len(low)):
        low[j], high[j] = cell_sides(padded[j], padded[j + 1], padded[j + 2], padded[j + 3], padded[j + 4], EVEN)
