"""Boosted frames: a flow at a hundred times the speed of sound past the lattice and the boundary."""

import numpy as np
import pytest

from discsim import Simulation
from discsim.exact import dustywave

BOOST = 100.0


def line(coefficient, scheme, boost):
    """Worst rms error of a DustyWave over its largest exact velocity in the frame of the wave."""
    sim = Simulation(
        {
            "units": {"system": "code"}, "run": {"until": 0.5},
            "space": {"dimensions": 1, "size": 1.0, "boundary": "periodic"},
            "initial": {"kind": "wave", "velocity": boost},
            "gas": {"particles": 240, "smoothing_length": 0.025, "eos": {"kind": "isothermal", "sound_speed": 1.0}},
            "dust": {"particles": 240, "ratio": 1.0}, "drag": {"law": "constant", "K": coefficient, "scheme": scheme},
        }
    )  # fmt: skip
    sim.run()
    errors = []
    for name, p in sim.state.species.items():
        exact = getattr(dustywave.solution(p.pos[:, 0], 0.5, coefficient, 1.0, boost=boost), f"{name}_velocity")
        errors.append(np.sqrt(((p.vel[:, 0] - exact) ** 2).mean()) / np.abs(exact - boost).max())
    return max(errors)


@pytest.mark.parametrize("scheme", ["tsc", "idic-linear"])
@pytest.mark.parametrize("coefficient", [0.5, 500.0, 1e9])
def test_dustywave_at_a_hundred_times_the_speed_of_sound(coefficient, scheme):
    """Particles cross 30 cells a step: the error is bounded as at rest, and a fifth above it at most (other cells)."""
    moving = line(coefficient, scheme, BOOST)
    assert moving <= 0.001
    assert moving <= 1.2 * line(coefficient, scheme, 0.0) + 1e-4


def square(velocity, **drag):
    """A dusty mixture with noise in a periodic square; places and velocities in its own frame, and its momentum."""
    rng = np.random.default_rng(7)
    x = (np.arange(24) + 0.5) / 24
    lattice = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1).reshape(-1, 2)
    given = {}
    for name in ("gas", "dust"):
        wave = 0.05 * np.sin(2 * np.pi * (lattice + rng.random(2)))
        given[name] = {
            "pos": (lattice + 0.2 * (rng.random(lattice.shape) - 0.5) / 24) % 1.0, "vel": velocity + wave,
            "mass": np.full(576, 1 / 576),
        }  # fmt: skip
    sim = Simulation(
        {
            "units": {"system": "code"}, "run": {"until": 0.2, "timestep": 0.01},
            "space": {"size": 1.0, "boundary": "periodic", "cells": 16},
            "gas": {"particles": 576, "viscosity": {}, "eos": {"kind": "isothermal", "sound_speed": 1.0}},
            "dust": {"particles": 576, "ratio": 1.0}, **drag,
        },
        particles=given,
    )  # fmt: skip
    sim.run()
    return [p.vel[np.argsort(p.ids)] - velocity for p in sim.state.species.values()]


def test_a_square_in_a_moving_frame():
    """Gas, viscosity and drag at (100, -60) c_s. Gas and dust alone do not notice, to the rounding of 100.

    Drag notices its lattice: seven particles of a cell fit slopes to their noise, at most a tenth of .035.
    """
    for drag, limit in (({}, 1e-11), ({"drag": {"law": "stopping-time", "t_stop": 0.02}}, 0.1 * 0.035)):
        still, moving = square(np.zeros(2), **drag), square(np.array([BOOST, -60.0]), **drag)
        for a, b in zip(still, moving, strict=True):
            assert np.sqrt(((a - b) ** 2).mean()) < limit
        total = [sum(v.sum(axis=0) / 576 for v in frame) for frame in (still, moving)]
        np.testing.assert_allclose(total[1], total[0], atol=1e-11)
