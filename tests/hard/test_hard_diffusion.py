"""Diffusion of dust where there is next to nothing to diffuse through, or next to no end to it."""

import numpy as np
import pytest

from discsim import Simulation
from discsim.drag.base import KickResult
from discsim.run.forces import PhysicsError


def disc(alpha=0.01, stokes=0.1, **tables):
    return {
        "units": {"system": "code"},
        "run": {"until": 0.1},
        "space": {"size": 5.0},
        "initial": {"kind": "disc", "mass": 1e-3, "inner": 0.7, "outer": 1.6},
        "gas": {
            "particles": 400,
            "kernel": "cubic",
            "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.1},
            "viscosity": {},
        },
        "dust": {"particles": 300, "ratio": 0.3},
        "star": {"mass": 1.0, "accretion_radius": 0.3},
        "drag": {"law": "stokes-number", "stokes": stokes},
        "dust_diffusion": {"alpha": alpha},
        **tables,
    }


def stopping_times(sim, times):
    """Let the grains of a simulation have stopping times."""
    sim.effects["drag"].engine.record(sim.dust, KickResult(np.arange(0), times))


@pytest.mark.parametrize("stokes", [1e-30, 1e30])
@pytest.mark.parametrize("alpha", [1e-30, 1.0])
def test_extreme_numbers(stokes, alpha):
    sim = Simulation(disc(alpha, stokes))
    for _ in range(3):
        sim.step()
    assert np.isfinite(sim.dust.pos).all() and np.isfinite(sim.gas.vel).all()
    assert np.abs(sim.dust.pos).max() < 2.5


def test_grains_without_drag_are_not_stirred():
    sim = Simulation(disc())
    sim._prepare()
    before = sim.dust.pos.copy()
    stopping_times(sim, np.where(np.arange(sim.dust.count) % 2, np.inf, 0.1))
    sim.effects["dust_diffusion"].move(sim.state, 0.01)
    moved = (sim.dust.pos != before).any(axis=1)
    assert (moved == (np.arange(sim.dust.count) % 2 == 0)).all()


def test_grains_beyond_the_gas_and_on_the_star():
    """Neither has gas; one lies at the very edge of the gas, where grad ln Sigma has no end."""
    sim = Simulation(disc())
    sim._prepare()
    gas, dust = sim.gas, sim.dust
    outermost = int(np.argmax(np.hypot(*gas.pos.T)))
    edge = gas.pos[outermost] / np.hypot(*gas.pos[outermost])
    dust.pos[0], dust.pos[1] = (0.0, 0.0), (2.4, 0.0)
    dust.pos[2] = gas.pos[outermost] + (1.0 - 1e-9) * 2.0 * gas.h[outermost] * edge
    stopping_times(sim, np.full(dust.count, 0.1))
    before = dust.pos[:3].copy()
    sim.effects["dust_diffusion"].move(sim.state, 0.05)
    assert (dust.pos[:2] == before[:2]).all()
    assert 0.0 < np.hypot(*(dust.pos[2] - before[2])) < 2.0 * gas.h[outermost]
    assert np.isfinite(dust.vel).all() and np.isfinite(gas.vel).all()


def test_no_gas_is_left():
    sim = Simulation(disc())
    sim.gas.remove(np.ones(sim.gas.count, bool))
    before = sim.dust.pos.copy()
    sim.effects["dust_diffusion"].move(sim.state, 0.1)
    assert (sim.dust.pos == before).all()


def test_a_walk_without_end_is_told():
    sim = Simulation(disc(dust_diffusion={"D": 1e6}))
    with pytest.raises(PhysicsError, match=r"dust_diffusion would need .* lower the diffusivity"):
        sim.step()


def test_a_strong_walk_is_made_in_short_steps():
    """sqrt(2 D dt) of twenty h: grains come to where the gas is, and none leaves it."""
    sim = Simulation(disc(dust_diffusion={"D": 0.5}))
    sim.step(0.05)
    near = np.sqrt(((sim.dust.pos[:, None] - sim.gas.pos[None]) ** 2).sum(axis=2)) < 2.0 * sim.gas.h
    assert near.any(axis=1).all()
