"""The star and its companions as a run holds them: small arrays, the star as entry 0. Data, and its kick."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Self

import numpy as np

Array = np.ndarray
SPECIES = ("gas", "dust")


@dataclass(kw_only=True)
class Bodies:
    """Star and companions in code units, one entry each, the star first; pos, vel (n, 2) in the frame of the run.

    acc (n, 2) is what their kick gives: accelerations but for those that their drift has, Kepler's motion about the
    star. pulled (n, 2, 2): accelerations by gas and by dust, of whoever feels them or not; accreted (n, 2): masses of
    gas and dust taken so far; gained (n,): what of them is part of `mass`; begun (n,): time at which its ramp and its
    fixed orbit began, below 0 where a run goes on from a snapshot. Gas and dust feel masses `felt` (n,) at pos + shift,
    shift (2,), which differ from mass and pos during a ramp alone (`physics/orbits.py`).
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
        """One of them, for a sentence."""
        return f"companion {number}" if number > 0 else "the star"

    def arrays(self) -> dict[str, Array]:
        return {f.name: getattr(self, f.name) for f in fields(self)}

    def copy(self) -> Self:
        return type(self)(**{name: array.copy() for name, array in self.arrays().items()})

    def kick(self, dt: float) -> None:
        self.vel += dt * self.acc

    @property
    def felt_pos(self) -> Array:
        """Places (n, 2) at which gas and dust feel them."""
        return self.pos + self.shift

    def barycentre(self, chosen: Array) -> tuple[Array, Array]:
        """Place and velocity (2,) of the barycentre of the bodies `chosen` (n,)."""
        share = self.mass * chosen / self.mass[chosen].sum()
        return share @ self.pos, share @ self.vel
