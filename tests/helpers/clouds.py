"""Clouds of mass under self-gravity, with their exact fields."""

from types import SimpleNamespace

import numpy as np

from discsim.effects.self_gravity import Effect
from discsim.numerics.grid import Grid
from discsim.numerics.operators import accelerate
from discsim.numerics.state import Particles, State


def cloud(pos, mass, dimensions=2):
    pos = np.ascontiguousarray(pos, dtype=float)
    zeros = np.zeros((len(pos), dimensions))
    mass = np.broadcast_to(np.asarray(mass, dtype=float), len(pos)).copy()
    return Particles(pos=pos, vel=zeros, acc=zeros.copy(), mass=mass, ids=np.arange(len(pos)))


def gravity(grid, softening, gas, dust=None, sources=("gas", "dust"), drag=None):
    """The effect and its state, accelerations made."""
    table = SimpleNamespace(kernel="plummer", softening=softening, sources=sources)
    scene = SimpleNamespace(self_gravity=table, drag=drag)
    state = State(scene=scene, gas=gas, dust=dust, grid=grid)
    effect = Effect(scene, state)
    accelerate(effect, state)
    return effect, state


def centred(cells, side):
    return Grid((-side / 2, -side / 2), side / cells, (cells, cells), periodic=False)


def scattered(grid, count, seed):
    """Particles at random, well off the edges of the grid."""
    rng = np.random.default_rng(seed)
    corner, extent = np.array(grid.origin), np.array(grid.shape) * grid.cell
    return cloud(corner + extent * (0.15 + 0.7 * rng.random((count, 2))), rng.random(count) + 0.1)


def maclaurin_disc(count):
    """Equal masses on a golden-angle spiral: the disc's mass within r is 1 - (1 - r^2)^(3/2)."""
    share = (np.arange(count) + 0.5) / count
    radius = np.sqrt(1 - (1 - share) ** (2 / 3))
    angle = np.arange(count) * np.pi * (3 - np.sqrt(5))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
