"""What star and companions take: the mass and the momentum of particles, at the barycentre of both."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from discsim.numerics.totals import total, totals
from discsim.parts import Lazy

if TYPE_CHECKING:
    from discsim.numerics.state import State

SPECIES = ("gas", "dust")
growth = Lazy("discsim.physics.growth")


class Taken(NamedTuple):
    """Of particles all their mass, what of it is of their species, and small dust that they carry: with two-way drag
    that is the rest, with one-way drag beside it.
    """

    mass: float
    own: float
    small: float


def taken_from(state: State, name: str, gone: np.ndarray) -> Taken:
    """What the particles `gone` (their numbers) of a species have."""
    particles = state.species[name]
    mass, small = total(particles.mass[gone]), 0.0
    if state.gas is not None and state.gas.small is not None and name == "gas":
        small = total(state.gas.small[gone])
        if growth.laden(state.scene):
            return Taken(mass, total(particles.mass[gone] - state.gas.small[gone]), small)
    return Taken(mass, mass, small)


def swallow(state: State, number: int, name: str, gone: np.ndarray, taken: Taken, grows: bool, moves: bool) -> None:
    """Let the body `number` take the particles `gone` of a species, which have `taken`; they are still to be removed.

    grows: whether their mass becomes its own, moves: and their momentum, at the barycentre of both. One-way dust beside
    gas is counted and does neither, as the gas would notice.
    """
    bodies, particles = state.bodies, state.species[name]
    assert bodies is not None
    bodies.accreted[number, SPECIES.index(name)] += taken.own
    if taken.small > 0.0:
        bodies.accreted[number, SPECIES.index("dust")] += taken.small
    if not grows or (name == "dust" and state.unnoticed):
        return
    after = bodies.mass[number] + taken.mass
    if moves:
        for own, theirs in ((bodies.pos, particles.pos[gone]), (bodies.vel, particles.vel[gone])):
            own[number] += totals(particles.mass[gone, None] * (theirs - own[number])) / after
    bodies.gained[number] += taken.mass
    bodies.mass[number] = after
