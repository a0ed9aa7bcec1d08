"""What a kick knows of the particles of all processes. One process has them all; for ranks see `ranks/drag.py`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from discsim.drag.cells import Lattice

Array = np.ndarray


class Known:
    """own_grains: where the process's own ones are in the dust that a kick is given."""

    own_grains: Any = slice(None)

    def __call__(self, name: str, find: Callable[[], Any]) -> Any:
        """What `find` finds, by asking all processes; a kick has it under one `name`."""
        return find()

    def own_blocks(self, count: int) -> int:
        """How many of the blocks of a kick, the first ones of `count`, hold any of the process's own particles."""
        return count

    def part_of(self, lattice: Lattice, shift: Array, species: Sequence[Any]) -> Lattice:
        """The part of a lattice that the process has; `shift` (2,) of it in leaves."""
        return lattice

    def leaves(self, name: str, pos: Array, find: Callable[[Array], Array]) -> Array:
        """What `find` makes of places (n, d), the leaf of each; a kick has that of a species under one `name`."""
        return find(pos)

    def summed(self, lattice: Lattice, *held: Array) -> Sequence[Array]:
        """What all processes have in the leaves of a part, of what own particles make there (leaves + 1,), in whole
        numbers.
        """
        return held
