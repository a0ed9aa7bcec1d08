"""SPH sums of own gas beside that of other ranks: those of `numerics/sph.py`, of the cells that hold own particles.

Cells of neighbours are those of all the gas: the same box, size classes and sides on every rank, which has the part of
them about its own. It fetches the particles of all cells within reach of its own (`kernels/halo.py`), as whole cells,
so that lists of candidates are those of one rank. After each pass over density others' h, and after the last one all
that forces read of them, is fetched from where it was found. Where an h outgrows what the cells were fetched for, all
is done anew with more.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from discsim.kernels.halo import EITHER, mark_cells
from discsim.kernels.neighbours import FIRST, REACH, widen
from discsim.kernels.sph import force_columns
from discsim.kernels.sph_density import Found, Given, Wanted, density_driver
from discsim.kernels.sph_packs import ENERGY, FLUIDITY
from discsim.numerics import world
from discsim.numerics.neighbours import LEAST, candidates, cells_in, corners_of_cells, keys_in
from discsim.numerics.sph import NONE, Sph
from discsim.numerics.state import Gas
from discsim.numerics.threads import share
from discsim.numerics.world import Needed
from discsim.ranks.comm import Comm
from discsim.ranks.exchange import in_cells
from discsim.scene import Scene

Array = np.ndarray
HALO = 1.35  # times the largest support of a class, that the cells are fetched for: outgrown ones look 1.2 h far
MORE = 1.1  # times what was found to be needed


class DividedSph(Sph):
    """`Sph` of a rank."""

    def __init__(self, scene: Scene, comm: Comm):
        super().__init__(scene)
        self.comm = comm
        self.room = HALO
        self.again = 0  # how often the halo was too narrow

    def keys(self, gas: Gas) -> tuple[Array, int]:
        grids, classes = self.grids_of(gas)
        return keys_in(grids, classes, gas.pos), grids.cells

    def settle(self, gas: Any, vel: Array, h_least: float) -> None:
        begun = gas.h.copy()
        while (needed := self._settle(gas, vel, h_least, self.room)) > self.room:
            gas.h[:], self.room = begun, MORE * needed
            self.again += 1
        self.room = max(HALO, MORE * needed)

    def _settle(self, gas: Gas, vel: Array, h_least: float, room: float) -> float:
        """`settle` with cells for supports `room` times the largest; the room that it needed."""
        grids, classes = self.grids_of(gas)
        held = np.flatnonzero(np.bincount(classes))
        widest = grids.table[held, REACH].max(initial=0.0)
        grids = grids.near(*corners_of_cells(grids, classes, gas.pos), room * np.maximum(grids.table[:, REACH], widest))
        key = keys_in(grids, classes, gas.pos)
        mine, table = np.flatnonzero(np.bincount(key)), grids.table
        needed = mark_cells(mine, table, np.zeros(2), table, EITHER, room, self.dim == 1, self.periodic)
        numbers = grids.numbers()
        wide = self.wide = in_cells(self.comm, gas, key, Needed(needed, numbers, numbers + 1))
        pos, h, mass = wide.of_all([gas.pos, gas.h, gas.mass])
        self.pos = pos
        moving = wide.of(vel) if self.balsara else pos
        cells = self.cells = cells_in(grids, wide.of(classes), pos, h, wide.place)
        self.mine = mine
        self.lists = lists = self.parts(candidates(cells._replace(filled=mine), cells, mutual=True))
        self.met = np.zeros(len(cells.bounds), np.bool_)
        self.shear = [np.empty(wide.count if self.balsara else 0) for _ in range(2)]
        self.found = found = Found(h, *np.empty((2, wide.count)), *self.shear)
        driver = density_driver(self.kernel, self.dim, self.balsara)
        wanted, left, most = Wanted(self.eta, h_least, self.h_most, self.fixed), mine, 0.0
        while True:
            outgrown = np.zeros(len(left), np.bool_)
            share(
                driver,
                len(left),
                left,
                Given(pos, moving, mass),
                found,
                wanted,
                cells,
                outgrown,
                least=LEAST,
                each=lists,
            )
            wide.refresh(h)
            beyond = self.support * h[cells.order] > cells.radius[: len(cells.order)]
            out = np.flatnonzero(np.bincount(cells.key[cells.order[beyond]]))
            if not world.together.most(len(out)):
                break
            widen(out, 1.2 * self.support, h, cells)
            most = world.together.most(self._widest(out, grids.table))
            if most > room:
                return most
            for listed in candidates(cells._replace(filled=out), cells, mutual=True):
                self.met[cells.key[cells.order[listed.slots[: listed.begin[-1]]]]] = True
            left = np.intersect1d(out, mine, assume_unique=True)
            lists = self.parts(candidates(cells._replace(filled=left), cells, mutual=True))
        gas.h[:], gas.density[:], gas.gradh[:] = h[wide.own], found.rho[wide.own], found.gradh[wide.own]
        return most

    def _widest(self, some: Array, table: Array) -> float:
        """The largest support in `some` cells over what was the largest in their grids."""
        if len(some) == 0:
            return 0.0
        level = np.searchsorted(table[:, FIRST], some, side="right") - 1
        return float((self.cells.bounds[some, 4] / table[level, REACH]).max())

    def _masses(self, gas: Gas) -> tuple[float, float]:
        most, least = float(gas.mass.max(initial=0.0)), float(gas.mass.min(initial=np.inf))
        return world.together.most(most), world.together.least(least)

    def forces(self, gas: Gas, vel: Array, u: Array | None, pressure: Array) -> tuple[Array, float]:
        terms = self.pairs, u is not None, self.conductivity is not None
        wide, cells, found, dim = self.wide, self.cells, self.found, self.dim
        for array in (found.rho, found.gradh, *(self.shear if self.balsara else ())):
            wide.refresh(array)  # on ranks without particles too: all call
        optional = [array for array in (u, gas.nu) if array is not None]
        moving, mass, press, sound, *rest = wide.of_all([vel, gas.mass, pressure, gas.sound_speed, *optional])
        energy, nu = rest[0] if u is not None else NONE, rest[-1] if gas.nu is not None else NONE
        heaviest, lightest = self._masses(gas)
        alpha, beta = (self.viscosity.alpha / 16.0, self.viscosity.beta / 8.0) if self.viscosity else (0.0, 0.0)
        more = self.conductivity is not None or len(nu) > 0
        if len(self.columns) < wide.count:  # kept: new memory costs as much as what is written to it
            self.columns = np.empty((wide.count + wide.count // 16, FLUIDITY + 1 if more else ENERGY))
        table = self.columns[: wide.count]
        given = Given(self.pos, moving, mass)
        share(
            force_columns, wide.count, given, found, press, sound, energy, nu, *terms, alpha, cells.order, table,
        )  # fmt: skip
        acc, rate = np.zeros((wide.count, dim)), np.zeros(wide.count if u is not None else 0)
        acc[wide.own] = gas.acc
        if u is not None:
            rate[wide.own] = gas.heating_rate
        divergence, conduction = np.zeros(wide.count), np.zeros(wide.count if self.conductivity else 0)
        strengths = beta, self.conductivity.alpha if self.conductivity else 0.0
        driver = self.driver(u, nu, heaviest > lightest)
        met = self.mine[self.met[self.mine]]
        for filled, again in ((self.mine, False), (met, True)):
            some = cells._replace(filled=filled)
            lists = self.parts(candidates(some, some, mutual=True)) if again else self.lists
            share(
                driver, len(filled), table, acc, rate if u is not None else NONE, divergence, conduction, strengths,
                some, self.met, again, least=LEAST, each=lists,
            )  # fmt: skip
        gas.acc[:] = acc[wide.own]
        if u is not None:
            gas.heating_rate[:] = rate[wide.own]
        return divergence[wide.own], float(conduction[wide.own].max(initial=0.0)) if self.conductivity else 0.0
