"""Cells of particles and lists of candidates: what `kernels/neighbours.py` does, shared among threads."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from discsim.kernels import neighbours as kernels
from discsim.kernels.neighbours import CELL_OVER_REACH, FIRST, LANES, MAX_CLASSES, NX, REACH, SIDE_X, Cells
from discsim.numerics.sorting import counting_sort
from discsim.numerics.threads import share

Array = np.ndarray
LEAST = 64  # the fewest cells that a thread takes at once


def box_about(pos: Array) -> tuple[Array, Array]:
    """Lower corner and widths (2,) of the box about positions (n, d), in one dimension flat."""
    low, width = np.zeros(2), np.zeros(2)
    least, most = _extremes(pos)
    low[: len(least)], width[: len(least)] = least, most - least
    width[0] = max(width[0], 1e-300)
    return low, width


def sort_into_cells(pos: Array, h: Array, extent: float, low: Array, width: Array, periodic: bool) -> Cells:
    """Cells of all particles, whose supports are `extent` times h (n,).

    `low` and `width` (2,) are the box; in 1D width[1] is 0.
    """
    least, most = (extent * float(h_extreme[0]) for h_extreme in _extremes(h[:, None]))
    edges = (1.0 + 1e-12) * max(2.0 * least, most * 2.0 ** (1 - MAX_CLASSES)) * 2.0 ** np.arange(MAX_CLASSES)
    classes = np.empty(len(pos), np.uint8)
    found = np.array(share(kernels.size_classes, len(pos), h, extent, edges, classes))
    grids, count = _lay_grids(found[:, 0].sum(axis=0), found[:, 1].max(axis=0), low, width, periodic)
    key = np.empty(len(pos), np.uint32)
    share(kernels.cell_keys, len(pos), pos, classes, grids, low, key)
    order, start = counting_sort(key, count)
    x, y, radius = np.zeros((3, len(pos) + LANES))  # as much as loops over whole vectors look at
    bounds = np.empty((count, 5))
    share(kernels.lay_out, count, pos, h, extent, order, start, x, y, radius, bounds)
    filled = np.flatnonzero(np.diff(start))
    return Cells(filled, key, grids, order, start, x, y, radius, bounds, low, width, periodic)


def candidates(points: Cells, among: Cells, mutual: bool, extent: float = 1.0) -> list[Any]:
    """Of each cell of `points`, particles of `among` within `extent` times its reach; by the pieces of `share`."""
    given = points.filled, points.bounds, extent, mutual, among
    return share(kernels.list_candidates, len(points.filled), *given, least=LEAST)


def _extremes(values: Array) -> tuple[Array, Array]:
    # Least and largest of each column.
    found = np.array(share(kernels.extremes, len(values), values))
    return found[:, 0].min(axis=0), found[:, 1].max(axis=0)


def _lay_grids(members: Array, reach: Array, low: Array, width: Array, periodic: bool) -> tuple[Array, int]:
    """The table of grids over the box [low, low + width], with at most some cells a particle, and how many cells."""
    count = int(np.flatnonzero(members)[-1]) + 1
    grids = np.zeros((count, 6))
    grids[:, REACH] = reach[:count]
    sides = width.tolist()  # Python's numbers overflow in silence
    first = 0
    for k, (held, widest) in enumerate(zip(members[:count].tolist(), reach[:count].tolist(), strict=True)):
        # A class may be empty where h jumps: then one cell that holds nobody.
        side = CELL_OVER_REACH * widest if held > 0 else max(sides)
        most = 16.0 * held + 64.0
        # Few particles far apart: coarser cells rather than an array of empty ones.
        if (sides[0] / side + 1.0) * (sides[1] / side + 1.0) > most:
            area = max(sides[0], side) * max(sides[1], side)
            side = max(side, math.sqrt(area / most), sides[0] / most, sides[1] / most)
        grids[k, FIRST] = first
        for axis in range(2):
            along = sides[axis] / side
            n = math.floor(along) if along >= 1.0 else 1  # also of places that are no numbers: a kick will say so
            grids[k, NX + axis] = n
            grids[k, SIDE_X + axis] = max(sides[axis] / n, 1e-300) if periodic or n > 1 else max(sides[axis], side)
        first += int(grids[k, NX] * grids[k, NX + 1])
    return grids, first
