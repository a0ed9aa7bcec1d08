"""Velocities that a disc starts with."""

import tomllib

import numpy as np
import pytest
from runs import DISC
from scipy.interpolate import make_interp_spline

from discsim import Simulation, load_scene
from discsim.exact import nsh
from discsim.initial import balance
from discsim.initial.rings import cubic_spline, perturb_angles
from discsim.physics import profile
from discsim.run.start import begin

ASPECT = 0.05


def disc(dust, aspect=ASPECT, **drag):
    """Sigma ~ 1/r and H/r the same everywhere, from 1 to 3; grains of the stopping time s rho_s / (c_s rho_g)."""
    with_dust = {"dust": dust, "drag": {"law": "epstein", "convention": "papers"} | drag} if dust else {}
    return Simulation(
        {
            "units": {"system": "code"},
            "run": {"until": 1.0},
            "space": {"size": 8.0, "cells": 32},
            "initial": {"kind": "disc", "mass": 1e-4, "inner": 1.0, "outer": 3.0},
            "gas": {
                "particles": 2000,
                "eos": {"kind": "locally-isothermal", "aspect_ratio": aspect, "temperature_index": 1.0},
            },
            "star": {"mass": 1.0},
            **with_dust,
        }
    )


def beyond_kepler(particles):
    """Radius, and radial and azimuthal velocity beyond Kepler's over the headwind eta v_K."""
    r = np.sqrt((particles.pos**2).sum(axis=1))
    radial = (particles.pos * particles.vel).sum(axis=1) / r
    azimuthal = (particles.pos[:, 0] * particles.vel[:, 1] - particles.pos[:, 1] * particles.vel[:, 0]) / r
    unit = ASPECT**2 * r**-0.5
    return r, radial / unit, (azimuthal - r**-0.5) / unit


def grains(stokes, ratio, **keys):
    """Grains whose Stokes number at r = 1 is given: St = s rho_s sqrt(2 pi) / Sigma, so that it grows with r."""
    sigma = 1e-4 / (4 * np.pi)  # of the disc's mass, at r = 1
    return {
        "particles": 400,
        "ratio": ratio,
        "grain_size": stokes * sigma / np.sqrt(2 * np.pi),
        "grain_density": 1.0,
    } | keys


def drift_over_headwind(r, stokes, ratios):
    """Drift about the circles of the gas, of Stokes numbers that rise with r, over the headwind."""
    unit = ASPECT**2 * r**-0.5
    found = nsh.drift_about_circular_orbits(np.outer(stokes, r), np.outer(ratios, np.ones(len(r))), unit, r**-0.5)
    return nsh.Drift(*(velocity / unit for velocity in found))


@pytest.mark.parametrize(
    ("stokes", "ratios"),
    [((0.02, 0.1, 0.6), (0.2, 0.3, 0.5)), (np.logspace(-3, 1, 8), np.full(8, 0.1))],
    ids=["three", "eight"],
)
def test_populations_start_at_their_common_drift(stokes, ratios):
    sim = disc([grains(st, ratio) for st, ratio in zip(stokes, ratios, strict=True)])
    r, *gas = beyond_kepler(sim.gas)
    found = drift_over_headwind(r, stokes, ratios)
    # To rounding of the Keplerian velocity over the headwind.
    np.testing.assert_allclose(gas, [found.gas_radial, found.gas_azimuthal], rtol=1e-9, atol=1e-12)
    r, *dust = beyond_kepler(sim.dust)
    found = drift_over_headwind(r, stokes, ratios)
    own = sim.dust.species, np.arange(len(r))
    np.testing.assert_allclose(dust, [found.dust_radial[own], found.dust_azimuthal[own]], rtol=1e-9, atol=1e-12)
    linear = nsh.velocities_of_populations(np.outer(stokes, r), np.outer(ratios, np.ones(len(r))), 1.0)
    # eta = .0025, of which the centrifugal force of the slip is of second order: some eta of the drift.
    np.testing.assert_allclose(dust, [linear.dust_radial[own], linear.dust_azimuthal[own]], rtol=0.01, atol=2e-4)


def rotation(particles):
    """v_phi over the Keplerian speed."""
    r = np.hypot(*particles.pos.T)
    return (particles.pos[:, 0] * particles.vel[:, 1] - particles.pos[:, 1] * particles.vel[:, 0]) / r**0.5


@pytest.mark.parametrize("ratios", [[1e-12], [1e-12, 3e-13], [1e-3], [4e-4, 6e-4]])
@pytest.mark.parametrize("direction", ["two-way", "one-way"])
def test_a_trace_of_dust_changes_nothing_of_a_thick_disc(ratios, direction):
    """H/r = .3, small grains: v_K (1 - 2 eta / (1 + eps))^(1/2) of gas and dust together, eta of the gas .09."""
    eta, moving = 0.3**2, sum(ratios) if direction == "two-way" else 0.0
    sim = disc([grains(1e-7, ratio) for ratio in ratios], aspect=0.3, direction=direction)
    alone = disc(None, aspect=0.3)
    np.testing.assert_allclose(rotation(alone.gas), np.sqrt(1 - 2 * eta), rtol=1e-12)
    mixture = np.sqrt(1 - 2 * eta / (1 + moving))
    for particles in (sim.gas, sim.dust):
        np.testing.assert_allclose(rotation(particles), mixture, rtol=1e-11)  # St^2
    if moving < 1e-6:
        np.testing.assert_allclose(sim.gas.vel, alone.gas.vel, rtol=0, atol=1e-11)


@pytest.mark.parametrize("direction", ["two-way", "one-way"])
def test_boulders_of_a_thick_disc_start_on_keplerian_circles(direction):
    """St = 1e7, whatever the gas does."""
    sim = disc([grains(1e7, 1.0)], aspect=0.3, direction=direction)
    np.testing.assert_allclose(rotation(sim.dust), 1.0, rtol=1e-12)
    np.testing.assert_allclose(rotation(sim.gas), np.sqrt(1 - 2 * 0.3**2), rtol=1e-12)


def test_gas_where_there_is_no_dust_feels_none():
    """A population beyond r = 2 alone: within, gas turns with its whole headwind and dust-free."""
    sim = disc([grains(0.1, 1.0, inner=2.0), grains(0.1, 1e-9)])
    r, radial, azimuthal = beyond_kepler(sim.gas)
    within = r < 2.0
    alone = (np.sqrt(1.0 - 2.0 * ASPECT**2) - 1.0) / ASPECT**2
    np.testing.assert_allclose(azimuthal[within], alone, atol=1e-6)
    np.testing.assert_allclose(radial[within], 0.0, atol=1e-6)
    assert azimuthal[~within].max() < -0.3 and azimuthal[~within].min() > -0.7 and radial[~within].min() > 0.05


def test_one_way_dust_starts_as_if_alone():
    sim = disc([grains(0.1, 1.0), grains(1.0, 1.0)], direction="one-way")
    r, radial, _ = beyond_kepler(sim.dust)
    alone = drift_over_headwind(r, [0.1, 1.0], [0.0, 0.0])
    np.testing.assert_allclose(radial, alone.dust_radial[sim.dust.species, np.arange(len(r))], rtol=1e-9)
    np.testing.assert_allclose(beyond_kepler(sim.gas)[1], 0.0, atol=1e-9)


def test_the_start_is_held_by_the_pressure_of_its_tapers():
    """-(1/Sigma) dP/dr by differences, but next to the edges, where no rotation balances the fall."""
    start = {"kind": "disc", "mass": 1e-4, "inner": 1.0, "outer": 3.0, "inner_taper": 0.6, "outer_taper": 0.8}
    eos = {"kind": "locally-isothermal", "aspect_ratio": 0.1, "temperature_index": 0.7}
    scene = load_scene(
        {
            "units": {"system": "code"},
            "run": {"until": 1.0},
            "space": {"size": 8.0},
            "initial": start,
            "gas": {"particles": 10, "eos": eos},
            "star": {"mass": 1.0},
        }
    )
    r, step = np.linspace(1.25, 2.4, 50), 1e-5

    def pressure(r):
        return profile.sound_speed(scene, r, r) ** 2 * profile.surface_density(scene, r)

    slope = (pressure(r + step) - pressure(r - step)) / (2 * step)
    expected = -slope / profile.surface_density(scene, r)
    # Of the difference, step^2, and its rounding, 1e-16 / step.
    np.testing.assert_allclose(profile.pressure_acceleration(scene, r), expected, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("nodes", [5, 10])
def test_phases_of_a_perturbation_are_a_spline(nodes):
    values = 2.0 * np.pi * np.random.default_rng(1).random(nodes)
    x = np.linspace(0.3, 25.0, 1001)
    expected = make_interp_spline(np.linspace(0.3, 25.0, nodes), values, k=3)(x)
    np.testing.assert_allclose(cubic_spline((0.3, 25.0), values, x), expected, atol=1e-13)  # rounding of values to 2 pi


def test_a_perturbation_is_that_of_the_density():
    """The modes m = 2 to 6 of a ring's density have the amplitude that is asked for, and no other has any."""
    amplitude, angle = 1e-6, 2 * np.pi * np.arange(64) / 64
    scene = load_scene("setups/stable_disc.toml", [f"initial.perturbation={amplitude}"])
    moved = perturb_angles(scene, np.full(64, 0.5 * (scene.initial.inner + scene.initial.outer)), angle)
    modes = [2 * abs(np.exp(-1j * m * moved).mean()) for m in range(1, 9)]
    # What is left is of second order: 8^2 / 2 times the square of all the modes' angles together, 1.5 amplitude.
    np.testing.assert_allclose(modes, amplitude * np.array([0, 1, 1, 1, 1, 1, 0, 0]), atol=100 * amplitude**2)


def test_the_start_turns_in_the_pull_of_star_and_disc():
    """A cold disc of a tenth of the star's mass: v^2 / r is both pulls, the disc's the mean over a ring."""
    sim = Simulation(
        {
            "units": {"system": "code"},
            "run": {"until": 1.0},
            "space": {"size": 8.0, "cells": 64},
            "initial": {"kind": "disc", "mass": 0.1, "inner": 1.0, "outer": 3.0},
            "gas": {"particles": 4000, "eos": {"kind": "locally-isothermal", "aspect_ratio": 1e-3}},
            "star": {"mass": 1.0},
            "self_gravity": {"softening": 0.2},
        }
    )
    pos, vel = sim.gas.pos, sim.gas.vel
    r = np.sqrt((pos**2).sum(axis=1))
    of_star, of_disc = (-(sim.acceleration(name)[0] * pos).sum(axis=1) / r for name in ("star", "self_gravity"))
    turn = (pos[:, 0] * vel[:, 1] - pos[:, 1] * vel[:, 0]) ** 2 / r**3
    rings = np.digitize(r, np.linspace(1.0, 3.0, 9)[1:-1])
    left, pull = (np.bincount(rings, values) for values in (turn - of_star, of_disc))
    # Means over rings a cell wide, between which the start interpolates: off most at the inner edge.
    np.testing.assert_allclose(left, pull, atol=0.05 * np.abs(pull).max())
    assert of_disc.max() > 0.01


@pytest.mark.parametrize(
    ("eos", "sound"),
    [
        ({"kind": "polytropic", "gamma": 1.5, "constant": 0.02}, lambda r, sigma: np.sqrt(0.03 * sigma**0.5)),
        ({"kind": "adiabatic", "gamma": 1.5, "aspect_ratio": 0.1}, lambda r, sigma: np.sqrt(1.5) * 0.1 * r**-0.25),
    ],
    ids=["polytropic", "adiabatic"],
)
def test_the_least_toomre_q_of_any_gas(eos, sound):
    """c_s Omega / (pi Sigma) is nowhere below what the scene asks for, c_s of sound waves; T ~ r^-1/2 by default."""
    scene = load_scene(
        {
            "units": {"system": "code"},
            "run": {"until": 1.0},
            "space": {"size": 8.0},
            "initial": {"kind": "disc", "toomre_q": 1.7, "inner": 1.0, "outer": 3.0},
            "gas": {"particles": 100, "eos": eos},
            "star": {"mass": 1.0},
        }
    )
    r = profile.sample_radii(scene.initial)
    sigma = profile.surface_density(scene, r)
    assert (sound(r, sigma) * r**-1.5 / (np.pi * sigma)).min() == pytest.approx(1.7, rel=1e-9)  # a formula: to rounding


def test_velocities_are_found_in_pieces(monkeypatch):
    """With the bits of those that are found all at a time; of gas and dust that drift."""
    scene, found = load_scene(tomllib.loads(DISC)), []
    for piece in (10_000, 77):
        monkeypatch.setattr(balance, "CHUNK", piece)
        state = begin(scene).state
        found.append([p.vel.tobytes() for p in state.species.values()])
    assert found[0] == found[1]
