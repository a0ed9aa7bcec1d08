"""Smoothed particle hydrodynamics: neighbours, density and forces of the gas (equations in `kernels/sph.py`)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

from discsim.kernels.neighbours import cell_bounds, sort_into_cells
from discsim.kernels.smoothing import KERNELS, SUPPORT
from discsim.kernels.sph import density_driver, force_driver
from discsim.threads import share

if TYPE_CHECKING:
    from discsim.scene import Scene
    from discsim.state import Gas

NONE = np.empty(0)
CELLS = 64  # the fewest that a thread takes at once


class Points(Protocol):
    """Particles that have a density: gas, or dust where drag asks for it."""

    pos: np.ndarray
    mass: np.ndarray
    h: np.ndarray
    density: np.ndarray
    gradh: np.ndarray

    @property
    def count(self) -> int: ...


class Sph:
    """The gas's discretisation: what a scene chose, and the neighbour cells of the last density pass."""

    def __init__(self, scene: Scene):
        self.kernel = KERNELS[scene.gas.kernel]
        self.support = SUPPORT[self.kernel]
        self.eta = scene.gas.eta
        self.fixed = scene.gas.smoothing_length is not None
        self.dim = scene.space.dimensions
        self.periodic = scene.space.boundary == "periodic"
        self.size = np.zeros(2)
        self.size[: self.dim] = scene.space.size
        # Lone particles have no h that solves eq. (1); none may reach over the whole disc.
        self.h_most = self.size.max() / (1.0 if self.periodic else 8.0)
        self.viscosity = scene.gas.viscosity
        self.conductivity = scene.gas.conductivity
        self.receding = 1.0 if self.viscosity is not None and self.viscosity.pairs == "all" else 0.0
        self.balsara = self.viscosity is not None and self.viscosity.switch == "balsara"

    def box_of(self, points: Points) -> tuple[np.ndarray, np.ndarray]:
        if self.periodic:
            return np.zeros(2), self.size
        low, width = np.zeros(2), np.zeros(2)
        low[: self.dim] = points.pos.min(axis=0)
        width[: self.dim] = points.pos.max(axis=0) - low[: self.dim]
        width[0] = max(width[0], 1e-300)
        return low, width

    def order(self, gas: Gas) -> np.ndarray:
        """Order of the particles by neighbour cell, for memory locality (n,)."""
        return sort_into_cells(gas.pos, self.support * gas.h, *self.box_of(gas), self.periodic)[1]

    def density(self, gas: Points, vel: np.ndarray) -> None:
        """Density, Omega and, unless fixed, smoothing length of all particles; what a switch needs of `vel`."""
        low, width = self.box_of(gas)
        radius = self.support * gas.h
        grids, order, start, bounds, filled = sort_into_cells(gas.pos, radius, low, width, self.periodic)
        self.cells = filled, grids, order, start
        self.box = low, width, self.periodic
        self.shear = [np.empty(gas.count if self.balsara else 0) for _ in range(2)]
        share(
            density_driver(self.kernel, self.dim, self.balsara), len(filled), gas.pos, vel, gas.mass, gas.h,
            gas.density, gas.gradh, *self.shear, self.eta, self.h_most, self.fixed,
            *self.cells, bounds, *self.box, least=CELLS,
        )  # fmt: skip

    def forces(self, gas: Gas, vel: np.ndarray, u: np.ndarray | None, pressure: np.ndarray) -> np.ndarray:
        """Add to `acc` (and `heating_rate`); return the velocity divergence (n,), for the step's limit."""
        filled, grids, order, start = self.cells
        radius = self.support * gas.h
        bounds = cell_bounds(gas.pos, radius, order, start)
        # h moved since the cells were laid, and with it how far the particles of a grid reach.
        grids = _with_reach(grids, bounds)
        switch = NONE
        if self.balsara:
            div, curl = self.shear
            switch = div / (div + curl + 1e-4 * gas.sound_speed / gas.h)
        divergence = np.zeros(gas.count)
        viscous, conductive = self.viscosity is not None, self.conductivity is not None
        driver = force_driver(self.kernel, self.dim, viscous, u is not None, conductive)
        share(
            driver, len(filled), gas.pos, vel, gas.mass, gas.h, radius, gas.density, gas.gradh, pressure,
            gas.sound_speed, switch,
            NONE if u is None else u, gas.acc, NONE if u is None else gas.heating_rate, divergence,
            self.viscosity.alpha if viscous else 0.0, self.viscosity.beta if viscous else 0.0,
            self.receding, self.conductivity.alpha if conductive else 0.0,
            filled, grids, order, start, bounds, *self.box, least=CELLS,
        )  # fmt: skip
        return divergence


def _with_reach(grids: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """The grids with their largest support radius taken again from the cells."""
    grids = grids.copy()
    edges = [*grids[:, 0].astype(int), len(bounds)]
    for k in range(len(grids)):
        grids[k, 5] = bounds[edges[k] : edges[k + 1], 4].max()
    return grids
