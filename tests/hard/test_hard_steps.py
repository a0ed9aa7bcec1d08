"""Steps forced far above what is stable: a clear stop and a way back, never numbers without a meaning."""

import re
import subprocess
import sys

import numpy as np
import pytest

from discsim import Simulation, load_scene
from discsim.output.checkpoint import read_checkpoint
from discsim.run.simulation import PhysicsError

SMALL = {
    "dusty_disc": ["gas.particles=800", "dust.particles=800", "space.cells=32"],
    "dusty_wave": [],
    "dusty_shock": ["gas.particles=300", "dust.particles=300"],
    "sedov": ["gas.particles=900"],
    "sheet": ["gas.particles=256", "space.cells=16"],
    "star_dust": ["dust.particles=500", 'star.softening="1e-4 au"'],  # in kicks, where orbits grow
}


def forced(name, times):
    """The scene with a fixed step of `times` the share of the limit that it would take at its start; overrides."""
    overrides = [*SMALL[name]]
    sim = Simulation(load_scene(f"setups/{name}.toml", overrides))
    sim._prepare()
    step = times * sim.scene.run.courant * sim.limit
    unit = "" if sim.units.system == "code" else "yr"
    if unit:
        step *= float(sim.units.show(1e6, "time").split()[0]) / 1e6
    value = f'"{step} {unit}"' if unit else f"{step}"
    return [*overrides, f"run.timestep={value}"]


@pytest.mark.parametrize("name", SMALL)
def test_a_step_ten_times_over_courant_stops_the_run(name):
    """Motion grows there, by 1e5 in ten steps, or gas cools below zero: the run ends before its first step."""
    sim = Simulation(load_scene(f"setups/{name}.toml", forced(name, 10.0)))
    with pytest.raises(
        PhysicsError,
        match=r"run\.timestep is [\d.]+ times the step limit of \w+: .*; lower run\.timestep to at most [\d.]+",
    ):
        sim.run()
    assert sim.state.step == 0 and np.isfinite(sim.limit)


@pytest.mark.parametrize("name", ["dusty_wave", "dusty_shock"])
def test_the_step_it_would_take_is_no_reason_to_stop(name):
    sim = Simulation(load_scene(f"setups/{name}.toml", forced(name, 1.0)))
    for _ in range(3):
        sim.step()


def test_command_line_with_a_step_ten_times_over_courant(tmp_path):
    """Exit status 3, a warning before, one message of why and how to go on, the start's checkpoint, no traceback."""
    out = tmp_path / "out"
    command = [sys.executable, "-m", "discsim", "run", "setups/dusty_shock.toml", "-o", str(out), "--quiet"]
    for override in forced("dusty_shock", 10.0):
        command += ["--set", override]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 3
    warning, _, message = done.stderr.strip().partition("\n")
    assert re.match(r"warning: run\.timestep = .* times the sound limit .*: lower run\.timestep to [\d.]+,", warning)
    assert message.startswith("stopped by a numerical failure at t = 0") and message.count("run.timestep is ") == 1
    assert re.search(r"; lower run\.timestep to at most [\d.]+$", message.splitlines()[0])
    assert "Traceback" not in message and "Warning" not in message and len(message.splitlines()) == 2
    assert f"{out}/checkpoint.h5" in message and "--resume" in message
    assert read_checkpoint(out / "checkpoint.h5")[1]["step"] == 0


def test_a_step_that_outgrows_its_limit_on_the_way():
    """Fixed at a fifth of 1/Omega, until what is allowed falls to a fifteenth: it stops there, not at the end."""
    tables = {
        "units": {"system": "code"}, "run": {"until": 3.0, "timestep": 0.2}, "space": {"size": 4.0},
        "dust": {"particles": 1, "ratio": 1.0}, "star": {"mass": 1.0, "softening": 1e-6},
    }  # fmt: skip
    grain = {"pos": np.array([[1.0, 0.0]]), "vel": np.array([[0.0, 1.0]]), "mass": np.ones(1)}
    sim = Simulation(tables, particles={"dust": grain})
    sim.run(1.0)
    sim.dust.pos *= 0.15
    sim.operators.forces()
    words = r"run\.timestep is [\d.]+ times the step limit of \w+: .*; lower run\.timestep to at most [\d.]+( yr)?$"
    with pytest.raises(PhysicsError, match=words):
        sim.run()
    assert sim.time == 1.0
