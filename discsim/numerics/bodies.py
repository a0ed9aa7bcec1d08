"""State of the star and its companions in a run: arrays with one entry each, the star first."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Self

import numpy as np

Array = np.ndarray
SPECIES = ("gas", "dust")


@dataclass(kw_only=True)
class Bodies:
    """Star and companions in code units. Arrays have one entry for each body; entry 0 is the star.

    Attributes
    ----------
    mass : ndarray, shape (n,)
        Masses.
    pos, vel : ndarray, shape (n, 2)
        Positions and velocities in the frame of the run.
    acc : ndarray, shape (n, 2)
        Accelerations used in kicks. They exclude the Kepler motion about the star, which is part of the drift.
    pulled : ndarray, shape (n, 2, 2)
        Accelerations by gas ([:, 0]) and by dust ([:, 1]), computed even for a body that does not feel them.
    accreted : ndarray, shape (n, 2)
        Accreted masses of gas ([:, 0]) and dust ([:, 1]).
    gained : ndarray, shape (n,)
        Part of the accreted mass that is included in `mass`.
    begun : ndarray, shape (n,)
        Time at which the ramp of the mass, or the fixed orbit, began. It may be earlier than the start of a run that
        continues from a snapshot.
    felt : ndarray, shape (n,)
        Masses of the bodies in the gravity on gas and dust. They differ from `mass` only during a ramp
        (`physics/orbits.py`).
    shift : ndarray, shape (2,)
        Displacement of all bodies in the gravity on gas and dust; not 0 only during a ramp.
    """

    mass: Array
    pos: Array
    vel: Array
    acc: Array
    pulled: Array
    accreted: Array
    gained: Array
    begun: Array
    felt: Array
    shift: Array

    @classmethod
    def at_rest(cls, mass: Array) -> Self:
        """Return bodies with these masses (n,), at rest at the origin, which have accreted nothing."""
        n = len(mass)
        vectors = {name: np.zeros((n, 2)) for name in ("pos", "vel", "acc", "accreted")}
        numbers = {name: np.zeros(n) for name in ("gained", "begun", "felt")}
        return cls(mass=np.array(mass, float), pulled=np.zeros((n, 2, 2)), shift=np.zeros(2), **numbers, **vectors)

    @property
    def count(self) -> int:
        return len(self.mass)

    def name(self, number: int) -> str:
        """Return the name of body `number` for messages, such as "companion 1"."""
        return f"companion {number}" if number > 0 else "the star"

    def arrays(self) -> dict[str, Array]:
        """Return the arrays by name."""
        return {f.name: getattr(self, f.name) for f in fields(self)}

    def copy(self) -> Self:
        return type(self)(**{name: array.copy() for name, array in self.arrays().items()})

    def kick(self, dt: float) -> None:
        """Advance the velocities over dt by `acc`."""
        self.vel += dt * self.acc

    @property
    def felt_pos(self) -> Array:
        """Positions (n, 2) of the bodies in the gravity on gas and dust."""
        return self.pos + self.shift

    def barycentre(self, chosen: Array) -> tuple[Array, Array]:
        """Return position and velocity, (2,) each, of the barycentre of the bodies in the mask `chosen` (n,)."""
        share = self.mass * chosen / self.mass[chosen].sum()
        return share @ self.pos, share @ self.vel
