"""Runs of a disc with grains of 1 mm and 5 cm, whose snapshots have known surface densities."""

import numpy as np

from discsim.numerics.state import Dust, Gas
from discsim.output.snapshot_writer import write_snapshot
from discsim.scene import load_scene

COUNT = 3000  # particles of each population, and of gas
MASSES = 3e-8, 5e-8  # of a grain of each population, in Msun
SPEEDS = -0.02, 0.07  # v_r / r
STOKES = 0.013, 0.6
EDGES = ((1.5, 4.5), (2.2, 3.4))  # in radius, at t = 0; the second population shrinks to 1 / (1 + t / 20)
TABLES = {
    "title": "Two sizes",
    "run": {"until": "30 yr"},
    "units": {"length": "2 au", "mass": "0.7 Msun"},
    "space": {"size": "30 au"},
    "initial": {"kind": "disc", "mass": "0.01 Msun", "inner": "2 au", "outer": "9 au"},
    "gas": {"particles": COUNT, "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.05}},
    "dust": [
        {"particles": COUNT, "ratio": 0.01, "grain_size": "1 mm", "grain_density": "1.3 g/cm3"},
        {"particles": COUNT, "ratio": 0.02, "grain_size": "5 cm", "grain_density": "1.3 g/cm3", "name": "pebbles"},
    ],
    "star": {"mass": "0.7 Msun"},
    "drag": {"law": "epstein"},
}


def ring(inner, outer):
    """COUNT positions, even in area."""
    r = np.sqrt(inner**2 + (outer**2 - inner**2) * (np.arange(COUNT) + 0.5) / COUNT)
    phi = np.arange(COUNT) * np.pi * (3.0 - np.sqrt(5.0))
    return np.stack([r * np.cos(phi), r * np.sin(phi)], axis=1)


def surface_density(number, time):
    """Surface density of a population between its edges, in code units."""
    inner, outer = EDGES[number]
    return MASSES[number] * COUNT / (np.pi * (outer**2 - inner**2)) * (1.0 + time / 20) ** (2 * number)


def write_two_sizes(directory, times=(0.0, 3.0, 11.0), tables=TABLES, spread=0.0):
    """Write the snapshots and scene.toml of a run, whose gas has grown by the factor 1 + spread t."""
    (directory / "snapshots").mkdir(parents=True)
    scene, one = load_scene(tables), np.ones(COUNT)
    (directory / "scene.toml").write_text(scene.text)
    gas_pos = ring(1.2, 5.0)
    state = {"h": one, "density": 2.0 * one, "gradh": one, "pressure": one, "sound_speed": one}
    order = np.random.default_rng(7).permutation(2 * COUNT)  # populations are mixed in the arrays
    for number, time in enumerate(times):
        now = (1.0 + spread * time) * gas_pos
        gas = Gas(pos=now, vel=0.1 * gas_pos, acc=0 * gas_pos, mass=1e-5 * one, ids=np.arange(COUNT), **state)
        pos = np.concatenate([ring(*EDGES[0]), ring(*EDGES[1]) / (1.0 + time / 20)])
        species = np.repeat([0, 1], COUNT)
        vel = np.array(SPEEDS)[species, None] * pos
        arrays = {"pos": pos, "vel": vel, "acc": 0 * pos, "mass": np.array(MASSES)[species], "species": species}
        dust = Dust(ids=np.arange(2 * COUNT), **{name: array[order] for name, array in arrays.items()})
        stokes = np.array(STOKES)[species][order]
        extra = {"dust": {"stokes": stokes, "stopping_time": 2.0 * stokes}}
        write_snapshot(directory / "snapshots" / f"{number:04}.h5", scene, time, gas, dust, extra)
    return directory
