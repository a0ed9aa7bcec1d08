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
        ({}, "no zone is there"),
        ({"inner": [2.0, 1.0]}, "not two rising radii"),
        ({"outer": [2.0, 3.0], "time": 0}, "is not positive"),
        ({"outr": [2.0, 3.0]}, "unknown key"),
    ],
)
def test_bad_keys_end_in_one_message(keys, wrong):
    (message,) = problems(dust(damping=keys))[:1]
    assert wrong in message
