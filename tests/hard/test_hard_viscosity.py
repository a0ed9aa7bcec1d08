"""A viscosity as strong as there is: alpha = 1, where a step must be far below that of sound."""

import numpy as np
import pytest

from discsim import Simulation


@pytest.mark.parametrize("courant", [0.3, 0.72])
def test_a_disc_of_alpha_one_stays_smooth(courant):
    """Random velocities of half a sound speed die out, in the longest steps too, and nothing is thrown out."""
    scene = {
        "units": {"system": "code"},
        "run": {"until": 0.3, "courant": courant},
        "space": {"size": 6.0},
        "initial": {"kind": "disc", "mass": 1e-6, "inner": 0.6, "outer": 2.0, "inner_taper": 0.2, "outer_taper": 0.2},
        "gas": {
            "particles": 1500,
            "kernel": "cubic",
            "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.1, "temperature_index": 1.0},
        },
        "star": {"mass": 1.0},
        "alpha_viscosity": {"alpha": 1.0},
    }
    sim = Simulation(scene)
    smooth = sim.gas.vel.copy()
    kicks = 0.05 * np.random.default_rng(2).standard_normal(smooth.shape)
    sim.gas.vel += kicks
    assert sim.step() > 0.0 and sim.limited_by == "alpha_viscosity"
    sim.run()
    r = np.sqrt((sim.gas.pos**2).sum(axis=1))
    turning = (sim.gas.pos[:, 0] * sim.gas.vel[:, 1] - sim.gas.pos[:, 1] * sim.gas.vel[:, 0]) / r
    middle = (r > 0.9) & (r < 1.6)
    # Of .05 a third is left, in waves longer than the particles' spacing, with the pull of pressure, .01.
    assert np.sqrt(((turning * np.sqrt(r) - 1.0)[middle] ** 2).mean()) < 0.03
    assert np.abs(turning * np.sqrt(r) - 1.0).max() < 0.25 and r.max() < 2.6


# Artificial viscosity of no strength is none, with sums that other tests have.
@pytest.mark.parametrize(
    "gas",
    [{"kernel": "cubic"}, {"kernel": "wendland-c4", "viscosity": {"alpha": 0, "beta": 0}}],
    ids=["cubic", "wendland-c4"],
)
def test_neighbours_do_not_swing_in_the_longest_steps(gas):
    """Random velocities on a lattice, whose stiffest wave is of two particles, after 100 steps of 1 / (25 W(0) nu)."""
    n = 16
    x = (np.arange(n) + 0.5) / n
    pos = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1).reshape(-1, 2)
    scene = {
        "units": {"system": "code"},
        "run": {"until": 1e9, "courant": 0.72},
        "space": {"size": 1.0, "boundary": "periodic", "cells": n},
        "gas": {"particles": n * n, "eos": {"kind": "isothermal", "sound_speed": 1e-3}} | gas,
        "alpha_viscosity": {"nu": 1.0},
    }
    vel = 1e-3 * np.random.default_rng(3).standard_normal(pos.shape)
    sim = Simulation(scene, particles={"gas": {"pos": pos, "vel": vel, "mass": np.full(n * n, 1.0 / n**2)}})
    for _ in range(100):
        sim.step()
    # Waves of two particles are gone, those across the box fall by exp(-nu k^2 t); at 1 / (20 W(0) nu) all would grow.
    assert np.sqrt((sim.gas.vel**2).mean()) < 0.3e-3
