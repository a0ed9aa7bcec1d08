"""Gas and dust in the whole loop: boxes, waves, shocks and discs against their exact solutions."""

import itertools

import numpy as np
import pytest
from dusty import ISOTHERMAL, scene
from scipy.linalg import expm

from discsim import Simulation
from discsim.exact import dustybox, dustyshock, dustywave

# DustyBox


def box_error(coefficient, ratio, scheme="tsc", start=(0.3, -1.0), external=(0.7, -0.4), **drag):
    """Largest error of all particles over the largest velocity, after .2 with accelerations."""
    box = {"kind": "box", "gas_velocity": start[0], "dust_velocity": start[1]}
    law = {"law": "constant", "K": coefficient, "scheme": scheme} | drag
    forces = {"gas": external[0], "dust": external[1]}
    sim = Simulation(scene(box, 0.2, law, ratio=ratio, external=forces))
    largest = max(np.abs(start))
    for _ in range(3):
        sim.step()
        gas, dust = dustybox.velocities(sim.time, *start, 1.0, ratio, coefficient, *external)
        error = max(np.abs(sim.gas.vel - gas).max(), np.abs(sim.dust.vel - dust).max())
        largest = max(largest, abs(gas), abs(dust))
    return error / largest


@pytest.mark.parametrize("scheme", ["idic", "idic-linear", "tsc"])
@pytest.mark.parametrize("ratio", [1e-6, 1e-2, 1.0, 1e6])
@pytest.mark.parametrize("coefficient", [1e-8, 1e-2, 1.0, 1e4, 1e12])
def test_dustybox_is_exact(coefficient, ratio, scheme):
    """Accelerations inside the relaxation: exact at any stiffness, to rounding."""
    assert box_error(coefficient, ratio, scheme) <= 1e-12


def test_dustybox_with_a_stopping_time():
    """K = eps rho_g / t_stop."""
    ratio, time = 0.3, 0.05
    box = {"kind": "box", "gas_velocity": 0.0, "dust_velocity": 1.0}
    sim = Simulation(scene(box, 0.2, {"law": "stopping-time", "t_stop": time}, ratio=ratio))
    sim.run()
    gas, dust = dustybox.velocities(0.2, 0.0, 1.0, 1.0, ratio, ratio / time)
    np.testing.assert_allclose(sim.gas.vel, gas, atol=1e-12)
    np.testing.assert_allclose(sim.dust.vel, dust, atol=1e-12)


def test_slip_at_long_steps():
    """dt = 50 t_stop under constant accelerations: the slip is (a_d - a_g) t_stop / (1 + eps)."""
    time = 0.002
    drag = {"law": "stopping-time", "t_stop": time}
    box = {"kind": "box"}
    external = {"gas": 0.5, "dust": 0.0}
    sim = Simulation(scene(box, 1.0, drag, run={"timestep": 50 * time}, external=external))
    sim.run()
    slip = sim.dust.vel.mean() - sim.gas.vel.mean()
    assert sim.state.step == 10
    assert slip == pytest.approx(-0.5 * time / 2, rel=0.01)


def test_one_way_box():
    """The dust follows; the gas does not notice."""
    box = {"kind": "box", "gas_velocity": 0.3, "dust_velocity": -1.0}
    drag = {"law": "stopping-time", "t_stop": 0.1, "direction": "one-way"}
    sim = Simulation(scene(box, 0.2, drag, ratio=2.0))
    sim.run()
    np.testing.assert_allclose(sim.gas.vel, 0.3, atol=1e-13)
    np.testing.assert_allclose(sim.dust.vel, 0.3 - 1.3 * np.exp(-2.0), atol=1e-12)


def test_implicit_integration_is_first_order():
    errors = []
    for steps in (20, 40, 80):
        box = {"kind": "box", "gas_velocity": 1.0, "dust_velocity": 0.0}
        drag = {"law": "constant", "K": 5.0, "integration": "implicit"}
        sim = Simulation(scene(box, 0.2, drag, run={"timestep": 0.2 / steps}))
        sim.run()
        errors.append(abs(sim.gas.vel.mean() - dustybox.velocities(0.2, 1.0, 0.0, 1.0, 1.0, 5.0)[0]))
    # Next order: K dt = .1, .05, .025.
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.05)
    assert errors[1] / errors[2] == pytest.approx(2.0, rel=0.03)


@pytest.mark.parametrize("scheme", ["idic", "idic-linear", "tsc"])
def test_three_populations(scheme):
    """Each with its own stopping time, coupled through the gas: the matrix exponential."""
    ratios, until = [0.5, 0.1, 1.0], 0.2
    dust = [{"particles": 40, "ratio": r} for r in ratios]
    box = {"kind": "box", "gas_velocity": 1.0, "dust_velocity": -0.5}
    sim = Simulation(scene(box, until, {"law": "constant", "K": 3.0, "scheme": scheme}, dust=dust))
    sim.run()
    a = np.zeros((4, 4))
    for j, ratio in enumerate(ratios, 1):
        a[0, 0] -= 3.0
        a[0, j] += 3.0
        a[j, j] -= 3.0 / ratio
        a[j, 0] += 3.0 / ratio
    exact = expm(a * until) @ [1.0, -0.5, -0.5, -0.5]
    np.testing.assert_allclose(sim.gas.vel, exact[0], atol=1e-12)
    for s in range(3):
        np.testing.assert_allclose(sim.dust.vel[sim.dust.species == s], exact[s + 1], atol=1e-12)


@pytest.mark.parametrize("scheme", ["idic", "idic-linear", "tsc"])
def test_momentum_with_random_velocities(scheme):
    """Gas and dust in 2D, dust at random places, all velocities random: momentum to 1e-12 of its terms a step."""
    rng = np.random.default_rng(8)
    given = {
        "gas": {"pos": rng.random((900, 2)), "vel": rng.normal(size=(900, 2)), "mass": np.full(900, 1 / 900)},
        "dust": {
            "pos": rng.random((700, 2)), "vel": rng.normal(size=(700, 2)), "mass": rng.uniform(0.5, 2, 700) / 700,
            "species": rng.integers(0, 2, 700),
        },
    }  # fmt: skip
    law = {"law": "constant", "K": 30.0, "scheme": scheme}
    tables = scene(None, 1.0, law, 900, [{"particles": 350, "ratio": 0.5}] * 2, dimensions=2)
    tables["initial"] = None
    sim = Simulation(tables, particles=given)

    def momentum():
        return sum((p.mass[:, None] * p.vel).sum(axis=0) for p in (sim.gas, sim.dust))

    scale = sum((p.mass[:, None] * np.abs(p.vel)).sum() for p in (sim.gas, sim.dust))
    for _ in range(3):
        before = momentum()
        sim.step()
        assert np.abs(momentum() - before).max() < 1e-12 * scale


# DustyWave: K = 500, 600 + 600 particles, t = .5 unless said; errors are rms over particles / max |exact|


def wave(h, coefficient=500.0, scheme="tsc", boost=0.0, offset=0.0):
    gas = {"particles": 600, "smoothing_length": h, "eos": ISOTHERMAL}
    dust = {"particles": 600, "ratio": 1.0, "offset": offset}
    start = {"kind": "wave", "velocity": boost}
    sim = Simulation(scene(start, 0.5, {"law": "constant", "K": coefficient, "scheme": scheme}, gas, dust))
    sim.run()
    out = []
    for p, name in ((sim.gas, "gas_velocity"), (sim.dust, "dust_velocity")):
        exact = getattr(dustywave.solution(p.pos[:, 0], 0.5, coefficient, 1.0, boost=boost), name)
        out.append(np.sqrt(((p.vel[:, 0] - exact) ** 2).mean()) / np.abs(exact - boost).max())
    return out


@pytest.mark.parametrize("scheme", ["idic-linear", "tsc"])
@pytest.mark.parametrize(("h", "bound"), [(0.025, 0.001), (0.01, 0.0006)])
@pytest.mark.parametrize("boost", [0.0, 1.0])
def test_dustywave(h, bound, boost, scheme):
    """The published aim for these schemes, in every frame."""
    assert max(wave(h, boost=boost, scheme=scheme)) <= bound


@pytest.mark.parametrize("scheme", ["idic-linear", "tsc"])
@pytest.mark.parametrize("h", [0.025, 0.01])
def test_dustywave_with_offset_dust(h, scheme):
    assert max(wave(h, offset=0.5, scheme=scheme)) <= 0.001


@pytest.mark.parametrize("scheme", ["idic-linear", "tsc"])
@pytest.mark.parametrize("coefficient", [0.5, 5.0, 5e5])
def test_dustywave_from_weak_to_stiff(coefficient, scheme):
    assert max(wave(0.01, coefficient, scheme=scheme)) <= 0.001


def test_clouds_smooth_no_drag_away():
    """Weak drag through wide clouds: with what they smooth given back, the error falls faster than second order."""
    wide, narrow = max(wave(0.04, 5.0)), max(wave(0.02, 5.0))
    # Without the gift .010 and .0024: k^2 h^2 / 4 of the drag.
    assert wide <= 0.001 and narrow <= 0.4 * wide


@pytest.mark.parametrize("h", [0.025, 0.01])
def test_plain_idic_has_its_staircase(h):
    """Velocities uniform in a cell of side h: the rest of a sine is k h / sqrt(24) whatever K."""
    assert wave(h, scheme="idic")[1] == pytest.approx(2 * np.pi * h / np.sqrt(24), rel=0.3)


def small_wave(coefficient, h, timestep, gas=600, dust=600, ratio=1.0, amplitude=1e-6):
    """A wave too small to steepen, at fixed steps."""
    start = {"kind": "wave", "amplitude": amplitude}
    law = {"law": "constant", "K": coefficient}
    particles = {"particles": gas, "smoothing_length": h, "eos": ISOTHERMAL}
    sim = Simulation(scene(start, 0.5, law, particles, dust, ratio, run={"timestep": timestep}))
    sim.run()
    return sim


def worst(sim, coefficient, ratio=1.0, amplitude=1e-6):
    """The worse rms error of the two species, over the largest exact velocity."""
    errors = []
    for name, p in sim.state.species.items():
        exact = dustywave.solution(p.pos[:, 0], 0.5, coefficient, ratio, amplitude=amplitude)
        velocity = getattr(exact, f"{name}_velocity")
        errors.append(np.sqrt(((p.vel[:, 0] - velocity) ** 2).mean()) / np.abs(velocity).max())
    return max(errors)


@pytest.mark.parametrize("coefficient", [5.0, 500.0])
def test_dustywave_is_second_order_in_h_and_tau(coefficient):
    """tsc: in h down to 2e-5, where the lattice of h = 12 spacings shows; in tau by differences of steps halved."""
    coarse, fine = (worst(small_wave(coefficient, h, 0.001), coefficient) for h in (0.04, 0.02))
    assert np.log2(coarse / fine) >= 1.9
    steps = [small_wave(coefficient, 0.04, tau) for tau in (0.05, 0.025, 0.0125)]
    vel = [np.concatenate([p.vel[np.argsort(p.ids), 0] for p in sim.state.species.values()]) for sim in steps]
    change = [np.sqrt(((a - b) ** 2).mean()) for a, b in itertools.pairwise(vel)]
    assert np.log2(change[0] / change[1]) >= 1.9


@pytest.mark.parametrize("coefficient", [0.5, 5.0, 500.0])
def test_a_wave_with_eight_grains(coefficient):
    """eps = .01: K's density is that of the dust, not of a lone grain in its cell (.07 then at K = 5); .0017 seen."""
    sim = small_wave(coefficient, 0.01, 0.003, dust=8, ratio=0.01, amplitude=1e-4)
    assert worst(sim, coefficient, 0.01, 1e-4) < 0.0025


def tube(dust, coefficient=500.0, ratio=1.0, gas=990):
    """DustyShock without the heat of friction, as Stoyanovskaya et al. 2018 have it, h = .01."""
    particles = {
        "particles": gas,
        "smoothing_length": 0.01,
        "eos": {"kind": "adiabatic", "gamma": 1.4},
        "viscosity": {},
    }
    law = {"law": "constant", "K": coefficient, "heating": False}
    sim = Simulation(scene({"kind": "shock"}, 0.2, law, particles, dust, ratio, space={"boundary": "open"}))
    sim.run()
    moving = ~sim.dust.immobile
    order = np.argsort(sim.dust.pos[moving, 0])
    x, u = sim.dust.pos[moving, 0][order], sim.dust.vel[moving, 0][order]
    exact = dustyshock.solution(x, 0.2, ratio).velocity
    return x, u, exact, np.sqrt(((u - exact) ** 2).mean()) / exact.max()


@pytest.mark.parametrize(("coefficient", "ratio"), [(500.0, 1.0), (5000.0, 1.0), (500.0, 3.0)])
def test_plateau_of_the_dustyshock_is_quiet(coefficient, ratio):
    """Noise below 2e-3 of the velocity about its running mean; the error is that of a front h wide, .031 to .035."""
    x, u, exact, error = tube(990, coefficient, ratio)
    assert error < 0.037
    plateau = (np.abs(exact / exact.max() - 1) < 1e-9) & (x > 0.02) & (x < 0.1)
    smooth = np.convolve(u[plateau], np.ones(9) / 9, "valid")
    assert np.sqrt(((u[plateau][4:-4] - smooth) ** 2).mean()) < 2e-3 * exact.max()


def test_a_shock_with_few_grains():
    """569 of gas and 50 of dust: less than twice the error of as many grains as gas (.040 and .030 seen)."""
    assert tube(50, gas=569)[3] < 2 * tube(569, gas=569)[3]


def test_dustyshock():
    """K = 500, eps = 1: the tube of a gas twice as heavy."""
    gas = {
        "particles": 1000, "smoothing_length": 0.01, "eos": {"kind": "adiabatic", "gamma": 1.4},
        "viscosity": {"alpha": 1.0, "beta": 2.0},
    }  # fmt: skip
    space = {"boundary": "open"}
    tables = scene({"kind": "shock"}, 0.2, {"law": "constant", "K": 500.0}, gas, 1000, space=space)
    sim = Simulation(tables)
    sim.run()
    x = sim.dust.pos[:, 0]
    inside = np.abs(x) < 0.45
    exact = dustyshock.solution(x, 0.2, 1.0)
    error = sim.dust.vel[:, 0] - exact.velocity
    # Front and contact are h wide: .01 / .3 of the motion's length, and some of it.
    assert np.abs(error)[inside].mean() < 0.015
    assert np.sqrt((error[inside] ** 2).mean()) < 0.06
    plateau = inside & (np.abs(exact.velocity / exact.velocity.max() - 1) < 1e-9)
    edges = np.quantile(x[plateau], [0.25, 0.75])
    middle = (x > edges[0]) & (x < edges[1])
    assert sim.dust.vel[middle, 0].mean() == pytest.approx(exact.velocity.max(), rel=0.02)
    gas_x = sim.gas.pos[:, 0]
    inside = np.abs(gas_x) < 0.45
    density = dustyshock.solution(gas_x, 0.2, 1.0).gas_density
    assert np.abs(sim.gas.density - density)[inside].mean() < 0.015
