"""Stopping times: their laws, and the relaxation where they depend on the slip."""

import math
from functools import cache

import numpy as np
import pytest
from astropy import constants as const
from astropy import units as un
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from discsim import Simulation
from discsim.exact import dustybox
from discsim.formulas import laws as formulas
from discsim.formulas.laws import EPSTEIN, EPSTEIN_STOKES, KWOK, STOPPING_TIME
from discsim.kernels.drag.coupled import SCRATCH_COLUMNS
from discsim.kernels.drag.laws import nonlinear_drag_factor, stopping_time
from discsim.kernels.drag.nonlinear import relax_nonlinear
from discsim.kernels.dust.background import Disc, path_at
from discsim.kernels.dust.background import relax_by_speed as relax_in_disc
from discsim.parts import LAWS
from discsim.physics.laws import stopping_times
from discsim.preview.derived import derived_rows, gas_at_start
from discsim.scene import load_scene

SUPERSONIC, BOULDER = np.array([1.0, KWOK, 0.0, 0.0, 0.0]), np.array([1.0, KWOK, 1.0, 1e-3, 1.0])
GRAINS = {"supersonic": (EPSTEIN, SUPERSONIC), "boulder": (EPSTEIN_STOKES, BOULDER)}


# Formulas


@pytest.mark.parametrize(
    ("speed", "coefficient"),
    [(0.01, lambda re: 24 / re), (10.0, lambda re: 24 / re**0.6), (1000.0, lambda re: 0.44)],
)
def test_stokes_drag_is_half_the_coefficient_times_the_ram_pressure(speed, coefficient):
    """F = C_D pi s^2 rho_g w^2 / 2 = m w / t_stop, with viscosity nu = lambda v_th / 2 (kinetic convention)."""
    size, material, rho, sound, path = 2.0, 5.0, 0.7, 1.3, 0.05
    thermal = math.sqrt(8 / math.pi)
    grain = np.array([size * material / thermal, 0.0, size, path * rho, thermal])
    reynolds = 2 * size * speed / (0.5 * path * thermal * sound)
    assert (reynolds < 1, 1 < reynolds < 783, reynolds > 783).index(True) == (0.01, 10.0, 1000.0).index(speed)
    force = 0.5 * coefficient(reynolds) * math.pi * size**2 * rho * speed**2
    mass = 4 / 3 * math.pi * size**3 * material
    time = stopping_time(EPSTEIN_STOKES, grain, 1.0, rho, sound, 0.0)
    time /= nonlinear_drag_factor(EPSTEIN_STOKES, grain, rho, sound, 0.0, speed)
    assert time == pytest.approx(mass * speed / force, rel=1e-12)


@pytest.mark.parametrize("form", range(5))
def test_kernels_and_previews_have_one_formula(form):
    """The same bits, compiled or not: previews call the formula itself."""
    stream = np.random.default_rng(form)
    for omega in (0.0, 1.7):
        for numbers in 10.0 ** stream.uniform(-3, 3, (50, 9)):
            grain, (ratio, density, sound, speed) = numbers[:5], numbers[5:]
            if form != formulas.STOKES_NUMBER or omega > 0.0:
                given = form, grain, ratio, density, sound, omega
                assert formulas.stopping_time(*given) == stopping_time(*given)
            given = form, grain, density, sound, omega, speed
            # Its power 0.4 is that of another library: an ulp or so.
            assert formulas.nonlinear_drag_factor(*given) == pytest.approx(nonlinear_drag_factor(*given), rel=1e-15)


@pytest.mark.parametrize(
    ("law", "given", "of_dust"),
    [
        ("constant", {"K": 3.0}, {}), ("stopping-time", {"t_stop": 0.3}, {}),
        ("stopping-time", {"t_stop": 0.3}, {"t_stop": 0.7}), ("stopping-time", {}, {"t_stop": 0.7}),
    ],
)  # fmt: skip
def test_the_rate_of_a_uniform_law_is_that_of_its_stopping_time(law, given, of_dust):
    """eps / t_stop, which exact solutions take; one that no gas changes says its time too, that of the dust first."""
    tables = uniform(law, **given)
    tables["dust"] = {**tables["dust"], **of_dust}
    scene = load_scene(tables)
    (time,) = stopping_times(scene, np.array([2.0]), np.ones(1), None)
    ratio = scene.dust[0].ratio
    assert LAWS[law].uniform_rate(scene, scene.dust[0], 2.0) == pytest.approx(ratio / time[0], rel=1e-15)
    assert LAWS[law].uniform_time is None or LAWS[law].uniform_time(scene, scene.dust[0]) == time[0]
    assert time[0] == of_dust.get("t_stop", time[0])


def uniform(law, **given):
    return {
        "units": {"system": "code"},
        "run": {"until": 1.0},
        "space": {"dimensions": 1, "size": 1.0, "boundary": "periodic"},
        "initial": {"kind": "box"},
        "gas": {"particles": 10, "eos": {"kind": "isothermal", "sound_speed": 1.0}},
        "dust": {"particles": 10, "ratio": 0.5},
        "drag": {"law": law, **given},
    }


def test_epstein_goes_over_into_stokes():
    """At lambda = 4 s / 9 the two drags are equal, and at vanishing speed the drag is continuous."""
    grain = np.array([2.0, 0.0, 1.0, 4 / 9, 1.0])
    below, above = (stopping_time(EPSTEIN_STOKES, grain, 1.0, rho, 1.0, 0.0) for rho in (1 - 1e-9, 1 + 1e-9))
    assert below == pytest.approx(above, rel=1e-8) and below == pytest.approx(2.0, rel=1e-8)
    # In dense gas Stokes' drag no longer depends on the density.
    dense = [stopping_time(EPSTEIN_STOKES, grain, 1.0, rho, 1.0, 0.0) for rho in (10.0, 100.0)]
    assert dense[0] == pytest.approx(dense[1], rel=1e-14) and dense[0] == pytest.approx(2.0, rel=1e-14)


@pytest.mark.parametrize("speed", [0.01, 1.0, 100.0])
@pytest.mark.parametrize("kind", GRAINS)
def test_drag_in_a_disc_is_that_in_the_gas_of_its_midplane(kind, speed):
    """Sigma about a star is gas of the density Sigma Omega / (sqrt(2 pi) c_s), whatever the slip."""
    (law, grain), rho, sound, omega = GRAINS[kind], 0.3, 2.0, 0.7
    sigma = math.sqrt(2 * math.pi) * rho * sound / omega
    times = [
        stopping_time(law, grain, 1.0, density, sound, turn)
        / nonlinear_drag_factor(law, grain, density, sound, turn, speed)
        for density, turn in ((sigma, omega), (rho, 0.0))
    ]
    assert times[0] == pytest.approx(times[1], rel=1e-12)  # rounding


def test_supersonic_limits():
    """Epstein's drag at high Mach numbers is ram pressure: 1/t ~ w; Kwok's formula joins the two."""
    slow, fast, faster = (nonlinear_drag_factor(EPSTEIN, SUPERSONIC, 1.0, 2.0, 0.0, w) for w in (1e-6, 2e3, 4e3))
    assert slow == pytest.approx(1.0, abs=1e-12) and faster == pytest.approx(2 * fast, rel=1e-5)
    assert nonlinear_drag_factor(EPSTEIN, SUPERSONIC, 1.0, 2.0, 0.0, 2.0) == pytest.approx(
        math.sqrt(1 + 9 * math.pi / 128)
    )


@pytest.mark.parametrize("w", [0.0, 0.3, 1e3])
def test_linear_laws_know_no_speed(w):
    assert nonlinear_drag_factor(EPSTEIN, np.array([1.0, 0.0, 0.0, 0.0, 0.0]), 1.0, 1.0, 0.0, w) == 1.0


# Relaxation


def by_ode(mass, slow, law, grains, y, b, two_way, dt):
    n, dim = y.shape

    def slope(_, x):
        v, out = x.reshape(n, dim), b.copy()
        for s in range(1, n):
            slip = v[s] - v[0]
            push = nonlinear_drag_factor(law, grains[s - 1], 1.0, 1.0, 0.0, math.sqrt((slip**2).sum())) / slow[s] * slip
            out[s] -= push
            if two_way:
                out[0] += mass[s] / mass[0] * push
        return out.ravel()

    return solve_ivp(slope, (0, dt), y.ravel(), method="LSODA", rtol=1e-11, atol=1e-13).y[:, -1].reshape(n, dim)


@pytest.mark.parametrize("two_way", [True, False])
@pytest.mark.parametrize("populations", [1, 3])
@pytest.mark.parametrize("time", [0.01, 1.0, 10.0])
@pytest.mark.parametrize("kind", GRAINS)
def test_relaxation_by_speed_is_that_of_an_ode_solver(kind, time, populations, two_way):
    """Mach and Reynolds numbers from 10 to 1e4 fall by orders within the kick."""
    law, grain = GRAINS[kind]
    rng = np.random.default_rng(3)
    n = populations + 1
    mass, slow = np.r_[1.0, rng.uniform(0.1, 2, populations)], np.r_[np.inf, time * rng.uniform(0.5, 2, populations)]
    y, b, change = 10 * rng.normal(size=(n, 2)), 3 * rng.normal(size=(n, 2)), np.empty((n, 2))
    grains = np.tile(grain, (populations, 1))
    times = slow.copy()
    relax_nonlinear(
        mass, times, law, grains, 1.0, 1.0, 0.0, y, b, two_way, 1.0, True, True, np.empty((n, SCRATCH_COLUMNS)), change
    )
    expected = by_ode(mass, slow, law, grains, y, b, two_way, 1.0)
    largest = np.abs(y - y[0]).max()
    np.testing.assert_allclose((y + b + change)[1:], expected[1:], rtol=0, atol=1e-7 * largest)
    assert (times[1:] < slow[1:]).all()  # faster than at no speed
    if two_way:
        np.testing.assert_allclose(mass @ change, 0.0, atol=1e-14 * largest)


@pytest.mark.parametrize("kind", GRAINS)
def test_a_push_takes_grains_at_rest_in_the_gas_into_quick_drag(kind):
    """Without a slip at the start the drag does not depend on it, but what pushes the grains makes one in the kick."""
    law, grain = GRAINS[kind]
    mass, slow, y = np.array([1.0, 0.4, 0.7]), np.array([np.inf, 2.3, 0.9]), np.tile([[0.3, -0.2]], (3, 1))
    b, change = np.array([[0.2, 0.1], [9.0, -7.0], [-4.0, 11.0]]), np.empty((3, 2))
    grains, times, room = np.tile(grain, (2, 1)), slow.copy(), np.empty((3, SCRATCH_COLUMNS))
    relax_nonlinear(mass, times, law, grains, 1.0, 1.0, 0.0, y, b, True, 1.3, True, True, room, change)
    expected = by_ode(mass, slow, law, grains, y, b, True, 1.3)
    # As of slips at the start: 1e-7 of the largest velocity.
    np.testing.assert_allclose(y + 1.3 * b + change, expected, rtol=0, atol=1e-7 * np.abs(expected).max())
    assert (times[1:] < slow[1:]).all()


@settings(deadline=None, max_examples=150)
@given(
    kind=st.sampled_from(sorted(GRAINS)),
    ratio=st.floats(-6, 6).map(lambda e: 10**e),
    time=st.floats(-6, 6).map(lambda e: 10**e),
    slip=st.floats(-30, 30),
    source=st.floats(-30, 30),
    boost=st.floats(-30, 30),
)
def test_relaxation_by_speed_is_sane(kind, ratio, time, slip, source, boost):
    """Momentum stays, the slip is finite and without a source only shrinks, in every frame the same."""
    law, grain = GRAINS[kind]
    mass, grains = np.array([1.0, ratio]), grain[None]
    size = abs(slip) + abs(source) + abs(boost)

    def change_of(y, b):
        change = np.empty((2, 1))
        slow = np.array([np.inf, time])
        relax_nonlinear(
            mass, slow, law, grains, 1.0, 1.0, 0.0, y, b, True, 1.0, True, True, np.empty((2, SCRATCH_COLUMNS)), change
        )
        assert np.isfinite(change).all()
        return change

    y, b = np.array([[0.0], [slip]]), np.array([[0.0], [source]])
    change = change_of(y, b)
    assert abs((mass @ change)[0]) <= 1e-13 * max(1.0, ratio) * size
    np.testing.assert_allclose(change_of(y + boost, b), change, rtol=0, atol=1e-7 * size)
    alone = change_of(y, 0 * b)
    assert abs(slip + alone[1, 0] - alone[0, 0]) <= abs(slip) * (1 + 1e-12)


def path_of(law, grain, gas=(1.0, 1.0, 0.1, 0.5, 1.5)):
    no_table = np.empty((0, 5)), 0.0, 1.0
    disc = Disc(law, grain[None], True, np.array([0.01]), np.ones(1), 1.0, 0.0, np.array(gas), *no_table)
    return path_at(0.8, 0.6, 0, disc)


def slip_by_ode(path, delta, m, a_r, a_phi, dt):
    spin = path.r * (path.orbit + path.azimuthal)

    def slope(_, y):
        w = np.hypot(path.radial + y[0], path.azimuthal + y[1] / path.r)
        rate = formulas.drag_factor(path.mach2, path.reynolds2, w * w) / path.slow
        more = 1 / path.time - rate
        radial = -y[0] * rate + path.radial * more + a_r + ((spin + y[1]) ** 2 - spin**2) / path.r**3
        return [radial, -y[1] * rate + path.r * (path.azimuthal * more + a_phi)]

    # Many steps, so that none passes over a slip at which the law changes.
    found = solve_ivp(slope, (0, dt), [delta, m], method="LSODA", rtol=1e-11, atol=1e-12, max_step=dt / 50)
    return found.y[:, -1]


def flowing(r, pull, time, star=1.3, softening=0.7):
    """The path at a radius of a grain of population 1 in a disc of uneven pressure that flows inwards, in units of its
    own star; light leaves `pull` of that star's pull on it.
    """
    log = np.linspace(-1.0, 1.0, 2001)
    pull_of_gas = 0.01 * np.exp(0.3 * log)  # g, with -(1/Sigma) dP/dr = g / r
    columns = -log, np.log(0.01) - 0.2 * log, pull_of_gas, 0.3 * pull_of_gas, -0.02 * np.exp(-0.5 * log)
    grains, ratios = np.array([[1.0, 0.0, 0.0, 0.0, 0.0], [time, 0.0, 0.0, 0.0, 0.0]]), np.full(2, 0.01)
    pulls, no_laws = np.array([1.0, pull]), np.array([1.0, 1.0, 0.01, 0.5, 1.5])
    disc = Disc(
        STOPPING_TIME, grains, True, ratios, pulls, star, softening, no_laws, np.stack(columns, axis=1), -1.0, 1000.0
    )
    return path_at(0.6 * r, 0.8 * r, 1, disc)


@pytest.mark.parametrize("pull", [1.0, 0.6, 0.05])
def test_a_grain_that_feels_no_drag_is_on_its_own_circle(pull):
    """v_phi^2 = beta's share of G M r^2 / (r^2 + s^2)^(3/2), however the gas turns and flows."""
    for r in (0.5, 1.1, 2.0):
        path = flowing(r, pull, 1e12)
        speed = math.sqrt(pull * 1.3 * r**2 / (r**2 + 0.49) ** 1.5)
        assert path.orbit + path.azimuthal == pytest.approx(speed, rel=1e-9)
        assert abs(path.radial) < 1e-9


@pytest.mark.parametrize("pull", [1.0, 0.6])
@pytest.mark.parametrize("time", [0.03, 1.0, 20.0])
def test_a_steady_drift_in_gas_that_flows_has_no_torque_left(pull, time):
    """The angular momentum that drag takes is what the gas has less of where it drifts to, by differences of the
    gas's own; and the force that is left on its path, `push`, is that of its place and velocity.
    """
    for r in (0.5, 1.1, 2.0):
        path, d = flowing(r, pull, time), 1e-4
        gas = [x * flowing(x, pull, time).orbit for x in (r - d, r + d)]
        assert path.time == time and path.slip - path.radial == pytest.approx(0.02 / math.sqrt(r), rel=1e-6)
        carried = path.radial * (gas[1] - gas[0]) / (2.0 * d)
        assert carried == pytest.approx(-r * path.azimuthal / time, rel=1e-4)  # of a table with nodes of .001
        pulled = pull * 1.3 * r / (r**2 + 0.49) ** 1.5
        force = (path.orbit + path.azimuthal) ** 2 / r - pulled - path.slip / time
        assert path.push == pytest.approx(force, abs=1e-12)


@pytest.mark.parametrize("kind", GRAINS)
@pytest.mark.parametrize("seed", range(12))
def test_slip_in_a_given_disc_is_that_of_an_ode_solver(kind, seed):
    """Radial velocity and angular momentum at a fixed place, whose stopping time depends on their slip, over a kick:
    near the steady drift and far from it, steps shorter and longer than the stopping time."""
    rng = np.random.default_rng(seed)
    path = path_of(*GRAINS[kind], (10.0 ** rng.uniform(-1, 1), 1.0, 10.0 ** rng.uniform(-4, -1), 0.5, 1.5))
    slip = np.hypot(path.radial, path.azimuthal)
    delta, m, a_r, a_phi = slip * 10.0 ** rng.uniform(-3, 2) * rng.normal(size=4)
    dt = 10.0 ** rng.uniform(-2, 0)
    found = relax_in_disc(delta, m, path, a_r, a_phi, path.r * (path.orbit + path.azimuthal), dt)
    expected = slip_by_ode(path, delta, m, a_r, a_phi, dt)
    largest = max(np.hypot(path.radial + v, path.azimuthal + w / path.r) for v, w in ((delta, m), expected))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-7 * largest)  # ten times what a step may err by


def test_slip_that_falls_through_the_end_of_stokes_drag():
    """Re falls from 3 to 0.03 in some stopping times: a long step must not miss where the drag turns linear."""
    path = path_of(EPSTEIN_STOKES, np.array([0.002, 0.0, 1.0, 1.0, 1.0]), (1.0, 1.0, 0.01, 0.5, 1.5))
    unit = 1.0 / math.sqrt(path.reynolds2)  # slip of Re = 1
    spin, dt = path.r * (path.orbit + path.azimuthal), 7.0 * path.slow
    assert np.hypot(path.radial, path.azimuthal) < 0.03 * unit
    for angle in (0.0, 0.5, 3.0):
        delta, m = 3.0 * unit * math.cos(angle), 3.0 * unit * math.sin(angle)
        found = relax_in_disc(delta, m, path, 0.0, 0.0, spin, dt)
        np.testing.assert_allclose(found, slip_by_ode(path, delta, m, 0.0, 0.0, dt), rtol=0, atol=3e-7 * unit)


@pytest.mark.parametrize("kind", GRAINS)
@pytest.mark.parametrize("dt", [1e-3, 1.0, 1e3, 1e6])
def test_steady_drift_is_exact_at_any_step(kind, dt):
    """On the path the drag is that of its own slip, and a grain there stays."""
    law, grain = GRAINS[kind]
    path = path_of(law, grain)
    slip = np.hypot(path.radial, path.azimuthal)
    fast = nonlinear_drag_factor(law, grain, path.density, path.sound, path.kepler, slip)
    assert path.time == pytest.approx(path.slow / fast, rel=1e-11)
    assert fast > 1.0
    found = relax_in_disc(0.0, 0.0, path, 0.0, 0.0, path.r * (path.orbit + path.azimuthal), dt)
    np.testing.assert_allclose(found, 0.0, atol=1e-11 * slip)


# Whole scenes


def box(size, scheme="tsc", direction="two-way", velocity="4 km/s", **drag):
    """Gas of 1e-9 g/cm3 at 1 au, grains of 3 g/cm3: c_s = 1 km/s, a mean free path of about 2 cm."""
    return {
        "run": {"until": "1 day", "timestep": "0.3 day"},
        "space": {"dimensions": 1, "size": "1 au", "boundary": "periodic"},
        "initial": {"kind": "box", "density": "1e-9 g/cm3", "dust_velocity": velocity},
        "gas": {"particles": 40, "eos": {"kind": "isothermal", "sound_speed": "1 km/s"}},
        "dust": {"particles": 40, "ratio": 0.5, "grain_size": size, "grain_density": "3 g/cm3"},
        "drag": {
            "law": "epstein-stokes", "convention": "papers", "scheme": scheme, "direction": direction,
            "supersonic": True,
        } | drag,
    }  # fmt: skip


def rate_of(size, units):
    """One over the stopping time of a grain in the box, as a function of its speed, in code units, by astropy."""
    rho, sound, s = 1e-9 * un.g / un.cm**3, 1 * un.km / un.s, un.Quantity(size)
    path = (2.34 * const.u / (2e-15 * un.cm**2) / rho).to(un.cm)
    mach = (un.au / units.time / sound).decompose().value  # of a speed of 1
    slow = (s * 3 * un.g / un.cm**3 / (rho * sound)).to(units.time).value
    ratio = (4 * s / (9 * path)).decompose().value
    if ratio < 1:
        return lambda speed: np.sqrt(1 + 9 * np.pi / 128 * (mach * speed) ** 2) / slow
    reynolds = 9 * ratio * mach
    return lambda speed: max(1.0, (reynolds * speed) ** 0.4, 0.44 / 24 * reynolds * speed) / (slow * ratio)


@cache
def exact_velocities(size, ratio, start, time):
    """Of gas and dust in the box, which schemes share: stiff, to 1e-11."""
    return dustybox.velocities_by_speed(time, 0.0, start, ratio, rate_of(size, load_scene(box(size)).units))


@pytest.mark.parametrize("scheme", ["idic", "idic-linear", "tsc"])
@pytest.mark.parametrize("direction", ["two-way", "one-way"])
@pytest.mark.parametrize("size", ["1 mm", "1 cm", "10 cm", "1 m", "10 m"])
def test_grains_of_all_sizes_stop_as_they_must(size, direction, scheme):
    """DustyBox from Epstein's drag through all of Stokes', to 1e-6 of an ODE solver's, in astropy's units."""
    sim = Simulation(box(size, scheme, direction))
    start = float(sim.dust.vel[0, 0])
    sim.run()
    ratio = 0.5 if direction == "two-way" else 1e-30
    gas, dust = exact_velocities(size, ratio, start, sim.time)
    # 1e-6 of the slip at the start.
    np.testing.assert_allclose(sim.gas.vel[:, 0], gas[0] if direction == "two-way" else 0.0, rtol=0, atol=1e-6 * start)
    np.testing.assert_allclose(sim.dust.vel[:, 0], dust[0], rtol=0, atol=1e-6 * start)


@pytest.mark.parametrize("scheme", ["idic-linear", "tsc"])
def test_grains_of_two_sizes_stop_each_as_its_own_must(scheme):
    """Two sizes of one population: each enters Stokes drag at its own size, not at the mean size."""
    tables = box({"smallest": "5 cm", "largest": "20 cm", "bins": 2}, scheme, "one-way")
    tables["dust"]["particles"] = 400
    sim = Simulation(tables)
    start, sizes = float(sim.dust.vel[0, 0]), np.unique(sim.dust.size)
    sim.run()
    assert len(sizes) == 2
    for size in sizes:
        text = f"{float((size * sim.units.length).to_value('cm'))!r} cm"
        _, dust = exact_velocities(text, 1e-30, start, sim.time)
        # As of one size: 1e-6 of the slip at the start.
        np.testing.assert_allclose(sim.dust.vel[sim.dust.size == size, 0], dust[0], rtol=0, atol=1e-6 * start)


@pytest.mark.parametrize("size", ["1 mm", "10 cm", "10 m"])
def test_the_preview_knows_both_regimes(size):
    """`discsim check` has a formula of its own, at no slip: that of the same grains in astropy's units, to rounding."""
    scene = load_scene(box(size))
    at = gas_at_start(scene)
    (found,) = stopping_times(scene, at.density, at.sound_speed, at.omega)
    assert found == pytest.approx(1 / rate_of(size, scene.units)(0.0), rel=1e-12)


@pytest.mark.parametrize("scheme", ["mk", "lab14", "reconstructed", "esph", "isph"])
def test_pairs_take_the_speed_that_they_have(scheme):
    """Stopping times of the slip at the start of each kick: first order in steps of .01 of a day, t_stop .35 days."""
    tables = box("10 cm", scheme)
    tables["run"] = {"until": "0.2 day", "timestep": "0.01 day"}
    tables["dust"]["offset"] = 0.5  # a pair at one place has no line of sight
    sim = Simulation(tables)
    start = float(sim.dust.vel[0, 0])
    sim.run()
    gas, dust = dustybox.velocities_by_speed(sim.time, 0.0, start, 0.5, rate_of("10 cm", sim.units))
    np.testing.assert_allclose(sim.gas.vel[:, 0], gas[0], rtol=0, atol=0.01 * start)
    np.testing.assert_allclose(sim.dust.vel[:, 0], dust[0], rtol=0, atol=0.01 * start)
    assert dust[0] < 0.9 * start


def test_friction_by_speed_heats_the_gas():
    """Fast dust in adiabatic gas: kinetic energy that goes is heat, to the tolerance of the sub-steps."""
    tables = box("1 cm")
    tables["gas"]["eos"] = {"kind": "adiabatic", "gamma": 1.4, "sound_speed": "1 km/s"}
    for scheme in ("idic", "idic-linear", "tsc"):
        tables["drag"] = tables["drag"] | {"scheme": scheme}
        sim = Simulation(tables)

        def energy(sim=sim):
            motion = sum((p.mass * (p.vel**2).sum(axis=1)).sum() / 2 for p in (sim.gas, sim.dust))
            return motion, (sim.gas.mass * sim.gas.u).sum()

        motion, heat = energy()
        sim.run()
        later, hotter = energy()
        assert motion - later > 0.3 * motion
        assert hotter - heat == pytest.approx(motion - later, rel=1e-6)


def test_stopping_times_follow_the_slip():
    """What snapshots hold is the time at the slip that there is."""
    sim = Simulation(box("1 mm", velocity="10 km/s"))
    at_rest = Simulation(box("1 mm", velocity="0 km/s"))
    times = []
    for one in (sim, at_rest):
        with one.synchronised() as state:
            times.append(one.effects["drag"].current_stopping_times(state))
    fast, slow = times
    np.testing.assert_allclose(slow / fast, math.sqrt(1 + 9 * math.pi / 128 * 100), rtol=1e-9)


def test_supersonic_dust_in_a_background():
    """A given disc and SPH-free dust: fast grains stop sooner than slow ones would."""
    tables = {
        "units": {"system": "code"}, "run": {"until": 0.01}, "space": {"size": 4.0},
        "background": {"surface_density": 1e-4, "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.05}},
        "initial": {"kind": "disc", "surface_density": 1e-4, "inner": 0.9, "outer": 1.1},
        "dust": {"particles": 50, "ratio": 0.01, "grain_size": 1e-4, "grain_density": 1.0}, "star": {"mass": 1.0},
        "drag": {"law": "epstein", "direction": "one-way"},
    }  # fmt: skip
    left = []
    for supersonic in (False, True):
        sim = Simulation(tables | {"drag": tables["drag"] | {"supersonic": supersonic}})
        sim.dust.vel *= 1.3  # Mach 6
        sim.step()
        speed = np.sqrt((sim.dust.vel**2).sum(axis=1)) * np.sqrt(np.sqrt((sim.dust.pos**2).sum(axis=1)))
        left.append(float(speed.mean() - 1))
    assert 0.0 < left[1] < 0.9 * left[0]


def test_stokes_over_density_is_epstein_of_a_disc():
    """St = stokes Sigma_ref / Sigma: .1 at the reference radius, as r for Sigma ~ 1/r."""
    tables = {
        "units": {"system": "code"}, "run": {"until": 1.0}, "space": {"size": 8.0, "cells": 64},
        "initial": {"kind": "disc", "mass": 0.01, "inner": 1.0, "outer": 3.0},
        "gas": {"particles": 4000, "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.05}},
        "dust": {"particles": 2000, "ratio": 0.01}, "star": {"mass": 1.0},
        "drag": {"law": "stokes-over-density", "stokes": 0.1},
    }  # fmt: skip
    sim = Simulation(tables)
    r = np.sqrt((sim.dust.pos**2).sum(axis=1))
    middle = (r > 1.3) & (r < 2.7)
    with sim.synchronised() as state:
        stokes = sim.effects["drag"].current_stopping_times(state) * r**-1.5
    # Cells of a tenth of the radius.
    assert np.median((stokes / (0.1 * r))[middle]) == pytest.approx(1.0, abs=0.03)
    rows = dict(derived_rows(load_scene(tables)))
    assert rows["at"] == "1, 2, 3"
    shown = [float(x) for x in rows["Stokes number"].split(",")]
    np.testing.assert_allclose(shown, [0.1, 0.2, 0.3], rtol=0.01)
