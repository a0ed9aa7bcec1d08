"""What the processes of a run know together. A run is one process, for which all this is nothing at all, unless
`discsim/ranks` has joined several.

Least, largest and sums of whole numbers are exact, and so the same however particles are divided among the processes;
sums of other numbers go through `numerics/totals.py`. Each process has to ask, in the same order.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from discsim.numerics.state import State

Array = np.ndarray


class Alone:
    """One process."""

    many = False
    balance = 1.0  # how much the most loaded process has to do, over the mean

    def least(self, values: Any) -> Any:
        """The least of each of `values`, a number or an array."""
        return values

    def most(self, values: Any) -> Any:
        """The largest of each."""
        return values

    def sum(self, values: Any) -> Any:
        """The sum of each, of whole numbers."""
        return values

    def settle(self, state: State) -> None:
        """Bring particles to the processes that they belong to, once they have moved."""

    def close_up(self, place: Array, gone: Array) -> Array:
        """Without the particles of the mask `gone` (n,), let the last ones of all processes take their places, as
        `Particles.remove` does; the order (kept,) of those that stay. `place` (n,) becomes what it is then.
        """
        raise NotImplementedError("one process has no places")

    def sample(self, columns: Array, place: Array | None, some: Array) -> Array:
        """Rows (m, columns) of the particles `some` of `place`, of all processes, in the order of all."""
        return columns


together: Any = Alone()


def join(world: Any) -> None:
    """Let `world` answer from now on."""
    global together
    together = world
