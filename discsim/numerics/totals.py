"""Exact sums over particles, rounded once.

Results are bitwise the same for any order of the particles and any number of threads and processes. Kernels accumulate
a sum as a fixed-point integer in limbs (integers of 32 bits each); a last limb counts entries that are not finite.
"""

from __future__ import annotations

import math

import numpy as np

from discsim.numerics import world
from discsim.numerics.threads import parallel_for
from discsim.parts import Lazy

kernels = Lazy("discsim.kernels.common.totals")
Array = np.ndarray
UNIT = 1 << 1075  # the fixed-point integer counts units of 1 / UNIT
FSUM_ROWS = 256  # largest number of rows summed by math.fsum on one process: exact too, and faster than a kernel


def total(values: Array) -> float:
    """Return the sum of `values` (n,) over all entries and processes."""
    return float(totals(values[:, None])[0])


def totals(values: Array) -> Array:
    """Return the sum (columns,) of each column of `values` (n, columns) over all processes.

    A sum is NaN if an entry is not finite.
    """
    values = np.ascontiguousarray(values, float)
    few = None if len(values) > FSUM_ROWS or world.processes.many else _sums_of_few(values)
    return rounded(sum(parallel_for(kernels.add_columns, len(values), values, light=True))) if few is None else few


def _sums_of_few(values: Array) -> Array | None:
    """Return the sum (columns,) of each column by math.fsum; None if a sum is not finite."""
    try:
        found = np.array([math.fsum(column) for column in values.T.tolist()])
    except (OverflowError, ValueError):  # too large, or infinities of both signs
        return None
    return found if np.isfinite(found).all() else None


def mean(values: Array) -> float:
    """Return the mean of `values` (n,) over all processes; there must be at least one value."""
    return total(values) / int(world.processes.sum(len(values)))


def rounded(limbs: Array) -> Array:
    """Return sums (columns,) as floats, from the limbs (columns, LIMBS) of each process.

    limbs: made by `kernels/common/totals.py`.
    """
    return np.array([_float_of(row) for row in world.processes.sum(limbs).tolist()])


def _float_of(limbs: list[int]) -> float:
    if limbs[-1] > 0:
        return float("nan")
    whole = sum(limb << 32 * k for k, limb in enumerate(limbs[:-1]))
    try:
        return whole / UNIT  # rounded once
    except OverflowError:
        return float("inf") if whole > 0 else float("-inf")
