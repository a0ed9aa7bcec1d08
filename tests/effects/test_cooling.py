"""Cooling within the step: zones, waves, balances of heat, energy, resume, and scenes that may name [cooling]."""

import itertools

import numpy as np
import pytest
from astropy import constants
from astropy import units as u
from runs import assert_resumes
from scipy.linalg import expm

from discsim import Simulation
from discsim.exact import cooling as exact
from discsim.kernels.sph import cooling as kernels
from discsim.physics import cooling as physics
from discsim.scene import SceneError, load_scene
from discsim.study.errors import drifts, totals

GAMMA = 1.4


def box(t_cool, run, particles=64, **tables):
    """A wave of sound in one dimension, of adiabatic speed 1 (code units)."""
    return {
        "units": {"system": "code"},
        "run": {"until": 0.5} | run,
        "space": {"dimensions": 1, "size": 1.0, "boundary": "periodic"},
        "initial": {"kind": "wave"},
        "gas": {"particles": particles, "eos": {"kind": "adiabatic", "gamma": GAMMA, "sound_speed": 1.0}},
        "cooling": {"kind": "constant", "t_cool": t_cool},
    } | tables


def disc(**tables):
    """Of adiabatic gas, in code units; `tables` take the place of its own, or are more."""
    eos = {"kind": "adiabatic", "gamma": GAMMA, "aspect_ratio": 0.1}
    return {
        "units": {"system": "code"},
        "run": {"until": 1.0},
        "space": {"size": 6.0, "cells": 32},
        "initial": {"kind": "disc", "mass": 0.01, "inner": 1.0, "outer": 2.0},
        "gas": {"particles": 1000, "eos": eos, "viscosity": {}},
        "star": {"mass": 1.0},
        "cooling": {"kind": "beta", "beta": 3.0},
    } | tables


DUSTY = {"dust": {"particles": 500, "ratio": 0.3}, "drag": {"law": "stopping-time", "t_stop": 0.1}}


@pytest.mark.parametrize("ratio", 10.0 ** np.arange(-6, 7, 2))
def test_a_zone_in_the_loop(ratio):
    """Still, even gas, ten times as hot as it is to be, in steps of .1: rounding, whatever t_cool is."""
    tables = box(
        0.1 * ratio, {"until": 0.5, "timestep": 0.1}, space={"dimensions": 1, "size": 40.0, "boundary": "periodic"}
    )
    warm = 1.0 / GAMMA / (GAMMA - 1.0)
    x = (np.arange(64.0)[:, None] + 0.5) * 40 / 64
    given = {"pos": x, "vel": np.zeros_like(x), "mass": np.full(64, 1 / 64), "u": np.full(64, 10.0 * warm)}
    sim = Simulation(tables, particles={"gas": given})
    sim.run()
    np.testing.assert_allclose(sim.gas.u, exact.linear(10.0 * warm, warm, 0.0, 0.1 * ratio, 0.5), rtol=1e-12)
    np.testing.assert_allclose(sim.gas.radiated, 10.0 * warm - sim.gas.u, atol=1e-13)


def amplitudes(sim):
    """Density, velocity and energy of the wave: sums of exp(-i k x), over those of the even gas."""
    phase = np.exp(-2j * np.pi * sim.gas.pos[:, 0])
    warm = 1.0 / GAMMA / (GAMMA - 1.0)
    density = 2.0 * (sim.gas.mass * phase).sum()
    return np.array([density, 2.0 * (sim.gas.mass * sim.gas.vel[:, 0] * phase).sum(),
                     2.0 * (sim.gas.mass * (sim.gas.u / warm - 1.0) * phase).sum()])  # fmt: skip


@pytest.mark.parametrize("t_cool", [1e-6, 1e-2, 0.1, 1.0, 1e3])
def test_a_wave_that_cools(t_cool):
    """Linear: d(rho) = -ik v, dv = -ik P, du = -(gamma - 1) ik v - u / t_cool; isothermal where cooling is quick, and
    damped between. SPH's sound is off by up to .6% (tests/effects/test_gas.py), of a phase of up to pi.
    """
    sim = Simulation(box(t_cool, {"until": 0.5, "courant": 0.2}, 100, initial={"kind": "wave", "amplitude": 1e-3}))
    ik = 2j * np.pi
    rates = np.array([[0, -ik, 0], [-ik / GAMMA, 0, -ik / GAMMA], [0, -(GAMMA - 1.0) * ik, -1.0 / t_cool]])
    start = amplitudes(sim)
    wanted = expm(0.5 * rates) @ start
    sim.run()
    np.testing.assert_allclose(amplitudes(sim), wanted, rtol=0, atol=0.02 * np.abs(start).max())


@pytest.mark.parametrize("t_cool", [0.025, 1.0])
def test_second_order_in_the_step(t_cool):
    """A wave of a tenth, by differences of steps halved; where it cools within six of the longest steps too."""

    def ends(dt):
        sim = Simulation(box(t_cool, {"until": 0.4, "timestep": dt}, 32, initial={"kind": "wave", "amplitude": 0.1}))
        sim.run()
        order = np.argsort(sim.gas.ids)
        return np.concatenate([sim.gas.u[order], sim.gas.vel[order, 0]])

    errors = [np.abs(a - b).max() for a, b in itertools.pairwise(ends(dt) for dt in (0.004, 0.002, 0.001))]
    assert 3.5 < errors[0] / errors[1] < 4.5


@pytest.mark.parametrize("more", [{}, DUSTY], ids=["gas", "dusty"])
@pytest.mark.parametrize(
    "cooling",
    [{"kind": "beta", "beta": 3.0, "aspect_ratio": 0.05}, {"kind": "constant", "t_cool": 1e-9, "aspect_ratio": 0.05}],
)
def test_energy_with_what_was_radiated_stays(cooling, more):
    """As without cooling: .3% of the energies of a disc whose edges spread; the heat of drag is in it."""
    found = []
    for tables in (disc(cooling=cooling, **more), {k: v for k, v in disc(**more).items() if k != "cooling"}):
        sim = Simulation(tables)
        before = totals(sim)
        sim.run()
        found.append(drifts(before, totals(sim))["energy"])
        if "cooling" in tables:
            assert abs((sim.gas.mass * sim.gas.radiated).sum()) > 5e-6  # of a thermal energy of 2e-4
    assert found[0] < max(1.5 * found[1], 1e-4)


def test_quick_cooling_is_a_held_temperature():
    """beta = 1e-9 beside gas that is locally isothermal: the same disc, step by step."""
    isothermal = {"particles": 1000, "viscosity": {}, "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.1}}
    cooled = Simulation(disc(cooling={"kind": "beta", "beta": 1e-9}, run={"until": 0.5, "timestep": 0.02}))
    held = disc(gas=isothermal, run={"until": 0.5, "timestep": 0.02})
    del held["cooling"]
    held = Simulation(held)
    for sim in (cooled, held):
        sim.run()
    r = np.linalg.norm(cooled.gas.pos, axis=1)
    np.testing.assert_allclose(cooled.gas.u, physics.target_energy(cooled.scene, r), rtol=1e-6)
    one, other = (sim.gas.pos[np.argsort(sim.gas.ids)] for sim in (cooled, held))
    # The viscosity's signal is that of the adiabatic sound; bits of the velocities too.
    assert np.abs(one - other).max() < 1e-3


def test_the_orbits_of_a_softened_star_are_longer():
    """beta / Omega with Omega^2 = G M / (r^2 + s^2)^(3/2): after a kick u is that of one zone at each place."""
    eos = {"kind": "adiabatic", "gamma": 1.6, "aspect_ratio": 0.1, "reference_radius": 2.0}
    sim = Simulation(
        disc(
            gas={"particles": 300, "eos": eos},
            star={"mass": 1.3, "softening": 0.9},
            cooling={"kind": "beta", "beta": 0.7, "aspect_ratio": 0.05},
        )
    )
    gas = sim.gas
    r = np.hypot(*gas.pos.T)
    gas.u[:], gas.kick_rate[:] = 3e-3, 1e-4
    settled = 0.05**2 * 1.3 / 2.0 * np.sqrt(2.0 / r) / 0.6
    t_cool = 0.7 * np.sqrt((r**2 + 0.81) ** 1.5 / 1.3)
    found = sim.state.cooled_energy(gas, 0.4)
    np.testing.assert_allclose(found, exact.linear(3e-3, settled, 1e-4, t_cool, 0.4), rtol=1e-12)


# Light


def shining(**cooling):
    """A disc of 3e-3 solar masses between 5 and 15 au, irradiated to H/r = .03 at 5 au."""
    eos = {"kind": "adiabatic", "gamma": GAMMA, "aspect_ratio": 0.05, "reference_radius": "5 au"}
    return {
        "run": {"until": "5 yr", "timestep": "1 yr"},
        "space": {"size": "40 au"},
        "initial": {"kind": "disc", "mass": "0.003 Msun", "inner": "5 au", "outer": "15 au"},
        "gas": {"particles": 1000, "eos": eos, "viscosity": {}},
        "star": {"mass": "1 Msun"},
        "cooling": {"kind": "radiative", "aspect_ratio": 0.03, **cooling},
    }


@pytest.mark.parametrize("opacity", ["1e-3 cm2/g", "0.05 m2/kg", "50 cm2/g", "bell-lin"])
def test_balance_of_a_viscous_irradiated_disc(opacity):
    """Each particle heated as by alpha = .01 for long: T^4 = T_irr^4 + (9/8) nu Sigma Omega^2 tau_eff / sigma.

    In cgs by astropy, with nu = alpha c_s^2 / Omega at the temperature of the balance. The energies are those of an
    exact balance to 1e-6; what is left is that both sides have constants of their own.
    """
    sim = Simulation(shining(opacity=opacity))
    sim.step()
    gas, scene = sim.gas, sim.scene
    r = scene.units.quantity(np.linalg.norm(gas.pos, axis=1), "length").cgs
    sigma = scene.units.quantity(gas.density, "density").cgs
    omega = np.sqrt(constants.G * u.Msun / r**3).cgs
    mean = scene.gas.eos.mean_molecular_weight * (constants.m_p + constants.m_e)
    per_energy = ((GAMMA - 1.0) * mean / constants.k_B).cgs
    irradiated = (0.03**2 * constants.G * u.Msun / (5 * u.au) * (5 * u.au / r) ** 0.5 * mean / constants.k_B).to(u.K)
    for _ in range(60):  # the heat that this temperature makes, and the temperature that this heat makes
        found = (scene.units.quantity(gas.u, "specific_energy") * per_energy).to(u.K)
        speed2 = (constants.k_B * found / mean).cgs
        heat = (2.25 * 0.01 * speed2 * omega).cgs  # (9/4) nu Omega^2 of a unit of mass
        gas.kick_rate[:] = heat.value / scene.units.cgs("specific_energy") * scene.units.cgs("time")
        gas.u[:] = sim.state.cooled_energy(gas, 1e6 / scene.units.time.to(u.yr))
    if opacity == "bell-lin":
        kappa = np.empty(gas.count)
        rho = (sigma * omega / np.sqrt(2 * np.pi * speed2)).cgs.value
        kernels.write_opacities(0, gas.count, rho, found.value, kappa)
    else:
        kappa = u.Quantity(opacity).cgs.value
    tau = 0.5 * kappa * sigma.value
    wanted = (irradiated**4 + heat * sigma * physics.effective_depth(tau) / 2.0 / constants.sigma_sb).to(u.K**4) ** 0.25
    np.testing.assert_allclose(found.value, wanted.value, rtol=1e-3)
    assert (found > 1.005 * irradiated).any()


def test_hot_gas_shines_through_the_molecules_of_its_midplane():
    """2 sigma T^4 / (tau_eff Sigma) with Bell & Lin's 1e-8 rho^(2/3) T^3 between 2200 and 3000 K at .2 au,
    rho = Sigma Omega / (sqrt(2 pi) c_s) about a softened star; in cgs by astropy. u changes by less than 1e-3 in the
    step.
    """
    tables = shining(opacity="bell-lin") | {"space": {"size": "1 au"}}
    tables["initial"] = {"kind": "disc", "mass": "1e-4 Msun", "inner": "0.15 au", "outer": "0.25 au"}
    tables["star"] = {"mass": "1.7 Msun", "softening": "0.1 au"}
    tables["gas"]["particles"] = 300
    sim = Simulation(tables)
    sim._prepare()
    gas, units = sim.gas, sim.scene.units
    mean = sim.scene.gas.eos.mean_molecular_weight * (constants.m_p + constants.m_e)
    r, sigma = units.quantity(np.hypot(*gas.pos.T), "length").cgs, units.quantity(gas.density, "density").cgs
    temperature = np.linspace(2200.0, 3000.0, gas.count) * u.K
    heat = (constants.k_B * temperature / mean / (GAMMA - 1.0)).cgs
    gas.u[:], gas.kick_rate[:] = heat.value / units.cgs("specific_energy"), 0.0
    omega = np.sqrt(1.7 * constants.G * u.Msun / (r**2 + (0.1 * u.au) ** 2) ** 1.5).cgs
    rho = (sigma * omega / np.sqrt(2 * np.pi * constants.k_B * temperature / mean)).cgs.value
    kappa = 1e-8 * rho ** (2 / 3) * temperature.value**3
    tau = 0.5 * kappa * sigma.value
    rate = (2.0 * constants.sigma_sb * temperature**4 / physics.effective_depth(tau) / sigma).cgs
    dt = (3e-4 * heat / rate).min()
    lost = gas.u - sim.state.cooled_energy(gas, dt.cgs.value / units.cgs("time"))
    assert (tau > 0.1).all()
    # Its star's light gives back (400 / 2200)^4 = .1% at most, and the rate changes by some times 3e-4 within the step.
    np.testing.assert_allclose(lost * units.cgs("specific_energy"), (rate * dt).cgs.value, rtol=5e-3)


@pytest.mark.slow
def test_a_viscous_irradiated_disc_comes_to_its_balance():
    """Heated by [alpha_viscosity], from 11% below: T in annuli is that of the balance of their own Sigma to 2%.

    After 60 yr, three cooling times and 2.7 orbits at 8 au, between the waves that the edges have sent in by then; 1.0
    to 1.5% are seen, all above, as the noise of particles lets the shear heat by some 3% more than nu does.
    """
    alpha, kappa, ratio = 0.1, 3.0, 0.04
    scene = {
        "run": {"until": "60 yr", "courant": 0.4},
        "space": {"size": "40 au"},
        "initial": {
            "kind": "disc", "mass": "0.003 Msun", "inner": "4 au", "outer": "14 au", "inner_taper": "2 au",
            "outer_taper": "4 au", "reference_radius": "8 au", "relax": 2,
        },
        "gas": {"particles": 6000, "eos": {"kind": "adiabatic", "gamma": GAMMA, "aspect_ratio": 0.06,
                                           "temperature_index": 1.1, "reference_radius": "8 au"}},
        "star": {"mass": "1 Msun", "accretion_radius": "3 au"},
        "alpha_viscosity": {"alpha": alpha},
        "cooling": {"kind": "radiative", "aspect_ratio": ratio, "temperature_index": 0.5, "opacity": f"{kappa} cm2/g"},
    }  # fmt: skip
    sim = Simulation(scene)
    gas, units = sim.gas, sim.scene.units
    mean = sim.scene.gas.eos.mean_molecular_weight * (constants.m_p + constants.m_e)

    def found_and_wanted():
        """Distance in au, and temperatures in K."""
        place = np.linalg.norm(gas.pos, axis=1)
        r, sigma = units.quantity(place, "length").cgs, units.quantity(gas.density, "density").cgs
        omega = np.sqrt(constants.G * u.Msun / r**3).cgs
        found = (units.quantity(gas.u, "specific_energy") * (GAMMA - 1.0) * mean / constants.k_B).to(u.K)
        irradiated = (ratio**2 * constants.G * u.Msun / (8 * u.au) * (8 * u.au / r) ** 0.5 * mean / constants.k_B).to(
            u.K
        )
        wanted = found
        for _ in range(60):  # the heat that this temperature makes, and the temperature that this heat makes
            heat = 2.25 * alpha * constants.k_B * wanted / mean * omega * sigma  # (9/4) nu Sigma Omega^2
            depth = physics.effective_depth(0.5 * kappa * sigma.value)
            wanted = (irradiated**4 + (heat * depth / 2.0 / constants.sigma_sb).to(u.K**4)) ** 0.25
        assert (wanted > 2.0 * irradiated)[(place > 7.0) & (place < 9.5)].all()  # of the 2% light alone has 1/16
        return place, found.value, wanted.value

    with sim.synchronised():  # the first forces make Sigma
        place, found, wanted = found_and_wanted()
    middle = (place > 7.5) & (place < 9.5)
    assert (found / wanted)[middle].max() < 0.93
    sim.run()
    place, found, wanted = found_and_wanted()
    for inner in (7.5, 8.0, 8.5, 9.0):
        ring = (place > inner) & (place < inner + 0.5)
        assert found[ring].mean() == pytest.approx(wanted[ring].mean(), rel=0.02)


@pytest.mark.parametrize("opacity", ["1e-2 cm2/g", "bell-lin"])
def test_light_in_the_loop(opacity):
    """Five years in steps of 1/22 and 1/88 of the innermost orbit: the same energies, to second order."""
    found = []
    for step in ("0.5 yr", "0.125 yr"):
        sim = Simulation(shining(opacity=opacity) | {"run": {"until": "5 yr", "timestep": step}})
        sim.run()
        found.append(sim.gas.u[np.argsort(sim.gas.ids)])
    assert min(each.min() for each in found) > 0.0
    assert np.abs(found[0] / found[1] - 1.0).mean() < 0.03


# The promises of every effect


def test_it_goes_on_from_a_checkpoint_to_the_bit(tmp_path):
    sim = assert_resumes(disc(cooling={"kind": "beta", "beta": 0.5}, **DUSTY), tmp_path / "half.h5", 0.15, 0.3)
    before = sim.gas.radiated.copy()
    with sim.synchronised():
        pass  # looking at it leaves what was radiated as it was
    np.testing.assert_array_equal(before, sim.gas.radiated)
    assert np.any(before)


def test_gas_without_cooling_holds_nothing_of_it():
    tables = disc()
    del tables["cooling"]
    sim = Simulation(tables)
    assert sim.gas.radiated is None and sim.state.cooled_energy is None


BAD = [
    ({"kind": "beta"}, r"cooling\.beta: missing, but required by cooling\.kind = \"beta\""),
    ({"kind": "beta", "beta": 0.0}, r"cooling\.beta: 0\.0 is not positive"),
    ({"kind": "beta", "beta": 3.0, "t_cool": 1.0}, r"cooling\.t_cool: used only with cooling\.kind = \"constant\""),
    ({"kind": "bta", "beta": 3.0}, r"cooling\.kind: \"bta\" is unknown; .* did you mean \"beta\""),
    ({"kind": "radiative", "opacity": 1.0}, r"cooling\.kind: radiative cooling needs temperatures"),
    ({"kind": "constant", "t_cool": 1.0, "aspect_ratio": -0.1}, r"cooling\.aspect_ratio: -0\.1 is out of range"),
    ({"beta": 3.0}, r"cooling\.kind: missing"),
]


@pytest.mark.parametrize(("cooling", "wrong"), BAD)
def test_bad_keys(cooling, wrong):
    with pytest.raises(SceneError, match=wrong) as fault:
        load_scene(disc(cooling=cooling))
    assert len(fault.value.problems) == 1


@pytest.mark.parametrize(
    ("opacity", "wrong"),
    [
        (None, r"cooling\.opacity: missing, but required by cooling\.kind = \"radiative\""),
        ("bell-linn", r"cooling\.opacity: .* expected .* or \"bell-lin\""),
        ("1 g/cm2", r"cooling\.opacity: .* expected an opacity, like \"1 cm2/g\", or \"bell-lin\""),
        ("-1 cm2/g", r"cooling\.opacity: opacity .* is not positive"),
        (2.0, r"cooling\.opacity: 2\.0 has no unit; an opacity needs a unit, like \"1 cm2/g\", or \"bell-lin\""),
    ],
)
def test_bad_opacities(opacity, wrong):
    tables = shining(opacity=opacity)
    if opacity is None:
        del tables["cooling"]["opacity"]
    with pytest.raises(SceneError, match=wrong) as fault:
        load_scene(tables)
    assert len(fault.value.problems) == 1


def test_scenes_that_have_nothing_to_cool():
    isothermal = disc(gas={"particles": 100, "eos": {"kind": "isothermal", "sound_speed": 0.1}})
    with pytest.raises(
        SceneError, match=r'gas with eos.kind = "isothermal" has no energy equation; set gas.eos.kind = "adiabatic"'
    ):
        load_scene(isothermal)
    with pytest.raises(SceneError, match="beta / Omega needs the orbital frequency about a star"):
        load_scene(box(1.0, {}, cooling={"kind": "beta", "beta": 1.0}))
    shock = box(1.0, {}, initial={"kind": "shock"}, space={"dimensions": 1, "size": 1.0}) | {
        "gas": {"particles": 100, "eos": {"kind": "adiabatic", "gamma": 1.4}}
    }
    with pytest.raises(SceneError, match=r"cooling.aspect_ratio: the temperature to which gas cools is given neither"):
        load_scene(shock)
    with pytest.raises(SceneError, match=r"cooling\.temperature_index: used only with cooling.aspect_ratio or"):
        load_scene(box(1.0, {}, cooling={"kind": "constant", "t_cool": 1.0, "temperature_index": 0.5}))
    grid = box(1.0, {}, dust={"particles": 64, "ratio": 1.0}, drag={"law": "constant", "K": 1.0, "scheme": "emsi-ppm"})
    with pytest.raises(SceneError, match=r'drag\.scheme "emsi-ppm" does not allow cooling'):
        load_scene(grid)
