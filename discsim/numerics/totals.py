"""Sums over particles that are exact except for one rounding at the end.

Results are bitwise the same for any order of the particles and any number of threads and processes. Kernels accumulate
a sum as a fixed-point integer, split into limbs of 32 bits each; a last limb counts entries that are not finite.
"""

from __future__ import annotations

import math
from contextlib import suppress

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
    """Return the sum of each column of `values` (n, columns) over all entries and processes, as an array (columns,).

    A sum is NaN if an entry is not finite.
    """
    values = np.ascontiguousarray(values, float)
    if len(values) <= FSUM_ROWS and not world.processes.is_parallel:
        with suppress(OverflowError, ValueError):  # a sum is too large, or has infinities of both signs
            found = np.array([math.fsum(column) for column in values.T.tolist()])
            if np.isfinite(found).all():
                return found
    return rounded(sum(parallel_for(kernels.add_columns, len(values), values, light=True)))


def mean(values: Array) -> float:
    """Return the mean of `values` (n,) over all processes; there must be at least one value."""
    return total(values) / int(world.processes.sum(len(values)))


def rounded(limbs: Array) -> Array:
    """Return the sums (columns,) over all processes as floats.

    limbs (columns, LIMBS): limbs of the sums of this process, from `kernels/common/totals.py`.
    """
    return np.array([_limbs_to_float(row) for row in world.processes.sum(limbs).tolist()])


def _limbs_to_float(limbs: list[int]) -> float:
    """Return the value of a sum; NaN if an entry was not finite, and an infinity if it is too large for a float."""
    if limbs[-1] > 0:
        return float("nan")
    whole = sum(limb << 32 * k for k, limb in enumerate(limbs[:-1]))
    try:
        return whole / UNIT  # rounded once
    except OverflowError:
        return float("inf") if whole > 0 else float("-inf")
