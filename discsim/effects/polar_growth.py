"""Growth of dust in gas of a polar grid, whose cells carry the small dust (`kernels/polar/growth.py`)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.effects import base, growth
from discsim.numerics.state import State
from discsim.numerics.threads import parallel_for
from discsim.parts import Lazy
from discsim.physics.eos import thermal_speed
from discsim.physics.polar import polar_shape

if TYPE_CHECKING:
    from discsim.scene import Scene

kernels = Lazy("discsim.kernels.dust.growth")
of_cells = Lazy("discsim.kernels.polar.growth")
polar = Lazy("discsim.numerics.polar")

# CPU nanoseconds: of an application per grain, and of a step per cell, which moves the small dust.
EXCHANGE_COST, CELL_COST = 600.0, 40.0


class Growth(growth.Effect):
    """Growth of dust particles, and exchange of mass with the small dust in polar cells."""

    def __init__(self, scene: Scene, state: State) -> None:
        super().__init__(scene, state)
        self.geometry = polar.geometry_of(*polar_shape(scene))

    @classmethod
    def nanoseconds(cls, scene: Scene, counts: base.Counts) -> float:
        application = counts.dust * (growth.GRAIN_COST + EXCHANGE_COST)
        return application / growth.STEPS_BETWEEN_CALLS + CELL_COST * counts.gas

    def gas_around(self, state: State) -> CellsAroundGrains:
        return CellsAroundGrains(state, self.mass_includes_small, self.geometry)


class CellsAroundGrains(growth.GasAroundGrains):
    """Polar cells around dust particles, in place of gas particles. geometry: of the cells."""

    def __init__(self, state: State, mass_includes_small: bool, geometry: Any) -> None:
        self.geometry = geometry
        super().__init__(state, mass_includes_small)

    def search(self, state: State) -> None:
        gas, dust = self.gas, self.dust
        self.grains = polar.PolarGrains(self.geometry, state, dust.pos)
        # The pressure of the last force belongs to the densities before the drift.
        pressure = thermal_speed(state.scene, gas) ** 2 * self.carried / self.grains.area
        arrays = [gas.vel, self.carried, gas.small, pressure]
        self.cells = of_cells.CarrierCells(*self.grains.with_ghost_rings(arrays))

    def find(self, centre: np.ndarray) -> np.ndarray:
        dust, grains = self.dust, self.grains
        self.field = np.empty((dust.count, kernels.COLUMNS))
        (deposit,) = grains.with_ghost_rings([grains.spread(dust.mass) / grains.area])
        parallel_for(
            of_cells.gather, dust.count, dust.pos, grains.places, self.cells, deposit, grains.geometry, self.field
        )
        return self.field

    def exchange(self, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        dust, grains, near = self.dust, self.grains, self.grains.near
        taken, spread = np.empty((2, *grains.shape))
        got = np.empty((*grains.shape, 3))
        wanted = np.where(grains.outside, 0.0, wanted)
        vel, field, of_near = near.members.all_with_ghosts([dust.vel, self.field, wanted])
        grains.for_rings(
            of_cells.exchange_to_cells, near.pos, vel, near.places, near.sorted, field, of_near, self.cells,
            grains.geometry, taken, spread, got,
        )  # fmt: skip
        (spread,) = grains.with_ghost_rings([spread[grains.own].ravel()])
        parallel_for(
            of_cells.exchange_to_grains, dust.count, dust.pos, grains.places, self.field, wanted, self.cells, spread,
            grains.geometry, dust.mass, dust.vel,
        )  # fmt: skip
        return taken[grains.own].ravel(), got[grains.own].reshape(-1, 3)
