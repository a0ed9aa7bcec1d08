"""Accretion of particles by a body, the star or a companion: the body gains their mass and momentum, and moves to the
common barycentre.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from discsim.numerics.bodies import SPECIES
from discsim.numerics.totals import total, totals
from discsim.parts import Lazy

if TYPE_CHECKING:
    from discsim.numerics.state import State

growth = Lazy("discsim.physics.growth")


class Accreted(NamedTuple):
    """Masses of accreted particles of one species.

    mass: sum of the particle masses. own: `mass` without small dust. small: mass of the small dust that accreted gas
    carries. With two-way drag `mass` includes `small`; with one-way drag it does not, and `own` equals `mass`.
    """

    mass: float
    own: float
    small: float


def accreted_masses(state: State, name: str, gone: np.ndarray) -> Accreted:
    """Return the masses of accreted particles of species `name`, which have the indices `gone` (k,)."""
    particles = state.species[name]
    mass, small = total(particles.mass[gone]), 0.0
    if name == "gas" and state.gas.small is not None:
        small = total(state.gas.small[gone])
        if growth.gas_mass_includes_small_dust(state.scene):
            return Accreted(mass, total(particles.mass[gone] - state.gas.small[gone]), small)
    return Accreted(mass, mass, small)


def accrete(state: State, number: int, name: str, gone: np.ndarray, masses: Accreted, grows: bool, moves: bool) -> None:
    """Add accreted particles to a body in `state.bodies`. The caller removes them from the species.

    number: index of the body, 0 for the star. name: species of the particles. gone (k,): indices of the particles.
    masses: result of `accreted_masses` for them. grows: whether the body gains their mass. moves: whether a growing
    body also gains their momentum and moves to the common barycentre. With one-way drag, accreted dust is recorded but
    does not change the body, as a heavier body would change the motion of the gas.
    """
    particles = state.species[name]
    taken = particles.mass[gone], particles.pos[gone], particles.vel[gone]
    add_to_body(state, number, name, taken, masses, grows and not (name == "dust" and state.dust_is_passive), moves)


def add_to_body(
    state: State, number: int, name: str, taken: tuple[np.ndarray, ...], masses: Accreted, grows: bool, moves: bool
) -> None:
    """Add accreted matter to a body in `state.bodies`.

    taken: masses (k,), positions (k, 2) and velocities (k, 2) of the matter. Other parameters are those of `accrete`.
    """
    bodies = state.bodies
    bodies.accreted[number, SPECIES.index(name)] += masses.own
    if masses.small > 0.0:
        bodies.accreted[number, SPECIES.index("dust")] += masses.small
    if not grows:
        return
    after = bodies.mass[number] + masses.mass
    if moves:
        mass, *theirs = taken
        for own, other in zip((bodies.pos, bodies.vel), theirs, strict=True):
            own[number] += totals(mass[:, None] * (other - own[number])) / after
    bodies.gained[number] += masses.mass
    bodies.mass[number] = after
