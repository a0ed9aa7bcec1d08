"""Parabolas in cells: the piecewise-parabolic reconstruction of Colella & Woodward 1984 (CW84), one cell at a time.

With the slopes d of (1.7) without limits, a cell with the mean a has at its upper side the value (1.6)

    a_(i+1/2) = a_i + e_0 (a_(i+1) - a_i) + e_1 d_(i+1) + e_2 d_i                                       (1)

in terms of the cell volumes, exact for cubics. The limits keep smooth extrema (Colella & Sekora 2008; McCorquodale &
Colella 2011, sec. 2.4): a side beyond the means of both cells, and the parabola of a cell at an extremum, keep a second
difference of at most LARGEST times that of each cell about them, or none if the signs differ. Other parabolas have no
extremum inside (CW84, 1.10). A parabola at an extremum that would change its sign in the cell is flat, so that
densities stay positive. The mean of the parabola over the fraction y of the volume next to a side is (1.12).
"""

import numpy as np

from discsim.jit.decorators import inline_jit, jit_subroutine

LARGEST = 1.25
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
def limited_side(value, left, right, curved_left, curved_right):
    """Return the value at a side, limited if it is beyond both means; curved_left, curved_right: second differences.

    Between means of one sign, the value has this sign too.
    """
    curve = 3.0 * (left - 2.0 * value + right)
    size = min(abs(curve), LARGEST * min(abs(curved_left), abs(curved_right)))
    kept = size if curve > 0.0 else -size
    is_smooth = (curved_left * curved_right > 0.0) & (curved_left * curve > 0.0)
    beyond = 0.5 * (left + right) - (kept if is_smooth else 0.0) / 6.0
    found = beyond if (value - left) * (right - value) < 0.0 else value
    smaller = left if abs(left) < abs(right) else right
    return smaller if (found * left < 0.0) & (found * right < 0.0) else found


@inline_jit
def cell_sides(two_below, below, mean, above, two_above, k):
    """Return the values at the lower and the upper side of a cell's parabola, from the means of five cells.

    k: the 12 coefficients of the cell, a tuple.
    """
    d1, d2, d3, d4 = below - two_below, mean - below, above - mean, two_above - above
    c1, c2, c3 = d2 - d1, d3 - d2, d4 - d3
    own = k[2] * d3 + k[3] * d2
    low = below + k[6] * d2 + k[7] * own + k[8] * (k[0] * d2 + k[1] * d1)
    high = mean + k[9] * d3 + k[10] * (k[4] * d4 + k[5] * d3) + k[11] * own
    low, high = limited_side(low, below, mean, c1, c2), limited_side(high, mean, above, c2, c3)
    down, up = mean - low, high - mean
    # At an extremum the parabola keeps a part of its curvature.
    curve = 6.0 * (up - down)
    size = min(abs(curve), LARGEST * min(abs(c1), min(abs(c2), abs(c3))))
    is_smooth = (c1 * c2 > 0.0) & (c2 * c3 > 0.0) & (c2 * curve > 0.0)
    kept = size / abs(curve) if is_smooth else 0.0
    flat_down, flat_up = kept * down, kept * up
    jump, bulge = flat_up + flat_down, 3.0 * (flat_down - flat_up)
    middle = mean - 0.25 * (flat_up - flat_down)
    changes_sign = (4.0 * bulge * middle + jump * jump) * bulge * mean <= 0.0
    flat_down, flat_up = (0.0 if changes_sign else flat_down), (0.0 if changes_sign else flat_up)
    # Elsewhere the extremum of the parabola is moved to a side.
    steep_up = min(abs(up), 2.0 * abs(down))
    steep_down = min(abs(down), 2.0 * abs(up))
    sign = 1.0 if up > 0.0 else -1.0
    is_extremum = (up * down <= 0.0) | (d2 * d3 <= 0.0)
    to_low, to_high = (flat_down if is_extremum else sign * steep_down), (flat_up if is_extremum else sign * steep_up)
    return mean - to_low, mean + to_high


@inline_jit
def part_mean(near, far, mean, y):
    """Return the mean of a parabola over the fraction `y` of the cell next to the side with the value `near`.

    far: value at the opposite side. mean: mean of the cell.
    """
    bulge = 6.0 * (mean - 0.5 * (near + far))
    return near - 0.5 * y * ((near - far) - (1.0 - 2.0 / 3.0 * y) * bulge)


@inline_jit
def change_within(near, far, mean, y):
    """Return the change of a parabola from the side with the value `near` to the fraction `y` of the cell from it.

    far: value at the opposite side. mean: mean of the cell.
    """
    return y * ((far - near) + (1.0 - y) * 6.0 * (mean - 0.5 * (near + far)))


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
