"""A cubic spline through points, whose third derivative is continuous at the second and the last but one (not-a-knot).

Bit for bit that of `scipy.interpolate.make_interp_spline`, which takes longer to import than a disc to be laid out.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray
K = 3


def through(x: Array, y: Array, at: Array) -> Array:
    """Values (m,) at `at` (m,) within x of the spline that is y (n,) at rising x (n,), of four points or more."""
    from scipy.linalg.lapack import dgbsv  # slow to import

    knots = np.concatenate([x[:1].repeat(K + 1), x[2:-2], x[-1:].repeat(K + 1)])
    first, basis = _basis(knots, x)
    banded = np.zeros((3 * K + 1, len(x)), order="F")
    for column in range(K + 1):
        banded[2 * K + np.arange(len(x)) - first - column, first + column] = basis[:, column]
    *_, coefficients, _ = dgbsv(K, K, banded, y)
    first, basis = _basis(knots, at)
    found = np.zeros(len(at))
    for column in range(K + 1):
        found += coefficients[first + column] * basis[:, column]
    return found


def _basis(knots: Array, x: Array) -> tuple[Array, Array]:
    """The first (n,) of the four B-splines that are not 0 at x (n,), and their values (n, 4): de Boor's recurrence."""
    last = np.clip(np.searchsorted(knots, x, "right") - 1, K, len(knots) - K - 2)
    values = np.zeros((len(x), K + 1))
    values[:, 0] = 1.0
    for degree in range(1, K + 1):
        lower, values[:, 0] = values.copy(), 0.0
        for n in range(1, degree + 1):
            after, before = knots[last + n], knots[last + n - degree]
            weight = lower[:, n - 1] / (after - before)
            values[:, n - 1] += weight * (after - x)
            values[:, n] = weight * (x - before)
    return last - K, values
