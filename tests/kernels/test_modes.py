"""The modes in which gas and many populations relax."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from discsim.kernels.modes import INVERSE, MASS, RATE, ROWS, STRENGTH, find_root
from discsim.kernels.relax import relax_modes


def exact(mass, time, y, b, dt):
    """Velocities (n, d) after dt, by the matrix exponential of eq. (1) of `kernels/drag.py` in slips from the gas."""
    n = len(mass)
    a = np.zeros((2 * n, 2 * n))
    for j in range(1, n):
        a[0, 0] -= mass[j] / mass[0] / time[j]
        a[0, j] += mass[j] / mass[0] / time[j]
        a[j, 0], a[j, j] = 1.0 / time[j], -1.0 / time[j]
    a[:n, n:] = np.eye(n)
    return (expm(a * dt) @ np.concatenate([y, b]))[:n]


def relaxed(mass, time, y, b, dt):
    slip, drive = np.zeros_like(y), np.zeros_like(y)
    relax_modes(mass, time, y, b, dt, True, slip, drive)
    return y + b * dt + slip + drive


@pytest.mark.parametrize("number", [1, 2, 8, 20])
def test_sizes_with_sources_are_the_matrix_exponential(number):
    rng = np.random.default_rng(number)
    mass = np.append(1.0, 10.0 ** rng.uniform(-3, 0.5, number))
    time = np.append(np.inf, 0.03 * 1.4 ** rng.permutation(number))
    y, b = rng.normal(size=(2, number + 1, 2))
    # The exponential's own rounding grows with its argument, some hundreds here.
    np.testing.assert_allclose(relaxed(mass, time, y, b, 0.7), exact(mass, time, y, b, 0.7), rtol=0, atol=1e-11)


def test_populations_of_one_stopping_time():
    """Three of seven are of one: together one to the others, and by themselves at their own rate."""
    mass = np.array([1.0, 0.2, 0.1, 0.4, 0.3, 0.05, 0.6, 0.7])
    time = np.array([np.inf, 0.5, 0.1, 0.5, 2.0, 0.1, 0.5, 9.0])
    y, b = np.random.default_rng(3).normal(size=(2, 8, 2))
    np.testing.assert_allclose(relaxed(mass, time, y, b, 0.7), exact(mass, time, y, b, 0.7), rtol=0, atol=1e-13)


def test_absent_and_uncoupled_populations_stay():
    mass, time = np.array([1.0, 0.0, 0.5, 0.3]), np.array([np.inf, 0.1, np.inf, 0.2])
    y, b = np.random.default_rng(5).normal(size=(2, 4, 2))
    slip, drive = np.zeros((4, 2)), np.zeros((4, 2))
    relax_modes(mass, time, y, b, 0.7, True, slip, drive)
    assert (slip[1:3] == 0.0).all() and (drive[1:3] == 0.0).all()
    assert (slip[[0, 3]] != 0.0).all()


LOGS = st.lists(st.tuples(st.floats(-12, 12), st.floats(-10, 6)), min_size=1, max_size=20)


@settings(deadline=None, max_examples=300)
@given(LOGS)
def test_roots_lie_between_the_rates_and_solve_the_equation(logs):
    rates = np.unique([10.0**x for x, _ in logs])
    number = len(rates)
    work = np.zeros((ROWS, number))
    work[RATE], work[MASS] = rates, 10.0 ** np.array([e for _, e in logs[:number]])
    work[STRENGTH] = work[RATE] * work[MASS]
    for k in range(number):
        root = find_root(k, number, work)
        assert rates[k] <= root and (k == number - 1 or root <= rates[k + 1])
        assert work[INVERSE, k] < 0.0 and (k == number - 1 or work[INVERSE, k + 1] > 0.0)
        terms = work[STRENGTH] * work[INVERSE]
        # Rounding of the sum itself, and of the root's distance, which changes no term by more.
        assert abs(1.0 + terms.sum()) <= 1e-14 * (1.0 + abs(terms).sum())


@settings(deadline=None, max_examples=200)
@given(LOGS, st.floats(-6, 6), st.integers(0, 2**31))
def test_momentum_is_kept_and_drag_gives_no_energy(logs, log_dt, seed):
    mass = np.append(1.0, [10.0**e for _, e in logs])
    time = np.append(np.inf, [10.0**-x for x, _ in logs])
    y = np.random.default_rng(seed).normal(size=(len(mass), 2))
    after = relaxed(mass, time, y, np.zeros_like(y), 10.0**log_dt)
    # As sums of as many terms round, and of what the gas gets from each.
    np.testing.assert_allclose(mass @ after, mass @ y, rtol=0, atol=1e-14 * len(mass) * (mass @ abs(y)).max())
    assert (mass @ after**2).sum() <= (mass @ y**2).sum() * (1 + 1e-9)
