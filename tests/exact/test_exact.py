"""The exact solutions against their own equations, or against an independent way to the same number."""

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.special import ellipe, ellipk

from discsim.exact import dustybox, dustyshock, dustywave, gresho, maclaurin, nsh, riemann, sedov, settling, sheet


@pytest.mark.parametrize("ratio", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("drag", [1e-8, 1.0, 1e4, 1e12])
def test_dustybox_against_high_precision(ratio, drag):
    """Against the same formula in 60 digits, where nothing can cancel."""
    from decimal import Decimal, getcontext

    getcontext().prec = 60
    t, v, u, rho, a, b = 0.7, 1.3, -0.4, 2.0, 0.3, -1.1
    T, V, U, A, B, E = (Decimal(x) for x in (t, v, u, a, b, ratio))
    rate = Decimal(drag) / Decimal(rho) * (1 + 1 / E)
    slip = (U - V) * (-rate * T).exp() + (B - A) * (1 - (-rate * T).exp()) / rate
    mean = (V + E * U) / (1 + E) + (A + E * B) / (1 + E) * T
    exact = float(mean - E / (1 + E) * slip), float(mean + slip / (1 + E))
    # A few roundings of terms no larger than the velocities.
    assert dustybox.velocities(t, v, u, rho, ratio, drag, a, b) == pytest.approx(exact, abs=1e-14, rel=0)


def test_dustybox_composes_and_conserves():
    box = (1.0, 0.3, 7.0, 0.2, -0.4)
    one = dustybox.velocities(0.5, 1.0, 0.0, *box)
    half = dustybox.velocities(0.25, *dustybox.velocities(0.25, 1.0, 0.0, *box), *box)
    np.testing.assert_allclose(one, half, rtol=1e-14)
    assert one[0] + 0.3 * one[1] == pytest.approx(1 + 0.5 * (0.2 - 0.3 * 0.4), rel=1e-14)


def test_dustybox_small_exchange_keeps_its_digits():
    """A gas at rest that is barely dragged: its tiny velocity is right to rounding of itself."""
    gas, _ = dustybox.velocities(1.0, 0.0, 0.0, 1.0, 1.0, 1e-8, 0.0, 1.0)
    # v = K t^2/2 (1 - lam t/3) with lam = 2 K; the next term is (lam t)^2/12 = 3e-17.
    assert gas == pytest.approx(0.5e-8 * (1 - 2e-8 / 3), rel=1e-13)


@pytest.mark.parametrize("ratio", [0.01, 1.0, 5.0])
@pytest.mark.parametrize("drag", [0.0, 0.5, 5.0, 60.0, 500.0, 2000.0])
def test_dustywave_against_integration(drag, ratio):
    k, sound, amplitude, boost, density, time = 2 * np.pi * 2 / 3, 1.5, 1e-4, 0.7, 2.0, 0.5

    def rates(_, y):
        d_gas, _, v, u = y
        force = drag / density * (u - v)
        return [-1j * k * v, -1j * k * u, -1j * k * sound**2 * d_gas + force, -force / ratio]

    run = solve_ivp(rates, (0, time), np.ones(4, complex), method="DOP853", rtol=1e-12, atol=1e-14)
    x = np.linspace(0, 3, 50)
    gas, dust, v, u = (amplitude * np.imag(m * np.exp(1j * k * (x - boost * time))) for m in run.y[:, -1])
    wave = dustywave.solution(x, time, drag, ratio, sound, amplitude, 2, 3.0, boost, density)
    # The integrator's own tolerance, over some thousands of steps.
    near = {"atol": 1e-9 * amplitude + 1e-15, "rtol": 0}
    np.testing.assert_allclose(wave.gas_density / density - 1, gas, **near)
    np.testing.assert_allclose(wave.dust_density / density / ratio - 1, dust, **near)
    np.testing.assert_allclose(wave.gas_velocity - boost, v, **near)
    np.testing.assert_allclose(wave.dust_velocity - boost, u, **near)


@pytest.mark.parametrize("ratio", [1e-6, 0.01, 1.0, 1e6])
def test_dustywave_tight_coupling(ratio):
    """At K = 1e12 both species are one gas of sound speed c_s/sqrt(1 + eps)."""
    x, time = np.linspace(0, 1, 40), 0.5
    wave = dustywave.solution(x, time, 1e12, ratio, amplitude=1.0)
    k, slow = 2 * np.pi, 1 / np.sqrt(1 + ratio)
    # d'Alembert from density A sin(k x), velocity A sin(k x); the slip is k/K ~ 1e-11.
    v = np.sin(k * x) * np.cos(k * slow * time) - slow * np.cos(k * x) * np.sin(k * slow * time)
    d = np.sin(k * x) * np.cos(k * slow * time) - np.cos(k * x) * np.sin(k * slow * time) / slow
    np.testing.assert_allclose(wave.gas_velocity, v, atol=1e-10)
    np.testing.assert_allclose(wave.dust_velocity, v, atol=1e-10)
    # The density amplitude is 1/slow, up to 1000 here.
    np.testing.assert_allclose(wave.gas_density - 1, d, atol=1e-10 / slow)
    np.testing.assert_allclose(wave.dust_density / ratio - 1, d, atol=1e-10 / slow)


def test_dustywave_is_continuous_where_the_method_changes():
    x = np.linspace(0, 1, 20)
    edge = dustywave._STIFF * 2 * np.pi / 2  # eps = 1: lam = 2 K
    below, above = (dustywave.solution(x, 0.5, edge * f, 1.0) for f in (1 - 1e-12, 1 + 1e-12))
    # The exponential loses lam t/2^53 ~ 2e-14 of the amplitude.
    np.testing.assert_allclose(below.dust_velocity, above.dust_velocity, atol=1e-12 * 1e-4, rtol=0)


def test_sod_star_state():
    """Toro 2009, table 4.2, test 1: p* = .30313, u* = .92745, densities .42632, .26557."""
    flow = riemann.solution(np.array([0.1, 0.2]), 0.2)
    # The table's five digits.
    np.testing.assert_allclose(flow.pressure, 0.30313, atol=5e-6)
    np.testing.assert_allclose(flow.velocity, 0.92745, atol=5e-6)
    np.testing.assert_allclose(flow.density, [0.42632, 0.26557], atol=5e-6)


def test_double_shock_and_rarefactions():
    """Toro's tests 2 (two rarefactions: p* = .00189) and 5 (two shocks: p* = 1691.64, u* = 8.68975)."""
    two = riemann.solution(np.array([0.0]), 0.1, (1, 0.4, -2), (1, 0.4, 2))
    assert two.pressure[0] == pytest.approx(0.00189, abs=5e-6)
    left, right = (5.99924, 460.894, 19.5975), (5.99242, 46.0950, -6.19633)
    five = riemann.solution(np.array([0.28]), 0.035, left, right)
    # The table's root is iterated to 1e-6 only.
    assert five.pressure[0] == pytest.approx(1691.64, abs=0.01)
    assert five.velocity[0] == pytest.approx(8.68975, abs=5e-5)


def test_riemann_conserves():
    """Mass, momentum and energy in a box that no wave has left, changed by the flux through its ends only."""
    x = np.linspace(-1, 1, 400_001)
    flow = riemann.solution(x, 0.2)
    # Three jumps, each known to half a spacing of 5e-6.
    assert np.trapezoid(flow.density, x) == pytest.approx(1.125, abs=1e-5)
    assert np.trapezoid(flow.density * flow.velocity, x) == pytest.approx(0.2 * 0.9, abs=1e-5)
    energy = flow.pressure / 0.4 + flow.density * flow.velocity**2 / 2
    assert np.trapezoid(energy, x) == pytest.approx(1.1 / 0.4, abs=1e-5)


def test_riemann_mirror():
    x = np.linspace(-0.5, 0.5, 101)
    flow = riemann.solution(x, 0.2, (1, 1, 0.3), (0.2, 0.3, -0.1))
    other = riemann.solution(-x, 0.2, (0.2, 0.3, 0.1), (1, 1, -0.3))
    np.testing.assert_allclose(flow.density, other.density, rtol=1e-12)
    np.testing.assert_allclose(flow.velocity, -other.velocity, rtol=1e-12, atol=1e-14)


def test_riemann_refuses_a_vacuum():
    with pytest.raises(ValueError, match="vacuum"):
        riemann.solution(np.array([0.0]), 1.0, (1, 1, -50), (1, 1, 50))


def test_isothermal_riemann():
    """Conservation as above, and the limit gamma -> 1 of the ideal gas."""
    x = np.linspace(-1, 1, 400_001)
    flow = riemann.isothermal_solution(x, 0.3, (1, 0.2), (0.125, -0.1), 0.8)
    assert np.trapezoid(flow.density, x) == pytest.approx(1.125 - 0.3 * (-0.0125 - 0.2), abs=1e-5)
    gained = 0.3 * (0.64 * 0.875 + 0.04 - 0.125 * 0.01)
    assert np.trapezoid(flow.density * flow.velocity, x) == pytest.approx(0.2 - 0.0125 + gained, abs=1e-5)
    places = np.linspace(-0.9, 0.9, 19)
    near = riemann.solution(places, 0.3, (1, 0.64, 0.2), (0.125, 0.08, -0.1), 1 + 1e-7)
    cold = riemann.isothermal_solution(places, 0.3, (1, 0.2), (0.125, -0.1), 0.8)
    # First order in gamma - 1 = 1e-7.
    np.testing.assert_allclose(near.density, cold.density, rtol=1e-6)
    np.testing.assert_allclose(near.velocity, cold.velocity, atol=1e-6)


def test_dustyshock_is_a_heavy_gas():
    x = np.linspace(-0.4, 0.4, 9)
    mixture = dustyshock.solution(x, 0.2, 3.0)
    # Four times the inertia: the same flow, half as fast.
    gas = riemann.solution(x, 0.1)
    np.testing.assert_allclose(mixture.gas_density, gas.density, rtol=1e-12)
    np.testing.assert_allclose(mixture.dust_density, 3 * gas.density, rtol=1e-12)
    np.testing.assert_allclose(mixture.velocity, gas.velocity / 2, rtol=1e-12)
    np.testing.assert_allclose(mixture.pressure, gas.pressure, rtol=1e-12)


def test_sheet_numbers():
    """Computed by hand from eq. (1) for c_s = .5 and 1.2, k = 2 pi, softening .02."""
    assert sheet.growth_rate(2 * np.pi, 1.0, 0.5, 0.02) == pytest.approx(4.9947, abs=5e-5)
    assert sheet.frequency(2 * np.pi, 1.0, 1.2, 0.02) == pytest.approx(4.6939, abs=5e-5)
    assert sheet.frequency(2 * np.pi, 1.0, 0.5, 0.02) == 0
    assert sheet.growth_rate(2 * np.pi, 1.0, 1.2, 0.02) == 0


@pytest.mark.parametrize("radius", [0.05, 0.5, 0.9, 1.3, 3.0])
@pytest.mark.parametrize("height", [0.01, 0.1, 1.0])
def test_maclaurin_against_quadrature(radius, height):
    """The disc as rings, whose potential and pull are elliptic integrals."""
    size, mass = 1.3, 0.7

    def total(ring):
        def share(angle):  # s = a sin(angle) takes the square root off the disc's edge
            s = size * np.sin(angle)
            ring_mass = 2 * np.pi * s * maclaurin.surface_density(s, size, mass) * size * np.cos(angle)
            far = (radius + s) ** 2 + height**2
            m = 4 * radius * s / far
            return ring_mass * ring(s, np.sqrt(far), ellipk(m), ellipe(m))

        peak = [np.arcsin(radius / size)] if radius < size else None
        return quad(share, 0, np.pi / 2, points=peak, epsabs=1e-11, epsrel=1e-11, limit=400)[0]

    def pull(s, far, k, e):
        near2 = (radius - s) ** 2 + height**2
        return -(k + (radius**2 - s**2 - height**2) / near2 * e) / (np.pi * radius * far)

    well = total(lambda s, far, k, e: -2 * k / (np.pi * far))
    # Far above what the quadrature is asked for; the fields are of order 1.
    assert maclaurin.radial_acceleration(radius, size, mass, height) == pytest.approx(total(pull), abs=1e-9)
    assert maclaurin.potential(radius, size, mass, height) == pytest.approx(well, abs=1e-9)


def test_maclaurin_in_its_plane_and_far_away():
    inside = np.array([0.1, 0.5, 0.99, 1.0])
    np.testing.assert_allclose(maclaurin.radial_acceleration(inside, 1.0, 1.0), -0.75 * np.pi * inside, rtol=1e-12)
    # A point mass at 1000 disc radii, but for the quadrupole: (3/10) * 1e-6.
    assert maclaurin.radial_acceleration(1e3, 1.0, 1.0) == pytest.approx(-1e-6, rel=1e-6)
    assert maclaurin.potential(1e3, 1.0, 1.0) == pytest.approx(-1e-3, rel=1e-6)
    assert maclaurin.surface_density(1.5, 1.0, 1.0) == 0


@pytest.mark.parametrize("stokes", [1e-6, 0.01, 1.0, 1e3])
@pytest.mark.parametrize("ratio", [1e-6, 0.01, 1.0, 100.0])
def test_nsh_is_steady(stokes, ratio):
    """Youdin & Johansen (2007), eqs. (6): the steady momentum equations, in units of Omega."""
    headwind = 0.003
    ux, uy, wx, wy = nsh.velocities(stokes, ratio, headwind)
    drag_x, drag_y = (wx - ux) / stokes, (wy - uy) / stokes
    # Rounding of the headwind is magnified by 1/St where the drag is a difference of near equals.
    near = {"abs": 1e-16 * headwind * (10 + 10 * (1 + ratio) / stokes)}
    assert 2 * uy + 2 * headwind + ratio * drag_x == pytest.approx(0, **near)
    assert -ux / 2 + ratio * drag_y == pytest.approx(0, **near)
    assert 2 * wy - drag_x == pytest.approx(0, **near)
    assert -wx / 2 - drag_y == pytest.approx(0, **near)


@pytest.mark.parametrize("count", [3, 8])
def test_populations_drift_as_the_momentum_equations_ask(count):
    """The same equations with several populations, solved as a linear system."""
    stream = np.random.default_rng(count)
    stokes, ratios = 10 ** stream.uniform(-3, 2, count), 10 ** stream.uniform(-3, 0.5, count)
    # Unknowns: radial and azimuthal velocity of the gas, then of each population; the headwind is 1.
    matrix, right = np.zeros((2 + 2 * count, 2 + 2 * count)), np.zeros(2 + 2 * count)
    matrix[0, 1], matrix[1, 0], right[0] = 2.0, -0.5, -2.0
    for k in range(count):
        a = 2 + 2 * k
        matrix[a, a + 1], matrix[a + 1, a] = 2.0, -0.5
        for c in (0, 1):
            matrix[c, [a + c, c]] += np.array([1, -1]) * ratios[k] / stokes[k]
            matrix[a + c, [a + c, c]] += np.array([-1, 1]) / stokes[k]
    expected = np.linalg.solve(matrix, right).reshape(count + 1, 2)
    found = nsh.velocities_of_populations(stokes, ratios, 1.0)
    gas, dust = [found.gas_radial, found.gas_azimuthal], np.stack([found.dust_radial, found.dust_azimuthal], axis=1)
    np.testing.assert_allclose(np.vstack([gas, dust]), expected, rtol=1e-8, atol=1e-11)


@pytest.mark.parametrize("light", [0.0, 0.4])
def test_drift_about_circles_balances_the_whole_centrifugal_force(light):
    """v_phi^2 / r and not its linear part, in units of the Keplerian speed, at headwinds up to .3 of it."""
    stream = np.random.default_rng(5)
    eta, kepler = np.array([-0.02, 1e-3, 0.03, 0.09, 0.3]), np.array([1.0, 2.0, 0.3, 1.5, 7.0])
    stokes, ratios = 10 ** stream.uniform(-3, 2, (4, 5)), stream.uniform(0.01, 2.0, (4, 5))
    push = light * stream.random((4, 5))
    found = nsh.drift_about_circular_orbits(stokes, ratios, eta * kepler, kepler, push * kepler if light else None)
    v, turn, vd, turn_d = (speed / kepler for speed in found)
    turn, turn_d = 1.0 + turn, 1.0 + turn_d
    drag_r, drag_phi = (vd - v) / stokes, (turn_d - turn) / stokes
    near = {"rtol": 0, "atol": 1e-12}  # rounding over St
    np.testing.assert_allclose(turn**2 - 1.0 + 2.0 * eta + (ratios * drag_r).sum(axis=0), 0.0, **near)
    np.testing.assert_allclose(-0.5 * turn * v + (ratios * drag_phi).sum(axis=0), 0.0, **near)
    np.testing.assert_allclose(turn_d**2 - 1.0 + push - drag_r, 0.0, **near)
    np.testing.assert_allclose(-0.5 * turn_d * vd - drag_phi, 0.0, **near)


def test_drift_about_circles_is_nsh_in_a_thin_disc():
    """As eta goes to 0, by eta."""
    stokes, ratios = np.array([[0.01], [0.3], [4.0]]), np.array([[0.2], [0.5], [0.1]])
    linear, errors = nsh.velocities_of_populations(stokes, ratios, [1.0]), []
    for eta in (1e-4, 1e-5):
        found = nsh.drift_about_circular_orbits(stokes, ratios, [eta * 2.5], [2.5])
        errors.append(max(np.abs(a / (2.5 * eta) - b).max() for a, b in zip(found, linear, strict=True)))
    assert errors[0] < 3e-4 and errors[1] / errors[0] == pytest.approx(0.1, rel=0.01)


def test_nsh_limits():
    drift = nsh.velocities(1.0, 0.0, 0.01)
    assert (drift.dust_radial, drift.gas_azimuthal, drift.gas_radial) == pytest.approx((-0.01, -0.01, 0.0))
    assert nsh.velocities(0.1, 0.01, 0.01).gas_radial > 0


def test_sedov_numbers():
    """E = .311357 takes a cylindrical shock to .75 in a time of 1 (Kamm & Timmes 2007, gamma = 1.4)."""
    assert sedov.shock_radius(1.0, 0.311357, gamma=1.4) == pytest.approx(0.75, abs=1e-5)
    assert sedov.arrival_time(sedov.shock_radius(0.3, 2.0, 5.0), 2.0, 5.0) == pytest.approx(0.3, rel=1e-12)


@pytest.mark.parametrize("gamma", [1.2, 1.4, 5 / 3])
def test_sedov_keeps_mass_and_energy(gamma):
    front = sedov.shock_radius(0.3, 2.0, 5.0, gamma)
    r = np.linspace(0, front, 400_001)[:-1]
    flow = sedov.solution(r, 0.3, 2.0, 5.0, gamma)
    energy = 0.5 * flow.density * flow.velocity**2 + flow.pressure / (gamma - 1)
    # The last of 4e5 intervals is left out, with up to ten times the mean density in a shell 1e-3 as wide as the front.
    assert 2 * np.pi * np.trapezoid(flow.density * r, r) == pytest.approx(5.0 * np.pi * front**2, rel=1e-4)
    assert 2 * np.pi * np.trapezoid(energy * r, r) == pytest.approx(2.0, rel=1e-4)
    assert sedov.solution(np.array([1.1 * front]), 0.3, 2.0, 5.0, gamma) == ([5.0], [0.0], [0.0])


def test_gresho_is_in_balance():
    """dP/dr = rho v^2 / r, by differences over 1e-6."""
    r = np.array([0.05, 0.3, 0.45, 0.59, 0.7])
    at = {"at": 0.3, "peak": 1.7}
    pressure = [gresho.pressure(r + d, 2.0, **at) for d in (-1e-6, 1e-6)]
    slope = (pressure[1] - pressure[0]) / 2e-6
    v = gresho.speed(r, **at)
    # Next to the peak, at .3, the mean of both sides is that of the kink.
    np.testing.assert_allclose(slope, 2.0 * v**2 / r, rtol=1e-4, atol=1e-6)
    assert v.max() == pytest.approx(1.7) and v[-1] == 0.0


def test_settling_of_a_damped_oscillator():
    """Constant t_stop: the damped harmonic oscillator, over and under the critical t_stop Omega = 1/2."""
    start, time = np.array([-2.0, 0.1, 1.0]), 3.0
    for stop in (0.05, 4.0):
        rate = np.sqrt(complex(0.25 / stop**2 - 4.0))  # Omega = 2
        shape = np.exp(-0.5 * time / stop) * (np.cosh(rate * time) + np.sinh(rate * time) / (2 * stop * rate))
        fall = -4.0 * np.exp(-0.5 * time / stop) * np.sinh(rate * time) / rate
        z, u = settling.trajectories(time, start, lambda z, stop=stop: np.full_like(z, stop), 2.0)
        # The integrator's tolerance of 1e-8 a step.
        np.testing.assert_allclose(z, start * shape.real, atol=1e-6)
        np.testing.assert_allclose(u, start * fall.real, atol=1e-5)


def test_small_grains_settle_at_the_terminal_velocity():
    z, u = settling.trajectories(0.5, np.array([0.5, 1.0]), lambda z: 1e-4 / settling.gas_density(z, 1.0, 1.0), 1.0)
    expected = settling.terminal_velocity(z, 1e-4 / settling.gas_density(z, 1.0, 1.0), 1.0)
    np.testing.assert_allclose(u, expected, rtol=1e-3)  # to t_stop Omega of 1.7e-4
