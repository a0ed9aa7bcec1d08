"""Gas in polar cells at the positions of grains, and sums over grains in cells.

A grain in the cell (i, j), at the fractions s and t of the cell beyond its middle in ln r and azimuth, has the weights

    w_ab = b_a(s) b_b(t),   b_-1 = (1/2 - s)^2 / 2,   b_0 = 3/4 - s^2,   b_1 = (1/2 + s)^2 / 2            (1)

of the cells (i + a, j + b): quadratic splines, with continuous gradients. Beyond an edge the ring at the edge takes the
weights of the missing ring. The gas at a grain is

    S = sum w Sigma,   c^2 = sum w Sigma c_cell^2 / S                                                     (2)

with the gradients of these sums. A quantity q of grains in a cell is the sum of w q over the grains near it. Grains are
sorted by cells, so that sums have the same order on any number of threads.
"""

import math
from typing import NamedTuple

import numpy as np

from discsim.jit.decorators import inline_jit, jit, jit_no_alloc
from discsim.kernels.dust.diffusion import DENSITY, LENGTH, SLOPES, SPEED2


class PolarPlaces(NamedTuple):
    """Places of grains among polar cells."""

    ring: np.ndarray  # (n,): ring of each grain; -1 beyond the edges of the grid
    column: np.ndarray  # (n,): cell in the ring
    offset: np.ndarray  # (n, 2): s and t of eq. (1)
    width: float  # of a ring in ln r


class SortedGrains(NamedTuple):
    """Grains sorted by cells."""

    order: np.ndarray  # (n,): indices of the grains
    start: np.ndarray  # (cells + 2,): first entry of each cell in `order`; grains beyond the edges come last


@jit_no_alloc
def find_places(first, last, pos, inner, rings_per_log, rings, angle, angles, places):
    """Write the places of grains at `pos` (n, 2).

    inner: radius of the inner edge. rings_per_log: rings per unit of ln r. angle: width of a cell.
    """
    for i in range(first, last):
        x, y = pos[i, 0], pos[i, 1]
        r = math.sqrt(x * x + y * y)
        radial = math.log(r / inner) * rings_per_log if r > 0.0 else -1.0
        if not 0.0 <= radial < rings:
            places.ring[i], places.column[i] = -1, 0
            places.offset[i, 0], places.offset[i, 1] = 0.0, 0.0
            continue
        around = math.atan2(y, x) / angle
        if around < 0.0:
            around += angles
        ring, column = int(radial), int(around)
        places.offset[i, 0], places.offset[i, 1] = radial - ring - 0.5, around - column - 0.5
        column = column if column < angles else 0
        places.ring[i], places.column[i] = ring, column


@inline_jit
def weights(t):
    """Return the three weights b of eq. (1)."""
    low, high = 0.5 - t, 0.5 + t
    return 0.5 * low * low, 0.75 - t * t, 0.5 * high * high


@inline_jit
def slopes(t):
    """Return the derivatives of the three weights b of eq. (1)."""
    return t - 0.5, -2.0 * t, t + 0.5


@inline_jit
def near_ring(ring, k, rings):
    """Return the ring `ring` + k - 1, or the ring at the edge beyond it."""
    return min(max(ring + k - 1, 0), rings - 1)


@inline_jit
def near_column(column, k, angles):
    """Return the cell `column` + k - 1 around a ring."""
    found = column + k - 1
    return found + angles if found < 0 else (found - angles if found >= angles else found)


@inline_jit
def weight_in_ring(places, g, ring, rings):
    """Return the sum of the radial weights of the grain `g` that belong to the ring `ring`."""
    w, found = weights(places.offset[g, 0]), 0.0
    for k in range(3):
        if near_ring(places.ring[g], k, rings) == ring:
            found += w[k]
    return found


@jit_no_alloc
def sample(first, last, pos, places, mass, speed2, geometry, field):
    """Write the gas (2) at grains to `field` (n, 7), in the columns of `kernels/dust/diffusion.py`.

    mass, speed2 (rings, angles): mass and c^2 of the cells. The length is the root of the area of a cell.
    """
    rings, angles = mass.shape
    width = places.width
    for g in range(first, last):
        for column in range(field.shape[1]):
            field[g, column] = 0.0
        if places.ring[g] < 0:
            continue
        s, t = places.offset[g, 0], places.offset[g, 1]
        across, along, slope, turn = weights(s), weights(t), slopes(s), slopes(t)
        total = rise = twist = heat = heat_rise = heat_twist = 0.0
        for a in range(3):
            i = near_ring(places.ring[g], a, rings)
            per_area = 1.0 / (geometry.volume[i] * geometry.angle)
            for b in range(3):
                j = near_column(places.column[g], b, angles)
                sigma = mass[i, j] * per_area
                hot = sigma * speed2[i, j]
                w, w_rise, w_twist = across[a] * along[b], slope[a] * along[b], across[a] * turn[b]
                total += w * sigma
                rise += w_rise * sigma
                twist += w_twist * sigma
                heat += w * hot
                heat_rise += w_rise * hot
                heat_twist += w_twist * hot
        x, y = pos[g, 0], pos[g, 1]
        r2 = x * x + y * y
        field[g, DENSITY], field[g, SPEED2] = total, heat / total
        field[g, LENGTH] = math.sqrt(r2 * width * geometry.angle)
        # Derivatives along ln r and azimuth, over r^2 for the Cartesian components.
        radial, around = rise / (total * width * r2), twist / (total * geometry.angle * r2)
        field[g, SLOPES], field[g, SLOPES + 1] = x * radial - y * around, y * radial + x * around
        if heat > 0.0:
            radial = heat_rise / (heat * width * r2) - radial
            around = heat_twist / (heat * geometry.angle * r2) - around
            field[g, SLOPES + 2], field[g, SLOPES + 3] = x * radial - y * around, y * radial + x * around


@jit_no_alloc
def sum_weights(first, last, places, values, out):
    """Write the sum of w times `values` (rings, angles) at each grain to `out` (n,); 0 beyond the edges."""
    rings, angles = values.shape
    for g in range(first, last):
        out[g] = 0.0
        if places.ring[g] < 0:
            continue
        across, along = weights(places.offset[g, 0]), weights(places.offset[g, 1])
        for a in range(3):
            i = near_ring(places.ring[g], a, rings)
            for b in range(3):
                out[g] += across[a] * along[b] * values[i, near_column(places.column[g], b, angles)]


@jit
def spread(first, last, places, grains, values, out):
    """Write the sum of w times `values` (n,) over grains to the cells of the rings `first` to `last`, `out`.

    grains: `SortedGrains`. out (rings, angles).
    """
    rings, angles = out.shape
    row = np.empty(angles)
    for i in range(first, last):
        row[:] = 0.0
        begin, end = grains.start[max(i - 1, 0) * angles], grains.start[min(i + 2, rings) * angles]
        for k in range(begin, end):
            g = grains.order[k]
            part, along = weight_in_ring(places, g, i, rings) * values[g], weights(places.offset[g, 1])
            for b in range(3):
                row[near_column(places.column[g], b, angles)] += part * along[b]
        for j in range(angles):
            out[i, j] = row[j]
