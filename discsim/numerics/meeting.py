"""Neighbour lists between gas and grains, for sums over gas at each grain and over grains at each gas particle.

A grain is a neighbour of the gas particles whose support contains it, and they are its neighbours. With several
processes, `Meeting.gas` and `Meeting.grains` extend arrays of local particles by ghosts (`world.Fetched`). Sums are
complete at local particles only: if a later sum reads the result of an earlier one, ghosts have to be refreshed first.
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
IN_A_CELL = 8.0  # mean number of grains in a cell of grains


@dataclass
class Grains:
    """Grains at positions pos (n, d); place (n,): their keys in the global order (`Particles`)."""

    pos: Array
    global_index: Array | None

    @property
    def count(self) -> int:
        return len(self.pos)


class Surroundings:
    """The present gas, sorted into cells for neighbour search by grains."""

    def __init__(self, sph: Sph, gas: Gas) -> None:
        self.sph, self.gas = sph, gas
        self.grids, self.classes = sph.grids_of(gas)

    @cached_property
    def cells(self) -> Cells:
        """Cells of the local gas."""
        return cells_in(self.grids, self.classes, self.gas.pos, self.gas.h)

    def meet(self, pos: Array, global_index: Array | None) -> Meeting:
        """Return the neighbour lists with grains at positions pos (n, d)."""
        return Meeting(self, Grains(pos, global_index))


class Meeting:
    """Neighbours between gas and grains.

    gas, grains: `world.Fetched` of each, which extends local arrays by ghosts. pos, h, grain_pos: arrays with ghosts.
    cells, grain_cells: cells with ghosts; `filled` lists those with local particles.
    """

    def __init__(self, gas: Surroundings, grains: Grains) -> None:
        grids, classes = _grids_of(gas.sph, grains)
        gas_grids, flat, gas_key, key = gas.grids, gas.sph.dim == 1, NONE, NONE
        if world.processes.many:
            about = _about((gas_grids, gas.classes, gas.gas.pos), (grids, classes, grains.pos))
            widest = np.full(len(grids.table), gas_grids.table[:, REACH].max())
            grids, gas_grids = grids.near(*about, widest), gas_grids.near(*about, gas_grids.table[:, REACH])
            gas_key, key = keys_in(gas_grids, gas.classes, gas.gas.pos), keys_in(grids, classes, grains.pos)
        of_gas, of_grains = (gas_grids, gas_key), (grids, key)
        self.gas = world.processes.in_cells(gas.gas, gas_key, lambda: _needed(*of_gas, *of_grains, halo.THEIRS, flat))
        self.grains = world.processes.in_cells(grains, key, lambda: _needed(*of_grains, *of_gas, halo.OWN, flat))
        self.pos, self.h = self.gas.of(gas.gas.pos), self.gas.of(gas.gas.h)
        self.grain_pos = self.grains.of(grains.pos)
        side = np.full(len(self.grain_pos), grids.table[0, REACH])
        self.grain_cells = cells_in(grids, self.grains.of(classes), self.grain_pos, side, self.grains.global_index)
        if not world.processes.many:
            self.cells = gas.cells
            return
        cells = cells_in(gas_grids, self.gas.of(gas.classes), self.pos, self.h, self.gas.global_index)
        self.cells = cells._replace(filled=_filled(gas_key))
        self.grain_cells = self.grain_cells._replace(filled=_filled(key))

    @cached_property
    def grains_about(self) -> list[Any]:
        """Candidate grains of each cell of gas, a list for each chunk of `share`."""
        return candidates(self.cells, self.grain_cells, mutual=False)

    @cached_property
    def gas_about(self) -> list[Any]:
        """Candidate gas of each cell of grains, a list for each chunk of `share`."""
        return candidates(self.grain_cells, self.cells, mutual=True, extent=0.0)


def _grids_of(sph: Sph, grains: Grains) -> tuple[Grids, Array]:
    low, width = (np.zeros(2), sph.size) if sph.periodic else box_about(grains.pos, world.processes)
    sides = width[width > 1e-300]
    count = int(world.processes.sum(grains.count))
    side = (IN_A_CELL * np.prod(sides) / count) ** (1.0 / max(1, len(sides)))
    return grids_of(grains.pos, np.full(grains.count, side), 1.0, low, width, sph.periodic, world.processes)


def _about(*some: tuple[Grids, Array, Array]) -> tuple[Array, Array]:
    """Return the least and largest coordinates (2,) of the cells of several sets of particles."""
    found = [corners_of_cells(*each) for each in some if len(each[2]) > 0] or [corners(some[0][2])]
    return np.min([low for low, _ in found], axis=0), np.max([high for _, high in found], axis=0)


def _filled(key: Array) -> Array:
    return np.flatnonzero(np.bincount(key))


def _needed(grids: Grids, key: Array, others: Grids, other_key: Array, reach_of: int, flat: bool) -> world.Needed:
    """Return the cells of `grids` whose particles are needed here, with their numbers on the whole grids.

    They are the cells of local particles, with cell numbers `key` (m,), and all cells within reach of the cells
    `other_key` (n,) of the other species. reach_of: halo.OWN or halo.THEIRS, the species whose reach counts.
    """
    away, periodic = grids.low - others.low, grids.periodic
    needed = halo.mark_cells(_filled(other_key), others.table, away, grids.table, reach_of, 1.0, flat, periodic)
    needed[key] = True
    numbers = grids.numbers()
    return world.Needed(needed, numbers, numbers + 1)
