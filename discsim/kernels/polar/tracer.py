"""Motion of small dust with the gas in polar cells, as a share q of the mass (`transport.py`).

The mass that passes a side carries the mean of the parabola of q over the swept part of the cell that it leaves. Where
q and the density are steep, this could be more than the cell has. The mean is therefore limited to

    q_cell m_cell / m,   or q_cell if gas leaves the cell through the opposite side too,                 (1)

with the mass m that passes the side. Small dust is conserved to rounding and not negative, and a uniform q stays
uniform.
"""

from typing import NamedTuple

import numpy as np

from discsim.jit.decorators import inline_jit, jit
from discsim.kernels.polar.geometry import GHOSTS, fill_positive, pad_row
from discsim.kernels.polar.parabola import part_mean, sides_along_ring, sides_of_ring


class Passed(NamedTuple):
    """Gas that passed the sides of the cells in a sweep; arrays without entries if nothing moves with the gas.

    mass, part (rings + 1, angles + 1): mass that passed each side, and the fraction of the cell behind that it filled,
    or -1 times that of the cell ahead. shift (rings,): whole cells by which each ring moved.
    """

    mass: np.ndarray
    part: np.ndarray
    shift: np.ndarray


@inline_jit
def carried_share(low, high, mean, y, passed, held, leaves_twice):
    """Return the mean share of the mass `passed` that leaves a cell through one side, limited by (1).

    low, high, mean: share at both sides of the cell, and its mean. y: swept fraction of the cell, negative at its lower
    side. held: mass of the cell before. leaves_twice: whether gas leaves through the opposite side too.
    """
    near, far = (high, low) if y > 0.0 else (low, high)
    most = mean if leaves_twice else mean * held / abs(passed)
    return min(max(part_mean(near, far, mean, abs(y)), 0.0), most)


@jit
def fill_share_ghosts(share):
    """Fill the ghost rings of `share` (rings + 4, angles)."""
    fill_positive(share)


@jit
def carry_radially(first, last, share, before, after, passed, swept, geometry, new):
    """Write the shares of the rings `first` to `last` after a radial sweep, and return what leaves the edges (2,).

    share (rings + 4, angles): before the sweep, with ghosts. before, after (rings + 4, angles): surface densities.
    swept: result of `transport.find_swept`, which has the signs of `passed.part` at the next sides too.
    """
    angles, rings = share.shape[1], len(geometry.radius)
    sides, flux, lost = np.zeros((2, 2, angles)), np.zeros((2, angles)), np.zeros(2)
    for side in range(first, last + 1):
        old, now = (side + 1) % 2, side % 2
        if side == first and side > 0:
            sides_of_ring(share, side + GHOSTS - 1, geometry.weights, sides[old, 0], sides[old, 1])
        if side < rings:
            sides_of_ring(share, side + GHOSTS, geometry.weights, sides[now, 0], sides[now, 1])
        for j in range(angles):
            y, mass = passed.part[side, j], passed.mass[side, j]
            if y == 0.0 or mass == 0.0:
                flux[now, j] = 0.0
                continue
            k, which = (side - 1, old) if y > 0.0 else (side, now)
            twice = swept[side - 1, j] < 0.0 if y > 0.0 else swept[side + 1, j] > 0.0
            held = before[k + GHOSTS, j] * geometry.volume[k]
            flux[now, j] = mass * carried_share(
                sides[which, 0, j], sides[which, 1, j], share[k + GHOSTS, j], y, mass, held, twice
            )
        if side > first:
            row, volume = side - 1 + GHOSTS, geometry.volume[side - 1]
            for j in range(angles):
                left = before[row, j] * volume * share[row, j] + flux[old, j] - flux[now, j]
                new[row, j] = max(left, 0.0) / (after[row, j] * volume)
        for edge in range(2):
            if side == edge * rings:
                for j in range(angles):
                    lost[edge] += (2.0 * edge - 1.0) * geometry.angle * flux[now, j]
    return lost


@jit
def carry_around(first, last, share, before, after, passed, new):
    """Write the shares of the rings `first` to `last` after an azimuthal sweep; arguments as in `carry_radially`."""
    angles = share.shape[1]
    padded, flux = np.empty(angles + 6), np.empty(angles + 1)
    low, high = np.empty(angles + 2), np.empty(angles + 2)
    for i in range(first, last):
        row = i + GHOSTS
        pad_row(share[row], 0.0, padded)
        sides_along_ring(padded, low, high)
        for j in range(angles + 1):
            y, mass = passed.part[i, j], passed.mass[i, j]
            if y == 0.0 or mass == 0.0:
                flux[j] = 0.0
                continue
            k = j if y > 0.0 else j + 1  # of the cell that the gas leaves, among the sides
            cell = k - 1 if 0 < k <= angles else (angles - 1 if k == 0 else 0)
            behind, ahead = (j - 1 if j > 0 else angles - 1), (j + 1 if j < angles else 1)
            twice = passed.part[i, behind] < 0.0 if y > 0.0 else passed.part[i, ahead] > 0.0
            flux[j] = mass * carried_share(low[k], high[k], padded[k + 2], y, mass, before[row, cell], twice)
        for j in range(angles):
            to = j + passed.shift[i]
            to = to - angles if to >= angles else to
            left = before[row, j] * share[row, j] + flux[j] - flux[j + 1]
            new[row, to] = max(left, 0.0) / after[row, to]
