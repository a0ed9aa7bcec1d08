"""Collective quantities of a kick, the same on all processes, in serial runs; for MPI ranks see `ranks/drag.py`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from discsim.drag.cells import Lattice

Array = np.ndarray


class Known:
    """Collective quantities of a serial run: local values are those of all.

    own_grains: index of the local grains in the dust of a kick.
    """

    own_grains: Any = slice(None)

    def __call__(self, name: str, find: Callable[[], Any]) -> Any:
        """Return `find()`, which may be collective. On several processes a kick computes it once per `name`."""
        return find()

    def own_blocks(self, count: int) -> int:
        """Return how many of the `count` blocks of a kick have local particles. They are the first ones."""
        return count

    def part_of(self, lattice: Lattice, shift: Array, species: Sequence[Any]) -> Lattice:
        """Return the part of a lattice that this process has; `shift` (2,) is in leaves."""
        return lattice

    def leaves(self, name: str, pos: Array, find: Callable[[Array], Array]) -> Array:
        """Return `find(pos)`, the leaf of each position (n, d). On several processes a kick keeps it under `name`."""
        return find(pos)

    def summed(self, lattice: Lattice, *held: Array) -> Sequence[Array]:
        """Return the sums over all processes in the leaves of a part, from local sums (leaves + 1,) of integers."""
        return held
