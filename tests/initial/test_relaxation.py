"""Gas that settles before t = 0: forces in balance, rings that stay, dust that has no part, resume, bad keys."""

import numpy as np
import pytest
from runs import on_threads
from scenes import problems

from discsim import Simulation, load_scene
from discsim.physics.eos import initial_energy
from discsim.preview.check import report
from discsim.preview.forecast import forecast
from discsim.run.runner import run_scene

LOCAL = {"kind": "locally-isothermal", "aspect_ratio": 0.05, "temperature_index": 1.0}


def disc(relax=0.5, eos=LOCAL, until=0.3, start=(), gas=(), **tables):
    """A disc with sharp edges, which nothing balances at first."""
    first = {"kind": "disc", "mass": 1e-4, "inner": 0.5, "outer": 2.0, "relax": relax}
    return {
        "units": {"system": "code"},
        "run": {"until": until, "threads": 1},
        "space": {"size": 6.0, "cells": 32},
        "initial": first | dict(start),
        "gas": {"particles": 2000, "eos": eos, "viscosity": {}} | dict(gas),
        "star": {"mass": 1.0, "accretion_radius": 0.2},
    } | tables


DUSTY = {"dust": {"particles": 500, "ratio": 0.5}, "drag": {"law": "stopping-time", "t_stop": 0.1}}


def polar(p):
    r = np.hypot(*p.pos.T)
    return r, (p.pos * p.vel).sum(axis=1) / r, (p.pos[:, 0] * p.vel[:, 1] - p.pos[:, 1] * p.vel[:, 0]) / r


def noise(sim):
    """The rms of v_r / c_s."""
    with sim.synchronised():
        r, radial, _ = polar(sim.gas)
        return np.sqrt((radial**2 * r).mean()) / 0.05


# Viscosity of approaching pairs brakes the shear, and is part of the forces that come into balance.
@pytest.mark.parametrize(
    "gas, before, after, noisy",
    [
        ({"kernel": "quintic", "viscosity": {"pairs": "approaching"}}, 0.3, 0.02, 0.7),  # .51, .015 and .39 seen
        ({}, 0.25, 0.005, 0.15),  # .27, .002 and .09 seen
    ],
)
def test_forces_come_into_balance_and_stay_there(gas, before, after, noisy):
    """What is left falls to some hundredth, as epicycles at the outer edge, r = 2, have an orbit of theirs."""
    settled, plain = Simulation(disc(3.0, gas=gas)), Simulation(disc(0.0, gas=gas))
    assert plain.relaxed is None and settled.relaxed.orbits == 3.0 and settled.relaxed.steps > 50
    assert settled.relaxed.before > before and settled.relaxed.after < after * settled.relaxed.before
    for sim in (settled, plain):
        sim.run(0.5 * np.pi)
    assert noise(settled) < noisy * noise(plain)  # after a quarter of an orbit at r = 1


def test_rings_stay_rings_with_their_mass_and_angular_momentum():
    settled, plain = Simulation(disc(1.0)), Simulation(disc(0.0))
    (r, _, turning), (before, _, fell) = polar(settled.gas), polar(plain.gas)
    np.testing.assert_allclose(r * turning, before * fell, rtol=1e-12)
    assert 0.005 < np.abs(r - before).max() < 0.15
    starts = np.flatnonzero(np.abs(np.diff(before)) > 1e-9)
    assert (np.abs(np.diff(r)) > 1e-9).nonzero()[0].tolist() == starts.tolist()
    middle = (before > 0.8) & (before < 1.6)
    assert np.abs(r - before)[middle].max() < 0.01  # the profile stays: H is .05 r


def test_dust_and_time_have_no_part():
    settled, plain = Simulation(disc(0.5, **DUSTY)), Simulation(disc(0.0, **DUSTY))
    assert settled.time == 0.0 and settled.state.step == 0 and settled.state.velocity_lag == 0.0
    for key in ("pos", "vel", "mass"):
        assert getattr(settled.dust, key).tobytes() == getattr(plain.dust, key).tobytes()
    # Gas drifts with the dust that drags it, as the start without relaxation does: the dust has half of its mass.
    given = {name: table for name, table in disc(0.5).items() if name != "drag"}
    alone = Simulation(given)
    drift = Simulation(disc(0.0, **DUSTY))
    bare = Simulation(disc(0.0))
    middle = np.abs(np.hypot(*bare.gas.pos.T) - 1.2) < 0.3
    for component in (1, 2):
        found = polar(settled.gas)[component] - polar(alone.gas)[component]
        wanted = polar(drift.gas)[component] - polar(bare.gas)[component]
        assert np.abs(wanted[middle]).min() > 1e-5
        np.testing.assert_allclose(found[middle], wanted[middle], rtol=0.02)  # of places that are 1% elsewhere


def test_temperature_is_that_of_the_start():
    eos = {"kind": "adiabatic", "gamma": 1.4, "aspect_ratio": 0.05, "temperature_index": 1.0}
    sim = Simulation(disc(0.5, eos))
    r = np.hypot(*sim.gas.pos.T)
    np.testing.assert_allclose(sim.gas.u, initial_energy(sim.scene, r), rtol=1e-12)


def test_a_viscous_disc_keeps_its_inflow():
    start = {"kind": "steady", "accretion_rate": 1e-9, "inner": 0.5, "outer": 2.0, "relax": 0.5}
    scene = disc(start=start, alpha_viscosity={"alpha": 0.02})
    scene["initial"] = start
    scene["gas"]["kernel"] = "wendland-c4"  # whose sums other tests have
    sim = Simulation(scene)
    r, radial, _ = polar(sim.gas)
    inside = (r > 0.52) & (r < 1.98)  # rings beyond the first edges have what the edge has
    np.testing.assert_allclose(radial[inside], (-1.5 * 0.02 * 0.05**2 * r**-0.5)[inside], rtol=0.02)


def test_goes_on_from_a_checkpoint_to_the_bit_and_settles_once(tmp_path):
    given = disc(0.3, damping={"inner": [0.5, 0.7]}, **DUSTY)
    whole = Simulation(given)
    whole.evolve(0.15)
    whole.save(tmp_path / "a.h5")
    whole.evolve(0.3)
    again = Simulation(given, to_restore=True)
    assert again.relaxed is None
    again.restore(tmp_path / "a.h5")
    again.evolve(0.3)
    for name, particles in whole.state.species.items():
        for key, array in particles.arrays().items():
            assert array.tobytes() == again.state.species[name].arrays()[key].tobytes(), (name, key)


def test_the_same_bits_on_any_number_of_threads(monkeypatch):
    ends = []
    for _ in on_threads(monkeypatch):
        gas = Simulation(disc(0.1)).gas
        ends.append((gas.pos.tobytes(), gas.vel.tobytes(), gas.h.tobytes()))
    assert ends[0] == ends[1]


def test_it_is_told_and_foreseen(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr("discsim.output.figure.last_state_figure", lambda snapshot, figure: figure.touch())
    scene = load_scene(disc("2 orbits", until=0.02))
    assert scene.initial.relax == 2.0
    expected = forecast(scene)
    # Of its steps each costs what one of the gas alone does: nothing but the star's pull less.
    assert Simulation(scene).relaxed.steps == pytest.approx(expected.relaxation / expected.step_seconds, rel=0.3)
    assert "CPU time before t = 0" in report(scene)
    assert "CPU time before t = 0" not in report(load_scene(disc(0)))
    assert run_scene(scene, tmp_path / "out", quiet=True) == 0
    log = (tmp_path / "out" / "run.log").read_text()
    assert log.count("gas relaxed for 2 orbits before t = 0") == 1
    longer = load_scene(disc("2 orbits", until=0.04))
    assert run_scene(longer, tmp_path / "out", resume=True, quiet=True) == 0
    assert (tmp_path / "out" / "run.log").read_text().count("gas relaxed") == 1


@pytest.mark.parametrize(
    ("scene", "wrong"),
    [
        (disc("3 au"), '"3 au" is not a number of orbits; expected a number like 2 or "2 orbits"'),
        (disc("many orbits"), "is not a number of orbits"),
        (disc(-1), "expected at least 0"),
        (disc("nan orbits"), "is not a number of orbits"),
        (disc(True), "is not a number"),
        (disc(1e4), "expected at most 1000"),
        (disc(1, start={"perturbation": 0.1}), "relaxation would remove it; remove initial.perturbation"),
        (disc(1, start={"relex": 1}), "relax"),
    ],
)
def test_bad_keys_end_in_one_message(scene, wrong):
    (message,) = problems(scene)
    assert wrong in message


def test_without_gas_or_a_star_there_is_nothing_to_settle():
    bare = {name: table for name, table in disc(1, **DUSTY).items() if name not in ("gas", "drag")}
    assert any("relaxation needs gas" in message for message in problems(bare))
    lone = {name: table for name, table in disc(1, self_gravity={}).items() if name != "star"}
    assert any("relaxation is measured in orbits about a star" in message for message in problems(lone))
