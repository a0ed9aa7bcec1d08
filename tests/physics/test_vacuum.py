"""A polytrope beyond the edges of its disc, where there is no gas: nothing is divided by zero."""

import numpy as np
import pytest

from discsim import Simulation, load_scene
from discsim.physics import profile


def constant_of(gamma):
    """P / Sigma of gamma < 1 grows where the tapers thin the gas out: less pressure leaves the disc in balance."""
    return 0.002 if gamma < 1.0 else 0.14


def scene_of(gamma, **tables):
    return load_scene({
        "units": {"system": "code"}, "run": {"until": 0.01, "threads": 1}, "space": {"size": 7.0},
        "star": {"mass": 1.2},
        "initial": {"kind": "disc", "mass": 0.013, "inner": 0.6, "outer": 2.1, "inner_taper": 0.15, "outer_taper": 0.3},
        "gas": {"particles": 90, "eos": {"kind": "polytropic", "constant": constant_of(gamma), "gamma": gamma}},
        **tables,
    })  # fmt: skip


@pytest.mark.parametrize("gamma", [0.5, 1.4, 2.0, 5.0])
def test_the_pull_of_pressure_is_that_of_the_profile_and_nothing_beyond_it(gamma):
    scene, step = scene_of(gamma), 1e-6
    beyond = np.array([0.05, 0.59, 2.11, 40.0])
    assert (profile.pressure_acceleration(scene, beyond) == 0.0).all()
    assert (profile.sound_speed(scene, beyond, np.zeros(4)) == 0.0).all()
    r = np.linspace(0.8, 1.7, 7)  # where the tapers fall over more than H
    low, sigma, high = (profile.surface_density(scene, r + shift) for shift in (-step, 0.0, step))
    pull = -constant_of(gamma) * (high**gamma - low**gamma) / (2.0 * step) / sigma
    # Central differences have an error of step^2, and lose 1e-16 / step by rounding.
    assert profile.pressure_acceleration(scene, r) == pytest.approx(pull, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("gamma", [0.5, 1.4])
def test_a_damped_edge_of_a_polytrope_begins_without_a_warning(gamma):
    """The zones reach beyond the disc; with dust, whose drag needs the speed of sound there."""
    Simulation(scene_of(
        gamma, damping={"inner": [0.6, 0.8], "outer": [1.7, 2.6]}, dust={"particles": 80, "ratio": 0.03},
        drag={"law": "stopping-time", "t_stop": 0.3},
    ))  # fmt: skip
