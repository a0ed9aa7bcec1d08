"""What an effect may do in a step; each overrides what it needs.

A force adds to `acc` and moves nothing. The drag *is* the kick: it turns accelerations into velocities together
with the relaxation. An event runs once the particles have moved. Each may limit the step.
"""

import numpy as np

from discsim.numerics.state import Particles, State
from discsim.numerics.threads import share
from discsim.parts import Lazy
from discsim.scene.fields import Table
from discsim.scene.rules import Rule

moves = Lazy("discsim.kernels.move")

# Steps between reorderings of a species' arrays. A particle's place in memory decides the order of sums, so that
# reordering must depend on the number of the step alone.
SORT_EVERY = 16


class Effect:
    """Base of the effects: does nothing and limits nothing."""

    name: str
    keys: type[Table]  # of its table in a scene
    several = False  # whether the table may be a list of them
    rules: tuple[Rule, ...] = ()  # what the table demands of the others
    # Whom it accelerates: the relaxation of drag has to know what acts on one species alone.
    acts_on: tuple[str, ...] = ("gas", "dust")
    # Whether gas and dust at one place get the same acceleration from it: then it leaves their slip alone.
    shared = False
    softer = ""  # what to change so that `limit_of` is longer

    def accelerate(self, state: State) -> None:
        """Add this effect's accelerations to `acc` (and rates to `heating_rate`)."""

    def limit(self, state: State) -> float:
        """The longest step this effect allows, before the Courant factor, in code units."""
        return float("inf")

    def limit_of(self, state: State, name: str) -> float:
        """The longest step in which the species `name` keeps its orbits in this effect's field."""
        return float("inf")

    def tightest(self, particles: Particles, acc: np.ndarray) -> int:
        """Which of the particles sets `limit_of`, from what this effect gives them."""
        return int((acc**2).sum(axis=1).argmax())

    def kick(self, state: State, dt: float) -> None:
        """Turn accelerations into velocities over dt (the species' own kick, where no drag is solved with it)."""

    def move(self, state: State, dt: float) -> None:
        """Move the effect's particles over dt."""

    def event(self, state: State) -> None:
        """Act on the particles after they have moved."""

    def potential_energy(self, state: State) -> float:
        """The potential energy that this effect holds, in code units."""
        return 0.0


def drift(scene, particles: Particles, dt: float) -> None:
    """Move at constant velocity over dt; immobile particles stay."""
    if particles.immobile is None:
        share(moves.add_scaled, particles.count, particles.pos, particles.vel, dt)
    else:
        free = ~particles.immobile
        particles.pos[free] += dt * particles.vel[free]
    if scene.space.boundary == "periodic":
        share(moves.wrap, particles.count, particles.pos, np.array(scene.space.size))
