"""Neighbour lists between gas and dust grains, for sums over gas at each grain and over grains at each gas particle.

A grain and a gas particle are neighbours if the grain is within the support of the gas particle. With several
processes, arrays of local particles are combined with ghosts. Sums are then complete at local particles only. If a
later sum reads the result of an earlier one, call `refresh` first, which updates its ghost entries.
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
NO_ENTRIES = np.empty(0)
GRAINS_PER_CELL = 8.0  # mean number of grains in a cell of grains


@dataclass
class Grains:
    """Grains: positions pos (n, d), and global_index (n,), their keys in the order of all processes, or None."""

    pos: Array
    global_index: Array | None

    @property
    def count(self) -> int:
        return len(self.pos)


class GasCells:
    """Gas sorted into cells, in which neighbours of grains are searched; sph: its SPH sums."""

    def __init__(self, sph: Sph, gas: Gas) -> None:
        self.sph, self.gas = sph, gas
        self.grids, self.classes = sph.grids_of(gas)

    @cached_property
    def cells(self) -> Cells:
        """Cells of the local gas."""
        return cells_in(self.grids, self.classes, self.gas.pos, self.gas.h)

    def neighbours_of(self, pos: Array, global_index: Array | None) -> GasDustNeighbours:
        """Return the neighbour lists between this gas and grains at positions pos (n, d).

        global_index (n,): keys of the grains in the order of all processes; None on one process.
        """
        return GasDustNeighbours(self, Grains(pos, global_index))


class GasDustNeighbours:
    """Neighbour lists between gas and grains.

    gas, grains: `world.ParticlesWithGhosts` of each. pos, h: positions and smoothing lengths of the gas, ghosts
    included. grain_pos: positions of the grains, ghosts included.
    cells, grain_cells: cells of gas and of grains, ghosts included; `filled` lists the cells with local particles.
    """

    def __init__(self, gas: GasCells, grains: Grains) -> None:
        grids, classes = _grids_of(gas.sph, grains)
        gas_grids, flat, gas_key, key = gas.grids, gas.sph.dim == 1, NO_ENTRIES, NO_ENTRIES
        if world.processes.is_parallel:
            box = _box_of_cells((gas_grids, gas.classes, gas.gas.pos), (grids, classes, grains.pos))
            widest = np.full(len(grids.table), gas_grids.table[:, REACH].max())
            grids, gas_grids = grids.near(*box, widest), gas_grids.near(*box, gas_grids.table[:, REACH])
            gas_key, key = keys_in(gas_grids, gas.classes, gas.gas.pos), keys_in(grids, classes, grains.pos)
        of_gas, of_grains = (gas_grids, gas_key), (grids, key)
        combine = world.processes.fetch_ghosts
        self.gas = combine(gas.gas, gas_key, lambda: _needed_cells(*of_gas, *of_grains, halo.THEIRS, flat))
        self.grains = combine(grains, key, lambda: _needed_cells(*of_grains, *of_gas, halo.OWN, flat))
        self.pos, self.h = self.gas.with_ghosts(gas.gas.pos), self.gas.with_ghosts(gas.gas.h)
        self.grain_pos = self.grains.with_ghosts(grains.pos)
        side = np.full(len(self.grain_pos), grids.table[0, REACH])
        self.grain_cells = cells_in(
            grids, self.grains.with_ghosts(classes), self.grain_pos, side, self.grains.global_index
        )
        if not world.processes.is_parallel:
            self.cells = gas.cells
            return
        cells = cells_in(gas_grids, self.gas.with_ghosts(gas.classes), self.pos, self.h, self.gas.global_index)
        self.cells = cells._replace(filled=_filled_cells(gas_key))
        self.grain_cells = self.grain_cells._replace(filled=_filled_cells(key))

    @cached_property
    def grains_about(self) -> list[Any]:
        """Grains that may be neighbours of the gas in each cell: a list of candidates per chunk of `parallel_for`."""
        return candidates(self.cells, self.grain_cells, mutual=False)

    @cached_property
    def gas_about(self) -> list[Any]:
        """Gas that may be a neighbour of the grains in each cell: a list of candidates per chunk of `parallel_for`."""
        return candidates(self.grain_cells, self.cells, mutual=True, extent=0.0)


def _grids_of(sph: Sph, grains: Grains) -> tuple[Grids, Array]:
    """Return the grids of the grains of all processes, and the size class (n,) of each local grain.

    All grains are in one size class.
    """
    low, width = (np.zeros(2), sph.size) if sph.periodic else box_about(grains.pos, world.processes)
    sides = width[width > 1e-300]
    count = int(world.processes.sum(grains.count))
    side = (GRAINS_PER_CELL * np.prod(sides) / count) ** (1.0 / max(1, len(sides)))
    return grids_of(grains.pos, np.full(grains.count, side), 1.0, low, width, sph.periodic, world.processes)


def _box_of_cells(*some: tuple[Grids, Array, Array]) -> tuple[Array, Array]:
    """Return the corners, (2,) each, of the box that encloses the cells of several sets of local particles.

    some: for each set a tuple of its grids, size classes (n,) and positions (n, d).
    """
    found = [corners_of_cells(*each) for each in some if len(each[2]) > 0] or [corners(some[0][2])]
    return np.min([low for low, _ in found], axis=0), np.max([high for _, high in found], axis=0)


def _filled_cells(key: Array) -> Array:
    """Return the indices of the cells that contain particles, ascending; key (n,): cell index of each particle."""
    return np.flatnonzero(np.bincount(key))


def _needed_cells(
    grids: Grids, key: Array, others: Grids, other_key: Array, reach_of: int, flat: bool
) -> world.NeededCells:
    """Return the cells of a species whose particles this process needs.

    Needed are the cells of local particles, and all cells within reach of local particles of the other species.
    grids, key (m,): grids of the species, and cell indices of its local particles. others, other_key (n,): grids and
    cell indices of the other species. reach_of: species whose support radius is the reach, halo.OWN or halo.THEIRS
    (`kernels/mpi/halo.py`). flat: whether the scene is one-dimensional.
    """
    away, periodic = grids.low - others.low, grids.periodic
    needed = halo.mark_cells(_filled_cells(other_key), others.table, away, grids.table, reach_of, 1.0, flat, periodic)
    needed[key] = True
    numbers = grids.indices_in_whole()
    return world.NeededCells(needed, numbers, numbers + 1)
