"""Gas and grains that meet: cells of both, and of each the others about it, for sums of one over the other.

A grain meets the gas particles within whose support it is, and these meet it. Where other processes have some of them,
`Meeting.gas` and `Meeting.grains` make arrays of own particles and those (`world.Whole`). Sums are right at own
particles: where another one reads what a sum has found, others' entries have to be refreshed before.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.kernels.neighbours import REACH, Cells
from discsim.numerics import world
from discsim.numerics.neighbours import Grids, box_about, candidates, cells_in, grids_of, keys_in
from discsim.numerics.threads import share
from discsim.parts import Lazy

if TYPE_CHECKING:
    from discsim.numerics.sph import Sph
    from discsim.numerics.state import Gas

halo = Lazy("discsim.kernels.halo")
Array = np.ndarray
IN_A_CELL = 16.0  # grains that look for gas together


@dataclass
class Grains:
    """Grains at places pos (n, d), with their `place` in the order of all (`Particles`)."""

    pos: Array
    place: Array | None

    @property
    def count(self) -> int:
        return len(self.pos)


class Surroundings:
    """The gas as it is now, which grains at places meet."""

    def __init__(self, sph: Sph, gas: Gas) -> None:
        self.sph, self.gas = sph, gas
        self.grids, self.classes = sph.grids_of(gas)
        self.key = keys_in(self.grids, self.classes, gas.pos)

    @cached_property
    def cells(self) -> Cells:
        """Cells of own gas."""
        return cells_in(self.grids, self.classes, self.gas.pos, self.gas.h)

    def meet(self, pos: Array, place: Array | None) -> Meeting:
        """The meeting with grains at pos (n, d)."""
        return Meeting(self, Grains(pos, place))


class Meeting:
    """Of gas and grains.

    gas, grains: what makes arrays of own ones and others that these meet. pos, h, grain_pos: those of both. cells,
    grain_cells: cells of both, `filled` where they hold own ones.
    """

    def __init__(self, gas: Surroundings, grains: Grains) -> None:
        grids, classes = _grids_of(gas.sph, grains)
        key = keys_in(grids, classes, grains.pos)
        flat = gas.sph.dim == 1
        of_gas, of_grains = (gas.grids, gas.key), (grids, key)
        self.gas = world.together.in_cells(gas.gas, gas.key, lambda: _needed(*of_gas, *of_grains, False, flat))
        self.grains = world.together.in_cells(grains, key, lambda: _needed(*of_grains, *of_gas, True, flat))
        self.pos, self.h = self.gas.of(gas.gas.pos), self.gas.of(gas.gas.h)
        self.grain_pos = self.grains.of(grains.pos)
        side = np.full(len(self.grain_pos), grids.table[0, REACH])
        self.grain_cells = cells_in(grids, self.grains.of(classes), self.grain_pos, side)
        if not world.together.many:
            self.cells = gas.cells
            return
        cells = cells_in(gas.grids, self.gas.of(gas.classes), self.pos, self.h)
        self.cells = cells._replace(filled=_filled(gas.key))
        self.grain_cells = self.grain_cells._replace(filled=_filled(key))

    @cached_property
    def grains_about(self) -> list[Any]:
        """The grains about each cell of gas, by the pieces of `share`."""
        return candidates(self.cells, self.grain_cells, mutual=False)

    @cached_property
    def gas_about(self) -> list[Any]:
        """The gas about each cell of grains."""
        return candidates(self.grain_cells, self.cells, mutual=True, extent=0.0)


def _grids_of(sph: Sph, grains: Grains) -> tuple[Grids, Array]:
    low, width = (np.zeros(2), sph.size) if sph.periodic else box_about(grains.pos, world.together)
    sides = width[width > 1e-300]
    count = int(world.together.sum(grains.count))
    side = (IN_A_CELL * np.prod(sides) / count) ** (1.0 / max(1, len(sides)))
    return grids_of(grains.pos, np.full(grains.count, side), 1.0, low, width, sph.periodic, world.together)


def _filled(key: Array) -> Array:
    return np.unique(key).astype(np.int64)  # as those of one process are: kernels are compiled for one kind


def _needed(grids: Grids, key: Array, others: Grids, other_key: Array, by_others: bool, flat: bool) -> Array:
    """The cells (cells,) of `grids` that own particles are in, or that those of `other_key` (n,) may reach, or be in
    reach of: `by_others` it is their own reach that counts.
    """
    needed, about = np.zeros(grids.cells, bool), _filled(other_key)
    share(
        halo.mark_others, len(about), about, others.table, grids.low - others.low, grids.table, by_others,
        flat, grids.periodic, needed,
    )  # fmt: skip
    needed[key] = True
    return needed
