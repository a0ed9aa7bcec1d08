"""The shear viscosity: its profile, its strength on lattices and in disorder, what it conserves, and its step."""

import numpy as np
import pytest
from runs import assert_resumes
from scenes import problems

from discsim import Simulation, load_scene
from discsim.formulas.smoothing import SMOOTHING
from discsim.numerics.operators import accelerate
from discsim.physics import viscosity
from discsim.preview.check import report
from discsim.preview.derived import gas_at_start
from discsim.run.forces import PhysicsError

NU = 0.02
DISC = {
    "units": {"system": "code"},
    "run": {"until": 1.0},
    "space": {"size": 6.0},
    "initial": {"kind": "disc", "mass": 1e-6, "inner": 0.6, "outer": 2.0, "inner_taper": 0.2, "outer_taper": 0.2},
    "gas": {
        "particles": 1500,
        "kernel": "cubic",
        "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.1, "temperature_index": 1.0},
    },
    "star": {"mass": 1.0, "accretion_radius": 0.3},
}


def disc(**viscous):
    return DISC | {"alpha_viscosity": viscous}


def box(pos, vel, nu=NU, mass=None, u=None, size=1.0, boundary="periodic", timestep=None, **gas):
    eos = {"kind": "adiabatic", "gamma": 1.4} if u is not None else {"kind": "isothermal"}
    gas = {"particles": len(pos), "eos": eos | {"sound_speed": 1.0}} | gas
    scene = {
        "units": {"system": "code"},
        "run": {"until": 1e9} | ({} if timestep is None else {"timestep": timestep}),
        "space": {"size": size, "boundary": boundary, "cells": 16},
        "gas": gas,
    }
    if nu is not None:
        scene["alpha_viscosity"] = {"nu": nu}
    given = {"pos": pos, "vel": vel, "mass": np.full(len(pos), 1.0 / len(pos)) if mass is None else mass}
    if u is not None:
        given["u"] = u
    return Simulation(scene, particles={"gas": given})


def lattice(n):
    x = (np.arange(n) + 0.5) / n
    return np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1).reshape(-1, 2)


def viscous_part(sim, vel):
    """The acceleration that is odd in the velocities, which pressure's is not; in the order of the state."""
    found = []
    for sign in (1.0, -1.0):
        sim.gas.vel[:] = sign * vel
        found.append(sim.acceleration("gas")[0])
    return 0.5 * (found[0] - found[1])


def strength(sim, axis):
    """The viscosity that brakes v = sin(2 pi x) along (axis 0) or across (axis 1) the wave, over what was asked."""
    sim.gas.kick_acc[:] = 0.0
    wave = np.sin(2.0 * np.pi * sim.gas.pos[:, 0])
    vel = np.zeros_like(sim.gas.pos)
    vel[:, axis] = 1e-3 * wave
    brake = -(viscous_part(sim, vel)[:, axis] * wave).sum() / (1e-3 * (wave**2).sum())
    return brake / (NU * (2.0 * np.pi) ** 2)


# The profile


def test_alpha_is_the_power_the_step_and_the_dead_zone():
    r = np.array([0.3, 0.8, 1.0, 1.7, 3.0])
    nu = viscosity.diffusivity(load_scene(disc(alpha=0.02, index=-0.5)), r)
    np.testing.assert_allclose(nu, 0.02 * r**-0.5 * 0.01 * r**0.5, rtol=1e-12)  # alpha (H/r)^2 r^2 Omega
    np.testing.assert_allclose(viscosity.diffusivity(load_scene(disc(nu=3e-4)), r), 3e-4)
    step = {"inner_alpha": 0.1, "outer_alpha": 0.02, "radius": 1.2, "width": 0.3}
    found = viscosity.alpha(load_scene(disc(**step)), r)
    # tanh(ln x / w) = (x^(2/w) - 1) / (x^(2/w) + 1)
    power = (r / 1.2) ** (2.0 / 0.3)
    np.testing.assert_allclose(found, (0.1 + 0.02 * power) / (1.0 + power), rtol=1e-12)
    found = viscosity.alpha(load_scene(disc(**step, step="logarithmic")), r)
    np.testing.assert_allclose(found, 0.02 * 5.0 ** (1.0 / (1.0 + power)), rtol=1e-12)
    dead = {"dead_alpha": 1e-4, "dead_inner": 0.7, "dead_outer": 1.5, "dead_width": 0.1}
    found = viscosity.alpha(load_scene(disc(alpha=0.01, **dead)), r)
    inner, outer = ((r / edge) ** 20 for edge in (0.7, 1.5))
    share = inner / (1.0 + inner) - outer / (1.0 + outer)
    np.testing.assert_allclose(found, 0.01 + share * (1e-4 - 0.01), rtol=1e-12)


def test_a_power_of_alpha_is_about_the_reference_radius():
    """alpha = .02 (r / 2.5)^index of a disc that refers to 2.5, in a run as in the formula; q = 1.2 of the gas."""
    scene = disc(alpha=0.02, index=-0.6)
    scene["initial"] = scene["initial"] | {"reference_radius": 2.5}
    r = np.array([0.7, 1.0, 1.9])
    np.testing.assert_allclose(viscosity.alpha(load_scene(scene), r), 0.02 * (r / 2.5) ** -0.6, rtol=1e-12)
    sim = Simulation(scene)
    accelerate(sim.effects["gas"], sim.state)
    r = np.hypot(*sim.gas.pos.T)
    wanted = 0.02 * (r / 2.5) ** -0.6 * sim.gas.sound_speed**2 * r**1.5
    np.testing.assert_allclose(sim.gas.nu, wanted, rtol=1e-12)


@pytest.mark.parametrize(("pairs", "braked"), [("all", 1.0), ("approaching", 0.5)])
@pytest.mark.parametrize(("switch", "left"), [("none", 1.0), ("balsara", 0.25)])
def test_check_foretells_the_artificial_viscosity_of_a_shear(pairs, braked, switch, left):
    """[3/16 alpha <q> (h/H) (1 or 1/2) c_s/c_T + beta <q^2> (h/H)^2 / (4 pi)], at a shear of 3/2 Omega."""
    tables = disc(alpha=1e-3) | {"star": {"mass": 1.7}}
    tables["gas"] = tables["gas"] | {
        "viscosity": {"alpha": 0.7, "beta": 3.0, "pairs": pairs, "switch": switch},
        "eos": {"kind": "adiabatic", "gamma": 1.4, "aspect_ratio": 0.1, "temperature_index": 1.0},
    }
    scene = load_scene(tables)
    at = gas_at_start(scene)
    wide = at.h / (0.1 * at.radius)  # h/H
    wanted = 3 / 16 * 0.7 * 5 / 7 * wide * braked * 1.4**0.5 + 3.0 * 31 / 49 * wide**2 / (4 * np.pi)
    found = viscosity.artificial_nu(scene, at) * np.sqrt(1.7 / at.radius**3) / (0.01 * 1.7 / at.radius)
    np.testing.assert_allclose(found, left * wanted, rtol=1e-12)
    rows = dict(line.strip().split("  ", 1) for line in report(scene).splitlines() if "alpha of artificial" in line)
    (text,) = rows.values()
    np.testing.assert_allclose([float(word) for word in text.split(",")], left * wanted, rtol=0.05)  # two digits


def test_check_foretells_no_artificial_viscosity_on_reconstructed_velocities():
    tables = disc(alpha=1e-3)
    tables["gas"] = tables["gas"] | {"viscosity": {"alpha": 0.7, "beta": 3.0, "pairs": "reconstructed"}}
    scene = load_scene(tables)
    assert np.all(viscosity.artificial_nu(scene, gas_at_start(scene)) == 0.0)


def test_a_reconstructed_viscosity_leaves_a_shear_wave_alone():
    """Less than a tenth of the viscosity of all pairs is left at kh = .26, where slopes nearly follow the wave."""
    nu = {}
    for pairs in ("all", "reconstructed"):
        sim = box(lattice(32), np.zeros((1024, 2)), nu=None, viscosity={"alpha": 0.5, "beta": 0.0, "pairs": pairs})
        nu[pairs] = strength(sim, 1)
    assert 0.0 < nu["reconstructed"] < 0.1 * nu["all"]


@pytest.mark.parametrize(("pairs", "braked"), [("all", 1.0), ("approaching", 0.5)])
def test_artificial_viscosity_brakes_a_shear_wave_as_foretold(pairs, braked):
    """3/16 alpha <q> c_s h with all pairs, half of it with approaching ones; a lattice has some per cent less."""
    sim = box(lattice(32), np.zeros((1024, 2)), nu=None, viscosity={"alpha": 0.5, "beta": 0.0, "pairs": pairs})
    foretold = 3 / 16 * 0.5 * 5 / 7 * braked
    assert strength(sim, 1) * NU / sim.gas.h.mean() == pytest.approx(foretold, rel=0.1)


def test_the_flow_of_power_laws_is_a_power_law():
    """nu ~ r^(1/2), Sigma ~ 1/r: nu Sigma sqrt(r) is uniform and nothing flows; Sigma ~ 1/nu has -3 nu / (2 r)."""
    scene, r = load_scene(disc(alpha=0.01)), np.array([0.5, 1.0, 2.0])
    nu = viscosity.diffusivity(scene, r)
    assert np.abs(viscosity.radial_flow(scene, r, lambda x: 1.0 / x) / (nu / r)).max() < 1e-10
    found = viscosity.radial_flow(scene, r, lambda x: x**-0.5)
    np.testing.assert_allclose(found, -1.5 * nu / r, rtol=1e-8)  # rounding over the step in ln r


def test_particles_have_the_viscosity_of_their_present_sound_speed():
    scene = disc(alpha=0.02) | {"gas": DISC["gas"] | {"eos": {"kind": "adiabatic", "gamma": 1.4, "aspect_ratio": 0.1}}}
    sim = Simulation(scene)
    u = sim.gas.u * np.linspace(1.0, 3.0, sim.gas.count)
    sim.gas.u[:] = u
    accelerate(sim.effects["gas"], sim.state)
    r = np.sqrt((sim.gas.pos**2).sum(axis=1))
    np.testing.assert_allclose(sim.gas.nu, 0.02 * 0.4 * u * r**1.5, rtol=1e-12)  # alpha (P / rho) / Omega


# Strength


@pytest.mark.parametrize("kernel, off", [("cubic", 0.03), pytest.param("wendland-c4", 0.015, marks=pytest.mark.slow)])
def test_a_shear_wave_feels_the_viscosity_asked_for(kernel, off):
    """On a square lattice, and after it dissolved. q^2 dW/dr leaves 2 to 3% under the cubic kernel, of few neighbours,
    and the wave's own curvature (k h)^2 / 10 or less; with dW/dr a lattice has 12% less.
    """
    sim = box(lattice(32), np.zeros((1024, 2)), kernel=kernel)
    assert strength(sim, 1) == pytest.approx(1.0, abs=off)
    assert strength(sim, 0) == pytest.approx(3.0, abs=3.0 * 2 * off)  # lap v + 2 grad div v; the lattice's other side
    shaken = lattice(32) + 0.3 / 32 * np.random.default_rng(1).uniform(-1.0, 1.0, (1024, 2))
    sim = box(shaken % 1.0, np.zeros((1024, 2)), kernel=kernel)
    sim.run(0.5)
    assert strength(sim, 1) == pytest.approx(1.0, abs=off)


def test_a_shear_wave_decays_as_asked_beside_the_artificial_part():
    """exp(-(nu + nu_sph) k^2 t), with nu_sph = 3/16 alpha <q> c_s h on all pairs (`physics/viscosity.py`)."""
    n, k = 32, 2.0 * np.pi
    pos = lattice(n)
    vel = np.stack([0.0 * pos[:, 0], 1e-3 * np.sin(k * pos[:, 0])], axis=1)
    artificial = {"alpha": 0.5, "beta": 0.0, "pairs": "all"}
    sim = box(pos, vel, kernel="wendland-c4", eta=2.2, viscosity=artificial)
    expected = NU + 3.0 / 16.0 * 0.5 * SMOOTHING["wendland-c4"].mean_q[0] * 2.2 / n
    sim.run(0.5)
    left = 2.0 * (sim.gas.vel[:, 1] * np.sin(k * sim.gas.pos[:, 0])).mean() / 1e-3
    # The artificial part, a fifth of it, has the gradient itself: 5% less on a lattice; (k h)^2 takes 2% of both.
    assert -np.log(left) / (k**2 * 0.5) == pytest.approx(expected, rel=0.03)


def test_stress_is_continuous_where_the_viscosity_has_a_step():
    """Two slopes of v_y that make one stress of nu = 1 and 1/9: nothing is accelerated beyond the kernels' reach, and
    within it the sum over the step is right.
    """
    n, nu = 40, (1.0, 1.0 / 9.0)
    pos = lattice(n)
    sim = box(pos, np.zeros((n * n, 2)), kernel="cubic")
    sim.operators.forces()
    gas = sim.gas
    thick = np.abs(gas.pos[:, 0] - 0.5) < 0.25
    gas.nu[:] = np.where(thick, *nu)
    x = gas.pos[:, 0]
    edge = np.where(x < 0.5, x - 0.25, 0.75 - x)  # distance from the nearer step, above 0 in the thick part
    vel = np.stack([0.0 * x, np.where(thick, edge / nu[0], edge / nu[1]) * np.where(x < 0.5, 1.0, -1.0)], axis=1)
    gas.acc[:] = 0.0
    sim.effects["gas"].sph.forces(gas, gas.acc, vel, None, np.zeros(n * n))
    left = (x > 0.1) & (x < 0.4)
    scale = 1.0 / (gas.h.mean())  # of an acceleration by a stress of one that ended within h
    assert np.abs(gas.acc[left, 1]).max() < 0.5 * scale
    # Beside the step the sum of forces is what flows out of one side into the other: none of it is lost or made.
    assert abs(gas.acc[left, 1].sum() / n) < 0.02 * n


# Conservation


def test_momentum_angular_momentum_and_heat_are_exact():
    """Unequal masses in disorder: the pairs' forces are along their lines, and what they lose is heat; beside an
    artificial viscosity of nothing.
    """
    rng = np.random.default_rng(7)
    n = 200
    pos = rng.random((n, 2)) - 0.5
    mass = rng.uniform(0.5, 1.5, n) / n
    vel = rng.standard_normal((n, 2))
    none = {"alpha": 0.0, "beta": 0.0}
    sim = box(pos, vel, 0.1, mass, np.ones(n), 4.0, "open", kernel="wendland-c4", viscosity=none)
    sim.operators.forces()
    gas = sim.gas
    gas.acc[:] = 0.0
    gas.heating_rate[:] = 0.0
    sim.effects["gas"].sph.forces(gas, gas.acc, gas.vel, gas.u, np.zeros(n))
    force = gas.mass[:, None] * gas.acc
    torque = gas.pos[:, 0] * force[:, 1] - gas.pos[:, 1] * force[:, 0]
    assert np.abs(force.sum(axis=0)).max() < 1e-13 * np.abs(force).sum()
    assert abs(torque.sum()) < 1e-13 * np.abs(torque).sum()
    heating, work = gas.mass * gas.heating_rate, (force * gas.vel).sum(axis=1)
    assert (heating > 0.0).all()
    assert abs(heating.sum() + work.sum()) < 1e-13 * heating.sum()


def test_a_disc_keeps_its_angular_momentum():
    sim = Simulation(disc(alpha=0.1) | {"star": {"mass": 1.0}})

    def spin():
        return float(
            (sim.gas.mass * (sim.gas.pos[:, 0] * sim.gas.vel[:, 1] - sim.gas.pos[:, 1] * sim.gas.vel[:, 0])).sum()
        )

    before = spin()
    sim.run(0.5)
    assert abs(spin() / before - 1.0) < 1e-13


# The step, resumed runs


def test_the_step_is_the_viscosity_s_where_it_is_the_least():
    sim = box(lattice(16), np.zeros((256, 2)), nu=1.0, kernel="cubic")
    dt = sim.step()
    assert sim.limited_by == "alpha_viscosity"
    h = sim.gas.h.min()
    assert dt == pytest.approx(0.3 * h**2 / (18.0 * 10.0 / (7.0 * np.pi)), rel=3e-3)  # W(0) is there to .2%
    scene = load_scene(disc(alpha=1.0))
    assert gas_at_start(scene).step.min() < 0.5 * gas_at_start(load_scene(DISC)).step.min()  # so the forecast has it


@pytest.mark.parametrize("shaken", [0.0, 0.3])
@pytest.mark.parametrize("kernel", ["quintic", "wendland-c2"])
def test_velocities_of_neighbours_die_in_the_longest_steps_and_grow_in_those_that_are_refused(kernel, shaken):
    """Random velocities in gas of hardly any pressure, after 60 steps of .72 and of 1.24 times the limit."""
    rng, n, nu = np.random.default_rng(3), 16, 0.7
    pos = (lattice(n) + shaken / n * rng.uniform(-1.0, 1.0, (n * n, 2))) % 1.0
    vel = 1e-3 * rng.normal(size=(n * n, 2))
    cold = {"kind": "isothermal", "sound_speed": 1e-3}
    sim = box(pos, vel, nu=nu, kernel=kernel, eos=cold)
    sim.step(most=1e-9)
    limit = sim.gas.h.min() ** 2 / (18.0 * SMOOTHING[kernel].least_eta[1] ** 2 * nu)
    for share, dies in (0.72, True), (1.24, False):
        sim = box(pos, vel, nu=nu, timestep=share * limit, kernel=kernel, eos=cold)
        try:
            sim.evolve(1e9, lambda sim=sim: sim.state.step >= 60)
            assert ((sim.gas.vel**2).sum() < 0.01 * (vel**2).sum()) == dies
        except PhysicsError:
            assert not dies


def test_a_courant_factor_in_which_viscous_gas_is_torn_apart_is_one_message():
    scene = disc(alpha=0.05) | {"run": {"until": 1.0, "courant": 0.73}}
    assert problems(scene) == [
        "scene: run.courant: the value 0.73 gives time steps so long that viscous gas is unstable; expected "
        "at most 0.72"
    ]


def test_it_goes_on_from_a_checkpoint_to_the_bit(tmp_path):
    scene = disc(alpha=0.05, dead_alpha=0.001, dead_inner=0.9, dead_outer=1.2, dead_width=0.1)
    assert_resumes(scene, tmp_path / "half.h5", 0.1, 0.2)


# What users see


@pytest.mark.parametrize(
    "keys, wrong",
    [
        ({}, "alpha_viscosity: no viscosity is given; give either alpha, or nu"),
        ({"alpha": 0.1, "nu": 1.0}, "alpha_viscosity.nu: alpha and nu are both given"),
        ({"alpha": -0.1}, "alpha_viscosity.alpha: -0.1"),
        (
            {"inner_alpha": 0.1, "outer_alpha": 0.2, "radius": 1.0},
            "alpha_viscosity.width: missing, but needed with inner_alpha and",
        ),
        (
            {"alpha": 0.1, "step": "logarithmic"},
            "alpha_viscosity.step: step is used only with inner_alpha and outer_alpha",
        ),
        (
            {"inner_alpha": 0.1, "outer_alpha": 0.0, "radius": 1.0, "width": 0.1, "step": "logarithmic"},
            "alpha_viscosity.outer_alpha: 0 has no logarithm",
        ),
        (
            {"alpha": 0.1, "dead_alpha": 0.0, "dead_inner": 2.0, "dead_outer": 1.0, "dead_width": 1.0},
            "dead_outer: dead_outer is not larger",
        ),
        ({"nu": 0.1, "index": 1.0}, "alpha_viscosity.index: index is used only with alpha"),
        ({"alhpa": 0.1}, "alpha_viscosity.alhpa: unknown key"),
    ],
)
def test_a_bad_key_is_one_message(keys, wrong):
    found = problems(disc(**keys))
    assert any(wrong in line for line in found), found


def test_tables_that_the_viscosity_needs():
    def without(name):
        return {key: table for key, table in disc(alpha=0.1).items() if key != name}

    assert any("H = c_s / Omega needs a star" in line for line in problems(without("star")))
    flat = disc(nu=0.1) | {"space": {"dimensions": 1, "size": 1.0}}
    assert any("alpha viscosity needs shear" in line for line in problems(flat))


def test_check_tells_alpha_beside_what_the_scheme_has():
    coarse = disc(alpha=1e-3)
    coarse["gas"] = coarse["gas"] | {"viscosity": {"alpha": 0.7, "pairs": "all"}}
    text = report(load_scene(coarse))
    for row in ("alpha of the scene", "alpha of artificial viscosity", "estimated alpha of particle noise"):
        assert row in text
    assert "more than the 0.001 of [alpha_viscosity]: lower gas.viscosity.alpha, or raise" in text
    coarse["gas"] |= {"viscosity": {}}
    assert "more than the 0.001 of [alpha_viscosity]: set gas.quiet = true, or raise" in report(load_scene(coarse))
    coarse["gas"] |= {"quiet": {"share": 0.1, "time": 0.1}}
    assert "more than the 0.001 of [alpha_viscosity]: raise" in report(load_scene(coarse))
    assert "alpha of the scene" not in report(load_scene(DISC))


def test_noise_falls_with_the_neighbours():
    """The kernel's own with 36 neighbours, times (36 / N)^1.1 with N = pi (support eta)^2 in even gas."""
    found = {}
    for kernel, eta, support in (("quintic", 1.0, 3.0), ("quintic", 1.7, 3.0), ("wendland-c4", 2.4, 2.0)):
        given = disc(alpha=1e-3)
        given["gas"] = given["gas"] | {"kernel": kernel, "eta": eta}
        scene = load_scene(given)
        at = gas_at_start(scene)
        of_h = viscosity.noise_nu(scene, at) / (at.thermal_speed * at.resolution)
        neighbours = np.pi * (support * eta) ** 2
        own = {"quintic": 0.034, "wendland-c4": 0.021}[kernel]
        np.testing.assert_allclose(of_h, own * (36.0 / neighbours) ** 1.1, rtol=1e-12)  # the formula
        found[kernel, eta] = of_h[0]
    assert found["quintic", 1.0] > 0.03 > found["quintic", 1.7] > found["wendland-c4", 2.4]


def test_quiet_gas_has_what_its_share_and_time_leave_of_the_noise():
    """(1.03 - share) 10 / time of it, and never more than all."""
    given = disc(alpha=1e-3)
    given["gas"] = {key: value for key, value in given["gas"].items() if key != "viscosity"}
    scenes = [{"share": 0.8, "time": 20.0}, {"share": 0.3, "time": 2.0}, None]
    found = []
    for quiet in scenes:
        given["gas"] = given["gas"] | {"quiet": quiet if quiet is not None else False}
        scene = load_scene(given)
        found.append(viscosity.noise_nu(scene, gas_at_start(scene)))
    np.testing.assert_allclose(found[0], 0.115 * found[2], rtol=1e-12)  # the formula
    np.testing.assert_allclose(found[1], found[2], rtol=1e-12)


def test_a_scene_without_it_has_none_of_it():
    sim = Simulation(DISC)
    assert sim.gas.nu is None and sim.gas.kick_acc is None and "alpha_viscosity" not in sim.effects


def test_means_of_the_kernels():
    """<q> and <q^2> of W in two dimensions, by the formula of each kernel; a midpoint sum of 1e4."""
    from discsim.kernels.sph.smoothing import KERNELS, shape

    for name, kernel in SMOOTHING.items():
        q = (np.arange(10_000) + 0.5) / 10_000 * kernel.support
        w = np.array([shape.py_func(KERNELS[name], 2, x)[0] for x in q])
        weight = 2.0 * np.pi * q * kernel.norm[1] * w * kernel.support / 10_000
        np.testing.assert_allclose([(weight * q).sum(), (weight * q**2).sum()], kernel.mean_q, rtol=1e-6)
