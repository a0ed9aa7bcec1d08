"""Every setup, kernel, start, equation of state and integrator makes a few steps; so do effects (`effects/`) and drag
schemes (`drag/`) in tests of their own.
"""

import numpy as np
import pytest
from stepping import ISOTHERMAL, LOCALLY, assert_sane, choices, disc, kinds, scene, totals
from typer.testing import CliRunner

from discsim import Simulation, load_scene
from discsim.cli import app
from discsim.preview.derived import dust_masses, gas_mass
from discsim.scene.tables import TABLES
from setups import SETUPS

FEW = {"gas.particles": 1500, "dust.particles": 1500, "space.cells": 64}


# Setups


@pytest.mark.parametrize("path", SETUPS, ids=lambda path: path.stem)
def test_setup_passes_check(path):
    done = CliRunner().invoke(app, ["check", str(path)])
    assert done.exit_code == 0, done.stderr
    assert load_scene(path).title in done.stdout


@pytest.mark.parametrize("path", SETUPS, ids=lambda path: path.stem)
def test_setup_steps(path):
    whole = load_scene(path)
    reduced = [f"{key}={number}" for key, number in FEW.items() if getattr(whole, key.split(".")[0])]
    if whole.space.dimensions == 1:
        reduced = []  # small as they are, and with a fixed smoothing length
    sim = Simulation(load_scene(path, reduced))
    before = totals(sim)
    # What `discsim check` says, but for the particle at the end of a tube.
    expected = (gas_mass(sim.scene) if sim.gas is not None else 0.0) + sum(dust_masses(sim.scene))
    floor = 1e-5 if sim.scene.model.polar else 1e-6  # cells of a polar grid have at least 1e-6 of the largest density
    assert before["mass"] == pytest.approx(expected, rel=2e-3 if sim.scene.initial.kind == "shock" else floor)
    for _ in range(3):
        sim.step()
    after = totals(sim)
    assert_sane(sim)
    assert after["mass"] == pytest.approx(before["mass"], rel=1e-13)  # a sum of a thousand terms
    moved = after["momentum"] - before["momentum"]
    if sim.scene.star is not None:
        # Central forces on particles that lie evenly; the rest is the noise of a thousand of them.
        assert np.abs(moved).max() < 1e-3 * after["size"]
        # The star's torque is none; a coarse grid's self-gravity leaves this much of one, and what dust loses to
        # gas that it does not push is nobody's. Companions and damping zones give and take as little in three steps.
        alone = sim.scene.drag is not None and sim.scene.drag.direction == "one-way"
        others = sim.scene.companion is not None or sim.scene.damping is not None
        assert after["spin"] == pytest.approx(before["spin"], rel=1e-3 if alone or others else 1e-4)
    elif sim.scene.initial.kind == "shock":
        left, right = sim.scene.initial.left[1], sim.scene.initial.right[1]
        # The push of the pressures on the two ends; SPH smooths them over a few spacings.
        assert moved[0] == pytest.approx((left - right) * sim.time, rel=0.02)
    else:
        # Pairs and cells exchange momentum to rounding; the interpolated field of gravity nearly so.
        scale = max(after["size"], before["size"], sim.gas.mass @ sim.gas.sound_speed)
        assert np.abs(moved).max() < 1e-12 * scale


# Kernels, starts, equations of state, integrators


@pytest.mark.parametrize("dimensions", [1, 2])
@pytest.mark.parametrize("kernel", choices(TABLES["gas"], "kernel"))
def test_kernel(kernel, dimensions):
    sim = Simulation(scene({"kind": "box", "gas_velocity": 0.5}, {"kernel": kernel}, dimensions))
    sim.step()
    assert_sane(sim)
    # In 1D h is whole spacings and the sum is exact for splines; a square lattice leaves half a per cent.
    np.testing.assert_allclose(sim.gas.density, 1.0, rtol=0.01)
    # Forces on a lattice cancel.
    assert np.abs(sim.gas.vel[:, 0] - 0.5).max() < 1e-12


STARTS = {
    "box": ({"gas_velocity": 0.2, "dust_velocity": 1.0}, "periodic", ISOTHERMAL, (1, 2)),
    "wave": ({}, "periodic", ISOTHERMAL, (1, 2)),
    "sheet": ({}, "periodic", ISOTHERMAL, (1, 2)),
    "shock": ({}, "open", {"kind": "adiabatic", "gamma": 1.4}, (1,)),
    "disc": ({"mass": 0.01, "inner": 0.1, "outer": 0.45}, "open", LOCALLY, (2,)),
    "viscous-ring": ({"radius": 0.25, "mass": 0.01}, "open", LOCALLY, (2,)),
    "steady": ({"surface_density": 0.01, "inner": 0.1, "outer": 0.45}, "open", LOCALLY, (2,)),
    "blast": ({"radius": 0.2}, "open", {"kind": "adiabatic", "gamma": 1.4}, (2,)),
    "vortex": ({"velocity": [0.5, 0.0]}, "periodic", {"kind": "adiabatic", "gamma": 1.4}, (2,)),
    "settling": ({}, "open", ISOTHERMAL, (1,)),
    "streaming": ({"amplitude": 0.01}, "periodic", ISOTHERMAL, (2,)),
}


@pytest.mark.parametrize(("kind", "dimensions"), [(kind, d) for kind, (*_, allowed) in STARTS.items() for d in allowed])
def test_start(kind, dimensions):
    keys, boundary, eos, _ = STARTS[kind]
    dust = {"particles": 80, "ratio": 0.1}
    drag = {"law": "stopping-time", "t_stop": 0.1}
    star = {"star": {"mass": 1.0}}
    viscous = star | {"alpha_viscosity": {"alpha": 0.01}}
    more = {"disc": star, "viscous-ring": viscous, "steady": viscous}
    more |= {"settling": {"external": {"vertical_frequency": 4.0}}}
    more = (more | {"streaming": {"shearing_box": {"omega": 2.0, "headwind": 0.3}}}).get(kind, {})
    gas = {"eos": eos} | ({"kernel": "cubic"} if "alpha_viscosity" in more else {})
    source = scene({"kind": kind, **keys}, gas, dimensions, boundary, dust=dust, drag=drag, **more)
    sim = Simulation(source)
    before = totals(sim)["mass"]
    sim.step()
    assert_sane(sim)
    assert totals(sim)["mass"] == pytest.approx(before, rel=1e-14)
    assert sim.gas.vel.shape[1] == dimensions


def test_every_start_is_stepped_here():
    of_files = {"table", "snapshot"}  # initial/test_table.py and test_restart.py
    assert set(STARTS) | of_files == kinds(TABLES["initial"])


GASES = {
    "isothermal": {"sound_speed": 0.5},
    "locally-isothermal": {"aspect_ratio": 0.1},
    "adiabatic": {"gamma": 1.4, "sound_speed": 0.5},
    "polytropic": {"gamma": 2.0, "constant": 0.1},
}


@pytest.mark.parametrize("kind", GASES)
def test_equation_of_state(kind):
    sim = Simulation(disc(gas={"particles": 400, "viscosity": {}, "eos": {"kind": kind, **GASES[kind]}}))
    sim.step()
    assert_sane(sim)
    gas = sim.gas
    ratio = {
        "isothermal": 0.25,
        "locally-isothermal": 0.01 * np.linalg.norm(gas.pos, axis=1) ** -0.5,
        "adiabatic": 0.25 / 1.4,
        "polytropic": 0.1 * gas.density,
    }[kind]
    # c_s^2 / gamma. The energy of adiabatic gas has had one step of work, on rings that are uneven at the edges.
    np.testing.assert_allclose(gas.pressure / gas.density, ratio, rtol=0.05 if kind == "adiabatic" else 1e-12)


def test_every_equation_of_state_is_stepped_here():
    assert set(GASES) == kinds(TABLES["gas"].model_fields["eos"].annotation)


@pytest.mark.parametrize("integrator", choices(TABLES["run"], "integrator"))
def test_integrator(integrator):
    """Positions after a step: x + v dt (euler), x + v dt + a dt^2 / 2 (kdk)."""
    source = scene({"kind": "wave", "amplitude": 0.1}, run={"integrator": integrator, "timestep": 0.004})
    sim = Simulation(source)
    acc = sim.acceleration("gas")[0]
    x, v = sim.gas.pos.copy(), sim.gas.vel.copy()
    dt = sim.step()
    assert dt == 0.004
    order = np.argsort(sim.gas.ids)
    expected = x + v * dt + {"kdk": 0.5, "euler": 0.0}[integrator] * acc * dt**2
    np.testing.assert_allclose(sim.gas.pos[order], expected % 1.0, rtol=0, atol=1e-15)
    assert_sane(sim)
