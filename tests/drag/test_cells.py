"""Drag in cells: what lacks a partner, heat, one-way drag, and the laws of the stopping time in a run."""

import astropy.constants as const
import astropy.units as un
import numpy as np
import pytest
from dusty import ISOTHERMAL, scene

from discsim import Simulation
from discsim.exact import dustybox
from discsim.kernels.drag.blocks import add_in_units, block_squares, particles_in_blocks, uncoupled_particles

# Cells that lack a species


def test_few_dust_particles_are_all_coupled():
    """8 dust particles among 600 of gas: blocks grow until each has gas, and momentum stays."""
    dust = {"particles": 8, "ratio": 0.5}
    box = {"kind": "box", "gas_velocity": 0.0, "dust_velocity": 1.0}
    sim = Simulation(scene(box, 0.05, {"law": "stopping-time", "t_stop": 0.01}, gas=600, dust=dust))
    sim.run()
    distance = (sim.dust.pos - sim.gas.pos[:, 0] + 0.5) % 1.0 - 0.5
    side = sim.effects["drag"].engine.layout(sim.state).lattice.side  # of the smallest cells
    near = np.exp(-0.5 * (distance / (2.0 * side)) ** 2)
    slip = sim.dust.vel[:, 0] - near @ sim.gas.vel[:, 0] / near.sum(axis=1)
    momentum = (sim.gas.mass[:, None] * sim.gas.vel).sum() + (sim.dust.mass[:, None] * sim.dust.vel).sum()
    assert momentum == pytest.approx(0.5, rel=1e-13)
    # Each grain has met gas. The slip of 1 would be 5e-4 in an even mixture; here it is at most .13, as gas is pushed
    # aside by the heavy grains.
    assert np.isfinite(sim.effects["drag"].stopping_times).all()
    assert np.abs(slip).max() < 0.16 and sim.dust.vel.max() < 0.4


def test_dust_without_gas_is_reported():
    """Gas in one corner of an open box: dust far from it moves freely, and its share is told."""
    rng = np.random.default_rng(9)
    x = (np.arange(30) + 0.5) / 30 * 0.2
    gas = np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2) - 0.5
    near = rng.random((300, 2)) * 0.15 - 0.475
    dust = np.concatenate([near, rng.random((100, 2)) * 0.1 + 0.35])
    given = {
        "gas": {"pos": gas, "vel": np.zeros((900, 2)), "mass": np.full(900, 1 / 900)},
        "dust": {"pos": dust, "vel": np.tile([0.0, 0.1], (400, 1)), "mass": np.full(400, 1 / 400)},
    }
    law = {"law": "stopping-time", "t_stop": 1e-3}
    tables = scene(None, 1.0, law, 900, 400, dimensions=2, space={"boundary": "open", "cells": 64})
    tables["initial"] = None
    sim = Simulation(tables, particles=given)
    sim.step(most=0.01)
    far = slice(300, 400)
    assert (sim.effects["drag"].stopping_times[far] == np.inf).all()
    np.testing.assert_array_equal(sim.dust.vel[far], np.tile([0.0, 0.1], (100, 1)))
    assert (sim.dust.vel[:300, 1] < 0.09).mean() > 0.9
    assert 0.25 <= sim.effects["drag"].uncoupled < 0.6


def test_dust_at_the_edge_of_the_gas_has_its_whole_drag():
    """Where some nodes have no gas the others take their weight: the stopping time is the law's all the same."""
    rng = np.random.default_rng(5)
    x = (np.arange(30) + 0.5) / 30
    gas = np.stack(np.meshgrid(0.5 * x, x, indexing="ij"), axis=-1).reshape(-1, 2) - 0.5
    dust = np.stack([rng.uniform(-0.05, 0.01, 300), rng.uniform(-0.4, 0.4, 300)], axis=1)
    given = {
        "gas": {"pos": gas, "vel": np.zeros((900, 2)), "mass": np.full(900, 1 / 900)},
        "dust": {"pos": dust, "vel": np.ones((300, 2)), "mass": np.full(300, 1e-6)},
    }
    law = {"law": "stopping-time", "t_stop": 0.01}
    tables = scene(None, 1.0, law, 900, 300, dimensions=2, space={"boundary": "open", "cells": 64, "size": 2.0})
    tables["initial"] = None
    sim = Simulation(tables, particles=given)
    sim.step(most=0.01)
    np.testing.assert_allclose(sim.effects["drag"].stopping_times, 0.01, rtol=1e-12)


# Heat


@pytest.mark.parametrize("scheme", ["tsc", "idic", "idic-linear"])
@pytest.mark.parametrize("coefficient", [5.0, 1e4])
def test_friction_heats_the_gas(coefficient, scheme):
    """Energy of motion, less the work of the accelerations, is the heat: nothing is lost."""
    gas = {"particles": 40, "eos": {"kind": "adiabatic", "gamma": 1.4, "sound_speed": 1.0}}
    box = {"kind": "box", "gas_velocity": 1.0, "dust_velocity": -1.0}
    drag = {"law": "constant", "K": coefficient, "scheme": scheme}
    sim = Simulation(scene(box, 0.2, drag, gas=gas, ratio=0.5, external={"gas": 0.7, "dust": -0.4}))

    def energy():
        thermal = (sim.gas.mass * sim.gas.u).sum()
        return thermal + sum(0.5 * (p.mass[:, None] * p.vel**2).sum() for p in (sim.gas, sim.dust))

    def powers():
        return 0.7 * (sim.gas.mass @ sim.gas.vel)[0] - 0.4 * (sim.dust.mass @ sim.dust.vel)[0]

    start, work, dt = energy(), 0.0, 0.005
    sim._prepare()
    for _ in range(40):
        before = powers()
        sim.operators.kick(dt)
        work += 0.5 * dt * (before + powers())  # a kick's work, at the mean of its velocities
    assert energy() - start == pytest.approx(work, abs=1e-13 * start)
    assert np.ptp(sim.gas.u) < 1e-10
    if coefficient == 5.0:
        # Work of the constant accelerations along the exact paths, to second order in dt over t_stop of .07.
        times, weights = np.polynomial.legendre.leggauss(40)
        v, u = dustybox.velocities(0.1 * times + 0.1, 1.0, -1.0, 1.0, 0.5, coefficient, 0.7, -0.4)
        assert work == pytest.approx(0.1 * (weights * (0.7 * v - 0.2 * u)).sum(), rel=2e-3)


@pytest.mark.parametrize("coefficient", [1.0, 30.0, 1e4])
def test_nodes_heat_the_gas_by_what_is_lost(coefficient):
    """Random velocities on a common boost: the heat is the loss of energy of motion, and warms every particle."""
    rng = np.random.default_rng(8)
    boost = 100.0
    given = {
        "gas": {
            "pos": rng.random((900, 2)), "vel": boost + rng.normal(size=(900, 2)), "mass": np.full(900, 1 / 900),
            "u": np.full(900, 10.0),
        },
        "dust": {
            "pos": rng.random((700, 2)), "vel": boost + rng.normal(size=(700, 2)),
            "mass": rng.uniform(0.5, 2, 700) / 700, "species": rng.integers(0, 2, 700),
        },
    }  # fmt: skip
    gas = {"particles": 900, "eos": {"kind": "adiabatic", "gamma": 1.4, "sound_speed": 1.0}}
    law = {"law": "constant", "K": coefficient, "scheme": "tsc"}
    tables = scene(None, 1.0, law, gas, [{"particles": 350, "ratio": 0.5}] * 2, dimensions=2)
    tables["initial"] = None
    sim = Simulation(tables, particles=given)
    sim._prepare()
    for rates in (sim.gas.acc, sim.state.acc_unshared["gas"], sim.gas.heating_rate, sim.gas.pressure_acc):
        rates[:] = 0.0

    def motion():
        return sum(0.5 * (p.mass[:, None] * (p.vel - boost) ** 2).sum() for p in (sim.gas, sim.dust))

    before = motion()
    sim.operators.kick(0.01)
    heat = sim.gas.u - 10.0
    # Rounding of the boosted velocities: 1e-16 of 100^2, against a loss of .05 and more.
    assert (sim.gas.mass * heat).sum() == pytest.approx(before - motion(), rel=1e-10)
    assert heat.min() > 0


# One-way


def disc(drag, **tables):
    start = {"kind": "disc", "mass": 0.01, "inner": 1.0, "outer": 3.0}
    eos = {"kind": "locally-isothermal", "aspect_ratio": 0.1}
    out = {
        "units": {"system": "code"}, "run": {"until": 1.0}, "initial": start,
        "space": {"size": 8.0, "cells": 32}, "gas": {"particles": 1500, "viscosity": {}, "eos": eos},
        "star": {"mass": 1.0, "accretion_radius": 0.9}, **tables,
    }  # fmt: skip
    return out | ({"dust": {"particles": 1000, "ratio": 0.5}, "drag": drag} if drag else {})


@pytest.mark.parametrize("gravity", [{}, {"self_gravity": {"softening": 0.3, "sources": ["gas"]}}])
def test_one_way_gas_is_that_without_dust(gravity):
    """To the last bit, from the start through accretion, sorting and the choice of the step."""
    drag = {"law": "stokes-number", "stokes": 0.1, "direction": "one-way"}
    with_dust, without = Simulation(disc(drag, **gravity)), Simulation(disc(None, **gravity))
    np.testing.assert_array_equal(with_dust.gas.vel, without.gas.vel)
    for sim in (with_dust, without):
        sim.run(until=8.0)
    assert with_dust.state.step == without.state.step > 16
    for name, array in without.gas.arrays().items():
        np.testing.assert_array_equal(getattr(with_dust.gas, name), array, err_msg=name)


def test_gravity_does_not_make_dust_slip():
    """Gas and dust fall alike: in a self-gravitating sheet the pressure alone makes them slip."""
    time = 0.01
    drag = {"law": "stopping-time", "t_stop": time}
    gas = {"particles": 1024, "kernel": "quintic", "eos": ISOTHERMAL}
    sheet = {"kind": "sheet", "amplitude": 0.01}
    tables = scene(sheet, 1.0, drag, gas=gas, dust=1024, dimensions=2, space={"cells": 32})
    sim = Simulation(tables | {"self_gravity": {"softening": 0.1}})
    sim.step(most=8 * time)
    k = 2 * np.pi

    def wave(p):
        return 2 * (p.mass * p.vel[:, 0] * np.cos(k * p.pos[:, 0])).sum()

    slip = wave(sim.gas) - wave(sim.dust)
    # Terminal velocity: -c_s^2 k A cos(k x) t_stop / (1 + eps); the SPH pressure is right to some per cent at 32^2.
    assert slip == pytest.approx(-k * 0.01 * time / 2, rel=0.15)


# Laws


@pytest.mark.parametrize(("convention", "factor"), [("papers", 1.0), ("kinetic", np.sqrt(np.pi / 8))])
def test_epstein_stopping_times_of_a_disc(convention, factor):
    """t_stop = s rho_s / (c_s rho_g), rho_g = Sigma / (sqrt(2 pi) H), H = c_s / Omega: with astropy from the scene."""
    tables = {
        "run": {"until": "10 yr"}, "space": {"size": "260 au", "cells": 64},
        "initial": {"kind": "disc", "mass": "0.01 Msun", "inner": "10 au", "outer": "100 au"},
        "gas": {"particles": 4000, "eos": {
            "kind": "locally-isothermal", "aspect_ratio": 0.05, "reference_radius": "10 au"}},
        "dust": {"particles": 4000, "ratio": 0.01, "grain_size": "1 cm", "grain_density": "3 g/cm3"},
        "star": {"mass": "1 Msun"}, "drag": {"law": "epstein", "convention": convention},
    }  # fmt: skip
    sim = Simulation(tables)
    sim.step()
    r = np.sqrt((sim.dust.pos**2).sum(axis=1)) * un.au
    middle = (r > 30 * un.au) & (r < 80 * un.au)
    omega = np.sqrt(const.G * const.M_sun / r**3)
    sigma = 0.01 * un.Msun / (2 * np.pi * 90 * un.au * r)
    sound = 0.05 * np.sqrt(const.G * const.M_sun / (10 * un.au)) * (r / (10 * un.au)) ** -0.25
    midplane = sigma / (np.sqrt(2 * np.pi) * sound / omega)
    expected = (factor * 1 * un.cm * 3 * un.g / un.cm**3 / (sound * midplane)).to(un.yr)
    unit = np.sqrt(un.au**3 / (const.G * un.Msun)).to(un.yr)
    found = sim.effects["drag"].stopping_times * unit
    ratio = (found / expected).decompose().value[middle]
    # Cells of ~10 au, with their SPH density: the median over 2000 grains.
    assert np.median(ratio) == pytest.approx(1.0, abs=0.04)
    assert (np.abs(ratio - 1) < 0.3).mean() > 0.9


def test_stokes_number_law():
    """t_stop Omega is the number asked for, but for the width of a cell."""
    sim = Simulation(disc({"law": "stokes-number", "stokes": 0.1}))
    sim.step()
    r = np.sqrt((sim.dust.pos**2).sum(axis=1))
    stokes = sim.effects["drag"].stopping_times * r**-1.5
    coupled = np.isfinite(stokes)
    assert np.median(stokes[coupled]) == pytest.approx(0.1, rel=0.02)
    assert coupled.mean() > 0.9


@pytest.mark.parametrize("count", [0, 3, 4, 1002])
def test_sums_in_whole_units(count):
    """Of each particle of a leaf once, rounded: whatever their order."""
    rng = np.random.default_rng(6)
    key, values = rng.integers(0, 5, count, np.uint32), rng.random(count)
    out, order = np.zeros((2, 6)), rng.permutation(count)
    add_in_units(key, values, 64.0, out[0])
    add_in_units(key[order], values[order], 64.0, out[1])
    np.testing.assert_array_equal(out[0], np.bincount(key, np.rint(64.0 * values), 6))
    np.testing.assert_array_equal(out[0], out[1])


def test_members_that_are_alone():
    """Those of enlarged blocks, of a population without a rate, and outside; not of what others' blocks hold."""
    random, count = np.random.default_rng(8), 6
    rates, enlarged = random.integers(0, 2, (9, 2)) * 1.5, random.random(9) < 0.3
    start = np.append(0, np.cumsum(random.integers(0, 4, (9 + 2) * 2)))
    order = random.permutation(start[-1]).astype(np.uint32)
    chosen = np.ones((11, 2), bool)
    chosen[:9] = (rates == 0.0) | enlarged[:, None]
    chosen[count:9] = False
    found = uncoupled_particles(order, start, rates, enlarged, count)
    assert list(found) == list(particles_in_blocks(order, start, chosen.ravel()))
    assert list(found) == [i for k in np.flatnonzero(chosen.ravel()) for i in order[start[k] : start[k + 1]]]


def test_squares_of_blocks():
    leaf, level = np.array([[0, 3], [4, 8], [2, 2]], np.int32), np.array([0, 2, 1])
    corner, side = np.empty((3, 2)), np.empty(3)
    block_squares(0, 3, leaf, level, np.array([-1.0, 0.5]), (10, 20), 0.25, corner, side)
    assert corner.tolist() == [[1.5, 6.25], [2.5, 7.5], [2.0, 6.0]] and side.tolist() == [0.25, 1.0, 0.5]
