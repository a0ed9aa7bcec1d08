"""How gas and many populations relax together."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from discsim.kernels.drag.coupled import SCRATCH_COLUMNS, relax_coupled
from discsim.kernels.drag.relax import response


def exact(mass, time, y, b, dt):
    """Velocities (n, d) after dt, by the matrix exponential of eq. (1) of `drag/cells.py`, in slips from the gas."""
    n = len(mass)
    a = np.zeros((2 * n, 2 * n))
    for j in range(1, n):
        a[0, 0] -= mass[j] / mass[0] / time[j]
        a[0, j] += mass[j] / mass[0] / time[j]
        a[j, 0], a[j, j] = 1.0 / time[j], -1.0 / time[j]
    a[:n, n:] = np.eye(n)
    return (expm(a * dt) @ np.concatenate([y, b]))[:n]


def changes(mass, time, y, b, dt, exponential=True):
    slip, drive = np.zeros_like(y), np.zeros_like(y)
    relax_coupled(mass, time, y, b, dt, exponential, np.empty((len(mass), SCRATCH_COLUMNS)), slip, drive)
    return slip, drive


def relaxed(mass, time, y, b, dt):
    slip, drive = changes(mass, time, y, b, dt)
    return y + b * dt + slip + drive


@pytest.mark.parametrize("exponential", [True, False])
def test_sums_over_poles_are_the_response(exponential):
    """Of one population next to no mass, at any step from 1e-100 to 1e150 stopping times."""
    mass, y, b = np.array([1.0, 1e-200]), np.array([[0.0], [1.0]]), np.array([[0.0], [1.0]])
    for x in np.append(10.0 ** np.arange(-100, 151, 10), np.geomspace(1e-6, 1e6, 241)):
        slip, drive = changes(mass, np.array([np.inf, 1.0 / x]), y, b, 1.0, exponential)
        # Each term rounds, of weights up to 70 that nearly cancel.
        np.testing.assert_allclose((slip[1, 0], drive[1, 0]), response(x, 1.0, exponential), rtol=2e-13, atol=0)


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
    slip, drive = changes(mass, time, y, b, 0.7)
    assert (slip[1:3] == 0.0).all() and (drive[1:3] == 0.0).all()
    assert (slip[[0, 3]] != 0.0).all()


LOGS = st.lists(st.tuples(st.floats(-12, 12), st.floats(-10, 6)), min_size=1, max_size=20)


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
