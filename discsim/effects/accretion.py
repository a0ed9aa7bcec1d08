"""Accretion of particles by a body, the star or a companion: the body gains their mass and momentum, and moves to the
common barycentre.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from discsim.numerics.totals import total, totals
from discsim.parts import Lazy

if TYPE_CHECKING:
    from discsim.numerics.state import State

SPECIES = ("gas", "dust")
growth = Lazy("discsim.physics.growth")


class Accreted(NamedTuple):
    """Masses of accreted particles of one species.

    mass: sum of the particle masses. small: mass of the small dust in accreted gas. own: `mass` without small dust.
    With two-way drag `mass` includes `small`; with one-way drag it does not, and `own` equals `mass`.
    """

    mass: float
    own: float
    small: float


def accreted_from(state: State, name: str, gone: np.ndarray) -> Accreted:
    """Return the accreted masses of the particles of species `name` with the indices `gone` (k,)."""
    particles = state.species[name]
    mass, small = total(particles.mass[gone]), 0.0
    if state.gas is not None and state.gas.small is not None and name == "gas":
        small = total(state.gas.small[gone])
        if growth.small_dust_in_mass(state.scene):
            return Accreted(mass, total(particles.mass[gone] - state.gas.small[gone]), small)
    return Accreted(mass, mass, small)


def accrete(state: State, number: int, name: str, gone: np.ndarray, taken: Accreted, grows: bool, moves: bool) -> None:
    """Add accreted particles to a body. The caller removes them from the species.

    number: index of the body, 0 for the star. name: species of the particles. gone: their indices. taken: their
    masses, from `accreted_from`. grows: whether the body gains their mass. moves: whether a growing body also gains
    their momentum and moves to the common barycentre. With one-way drag by gas particles, dust is only counted, as a
    heavier body would change the motion of the gas.
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
