"""Particles that drift on their orbits about a star at rest: the step makes no error in them."""

import math

import numpy as np
import pytest

from discsim import Simulation, load_scene
from discsim.exact import kepler
from discsim.physics.orbits import circular_step_limit, drift_rotates_velocities, star_acts_in_drift

STAR = 1.7


def scene(**tables):
    held = {
        "units": {"system": "code"},
        "run": {"until": 1e9},
        "space": {"size": 12.0},
        "star": {"mass": STAR},
        "dust": {"particles": 3, "ratio": 0.01},
    }
    return held | tables


def on_orbits(*given):
    """Places and velocities (n, 2) of (semi-major axis, eccentricity, anomaly)."""
    table = np.array([kepler.motion_at_anomaly(STAR, *orbit) for orbit in given])
    return table[:, :2], table[:, 2:]


def grains(held, pos, vel):
    return Simulation(held, particles={"dust": {"pos": pos, "vel": vel, "mass": np.array([1.0, 0.3, 2.0]) * 1e-6}})


def test_orbits_of_grains_are_exact_at_the_default_step():
    """After forty turns, 13 steps a turn of the nearest: places, which a leapfrog has elsewhere within one turn."""
    given = (2.0, 0.5, 0.4), (1.3, 0.05, 2.0), (3.1, 0.2, -1.0)
    sim = grains(scene(), *on_orbits(*given))
    until = 40.0 * 2.0 * math.pi * math.sqrt(2.0**3 / STAR)
    sim.run(until=until)
    assert sim.state.step < 40 * 30
    for (a, e, anomaly), pos, vel in zip(given, sim.dust.pos[np.argsort(sim.dust.ids)], sim.dust.vel, strict=True):
        mean = kepler.mean_anomaly(e, anomaly) + math.sqrt(STAR / a**3) * until
        there = kepler.motion_at_mean_anomaly(STAR, a, e, mean)
        # Rounding of a thousand steps, which three hundred radians turn into phase.
        np.testing.assert_allclose([*pos, *vel], there, atol=1e-10)


def test_orbits_of_grains_that_light_pushes_are_exact():
    """Without drag: ellipses of what light leaves of the pull, a straight line where that is none, and hyperbolas."""
    betas = np.array([0.4, 1.0, 1.6])
    pos, vel = on_orbits((2.0, 0.3, 0.5), (1.3, 0.05, 2.0), (3.1, 0.2, -1.0))
    held = scene(radiation_pressure={"beta": betas.tolist()}, dust=[scene()["dust"] | {"particles": 1}] * 3)
    given = {"pos": pos, "vel": vel, "mass": np.full(3, 1e-6), "species": np.arange(3)}
    sim = Simulation(held, particles={"dust": given})
    until = 9.0
    sim.run(until=until)
    order = np.argsort(sim.dust.ids)
    found = np.column_stack([sim.dust.pos, sim.dust.vel])[order]
    first = kepler.drift(0.6 * STAR, kepler.Motion(*pos[0], *vel[0]), until)
    np.testing.assert_allclose(found[0], first, rtol=1e-11)
    np.testing.assert_allclose(found[1], [*(pos[1] + until * vel[1]), *vel[1]], rtol=1e-12)

    def energy(x, v):
        return 0.5 * (v**2).sum() + 0.6 * STAR / np.hypot(*x)

    assert energy(found[2, :2], found[2, 2:]) == pytest.approx(energy(pos[2], vel[2]), rel=1e-13)
    assert found[2, 2:] @ found[2, :2] > 0.0


def test_a_push_on_dust_that_gas_drags_is_in_the_kick():
    """Small grains take the speed a t_stop, not what the push gives them in a step."""
    disc = gas_disc(0.02)
    beta, stopping = 0.3, 1e-4
    held = disc | {
        "dust": {"particles": 400, "ratio": 1e-6},
        "drag": {"law": "stopping-time", "t_stop": stopping, "direction": "one-way"},
        "radiation_pressure": {"beta": beta},
    }
    sim = Simulation(held)
    for _ in range(3):
        sim.step()
    with sim.synchronised():
        r = np.hypot(*sim.dust.pos.T)
        near = np.abs(r - 2.0) < 0.2
        radial = (sim.dust.pos * sim.dust.vel).sum(axis=1)[near] / r[near]
        gas = np.hypot(*sim.gas.pos.T)
        with_it = (sim.gas.pos * sim.gas.vel).sum(axis=1)[np.abs(gas - 2.0) < 0.2] / gas[np.abs(gas - 2.0) < 0.2]
    # beta G M / r^2 t_stop is 1e-5; without it in the relaxation it would be a step's 1e-2.
    assert abs(np.median(radial) - np.median(with_it)) < 1e-3


def gas_disc(aspect_ratio=0.07, **star):
    return {
        "units": {"system": "code"},
        "run": {"until": 1e9},
        "space": {"size": 9.0},
        "initial": {
            "kind": "disc", "surface_density": 3e-4, "inner": 1.2, "outer": 3.0, "inner_taper": 0.2, "outer_taper": 0.3,
        },
        "star": {"mass": STAR, **star},
        "gas": {
            "particles": 900,
            "eos": {
                "kind": "locally-isothermal", "aspect_ratio": aspect_ratio, "temperature_index": 0.8,
                "reference_radius": 2.0,
            },
            "viscosity": {"alpha": 0.6, "beta": 1.3},
        },
    }  # fmt: skip


def test_gas_turns_at_the_speed_of_its_balance():
    """A leapfrog has the mean rotation (Omega dt)^2 / 8 below it, at 20 steps a turn a hundredth."""
    below = {}
    for softening in (0.0, 1e-9):  # the latter in the kick
        sim = Simulation(gas_disc(0.02, softening=softening))
        order = np.argsort(sim.gas.ids)
        r = np.hypot(*sim.gas.pos[order].T)
        start = (sim.gas.pos * sim.gas.vel[:, ::-1] * [1.0, -1.0]).sum(axis=1)[order] / r
        dt = 0.3 / math.sqrt(STAR / 1.2**3)
        for _ in range(6):
            sim.step(dt)
        with sim.synchronised():
            pos, vel = (values[np.argsort(sim.gas.ids)] for values in (sim.gas.pos, sim.gas.vel))
            turning = (pos * vel[:, ::-1] * [1.0, -1.0]).sum(axis=1)
            middle = np.abs(r - 2.0) < 0.3
            now = (turning / np.hypot(*pos.T))[middle]
            omega_dt = dt * np.sqrt(STAR / 2.0**3)
            below[softening] = float(1.0 - (now / start[middle]).mean()) / (omega_dt**2 / 8.0)
    assert below[1e-9] == pytest.approx(1.0, abs=0.2), below
    assert abs(below[0.0]) < 0.1, below


def test_the_pull_is_told_though_no_kick_has_it():
    pos, vel = on_orbits((2.0, 0.5, 0.4), (1.3, 0.05, 2.0), (3.1, 0.2, -1.0))
    sim = grains(scene(), pos, vel)
    sim.step()
    away = np.hypot(*sim.dust.pos.T)[:, None]
    np.testing.assert_allclose(sim.acceleration("star")[1], -STAR * sim.dust.pos / away**3, rtol=1e-13)
    assert not sim.dust.acc.any()


MOVES = {
    "a point at rest": ({}, True),
    "softened": ({"star": {"mass": STAR, "softening": 0.01}}, False),
    "free to move": ({"star": {"mass": STAR, "frame": "inertial"}}, False),
    "growing": ({"star": {"mass": STAR, "accretion_radius": 0.3, "grows": True}}, False),
    "with a planet": ({"companion": [{"mass": 1e-3, "semi_major_axis": 2.0, "softening": "0.1"}]}, False),
    "pulled by the disc": ({"self_gravity": {"softening": 0.1}}, False),
    "not pulled by the disc": (
        {"self_gravity": {"softening": 0.1}, "star": {"mass": STAR, "indirect": []}},
        True,
    ),
    "forward Euler": ({"run": {"until": 1e9, "integrator": "euler"}}, False),
}


@pytest.mark.parametrize("name", MOVES)
def test_orbits_are_in_the_drift_where_no_momentum_is_exchanged(name):
    tables, drifts = MOVES[name]
    found = load_scene(gas_disc() | tables)
    assert star_acts_in_drift(found) == drift_rotates_velocities(found) == drifts
    assert circular_step_limit(found) == (1.0 if drifts else 0.5)


def test_grains_in_a_given_disc_drift_by_themselves():
    disc = gas_disc()
    held = {key: disc[key] for key in ("units", "run", "space", "initial", "star")}
    held |= {
        "background": {"surface_density": 3e-4, "eos": disc["gas"]["eos"]},
        "dust": {"particles": 10, "ratio": 0.02, "grain_size": 1e-4, "grain_density": 40.0},
        "drag": {"law": "epstein", "direction": "one-way"},
    }
    found = load_scene(held)
    assert not star_acts_in_drift(found) and drift_rotates_velocities(found) and circular_step_limit(found) == 1.0


def test_particles_that_are_held_stay_where_they_are():
    pos, vel = on_orbits((2.0, 0.5, 0.4), (1.3, 0.05, 2.0), (3.1, 0.2, -1.0))
    held = np.array([False, True, False])
    given = {"pos": pos, "vel": vel, "mass": np.full(3, 1e-6), "immobile": held}
    sim = Simulation(scene(), particles={"dust": given})
    before = sim.dust.pos.copy(), sim.dust.vel.copy()
    sim.step(0.4)
    np.testing.assert_array_equal(sim.dust.pos[1], before[0][1])
    assert (sim.dust.pos[[0, 2]] != before[0][[0, 2]]).all()


@pytest.mark.parametrize("beta", [0.5, 0.9])
def test_loosely_coupled_grains_that_light_pushes_keep_their_circles(beta):
    """With drag both pull and push are in the kick: in the drift about all of M they went to 1.44 of their radius."""
    held = gas_disc(0.05) | {
        "dust": {"particles": 40, "ratio": 1e-6},
        "drag": {"law": "stopping-time", "t_stop": 1e6, "direction": "one-way"},
        "radiation_pressure": {"beta": beta},
    }
    assert not star_acts_in_drift(load_scene(held))
    angle, r = np.linspace(0.0, 6.0, 40), np.linspace(1.4, 2.6, 40)
    out = np.column_stack([np.cos(angle), np.sin(angle)])
    sim = Simulation(held)
    speed = np.sqrt((1.0 - beta) * STAR / r)[:, None]
    order = np.argsort(sim.dust.ids)[:40]
    sim.dust.pos[order] = r[:, None] * out
    sim.dust.vel[order] = speed * np.column_stack([-out[:, 1], out[:, 0]])
    sim.run(until=15.0)
    now = np.hypot(*sim.dust.pos[np.argsort(sim.dust.ids)[:40]].T)
    np.testing.assert_allclose(now / r, 1.0, atol=0.03)  # of a leapfrog in 20 steps a turn and more
