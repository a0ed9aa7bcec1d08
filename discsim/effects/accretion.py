"""What star and companions take: the mass and the momentum of particles, at the barycentre of both."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from discsim.numerics.state import State

SPECIES = ("gas", "dust")


def swallow(state: State, number: int, name: str, gone: np.ndarray, grows: bool, moves: bool) -> None:
    """Let the body `number` take the particles `gone` (their numbers) of a species; they are still to be removed.

    grows: whether their mass becomes its own, moves: and their momentum, at the barycentre of both. One-way dust beside
    gas is counted and does neither, as the gas would notice.
    """
    bodies, particles = state.bodies, state.species[name]
    assert bodies is not None
    mass = particles.mass[gone]
    taken = float(mass.sum())
    bodies.accreted[number, SPECIES.index(name)] += taken
    if not grows or (name == "dust" and state.unnoticed):
        return
    total = bodies.mass[number] + taken
    if moves:
        for own, theirs in ((bodies.pos, particles.pos[gone]), (bodies.vel, particles.vel[gone])):
            own[number] += (mass[:, None] * (theirs - own[number])).sum(axis=0) / total
    bodies.gained[number] += taken
    bodies.mass[number] = total
