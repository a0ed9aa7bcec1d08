"""Force given as a Python function, which `Simulation.add_force` adds to a run: a = function(particles, time).

The function has no velocities. A step of the leapfrog kicks velocities over a time centred on the positions, so at the
time of a force they are half a step behind; an acceleration that used them would be first order.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NoReturn

import numpy as np

from discsim.effects import base
from discsim.numerics.entries import EntryError
from discsim.numerics.state import Particles, State, read_only
from discsim.numerics.totals import total
from discsim.parts import EFFECTS
from discsim.printable import printable

GIVEN = ("pos", "mass", "ids", "species", "size")  # arrays of the particles that functions may use

Function = Callable[["GivenParticles", float], Any]


class GivenParticles:
    """Particles of one species, as a function of `Simulation.add_force` gets them.

    Attributes
    ----------
    pos : ndarray, shape (n, dimensions)
        Positions in code units. All arrays are read-only.
    mass : ndarray, shape (n,)
        Masses in code units.
    ids : ndarray, shape (n,)
        Identities, which stay with a particle when arrays are sorted.
    species : ndarray, shape (n,)
        Of dust, the number of the population, from 0.
    size : ndarray, shape (n,)
        Of dust with individual sizes, the radius of the grain in code units.
    """

    def __init__(self, particles: Particles | Any) -> None:
        for name in GIVEN:
            array = getattr(particles, name, None)
            if array is not None:
                setattr(self, name, read_only(array))

    def __getattr__(self, name: str) -> NoReturn:
        remedy = "; for a force that depends on velocities, use discsim.register" if name == "vel" else ""
        raise AttributeError(
            f"particles of a force have no {name} here; expected one of {', '.join(vars(self))}{remedy}"
        )


class AddedForce(base.Effect):
    """Force by a function of the user. function, species, potential, limit: as in `Simulation.add_force`.

    Raises EntryError, a ValueError, for a wrong name, species, function or limit.
    """

    def __init__(
        self, name: str, function: Function, on: str | Iterable[str], potential: Function | None, limit: float | None,
        state: State, effects: Mapping[str, base.Effect],
    ) -> None:  # fmt: skip
        _check_name(name, effects)
        for what, value in (("function", function), ("potential", potential)):
            if not callable(value) and (what == "function" or value is not None):
                raise EntryError(f"{what} is of type {type(value).__name__}; expected a function of (particles, time)")
        if limit is not None and not 0.0 < limit < math.inf:
            raise EntryError(f"limit = {limit:g}; expected a positive time, in code units or a Quantity")
        self.name, self.function, self.potential, self.step_limit = name, function, potential, limit
        self.species = _checked_species(on, state)

    @property
    def description(self) -> str:
        """The name and the species, as text."""
        return f'"{self.name}" on {" and ".join(self.species)}'

    def operators(self, state: State) -> list[base.Operator]:
        reads, acc = (base.arrays(self.species, names) for names in ("pos mass", "acc_unshared"))
        if "dust" in self.species:
            reads |= base.arrays("dust", "species size")
        force = base.Operator(f"{self.name}.push", base.Slot.FORCE, self.accelerate, reads, acc)
        limit = base.Operator(f"{self.name}.limit", base.Slot.LIMIT, self.limit)
        return [force] if self.step_limit is None else [force, limit]

    def accelerate(self, view: base.View) -> None:
        """Add the accelerations that the function returns to `acc_unshared`."""
        for name in self.species:
            particles = view.species[name]
            if particles.count > 0:
                acc = particles.acc_unshared
                acc += self._call(self.function, name, particles, view.time, particles.pos.shape)

    def limit(self, view: base.View) -> dict[str, base.Limit]:
        assert self.step_limit is not None
        return dict.fromkeys(self.species, base.Limit(self.step_limit))

    def potential_energy(self, state: State) -> float:
        energy = 0.0
        for name in self.species if self.potential is not None else ():
            particles = state.species[name]
            if particles.count > 0:
                given = name, particles, state.time, particles.mass.shape
                energy += total(particles.mass * self._call(self.potential, *given))
        return energy

    def _call(self, function: Any, species: str, particles: Any, time: float, shape: tuple[int, ...]) -> np.ndarray:
        """Return the result of a function for one species. Raises EntryError unless it has real numbers of `shape`."""
        found = function(GivenParticles(particles), time)
        try:
            array = np.asarray(found)
        except ValueError:  # rows of several lengths
            array = np.empty(0, object)
        if hasattr(found, "unit") or array.dtype.kind not in "fiu" or array.shape != shape:
            what = f"{type(found).__name__} with numbers of type {array.dtype} and shape {array.shape}"
            what = f"a Quantity in {found.unit}" if hasattr(found, "unit") else what
            which = "function" if function is self.function else "potential"
            raise EntryError(
                f"the {which} of force {self.name} returns {what} for {species}; "
                f"expected an array of real numbers of shape {shape}, in code units"
            )
        return array


def _check_name(name: str, effects: Mapping[str, base.Effect]) -> None:
    """Raise EntryError unless `name` is a word that neither a table of scenes nor another force has."""
    if not isinstance(name, str) or not (name.isidentifier() and name.isascii()):
        raise EntryError(f'name = "{printable(name)}"; expected letters, digits and _, like "wind"')
    if name in EFFECTS or name in effects:
        whose = "a table of scenes" if name in EFFECTS else "another force"
        raise EntryError(f'name = "{name}" is the name of {whose}; expected another name')


def _checked_species(on: str | Iterable[str], state: State) -> tuple[str, ...]:
    """Return the species in `on` in the order of the state. Raises EntryError for none, or one that the run lacks."""
    given = [on] if isinstance(on, str) or not isinstance(on, Iterable) else [*on]
    for name in given:
        if name not in state.species:
            raise EntryError(f'on has "{printable(name)}"; this scene has {" and ".join(state.species)}')
    if not given:
        raise EntryError(f'on has no species; expected one or more of {", ".join(state.species)}, like on=("dust",)')
    return tuple(name for name in state.species if name in given)


def descriptions(effects: Mapping[str, base.Effect]) -> list[str]:
    """Return the descriptions of all added forces, in the order in which they were added."""
    return [effect.description for effect in effects.values() if isinstance(effect, AddedForce)]
