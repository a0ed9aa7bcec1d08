"""Drag in the cells of a fixed grid."""

import numpy as np
import pytest

from discsim.formulas.laws import STOPPING_TIME
from discsim.kernels.fluid1d.drag import relax_together


def test_a_cell_relaxes_by_the_dust_to_gas_ratio_in_the_middle_of_the_step():
    """Slips without sources fall as exp(-(1 + eps) dt / t_stop), eps = .8 half-way of a step from .2 to 1.7."""
    dt, stop, v, u = 0.3, 0.41, 0.7, -0.4

    def cells(gas, dust):
        return np.array([[gas], [gas * v], [0.0], [dust], [dust * u]])

    after = cells(1.3, 2.21)
    grain = np.array([stop, 0.0, 0.0, 0.0, 1.0])
    given = np.array([0.9]), cells(2.0, 0.4), cells(1.5, 1.2), after, dt, True, False, False
    relax_together(STOPPING_TIME, grain, *given)
    slip = after[4, 0] / 2.21 - after[1, 0] / 1.3
    assert slip == pytest.approx((u - v) * np.exp(-1.8 * dt / stop), rel=1e-12)
    assert after[1, 0] + after[4, 0] == pytest.approx(1.3 * v + 2.21 * u, rel=1e-13)
