"""Gas and grains that meet: cells of both, and of each the others about it, for sums of one over the other.

A grain meets the gas particles within whose support it is, and these meet it. Where other processes have some of them,
`Meeting.gas` and `Meeting.grains` make arrays of own particles and those (`world.Fetched`). Sums are right at own
particles: where another one reads what a sum has found, others' entries have to be refreshed before.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.kernels.common.neighbours import REACH, Cells
from discsim.numerics import world
from discsim.numerics.neighbours import (
    Grids,
    box_about,
    candidates,
    cells_in,
    corners,
    corners_of_cells,
    grids_of,
    keys_in,
)
from discsim.parts import Lazy

if TYPE_CHECKING:
    from discsim.numerics.sph import Sph
    from discsim.numerics.state import Gas

halo = Lazy("discsim.kernels.mpi.halo")
Array = np.ndarray
NONE = np.empty(0)
IN_A_CELL = 8.0  # grains that look for gas together


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
        gas_grids, flat, gas_key, key = gas.grids, gas.sph.dim == 1, NONE, NONE
        if world.together.many:
            about = _about((gas_grids, gas.classes, gas.gas.pos), (grids, classes, grains.pos))
            widest = np.full(len(grids.table), gas_grids.table[:, REACH].max())
            grids, gas_grids = grids.near(*about, widest), gas_grids.near(*about, gas_grids.table[:, REACH])
            gas_key, key = keys_in(gas_grids, gas.classes, gas.gas.pos), keys_in(grids, classes, grains.pos)
        of_gas, of_grains = (gas_grids, gas_key), (grids, key)
        self.gas = world.together.in_cells(gas.gas, gas_key, lambda: _needed(*of_gas, *of_grains, halo.THEIRS, flat))
        self.grains = world.together.in_cells(grains, key, lambda: _needed(*of_grains, *of_gas, halo.OWN, flat))
        self.pos, self.h = self.gas.of(gas.gas.pos), self.gas.of(gas.gas.h)
        self.grain_pos = self.grains.of(grains.pos)
        side = np.full(len(self.grain_pos), grids.table[0, REACH])
        self.grain_cells = cells_in(grids, self.grains.of(classes), self.grain_pos, side, self.grains.place)
        if not world.together.many:
            self.cells = gas.cells
            return
        cells = cells_in(gas_grids, self.gas.of(gas.classes), self.pos, self.h, self.gas.place)
        self.cells = cells._replace(filled=_filled(gas_key))
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


def _about(*some: tuple[Grids, Array, Array]) -> tuple[Array, Array]:
    """Least and largest coordinates (2,) of the cells of all particles."""
    found = [corners_of_cells(*each) for each in some if len(each[2]) > 0] or [corners(some[0][2])]
    return np.min([low for low, _ in found], axis=0), np.max([high for _, high in found], axis=0)


def _filled(key: Array) -> Array:
    return np.flatnonzero(np.bincount(key))


def _needed(grids: Grids, key: Array, others: Grids, other_key: Array, reach_of: int, flat: bool) -> world.Needed:
    """The cells of `grids` that own particles are in, or that those of `other_key` (n,) may reach, or be in reach of:
    `reach_of` says whose reach it is.
    """
    away, periodic = grids.low - others.low, grids.periodic
    needed = halo.mark_cells(_filled(other_key), others.table, away, grids.table, reach_of, 1.0, flat, periodic)
    needed[key] = True
    numbers = grids.numbers()
    return world.Needed(needed, numbers, numbers + 1)
