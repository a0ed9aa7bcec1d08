"""Discs of particles on even rings, as snapshots, for images with known fluxes."""

import itertools

import numpy as np

from discsim.output.snapshot import Snapshot, SnapshotParticles
from discsim.scene.units import Units

UNITS = Units("physical", 2, "2 au", "0.7 Msun")  # none is 1
SCENE = """
title = "A disc of known flux"
units = {system = "physical", length = "2 au", mass = "0.7 Msun"}
space = {size = "400 au"}
star = {mass = "0.7 Msun"}
initial = {kind = "disc"}
"""
LAYERS = """
title = "A disc of known layers"
units = {system = "physical", length = "2 au", mass = "0.7 Msun"}
run = {until = "3 yr"}
space = {size = "400 au", cells = 32}
star = {mass = "1.3 Msun"}
drag = {law = "epstein", direction = "one-way"}
initial = {kind = "disc", mass = "1e-3 Msun", inner = "10 au", outer = "80 au"}
gas = {particles = 2000, eos = {kind = "locally-isothermal", aspect_ratio = 0.06, reference_radius = "13 au"}}
"""
DUST = '\n[[dust]]\nparticles = 500\nratio = 0.01\ngrain_density = "2 g/cm3"\ngrain_size = '


def scene_of_layers(*sizes):
    """A disc about a star of 1.3 Msun, with dust of these sizes, for exports."""
    return LAYERS + "".join(f'{DUST}"{size}"\n' for size in sizes)


def even_positions(inner, outer, rings, spacing=1.0):
    """Positions (n, 2) on rings that are as far apart as the particles on them, and the area of each particle."""
    edges = np.geomspace(inner, outer, rings + 1)
    pos, area = [], []
    for number, (low, high) in enumerate(itertools.pairwise(edges)):
        r = np.sqrt(0.5 * (low**2 + high**2))
        count = max(int(2 * np.pi * r / (high - low) / spacing), 6)
        phi = 2 * np.pi * (np.arange(count) / count + 0.618 * number)
        pos.append(r * np.stack([np.cos(phi), np.sin(phi)], axis=1))
        area.append(np.full(count, np.pi * (high**2 - low**2) / count))
    return np.concatenate(pos), np.concatenate(area)


def particles(pos, mass, **arrays):
    """Particles of a snapshot with these arrays, in code units."""
    dimensions = {"pos": "length", "vel": "velocity", "mass": "mass"}
    vel = arrays.pop("vel", np.zeros_like(pos))
    return SnapshotParticles(UNITS, dimensions, pos, vel, mass, np.arange(len(pos)), **arrays)


def snapshot(dust=None, gas=None, scene=SCENE):
    """A snapshot of these particles."""
    half = np.full(2, 100.0)
    return Snapshot(0.0, gas, dust, UNITS, scene, 2, -half, half)
