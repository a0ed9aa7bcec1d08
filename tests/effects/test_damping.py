"""Damping zones: exact relaxation to the equilibrium, circles that stay, the ledger, resume, bad keys."""

import numpy as np
import pytest
from runs import assert_resumes
from scenes import problems

from discsim import Simulation

ALL = {"inner": [1.0, 100.0]}


def dust(until=1.0, courant=0.1, **tables):
    return {
        "units": {"system": "code"},
        "run": {"until": until, "courant": courant, "threads": 1},
        "space": {"size": 8.0},
        "initial": {"kind": "disc", "mass": 1e-3, "inner": 1.0, "outer": 3.0},
        "dust": {"particles": 300, "ratio": 0.01},
        "star": {"mass": 1.0},
        **tables,
    }


def radial(p):
    return (p.pos * p.vel).sum(axis=1) / np.hypot(*p.pos.T)


def test_a_kick_decays_at_the_rate_of_the_zone():
    """One operator over dt: what differs from circles falls by exp(-R dt), R = x^2 / (0.3 orbits at r = 1)."""
    sim = Simulation(dust(damping={"inner": [1.0, 3.0]}))
    p = sim.dust
    r = np.hypot(*p.pos.T)
    p.vel += 0.1 * p.pos / r[:, None]
    sim.effects["damping"].operate(sim.state, 0.7)
    rate = np.clip((3.0 - r) / 2.0, 0.0, 1.0) ** 2 / (0.3 * 2.0 * np.pi)
    # To the table of circles, which are the same over Kepler's at every node.
    np.testing.assert_allclose(radial(p), 0.1 * np.exp(-0.7 * rate), atol=1e-12)


def test_what_it_takes_is_in_the_ledger():
    sim = Simulation(dust(damping=ALL))
    p = sim.dust
    p.vel *= 1.01
    p.vel += [0.02, -0.01]

    def totals():
        return np.array([*(p.mass @ p.vel), p.mass @ (p.pos[:, 0] * p.vel[:, 1] - p.pos[:, 1] * p.vel[:, 0])])

    before = totals()
    sim.effects["damping"].operate(sim.state, 0.5)
    taken = np.array([*sim.state.ledger.damped_momentum, sim.state.ledger.damped_angular_momentum])
    np.testing.assert_allclose(before - totals(), taken, atol=1e-17)
    assert (np.abs(taken) > 1e-3 * p.mass.sum()).all()


def test_the_ledger_of_a_moving_disc_is_about_the_origin():
    """A zone about a star that is .2 away from the barycentre of a pair, and moves."""
    pair = {"mass": 0.3, "semi_major_axis": 2.0, "eccentricity": 0.5, "softening": "0.1", "phase": 70.0}
    sim = Simulation(dust(damping={"inner": [0.5, 9.0]}, star={"mass": 1.0, "frame": "inertial"}, companion=[pair]))
    p = sim.dust
    p.vel *= 1.02
    p.vel += [0.03, -0.01]

    def totals():
        return np.array([*(p.mass @ p.vel), p.mass @ (p.pos[:, 0] * p.vel[:, 1] - p.pos[:, 1] * p.vel[:, 0])])

    assert np.hypot(*sim.bodies.pos[0]) > 0.2
    before = totals()
    sim.effects["damping"].operate(sim.state, 0.5)
    taken = np.array([*sim.state.ledger.damped_momentum, sim.state.ledger.damped_angular_momentum])
    np.testing.assert_allclose(before - totals(), taken, atol=1e-17)  # rounding of a mass of 1e-5
    assert (np.abs(taken) > 1e-4 * p.mass.sum()).all()


def test_each_population_relaxes_to_its_own_drift():
    """St = .1 and 2 in a given disc: from motion of neither, back to the velocities of its start."""
    given = {"surface_density": 1e-3, "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.1}}
    grains = [{"particles": 200, "ratio": 0.01, "grain_size": s, "grain_density": 1.0} for s in (3e-5, 6e-4)]
    drag = {"law": "epstein", "direction": "one-way"}
    start = {"kind": "disc", "mass": 1e-3, "inner": 1.0, "outer": 3.0, "dust_velocity": "drift"}
    zones, star = {"inner": [0.9, 1.1], "outer": [0.5, 1.0]}, {"mass": 1.3, "softening": 0.4}
    tables = dust(damping=zones, background=given, drag=drag, initial=start, star=star)
    sim = Simulation(tables | {"dust": grains})
    p, before = sim.dust, sim.dust.vel.copy()
    falls = [radial(p)[p.species == k].mean() for k in range(2)]
    assert falls[0] > 0.5 * falls[1] and falls[1] < -1e-3
    p.vel += [0.1, 0.2]
    sim.effects["damping"].operate(sim.state, 1e6)
    # Nodes of a table in ln r, between which drifts of 1e-2 are linear.
    np.testing.assert_allclose(p.vel, before, rtol=0, atol=1e-6)


def test_circles_stay_where_velocities_are_half_a_step_off():
    """Without the turn of half a step the zone would brake circles by (Omega dt)^2 / 4, and grains fall."""
    turns = 10 * 2 * np.pi
    sim = Simulation(dust(turns, damping=ALL))
    before = np.hypot(*sim.dust.pos.T)
    sim.run()
    moved = np.hypot(*sim.dust.pos.T) / before - 1.0
    # The start is off a leapfrog's circle by (Omega dt)^2 / 8 = 1.2e-3 of velocity; what falls would move by 2e-2.
    assert np.abs(moved).max() < 2e-3
    assert np.abs(radial(sim.dust)).max() < 1e-4  # undamped 2e-3


@pytest.mark.parametrize("softening", [0.0, 1e-9])
def test_gas_and_dust_in_a_zone_keep_the_radii_on_which_pressure_and_drag_hold_them(softening):
    """Zones include the half kick of pressure and drag, about a point star in the drift and a softened one in kicks.

    Without it gas falls by about eta Omega dt v_K: here by .0026 in ln r in thirteen steps, and dust by .0046.
    """
    scene = dust(6.0, 0.6, damping={"inner": [2.6, 100.0], "time": 1e-4}, star={"mass": 1.7, "softening": softening})
    scene["initial"] |= {"inner": 1.5, "outer": 2.5, "inner_taper": 0.3, "outer_taper": 0.3}
    scene["gas"] = {
        "particles": 2000,
        "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.12, "temperature_index": 0.5},
    }
    scene["dust"]["ratio"] = 0.3
    scene["drag"] = {"law": "stopping-time", "t_stop": 0.4}
    sim = Simulation(scene)
    before = [np.log(np.hypot(*p.pos.T)).mean() for p in (sim.gas, sim.dust)]
    drifts = [(radial(p) / np.hypot(*p.pos.T)).mean() for p in (sim.gas, sim.dust)]
    sim.run()
    moved = [np.log(np.hypot(*p.pos.T)).mean() - r for p, r in zip((sim.gas, sim.dust), before, strict=True)]
    # Rounding is far below; the drift of the dust changes by a few per cent over the way it drifts.
    np.testing.assert_array_less(np.abs(moved - np.array(drifts) * 6.0), [4e-4, 2e-3])


@pytest.mark.parametrize("falls", [-0.05, 0.03])
def test_a_flow_is_followed_to_where_velocities_are_ahead(falls):
    """v_r = falls v_K about M = 1.7: a spiral r^1.5 = r_0^1.5 + 1.5 falls M^.5 t, with phi = ln(r / r_0) / falls.

    Velocities are those a time of .05 / Omega later, at another angle and at a radius of another v_K.
    """
    from discsim.kernels.common import damping as kernels

    mass, r = 1.7, 2.0
    table = np.tile([falls, 1.0], (1, 2, 1))
    zones = kernels.Zones(np.array([[0.5, 1.0, 1e6]]), 0.0, 1.0, table, mass, 0.0, np.zeros(1))
    ahead = 0.05 * np.sqrt(r**3 / mass)
    later = (r**1.5 + 1.5 * falls * np.sqrt(mass) * ahead) ** (2.0 / 3.0)
    turned, speed = np.log(later / r) / falls, np.sqrt(mass / later)
    wanted = speed * np.array([falls * np.cos(turned) - np.sin(turned), falls * np.sin(turned) + np.cos(turned)])
    pos, vel = np.array([[r, 0.0]]), np.array([[0.3, 0.2]])
    none = np.zeros(0, np.int64)
    kernels.relax(0, 1, pos, vel, np.array([0.7]), np.empty(0), none, np.empty(0), 0, np.zeros(4), zones, ahead, 1.0)
    # To second order, .05^2 of the flow and .05^3 / 6 of the sine; circles there are slower by .05 falls / 2.
    np.testing.assert_allclose(vel[0], wanted, rtol=0, atol=0.25 * 0.05 * abs(falls) * speed)


@pytest.mark.parametrize("integrator", ["kdk", "euler"])
def test_a_zone_damps_at_its_rate_in_steps(integrator):
    """Radial motion falls by exp(-R t) over twenty steps, R t = .9, whatever makes them."""
    zone = {"outer": [0.2, 2.0], "time": 0.005}
    sim = Simulation(dust(damping=zone, run={"until": 0.08, "timestep": 0.004, "integrator": integrator}))
    p = sim.dust
    p.vel += 0.1 * p.pos / np.hypot(*p.pos.T)[:, None]
    sim.run()
    outer = np.hypot(*p.pos.T) > 2.05
    assert outer.sum() > 50
    rate = 1.0 / (0.005 * 2.0 * np.pi * 2.0**1.5)
    # Circles of forward Euler widen at Omega^2 r dt or less, 2% of what is left here.
    assert radial(p)[outer].mean() == pytest.approx(0.1 * np.exp(-0.08 * rate), rel=0.05)


@pytest.mark.parametrize("time", [1e-12, 1e12])
def test_extreme_times(time):
    sim = Simulation(dust(damping={"inner": [0.9, 1.5], "outer": [1.2, 40.0], "time": time}))
    sim.run()
    assert np.isfinite(sim.dust.vel).all()


def test_goes_on_from_a_checkpoint_to_the_bit(tmp_path):
    sim = assert_resumes(dust(2.0, damping=ALL), tmp_path / "a.h5", 1.0, 2.0)
    assert sim.state.ledger.damped_angular_momentum != 0.0


def test_own_particles_relax_to_their_mean():
    sim = Simulation(dust(damping=ALL))
    given = {"pos": sim.dust.pos, "vel": 0.9 * sim.dust.vel, "mass": sim.dust.mass}
    scene = dust(damping=ALL)
    del scene["initial"]
    own = Simulation(scene, particles={"dust": given})
    before = own.dust.vel.copy()
    own.effects["damping"].operate(own.state, 1e6)
    # Rings of 32 particles, a tenth of the disc wide.
    assert np.abs(own.dust.vel - before).max() < 0.02


@pytest.mark.parametrize(
    ("keys", "wrong"),
    [
        ({}, "no damping zone is given"),
        ({"inner": [2.0, 1.0]}, "the two radii are not increasing"),
        ({"outer": [2.0, 3.0], "time": 0}, "is not positive"),
        ({"outr": [2.0, 3.0]}, "unknown key"),
    ],
)
def test_bad_keys_end_in_one_message(keys, wrong):
    (message,) = problems(dust(damping=keys))[:1]
    assert wrong in message
