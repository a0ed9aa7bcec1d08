"""State of the star and its companions in a run: small arrays, with the star as entry 0."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Self

import numpy as np

Array = np.ndarray
SPECIES = ("gas", "dust")


@dataclass(kw_only=True)
class Bodies:
    """Star and companions in code units, one entry each, the star first.

    Attributes
    ----------
    mass : ndarray, shape (n,)
        Masses.
    pos, vel : ndarray, shape (n, 2)
        Positions and velocities in the frame of the run.
    acc : ndarray, shape (n, 2)
        Accelerations of the kick, without those of the drift, the Kepler motion about the star.
    pulled : ndarray, shape (n, 2, 2)
        Accelerations by gas and by dust, computed even if a body does not feel them.
    accreted : ndarray, shape (n, 2)
        Accreted masses of gas and dust.
    gained : ndarray, shape (n,)
        Part of the accreted mass that is included in `mass`.
    begun : ndarray, shape (n,)
        Time at which the ramp and the fixed orbit began; below 0 in a run that continues from a snapshot.
    felt : ndarray, shape (n,)
        Masses that gas and dust feel, at pos + shift. They differ from `mass` and `pos` only during a ramp
        (`physics/orbits.py`).
    shift : ndarray, shape (2,)
        Displacement of the felt positions.
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
        n = len(mass)
        vectors = {name: np.zeros((n, 2)) for name in ("pos", "vel", "acc", "accreted")}
        numbers = {name: np.zeros(n) for name in ("gained", "begun", "felt")}
        return cls(mass=np.array(mass, float), pulled=np.zeros((n, 2, 2)), shift=np.zeros(2), **numbers, **vectors)

    @property
    def count(self) -> int:
        return len(self.mass)

    def name(self, number: int) -> str:
        """Return the name of a body for messages."""
        return f"companion {number}" if number > 0 else "the star"

    def arrays(self) -> dict[str, Array]:
        return {f.name: getattr(self, f.name) for f in fields(self)}

    def copy(self) -> Self:
        return type(self)(**{name: array.copy() for name, array in self.arrays().items()})

    def kick(self, dt: float) -> None:
        self.vel += dt * self.acc

    @property
    def felt_pos(self) -> Array:
        """Positions (n, 2) at which gas and dust feel the bodies."""
        return self.pos + self.shift

    def barycentre(self, chosen: Array) -> tuple[Array, Array]:
        """Return position and velocity (2,) of the barycentre of the bodies `chosen`, a mask (n,)."""
        share = self.mass * chosen / self.mass[chosen].sum()
        return share @ self.pos, share @ self.vel
