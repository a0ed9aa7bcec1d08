"""Self-gravity: a = -grad phi, phi(x) = -G int Sigma(x') / sqrt(|x - x'|^2 + softening^2) d^2x'.

Particle mesh (Hockney & Eastwood 1988, ch. 5): deposit, potential by FFT, centred difference of fourth order,
gather with the deposit's weights. A particle off an open grid attracts nothing, and feels the mass on the
grid as one softened point.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numba
import numpy as np

from discsim.effects import base
from discsim.grid import Grid
from discsim.kernels.grid import largest_norm
from discsim.poisson import Poisson
from discsim.state import Particles, State

if TYPE_CHECKING:
    from discsim.scene import Scene

Array = np.ndarray


class Effect(base.Effect):
    """Adds the attraction of the species in `self_gravity.sources` to every species.

    Raises ValueError for open boundaries in one dimension or with fewer than five cells a side. `outside`
    is how many particles were off the grid when forces were last made.
    """

    name = "self_gravity"
    shared = True

    def __init__(self, scene: Scene, state: State) -> None:
        assert scene.self_gravity is not None and state.grid is not None
        self.grid = grid = state.grid
        self.sources = [name for name in state.species if name in scene.self_gravity.sources]
        self.softening = scene.self_gravity.softening
        threads = numba.get_num_threads()
        self.poisson = Poisson(grid.shape, grid.cell, self.softening, grid.periodic, threads)
        self.outside = 0
        self._field: _Field | None = None
        self._strongest: dict[str, float] = {}

    def accelerate(self, state: State) -> None:
        self._field = field = self._make_field(state)
        gradient = self.grid.gradient(field.potential)
        self.outside = 0
        for name, particles in state.species.items():
            acceleration = -self.grid.gather(gradient, particles.pos)
            outside = self.grid.outside(particles.pos)
            acceleration[outside] = field.monopole.acceleration(particles.pos[outside])
            self.outside += outside.size
            self._strongest[name] = largest_norm(acceleration)
            particles.acc += acceleration

    def limit(self, state: State) -> float:
        """The least sqrt(softening / |a|) of the limiting particles."""
        limiting = {id(particles) for particles in state.limiting}
        strongest = [a for name, a in self._strongest.items() if id(state.species[name]) in limiting]
        largest = max(strongest, default=0.0)
        return float(np.sqrt(self.softening / largest)) if largest > 0 else float("inf")

    def potential_energy(self, state: State) -> float:
        """Half the sum of m phi over the sources, in the potential that last made forces."""
        field = self._field or self._make_field(state)
        return 0.5 * sum(self._energy(state.species[name], field) for name in self.sources)

    def _energy(self, particles: Particles, field: _Field) -> float:
        potential = self.grid.gather(field.potential, particles.pos)
        outside = self.grid.outside(particles.pos)
        potential[outside] = field.monopole.potential(particles.pos[outside])
        return float((particles.mass * potential).sum())

    def _make_field(self, state: State) -> _Field:
        surface_density = np.zeros(self.grid.shape)
        for name in self.sources:
            particles = state.species[name]
            self.grid.deposit(particles.pos, particles.mass, out=surface_density)
        monopole = _monopole(self.grid, surface_density, self.softening)
        return _Field(self.poisson.solve(surface_density), monopole)


class _Monopole(NamedTuple):
    """The mass on the grid as one softened point at its centre."""

    mass: float
    centre: Array
    softening: float

    def potential(self, pos: Array) -> Array:
        return -self.mass / np.sqrt(self._squared_distance(pos))

    def acceleration(self, pos: Array) -> Array:
        return -self.mass * self._separation(pos) / self._squared_distance(pos)[:, None] ** 1.5

    def _separation(self, pos: Array) -> Array:
        return pos - self.centre[: pos.shape[1]]

    def _squared_distance(self, pos: Array) -> Array:
        return (self._separation(pos) ** 2).sum(axis=1) + self.softening**2


class _Field(NamedTuple):
    potential: Array
    monopole: _Monopole


def _monopole(grid: Grid, surface_density: Array, softening: float) -> _Monopole:
    # Cloud in cell keeps the mass and its first moments, so the grid gives those of the deposited particles.
    along = (surface_density.sum(axis=1), surface_density.sum(axis=0))
    total = float(along[0].sum())
    if total == 0.0:
        return _Monopole(0.0, np.zeros(2), softening)
    centre = np.array([(along[axis] * grid.nodes(axis)).sum() / total for axis in (0, 1)])
    return _Monopole(total * grid.cell**2, centre, softening)
