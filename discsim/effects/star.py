"""A fixed star at the origin: a = -G M r / (r^2 + s^2)^(3/2), s its softening; optional accretion radius.

What comes within the accretion radius is removed at the end of the step; its mass, momentum and angular momentum go
to the ledger. Step limit: 1/Omega = sqrt((r^2 + s^2)^(3/2) / (G M)) of the innermost particle.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from discsim.effects import base
from discsim.numerics.state import Particles, State
from discsim.numerics.threads import share
from discsim.parts import Lazy
from discsim.scene.fields import Length, Mass, Table
from discsim.scene.rules import Draft, Problem

if TYPE_CHECKING:
    from discsim.scene import Scene

kernels = Lazy("discsim.kernels.star")

PULL = 6.0  # CPU nanoseconds of a particle in a step


class Keys(Table):
    mass: Mass = Field(gt=0, description="fixed at the origin")
    accretion_radius: Length = Field(0.0, ge=0, description="what comes closer is removed and accounted for")
    softening: Length = Field(0.0, ge=0, description="Plummer length")


def _at_the_centre(draft: Draft) -> Iterator[Problem]:
    if draft.dimensions == 1:
        yield ("star",), "a star needs two dimensions, but space.dimensions is 1"
    elif draft.space and draft.space.boundary == "periodic" and not (draft.start and draft.start.edges):
        yield ("star",), "a periodic space has no centre, and the star's images would pull; expected open boundaries"


class Effect(base.Effect):
    keys = Keys
    rules = (_at_the_centre,)
    shared = marks_centre = True
    softer = "a larger star.accretion_radius or star.softening"

    def __init__(self, scene: Scene, state: State) -> None:
        self.star = scene.star
        self._nearest: dict[str, float] = {}  # squared distances that an event has found for the limit after it

    @classmethod
    def nanoseconds(cls, scene: Scene, counts: base.Counts) -> float:
        return PULL * (counts.gas + counts.dust)

    def accelerate(self, state: State) -> None:
        for particles in state.species.values():
            share(kernels.attract, particles.count, particles.pos, particles.acc, self.star.mass, self.star.softening)

    def limit(self, state: State) -> float:
        limiting = {id(particles) for particles in state.limiting}
        return min(self.limit_of(state, name) for name, p in state.species.items() if id(p) in limiting)

    def limit_of(self, state: State, name: str) -> float:
        p = state.species[name]
        distance2 = self._nearest.pop(name, None) or min(share(kernels.nearest, p.count, p.pos))
        return ((distance2 + self.star.softening**2) ** 1.5 / self.star.mass) ** 0.5

    def tightest(self, particles: Particles, acc: np.ndarray) -> int:
        return int((particles.pos**2).sum(axis=1).argmin())

    def event(self, state: State) -> None:
        if self.star.accretion_radius > 0.0:
            for name, particles in state.species.items():
                self._accrete(state, name, particles)

    def _accrete(self, state: State, name: str, particles: Particles) -> None:
        squared = self.star.accretion_radius**2
        inside = np.empty(particles.count, bool)
        self._nearest[name] = min(share(kernels.divide, particles.count, particles.pos, squared, inside))
        gone = np.flatnonzero(inside)
        if len(gone) == 0:
            return
        mass, pos, vel = particles.mass[gone], particles.pos[gone], particles.vel[gone]
        ledger = state.ledger
        setattr(ledger, f"accreted_{name}", getattr(ledger, f"accreted_{name}") + float(mass.sum()))
        ledger.accreted_momentum += (mass[:, None] * vel).sum(axis=0)
        spin = mass * (pos[:, 0] * vel[:, 1] - pos[:, 1] * vel[:, 0])
        ledger.accreted_angular_momentum += float(spin.sum())
        particles.remove(inside)

    def potential_energy(self, state: State) -> float:
        total = 0.0
        for p in state.species.values():
            distance = np.sqrt((p.pos**2).sum(axis=1) + self.star.softening**2)
            total -= float((p.mass * self.star.mass / distance).sum())
        return total
