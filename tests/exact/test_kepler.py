"""Kepler's problem: the universal drift, the closed forms, and their elements, against each other and an integrator."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from discsim.exact import kepler

ORBITS = [(0.0, 1.0), (0.3, -2.0), (0.9, 0.0), (0.9, 3.0), (0.99, 1.0), (1.5, -1.0), (5.0, 0.5)]


@pytest.mark.parametrize(("e", "anomaly"), ORBITS)
@pytest.mark.parametrize("dt", [1e-6, 0.01, 0.3, 7.0, 100.0, -3.0])
def test_the_drift_is_the_closed_form(e, anomaly, dt):
    mu, size = 1.3, 0.8
    start = kepler.motion_at_anomaly(mu, size, e, anomaly)
    mean = kepler.mean_anomaly(e, anomaly) + math.sqrt(mu / size**3) * dt
    exact, found = kepler.motion_at_mean_anomaly(mu, size, e, mean), kepler.drift(mu, start, dt)
    # At e = .99 the binding energy is the rest of terms 400 times as large, and 100 time units are 160 radians.
    assert np.abs(np.subtract(found, exact)).max() < 1e-10 * np.abs(exact).max()
    again = kepler.motion_at_mean_anomaly(mu, size, e, kepler.mean_anomaly(e, anomaly))
    assert np.abs(np.subtract(again, start)).max() < 1e-12


def test_the_drift_is_what_an_integrator_finds():
    start = kepler.Motion(1.0, 0.2, -0.3, 0.7)

    def rhs(t, y):
        return [y[2], y[3], *(-1.1 * y[:2] / math.hypot(y[0], y[1]) ** 3)]

    there = solve_ivp(rhs, (0.0, 5.0), start, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    assert np.abs(np.subtract(kepler.drift(1.1, start, 5.0), there)).max() < 1e-9  # of the integrator


def test_a_hundred_orbits_in_steps():
    mu, e = 1.001, 0.6
    start = at = kepler.motion_at_anomaly(mu, 1.0, e, 0.4)
    period = 2.0 * math.pi / math.sqrt(mu)
    for _ in range(100 * 37):
        at = kepler.drift(mu, at, period / 37)
    # Rounding of 3700 steps, which 600 radians turn into phase.
    assert np.abs(np.subtract(at, start)).max() < 1e-10


@pytest.mark.parametrize(("e", "anomaly"), ORBITS[1:])
def test_elements_are_those_of_the_orbit(e, anomaly):
    found = kepler.elements(1.3, *kepler.motion_at_anomaly(1.3, 0.8, e, anomaly))
    size = 0.8 if e < 1.0 else -0.8
    assert found == pytest.approx((size, e, 0.0, anomaly), abs=1e-11)
    # The mirror image turns the other way, from the same pericentre.
    x, y, vx, vy = kepler.motion_at_anomaly(1.3, 0.8, e, anomaly)
    assert kepler.elements(1.3, x, -y, vx, -vy) == pytest.approx((size, e, 0.0, anomaly), abs=1e-11)


def test_without_a_pull_the_way_is_straight():
    assert kepler.drift(0.0, kepler.Motion(1.0, 2.0, 3.0, -1.0), 0.5) == (2.5, 1.5, 3.0, -1.0)


def test_a_fall_into_the_centre_stays_a_number():
    at = kepler.Motion(1.0, 0.0, 0.0, 0.0)
    for _ in range(50):
        at = kepler.drift(1.0, at, 0.21)
        assert all(map(math.isfinite, at)) and abs(at.x) <= 1.0 + 1e-9
