"""The setups that come with discsim as runs of some steps of few particles, with a checkpoint after each."""

from functools import cache

from discsim import Simulation
from discsim.scene import load_scene

FEW = {"gas.particles": 400, "dust.particles": 400, "space.cells": 32}
# In 1D the smoothing length is given, and goes with the number of particles; a blast begins within some spacings.
SIZES = {
    "dusty_wave": ["gas.particles=60", "dust.particles=60", "gas.smoothing_length=0.1"],
    "dusty_shock": ["gas.particles=99", "dust.particles=99", "gas.smoothing_length=0.1"],
    "settling": ["gas.particles=60", "dust.particles=60"],
    "sedov": ["gas.particles=2500"],
}
STEPS = 4
ALWAYS = "run.checkpoint_every=1e-9 s"


@cache
def short(path):
    """The scene of a setup at `path`, over about STEPS steps with two outputs."""
    whole = load_scene(path)
    few = [f"{key}={number}" for key, number in FEW.items() if getattr(whole, key.split(".")[0])]
    few = [*SIZES.get(path.stem, few), ALWAYS, "run.threads=1", "run.snapshots=2"]
    sim = Simulation(load_scene(path, few))
    length = (STEPS - 0.5) * sim.step()
    if sim.units.system == "physical":
        length = sim.units.quantity(length, "time").to_string()
    return load_scene(path, [*few, f"run.until={length}"])
