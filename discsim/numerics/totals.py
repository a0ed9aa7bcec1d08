"""Totals over particles that are exact sums, rounded once: the same bits in whatever order the particles are, and
however they are divided, among threads or processes.
"""

from __future__ import annotations

import math

import numpy as np

from discsim.numerics import world
from discsim.numerics.threads import share
from discsim.parts import Lazy

kernels = Lazy("discsim.kernels.common.totals")
Array = np.ndarray
UNIT = 1 << 1075  # limbs count in units of 1 / UNIT
FEW = 256  # rows, of one process, whose sums Python makes as exactly before a kernel would begin


def total(values: Array) -> float:
    """The sum of values (n,)."""
    return float(totals(values[:, None])[0])


def totals(values: Array) -> Array:
    """The sum (columns,) of each column of values (n, columns); NaN where an entry is not finite."""
    values = np.ascontiguousarray(values, float)
    few = None if len(values) > FEW or world.together.many else _sums_of_few(values)
    return rounded(sum(share(kernels.add_columns, len(values), values, light=True))) if few is None else few


def _sums_of_few(values: Array) -> Array | None:
    """The same, exact too; None where one is not finite, which limbs tell apart."""
    try:
        found = np.array([math.fsum(column) for column in values.T.tolist()])
    except (OverflowError, ValueError):  # too large, or infinities of both signs
        return None
    return found if np.isfinite(found).all() else None


def mean(values: Array) -> float:
    """The mean of values (n,), of which there are some."""
    return total(values) / int(world.together.sum(len(values)))


def rounded(limbs: Array) -> Array:
    """The sums (columns,) of limbs (columns, LIMBS), as kernels of `kernels/common/totals.py` fill them."""
    return np.array([_number(row) for row in world.together.sum(limbs).tolist()])


def _number(limbs: list[int]) -> float:
    if limbs[-1] > 0:
        return float("nan")
    whole = sum(limb << 32 * k for k, limb in enumerate(limbs[:-1]))
    try:
        return whole / UNIT  # rounded once
    except OverflowError:
        return float("inf") if whole > 0 else float("-inf")
