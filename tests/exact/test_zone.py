"""Cooling of one zone: kernels against exact solutions, and what never falls below nothing."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from discsim.exact import cooling as exact
from discsim.kernels.sph import cooling as kernels
from discsim.physics.cooling import effective_depth

HERE = np.array([[1.0, 0.0]])
UNIT = np.array([1.0, 1e-7, 2.0 / 3.0, 1000.0, 1.0])  # temperatures of 1000 K, densities of 1e-7 g/cm3 at H = 1
COLUMN = 2.0


def linear(u, settled, rate, t_cool, dt, times=1):
    for _ in range(times):
        out = np.empty(1)
        given = np.array([u]), np.array([rate]), dt / times
        kernels.relax_to_energy(0, 1, HERE, *given, False, t_cool, np.array([settled, 0.0, 0.0]), 1.0, 0.0, out)
        u = out[0]
    return u


def light(u, settled, rate, dt, opacity=3.0, times=1):
    """u after dt of heating at `rate`; opacity 0 is Bell & Lin's."""
    for _ in range(times):
        out = np.empty(1)
        given = np.array([u]), np.array([COLUMN]), np.array([rate]), dt / times
        kernels.cool_radiatively(0, 1, HERE, *given, opacity, np.array([settled, 0.0, 0.0]), 1.0, 0.0, UNIT, out)
        u = out[0]
    return u


STRENGTH = 1.0 / (COLUMN * effective_depth(0.5 * 3.0 * COLUMN))  # of u^4 at an opacity of 3


@pytest.mark.parametrize("ratio", 10.0 ** np.arange(-6, 7))
@pytest.mark.parametrize(("u", "rate"), [(3.0, 0.5), (0.2, 0.0), (1.0, -0.3)])
def test_cooling_in_a_time_is_exact(u, rate, ratio):
    """At t_cool / dt from 1e-6 to 1e6, and in several kicks as in one: rounding."""
    dt = 0.1
    wanted = exact.linear(u, 0.7, rate, ratio * dt, dt)
    assert linear(u, 0.7, rate, ratio * dt, dt) == pytest.approx(wanted, rel=1e-14)
    assert linear(u, 0.7, rate, ratio * dt, dt, times=7) == pytest.approx(wanted, rel=1e-13)


def test_the_exact_solution_by_the_fourth_power():
    """Against an integration to 1e-12."""
    for start in (0.1, 0.999, 1.001, 20.0):
        found = solve_ivp(lambda t, u: 0.3 * (1.0 - u**4), (0.0, 2.0), [start], rtol=1e-12, atol=1e-14, method="Radau")
        assert exact.fourth_power(start, 1.0, 0.3, 2.0) == pytest.approx(found.y[0, -1], rel=1e-9)


@pytest.mark.parametrize("start", [1e-2, 0.9, 1.1, 5.0, 100.0])
@pytest.mark.parametrize("time", [1e-6, 1e-2, 1.0, 1e2, 1e6, 1e12])
def test_light_of_constant_opacity(start, time):
    """Steps within the kick err by 1e-6 of u each at most, and where there are many by far less."""
    wanted = exact.fourth_power(start, 1.0, STRENGTH, time / STRENGTH)
    for times in (1, 5):
        assert light(start, 1.0, 0.0, time / STRENGTH, times=times) == pytest.approx(wanted, rel=1e-5)
    # A heating rate shifts the balance, u_inf^4 = u_eq^4 + rate / strength.
    heated = exact.fourth_power(start, 2.0, STRENGTH, time / STRENGTH)
    assert light(start, 1.0, 15.0 * STRENGTH, time / STRENGTH) == pytest.approx(heated, rel=1e-5)


@pytest.mark.parametrize("opacity", [1e-6, 1.0, 1e4, 0.0])
@pytest.mark.parametrize("rate", [1e-6, 1.0, 1e6])
def test_a_stiff_zone_ends_where_heating_and_cooling_balance(opacity, rate):
    """From either side, in one kick; of Bell & Lin's opacity, whose gap may hold several, at one of them."""

    def net(u):
        kappa = opacity
        if opacity == 0.0:
            found = np.empty(1)
            rho = UNIT[1] * COLUMN / np.sqrt(2.0 * np.pi * UNIT[2] * u)
            kernels.write_opacities(0, 1, np.array([rho]), np.array([UNIT[3] * u]), found)
            kappa = found[0]
        return rate - (u**4 - 0.5**4) / (COLUMN * effective_depth(0.5 * kappa * COLUMN))

    for start in (1e-3, 1e3):
        found = light(start, 0.5, rate, 1e15, opacity)
        assert net(found * (1 - 1e-5)) > 0.0 > net(found * (1 + 1e-5))
        if opacity > 0.0:
            assert found == pytest.approx(brentq(net, 0.4, 1e4, xtol=1e-14, rtol=1e-14), rel=1e-6)


def test_nothing_falls_below_nothing():
    """Gas that loses a thousand times its energy in the kick, beside starlight or none."""
    for settled in (0.0, 1e-3):
        for dt in (1e-3, 1.0, 1e3):
            assert light(1.0, settled, -1e3 / dt, dt) > 0.0
            assert light(1.0, settled, -1e3 / dt, dt, opacity=0.0) > 0.0
            for t_cool in (1e-3, 1.0, 1e3):
                assert linear(1.0, settled, -1e3 / dt, t_cool, dt) >= 0.0
    assert linear(1.0, 0.0, 0.0, 1e-50, 1.0) == 0.0
    assert light(1.0, 0.0, 0.0, 1e6) == pytest.approx((1.0 + 3e6 * STRENGTH) ** (-1.0 / 3.0), rel=1e-5)


@pytest.mark.parametrize("rho", 10.0 ** np.arange(-30, -3, 3))
def test_opacity_is_continuous(rho):
    """The steepest of its powers of the temperature is the 24th."""
    temperature = np.exp(np.linspace(np.log(1.0), np.log(1e7), 100_001))
    found = np.empty_like(temperature)
    kernels.write_opacities(0, len(found), np.full(len(found), rho), temperature, found)
    assert np.abs(np.diff(np.log(found)) / np.diff(np.log(temperature))).max() < 24.1


def test_opacities_of_bell_and_lin():
    """In g and cm: ice, metals, molecules, free-free, electrons; by hand from their table."""
    rho = np.array([1e-9, 1e-7, 1e-6, 1e-9, 1e-12])
    temperature = np.array([100.0, 1000.0, 2500.0, 2e4, 1e6])
    found = np.empty(5)
    kernels.write_opacities(0, 5, rho, temperature, found)
    wanted = [2.0, 0.1 * 1000.0**0.5, 1e-8 * 1e-4 * 2500.0**3, 1.5e20 * 1e-9 * 2e4**-2.5, 0.348]
    np.testing.assert_allclose(found, wanted, rtol=1e-12)
