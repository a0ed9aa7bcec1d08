"""Companions where they are hardest: through particles, at the grid's edge, on needles, with nothing left to take."""

import math

import numpy as np
import pytest

from discsim import Simulation
from discsim.run.simulation import PhysicsError

EOS = {"kind": "locally-isothermal", "aspect_ratio": 0.1}


def tables(companion, star=None, **other):
    return {
        "units": {"system": "code"}, "run": {"until": 1.0}, "space": {"size": 4.0, "cells": 32},
        "initial": {"kind": "disc", "mass": 0.01, "inner": 0.5, "outer": 1.5},
        "star": {"mass": 1.0, "softening": 0.05} | (star or {}),
        "companion": companion,
    } | other  # fmt: skip


def finite(sim):
    arrays = [getattr(p, name) for p in (sim.bodies, *sim.state.species.values()) for name in ("pos", "vel", "mass")]
    return all(np.isfinite(array).all() for array in arrays)


def test_a_companion_runs_through_a_particle():
    """At one place the pull is nothing; one that comes against it goes through, and keeps its energy."""
    companion = {"mass": 0.1, "semi_major_axis": 1.0, "softening": "0.01", "orbit": "live"}
    at = {"pos": [[1.0, 0.0]], "vel": [[0.0, math.sqrt(1.1)]], "mass": [1e-9]}
    sim = Simulation(tables(companion, dust={"particles": 1, "ratio": 1.0}), particles={"dust": at})
    _, acc = sim.acceleration("companion")
    assert (acc == 0.0).all()
    head_on = {"pos": [[math.cos(0.5), math.sin(0.5)]], "vel": [[math.sin(0.5), -math.cos(0.5)]], "mass": [1e-9]}
    run = {"until": 1.0, "courant": 0.05}
    sim = Simulation(tables(companion, dust={"particles": 1, "ratio": 1.0}, run=run), particles={"dust": head_on})

    def jacobi():
        with sim.synchronised() as state:
            r, v, b = state.dust.pos[0], state.dust.vel[0], state.bodies
            rate = math.sqrt(1.1)
            away = math.sqrt(((r - b.pos[1]) ** 2).sum() + 1e-4)
            from_star = math.sqrt(r @ r + 0.0025)
            star = -0.1 / 1.1 * b.pos[1], -0.1 / 1.1 * b.vel[1]  # from the barycentre
            x, u = r + star[0], v + star[1]
            return u @ u / 2 - 1.0 / from_star - 0.1 / away - rate * (x[0] * u[1] - x[1] * u[0])

    # Of energies of m / eps = 10 on its way through; found .005, and .2 at the usual courant = .3.
    before = jacobi()
    sim.run(0.5)
    assert finite(sim) and abs(jacobi() - before) < 0.02


def test_a_planet_on_the_edge_of_the_grid():
    companion = {"mass": 0.01, "semi_major_axis": 2.0, "softening": 0.6, "orbit": "live", "accretion_radius": 0.05}
    scene = tables(
        companion, {"frame": "inertial"}, gas={"particles": 300, "eos": EOS, "viscosity": {}},
        self_gravity={"softening": 0.1},
    )  # fmt: skip
    sim = Simulation(scene)
    sim.run(1.0)
    assert finite(sim)


def test_on_a_needle():
    """e = .999: steps follow it down, and it comes back."""
    companion = {"mass": 0.01, "semi_major_axis": 1.0, "eccentricity": 0.999, "phase": 180.0, "softening": "0.1"}
    companion |= {"orbit": "live"}
    grain = {"pos": [[1.9, 0.0]], "vel": [[0.0, 0.7]], "mass": [1e-12]}
    sim = Simulation(tables(companion, dust={"particles": 1, "ratio": 1.0}), particles={"dust": grain})
    start = sim.bodies.pos[1].copy()
    sim.run(2.0 * math.pi / math.sqrt(1.01))
    assert sim.state.step < 5000
    assert np.abs(sim.bodies.pos[1] - start).max() < 1e-5  # the grain's pull and rounding, 1000 times at pericentre


@pytest.mark.parametrize("frame", ["star", "inertial"])
def test_a_star_that_has_it_all(frame):
    """Gas and dust to the last particle, by star and companion: the run goes on with nothing left."""
    star = {"frame": frame, "grows": True, "accretion_radius": 1.2, "indirect": ["companions", "gas", "dust"]}
    companion = {"mass": 0.01, "semi_major_axis": 1.4, "softening": 0.6, "orbit": "live", "accretion_radius": 3.0}
    scene = tables(
        companion, star, gas={"particles": 300, "eos": EOS, "viscosity": {}}, dust={"particles": 100, "ratio": 0.1},
        drag={"law": "stopping-time", "t_stop": 0.1, "scheme": "idic-linear"}, self_gravity={"softening": 0.1},
    )  # fmt: skip
    sim = Simulation(scene)
    mass = sum(p.mass.sum() for p in (sim.bodies, sim.gas, sim.dust))
    sim.run(1.0)
    assert sim.gas.count == sim.dust.count == 0 and finite(sim)
    assert sim.bodies.mass.sum() == pytest.approx(mass, rel=1e-13)
    assert sim.bodies.accreted.sum() == pytest.approx(0.011, rel=1e-12) and (sim.bodies.accreted > 0.0).all()
    with sim.synchronised():
        assert finite(sim)


def test_what_falls_straight_into_the_star_is_told_or_passes():
    """A live companion without angular momentum: no traceback, but a number or a message."""
    companion = {"mass": 0.01, "semi_major_axis": 1.0, "eccentricity": 0.9999999, "phase": 180.0, "softening": "0.1"}
    grain = {"pos": [[1.9, 0.0]], "vel": [[0.0, 0.7]], "mass": [1e-12]}
    scene = tables(
        companion | {"orbit": "live"}, dust={"particles": 1, "ratio": 1.0}, run={"until": 4.0, "timestep": 0.01}
    )
    sim = Simulation(scene, particles={"dust": grain})
    try:
        sim.run(4.0)
    except PhysicsError as fault:
        assert "run.timestep is" in str(fault)
    assert finite(sim)
