"""Snapshots of discs with companions whose orbits, gaps and damping zones are known in closed form."""

import numpy as np

from discsim.exact import kepler
from discsim.numerics.bodies import Bodies
from discsim.numerics.state import Dust, Gas
from discsim.output.snapshot_writer import write_snapshot
from discsim.scene import load_scene

INNER, OUTER = 0.55, 3.4  # radii of the disc
AXIS, RATIO = 1.3, 2e-3  # of the planet
SCENE = """
units.system = "code"
run.until = 9.0
space.size = 9.0
[initial]
kind = "disc"
surface_density = 1e-4
surface_density_index = 1.0
inner = 0.55
outer = 3.4
[star]
mass = 1.6
[gas]
particles = 500
eos = {kind = "locally-isothermal", aspect_ratio = 0.05, temperature_index = 1.0}
"""
PLANET = "[[companion]]\nmass = 3.2e-3\nsemi_major_axis = 1.3\nsoftening = 0.6\n"
DUST = '[dust]\nparticles = 100\nratio = 0.01\n[drag]\nlaw = "stokes-number"\nstokes = 0.2\n'
DAMPING = "[damping]\ninner = [0.55, 0.8]\nouter = [2.7, 3.4]\n"


def even(count):
    """Sigma ~ 1/r on a spiral of golden angles: equal mass in equal steps of radius."""
    r = INNER + (OUTER - INNER) * (np.arange(count) + 0.5) / count
    phi = np.arange(count) * np.pi * (3 - np.sqrt(5))
    return np.stack([r * np.cos(phi), r * np.sin(phi)], axis=1)


def gas_of(pos, mass):
    one = np.ones(len(pos))
    state = {"h": one, "density": one, "gradh": one, "pressure": one, "sound_speed": one}
    return Gas(pos=pos, vel=0.1 * pos, acc=0 * pos, mass=mass * one, ids=np.arange(len(pos)), **state)


def dust_of(pos, mass):
    count = len(pos)
    return Dust(
        pos=pos, vel=-0.1 * pos, acc=0 * pos, mass=np.full(count, mass), ids=np.arange(count),
        species=np.zeros(count, int),
    )  # fmt: skip


def bodies_of(star, orbits, shift=(0.0, 0.0)):
    """A star at `shift` and companions, given as (mass, semi-major axis, e, true anomaly, longitude of pericentre)."""
    bodies = Bodies.at_rest(np.array([star, *(each[0] for each in orbits)]))
    for k, (mass, size, e, anomaly, turn) in enumerate(orbits, 1):
        x, y, vx, vy = kepler.motion_at_anomaly(star + mass, size, e, anomaly)
        rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        bodies.pos[k], bodies.vel[k] = rotation @ (x, y), rotation @ (vx, vy)
    bodies.pos += shift
    return bodies


def write(path, text, time, gas, dust=None, bodies=None):
    """Write a snapshot of a scene, given as TOML."""
    scene_file = path.parent / f"{path.stem}.toml"
    path.parent.mkdir(parents=True, exist_ok=True)
    scene_file.write_text(text)
    write_snapshot(path, load_scene(scene_file), time, gas, dust, None, bodies)
    scene_file.unlink()
    return path


def write_gap_run(directory, depth=0.2, width=0.2, count=40_000, angle=2.1, text=SCENE + PLANET + DAMPING + DUST):
    """A run whose gas falls by t = 5 to the fraction 1 - (1 - depth) exp(-(r - a)^2 / 2 width^2) of its start.

    The planet is on a circle; at the end it has a heavy disc of its own, within a Hill radius.
    """
    pos = even(count)
    r = np.hypot(*pos.T)
    for k, time in enumerate((0.0, 5.0)):
        gas = gas_of(pos, 1e-3 / count)
        bodies = bodies_of(1.6, [(1.6 * RATIO, AXIS, 0.0, angle * k, 0.0)])
        if k == 1:
            gas.mass *= 1.0 - (1.0 - depth) * np.exp(-((r - AXIS) ** 2) / (2.0 * width**2))
            gas.mass[np.hypot(*(pos - bodies.pos[1]).T) < AXIS * (RATIO / 3) ** (1 / 3)] *= 30.0
        write(directory / "snapshots" / f"{k:04}.h5", text, time, gas, dust_of(pos[::40], 1e-6), bodies)
    return directory
