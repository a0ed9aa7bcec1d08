"""The step: its order with operators that do not commute, what limits it, and looking without touching."""

import itertools

import numpy as np
import pytest

from discsim import Simulation
from discsim.effects import base
from discsim.run.operators import Operators
from discsim.run.simulation import PhysicsError

ADIABATIC = {"kind": "adiabatic", "gamma": 1.4, "sound_speed": 1.0}


def wave(gas=None, drag=None, **run):
    """A steep wave with 60 + 60 particles, h = 2 spacings; one drag cell, so that no particle changes cells."""
    law = {"law": "constant", "K": 5.0, "scheme": "idic", "cell_length": 1.0}
    return {
        "units": {"system": "code"}, "run": {"until": 0.1} | run,
        "space": {"dimensions": 1, "size": 1.0, "boundary": "periodic"},
        "initial": {"kind": "wave", "amplitude": 0.05},
        "gas": {"particles": 60, "smoothing_length": 2 / 60,
                "eos": {"kind": "isothermal", "sound_speed": 1.0}} | (gas or {}),
        "dust": {"particles": 60, "ratio": 1.0}, "drag": law | (drag or {}),
    }  # fmt: skip


def orbit(**run):
    """A ring of gas about a star, with self-gravity on a grid and viscosity."""
    return {
        "units": {"system": "code"}, "run": {"until": 0.5} | run, "space": {"size": 6.0, "cells": 24},
        "initial": {"kind": "disc", "mass": 0.3, "inner": 1.0, "outer": 2.0},
        "gas": {"particles": 300, "viscosity": {}, "smoothing_length": 0.3,
                "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.2}},
        "star": {"mass": 1.0}, "self_gravity": {"softening": 0.5},
    }  # fmt: skip


def end(scene, steps, integrator="kdk"):
    """Positions and velocities by id after `steps` equal steps."""
    scene["run"] |= {"timestep": scene["run"]["until"] / steps, "integrator": integrator}
    sim = Simulation(scene)
    sim.run()
    assert sim.state.step == steps
    out = []
    for p in sim.state.species.values():
        out += [p.pos[np.argsort(p.ids)], p.vel[np.argsort(p.ids)]]
    if sim.gas.u is not None:
        out.append(np.tile(sim.gas.u[np.argsort(sim.gas.ids), None], out[0].shape[1]))
    return np.concatenate(out)


def orders(make, steps, integrator="kdk"):
    """log2 of the ratios of successive differences between runs of n, 2n, 4n, ... steps (rms over particles)."""
    ends = [end(make(), n, integrator) for n in steps]
    differences = [np.sqrt(((b - a) ** 2).mean()) for a, b in itertools.pairwise(ends)]
    return np.log2([a / b for a, b in itertools.pairwise(differences)])


CASES = {
    "pressure and drag": lambda: wave(),
    "stiff drag": lambda: wave(drag={"K": 40.0}),
    "viscosity and drag": lambda: wave({"viscosity": {}}),
    "adiabatic, viscosity, drag and its heat": lambda: wave({"viscosity": {}, "eos": ADIABATIC}),
    "friction's heat on cold gas": lambda: wave({"eos": ADIABATIC | {"sound_speed": 0.1}}),
    "star, self-gravity, pressure and viscosity": orbit,
}


@pytest.mark.parametrize("case", CASES)
def test_kick_drift_kick_is_second_order(case):
    # Differences of 40 to 160 steps: their ratio within a fifth of an order of its limit. Particles that change
    # drag or grid cells between runs, and viscosity's kink where pairs begin to part, hold it off.
    assert orders(CASES[case], (40, 80, 160))[-1] == pytest.approx(2.0, abs=0.25)


@pytest.mark.parametrize("case", ["pressure and drag", "star, self-gravity, pressure and viscosity"])
def test_euler_is_first_order(case):
    assert orders(CASES[case], (80, 160, 320), "euler")[-1] == pytest.approx(1.0, abs=0.2)


def test_euler_with_drag_does_not_depend_on_the_order_of_particles():
    """Particles given in another order are sorted on the way, and with them whatever the kick reads."""
    rng = np.random.default_rng(12)
    x = (np.arange(100) + 0.5) / 100
    x = x + 0.01 * np.sin(2 * np.pi * x)
    ends = []
    for order in (np.arange(100), rng.permutation(100)):
        scene = wave(until=0.02, timestep=0.001, integrator="euler")
        del scene["initial"]
        scene["gas"]["particles"] = scene["dust"]["particles"] = 100
        given = {"pos": x[order, None], "vel": np.sin(2 * np.pi * x[order, None]), "mass": np.full(100, 0.01)}
        sim = Simulation(scene, particles={"gas": given, "dust": dict(given, vel=0 * given["vel"])})
        sim.run()
        ends.append(np.sort(sim.gas.vel, axis=0))
    # Sums in another order: rounding.
    np.testing.assert_allclose(ends[1], ends[0], atol=1e-12)


def test_merged_kicks_are_those_made_one_by_one():
    """Closing every step gives what leaving the closing kick to the next one gives: the relaxation composes."""
    ends = []
    for close in (True, False):
        scene = wave(timestep=0.1 / 20)
        sim = Simulation(scene)
        if close:
            while sim.time < 0.1 - 1e-12:
                sim.step()
        else:
            sim.run()
        ends.append(np.concatenate([sim.gas.vel, sim.dust.vel]))
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-13)


def synchronise(sim):
    with sim.synchronised() as state:
        assert state.velocity_lag == 0.0


LOOKS = {"synchronised": synchronise, "acceleration": lambda sim: sim.acceleration("gas")}


@pytest.mark.parametrize("look", LOOKS)
def test_looking_changes_nothing(look):
    """States looked at on the way, and accelerations asked for, leave the rest of the run the same to the last bit."""
    ends = []
    for looks in (lambda sim: None, LOOKS[look]):
        scene = wave({"viscosity": {}, "eos": ADIABATIC}, {"scheme": "idic-linear", "cell_length": 0.1})
        del scene["gas"]["smoothing_length"]  # adaptive
        sim = Simulation(scene)

        def after(sim=sim, looks=looks):
            looks(sim)
            return False

        sim.evolve(0.1, after)
        ends.append(np.concatenate([sim.gas.pos, sim.gas.vel, sim.dust.vel, sim.gas.u[:, None]]))
    np.testing.assert_array_equal(ends[0], ends[1])


# What limits the step


def test_sound_limits_the_step():
    sim = Simulation(wave())
    dt = sim.step()
    assert sim.limited_by == "gas"
    # courant h / c_s
    assert dt == pytest.approx(0.3 * (2 / 60) / 1.0, rel=1e-12)


@pytest.mark.parametrize(("softening", "expected"), [(0.5, "star"), (1e-3, "self_gravity")])
def test_star_or_gravity_limit_the_step(softening, expected):
    """The innermost orbit, or softening over the largest pull, whichever is less; the gas is cold here."""
    scene = orbit()
    scene["gas"]["eos"]["aspect_ratio"] = 1e-3
    del scene["gas"]["viscosity"]
    scene["self_gravity"]["softening"] = softening
    scene["initial"]["mass"] = 0.03
    sim = Simulation(scene)
    innermost = np.sqrt((sim.gas.pos**2).sum(axis=1).min())
    pull = np.sqrt((sim.acceleration("self_gravity")[0] ** 2).sum(axis=1).max())
    limit = 0.5 * innermost**1.5 if expected == "star" else np.sqrt(softening / pull)
    assert sim.step() == pytest.approx(0.6 * limit, rel=1e-9)


def one_way(dust, **tables):
    """Grains beside 64 particles of gas on a circle at 3, whose step is about .1."""
    scene = {
        "units": {"system": "code"}, "run": {"until": 50.0}, "space": {"size": 8.0, "cells": 64},
        "gas": {"particles": 64, "eos": {"kind": "isothermal", "sound_speed": 0.5}},
        "dust": {"particles": len(dust["mass"]), "ratio": 1.0},
        "drag": {"law": "stopping-time", "t_stop": 1e3, "direction": "one-way"},
    }  # fmt: skip
    angle = 2 * np.pi * np.arange(64) / 64
    outward = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    gas = {"pos": 3 * outward, "vel": 3**-0.5 * outward[:, ::-1] * [-1, 1], "mass": np.full(64, 1e-8)}
    return Simulation(scene | tables, particles={"gas": gas, "dust": dust})


def grain(r):
    return {"pos": np.array([[r, 0.0]]), "vel": np.array([[0.0, r**-0.5]]), "mass": np.array([1e-9])}


def test_one_way_dust_that_a_step_would_throw_out_ends_the_run(tmp_path):
    """It may not shorten the gas's step; its energy of -10 would be +9000 after one step of a pull in kicks."""
    star = {"mass": 1.0, "softening": 1e-6}
    sim = one_way(grain(0.05), star=star)
    named = r"limit of star for the orbit of dust particle 64 at r = 0\.05.*a larger star\.accretion_radius"
    with pytest.raises(PhysicsError, match=named):
        sim.step()
    assert sim.state.step == 0
    sim.save(tmp_path / "c.h5")  # and again, resumed
    again = one_way(grain(0.05), star=star)
    again.restore(tmp_path / "c.h5")
    with pytest.raises(PhysicsError, match=named):
        again.step()
    # With a step that is right for it the grain keeps its orbit.
    sim.step(most=0.3 * 0.05**1.5)
    assert (sim.dust.vel**2).sum() / 2 - (sim.dust.pos**2).sum() ** -0.5 == pytest.approx(-10, rel=0.01)


def test_one_way_dust_in_the_drift_keeps_any_orbit_about_the_star_in_the_steps_of_the_gas():
    """Seven turns of e = .4 within one step; drag of 1e3 takes .002 of the energy in two."""
    dust = {"pos": np.array([[0.05, 0.0]]), "vel": np.array([[0.0, (1.4 * 1.3 / 0.05) ** 0.5]]), "mass": [1e-9]}
    sim = one_way({key: np.array(one) for key, one in dust.items()}, star={"mass": 1.3})
    sim.step()
    assert sim.step() > 0.9
    energy = (sim.dust.vel**2).sum() / 2 - 1.3 * (sim.dust.pos**2).sum() ** -0.5
    assert energy == pytest.approx(-0.3 * 1.3 / 0.05, rel=0.02)


def test_a_cloud_of_one_way_dust_that_a_step_would_heat_ends_the_run():
    """Cold, of radius .3 and mass 1, it collapses in .25: in two of the gas's steps."""
    rng = np.random.default_rng(3)
    r, angle = 0.3 * np.sqrt(rng.random(100)), 2 * np.pi * rng.random(100)
    pos = np.stack([r * np.cos(angle), r * np.sin(angle)], axis=1)
    cloud = {"pos": pos, "vel": np.zeros((100, 2)), "mass": np.full(100, 0.01)}
    sim = one_way(cloud, self_gravity={"softening": 0.1, "sources": ["dust"]})
    with pytest.raises(
        PhysicsError, match=r"limit of self_gravity for the orbit of dust particle .* a longer self_gravity\.softening"
    ):
        sim.step(most=0.17)  # 1.5 times what keeps its orbit; the step of the gas is longer


def test_dust_that_outlives_one_way_gas_limits_the_step():
    """Where the star has taken all gas, nobody is left who must not notice it."""
    sim = one_way(grain(3.5), star={"mass": 1.0, "accretion_radius": 3.2})
    sim.step()
    assert sim.gas.count == 0
    assert sim.step() == pytest.approx(0.6 * 3.5**1.5, rel=1e-3)  # 1/Omega of its circle, but for the first step's kick


def test_external_limits_the_step():
    scene = wave(until=1.0)
    scene |= {"external": {"vertical_frequency": 500.0}}
    sim = Simulation(scene)
    assert sim.step() == pytest.approx(0.3 / 500, rel=1e-12)
    assert sim.limited_by == "external"


def test_approach_limits_the_step():
    """Where viscous gas is compressed the signal is faster than sound: h / (c (1 + 1.2 alpha) + 3.4 h |div v|)."""
    x = (np.arange(100) + 0.5) / 100
    scene = wave({"viscosity": {"alpha": 1.0, "beta": 2.0}, "smoothing_length": 0.02})
    del scene["initial"], scene["dust"], scene["drag"]
    scene["gas"]["particles"] = 100
    vel = 10 * np.sin(2 * np.pi * x)[:, None]
    sim = Simulation(scene, particles={"gas": {"pos": x[:, None], "vel": vel, "mass": np.full(100, 0.01)}})
    # SPH's div v of a sine is low by k^2 h^2 / 6; pressure is uniform, viscosity's force gives the other limit.
    viscous = np.abs(sim.acceleration("gas")[0]).max()
    signal = 0.02 / (2.2 + 3.4 * 0.02 * 20 * np.pi)
    assert sim.step() == pytest.approx(0.3 * min(signal, np.sqrt(0.02 / viscous)), rel=0.01)


def box(timestep, until, **gas):
    """A DustyBox of 64 + 64 particles and t_stop .5, whose gas allows steps of .03 where it is warm."""
    return {
        "units": {"system": "code"}, "run": {"until": until, "timestep": timestep},
        "space": {"dimensions": 1, "size": 1.0, "boundary": "periodic"},
        "initial": {"kind": "box", "gas_velocity": 0.0, "dust_velocity": 1.0},
        "gas": {"particles": 64, "eos": {"kind": "isothermal", "sound_speed": 1.0} | gas},
        "dust": {"particles": 64, "ratio": 1.0}, "drag": {"law": "stopping-time", "t_stop": 0.5},
    }  # fmt: skip


def test_a_fixed_step_far_above_sound_is_refused_in_a_box_too():
    """Its rounding errors would be noise of order one in the gas after ten steps."""
    sim = Simulation(box(0.1, 1.0))
    with pytest.raises(PhysicsError, match=r"run\.timestep is [\d.]+ times the step limit of gas:"):
        sim.run()
    assert sim.state.step == 0


@pytest.mark.parametrize(("until", "sound"), [(0.1, 1.0), (0.3, 1.0), (1.0, 0.1)])
def test_a_box_of_few_steps_or_of_cold_gas_takes_any(until, sound):
    """Nothing grows within one step or three, nor where the step is below what sound allows; drag is exact at any."""
    sim = Simulation(box(0.1, until, sound_speed=sound))
    sim.run()
    slip = sim.dust.vel - sim.gas.vel
    np.testing.assert_allclose(slip, np.exp(-2 * until / 0.5), atol=1e-8)  # eps = 1: twice as fast as t_stop


def test_steps_land_on_the_end():
    sim = Simulation(wave(until=0.0777))
    sim.run()
    assert sim.time == 0.0777
    sim.run(until=0.1)
    assert sim.time == 0.1


def test_own_particles_may_lie_in_memory_as_they_like():
    pos = np.array([[1.0, 2.0, 1.5], [0.0, 0.5, 0.2]]).T
    scene = {
        "units": {"system": "code"}, "run": {"until": 1.0}, "space": {"size": 8.0}, "star": {"mass": 1.0},
        "dust": {"particles": 3, "ratio": 1.0},
    }  # fmt: skip
    ends = []
    for order in "CF":
        dust = {name: np.array(pos, order=order) for name in ("pos", "vel")} | {"mass": np.ones(6)[::2]}
        sim = Simulation(scene, particles={"dust": dust})
        sim.step()
        ends.append(sim.dust.pos)
    np.testing.assert_array_equal(*ends)


def test_gas_that_loses_more_heat_in_a_step_than_it_had_is_named():
    """Cold gas that flies apart: (gamma - 1) div v dt is above 1 in the first step, as nothing else limits it."""
    scene = {
        "units": {"system": "code"}, "run": {"until": 10.0}, "space": {"size": 100.0},
        "gas": {"particles": 64, "eos": {"kind": "adiabatic", "gamma": 1.4}},
    }  # fmt: skip
    pos = np.stack(np.meshgrid(*[np.arange(8.0)] * 2), axis=-1).reshape(-1, 2) - 3.5
    own = {"pos": pos, "vel": 5.0 * pos, "mass": np.ones(64), "u": np.full(64, 1e-6)}
    with pytest.raises(PhysicsError, match=r"gas particle \d+ has a negative energy after one step"):
        Simulation(scene, particles={"gas": own}).run()


def test_a_smoothing_length_that_is_none_ends_the_run():
    """Rather than a search for neighbours that never ends."""
    sim = Simulation(orbit() | {"gas": orbit()["gas"] | {"smoothing_length": None}})
    sim.step()
    sim.gas.h[7] = np.nan
    with pytest.raises(PhysicsError, match=rf"gas particle {sim.gas.ids[7]} is not finite in its h before the step"):
        sim.step()


@pytest.mark.parametrize("place", [np.nan, np.inf])
def test_a_place_that_is_none_ends_the_run(place):
    """Its smoothing length stays: grown to the largest it would make neighbours of all, in a search of hours."""
    sim = Simulation(orbit() | {"gas": orbit()["gas"] | {"smoothing_length": None}})
    sim.step()
    sim.gas.pos[7] = place
    before = sim.gas.h[7]
    with pytest.raises(PhysicsError, match=r"in its pos before the step"):
        sim.step()
    assert sim.gas.h[7] == before


class Push(base.Effect):
    """A constant acceleration of the dust, as an effect of somebody's own."""

    def operators(self, state):
        acc = base.arrays("dust", "acc_unshared")
        return [base.Operator("push.on_dust", base.Slot.FORCE, self.accelerate, writes=acc)]

    def accelerate(self, view):
        view.dust.acc_unshared[:, 0] += 0.3


@pytest.mark.parametrize("scheme", ["tsc", "idic-linear", "lab14"])
def test_the_relaxation_knows_any_force_on_one_species(scheme):
    """At steps of 100 stopping times dust slips at its terminal velocity, as under the same [external] force."""
    scene = {
        "units": {"system": "code"}, "run": {"until": 0.2, "timestep": 0.02},
        "space": {"dimensions": 1, "size": 1.0, "boundary": "periodic"}, "initial": {"kind": "box"},
        "gas": {"particles": 64, "eos": {"kind": "isothermal", "sound_speed": 1.0}},
        "dust": {"particles": 64, "ratio": 1.0, "offset": 0.5},
        "drag": {"law": "stopping-time", "t_stop": 2e-4, "scheme": scheme},
    }  # fmt: skip
    sim, external = Simulation(scene), Simulation(scene | {"external": {"dust": 0.3}})
    sim.operators = Operators(sim.state, {"push": Push(sim.scene, sim.state)} | sim.effects)
    sim.run()
    external.run()
    slip = sim.dust.vel.mean() - sim.gas.vel.mean()
    assert slip == pytest.approx(0.3 * 2e-4 / 2, rel=1e-6)  # a t_stop / (1 + eps)
    np.testing.assert_allclose(sim.dust.vel, external.dust.vel, rtol=1e-12)
