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
        self.grains = polar.PolarGrains(self.geometry, dust.pos, dust.ids)
        shape = self.grains.shape
        self.area = np.repeat(self.geometry.volume * self.geometry.angle, shape[1])
        # The pressure of the last force belongs to the densities before the drift.
        pressure = thermal_speed(state.scene, gas) ** 2 * self.carried / self.area
        arrays = self.carried, gas.small, pressure
        self.cells = of_cells.CarrierCells(gas.vel.reshape(*shape, 2), *(array.reshape(shape) for array in arrays))

    def find(self, centre: np.ndarray) -> np.ndarray:
        dust, grains = self.dust, self.grains
        self.field = np.empty((dust.count, kernels.COLUMNS))
        deposit = (grains.spread(dust.mass) / self.area).reshape(grains.shape)
        parallel_for(
            of_cells.gather, dust.count, dust.pos, grains.places, self.cells, deposit, self.geometry, self.field
        )
        return self.field

    def exchange(self, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        dust, grains = self.dust, self.grains
        taken, spread = np.empty((2, *grains.shape))
        got = np.empty((*grains.shape, 3))
        wanted = np.where(grains.outside, 0.0, wanted)
        given = self.field, wanted, self.cells
        grains.for_rings(
            of_cells.exchange_to_cells, dust.pos, dust.vel, grains.places, grains.sorted, *given, self.geometry, taken,
            spread, got,
        )  # fmt: skip
        parallel_for(
            of_cells.exchange_to_grains, dust.count, dust.pos, grains.places, *given, spread, self.geometry, dust.mass,
            dust.vel,
        )  # fmt: skip
        return taken.ravel(), got.reshape(-1, 3)
