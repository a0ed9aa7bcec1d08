"""Samplers of the gas at the positions of grains: gas particles, polar cells, a prescribed disc, or uniform gas.

`GasModel.sampler` names the class of a gas model. The properties of the gas at a grain are those of a random walk
(`kernels/dust/diffusion.py`): density, the length over which the gas changes, c^2 and gradients.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.formulas.smoothing import SMOOTHING
from discsim.numerics import world
from discsim.numerics.state import State
from discsim.numerics.threads import parallel_for
from discsim.parts import Lazy, import_object
from discsim.physics.eos import thermal_speed
from discsim.physics.polar import polar_shape

if TYPE_CHECKING:
    from discsim.scene import Scene

kernels = Lazy("discsim.kernels.dust.diffusion")
of_cells = Lazy("discsim.kernels.polar.sampling")
neighbours = Lazy("discsim.numerics.neighbours")
meeting = Lazy("discsim.numerics.meeting")
smoothing = Lazy("discsim.numerics.sph")
polar = Lazy("discsim.numerics.polar")

PAIR_COST, CELL_COST = 7.5, 70.0  # CPU nanoseconds in a pass, per gas neighbour of a grain, and per grain in cells


def sampler_class(scene: Scene) -> type[GasSampler]:
    """Return the class of the sampler of a scene's gas."""
    has_gas = scene.gas is not None or scene.model.given is not None
    return import_object(scene.model.sampler) if has_gas else GasSampler


class GasSampler:
    """Sampler of uniform gas, for scenes without gas, and base class of the others.

    longest: longest displacement in a substep, as text for messages. drag: the effect of [drag], or None.
    """

    longest = "h/2"

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.drag: Any = None

    @classmethod
    def nanoseconds(cls, scene: Scene) -> float:
        """Estimate the CPU time of a pass over the gas for each grain, in nanoseconds."""
        return 0.0

    def begin(self, state: State) -> None:
        """Prepare the samples of the gas in `state`, which does not change until the next call but for velocities."""
        self.state = state

    def at(self, pos: np.ndarray) -> np.ndarray:
        """Return the properties of the gas at the positions of the dust.

        Parameters
        ----------
        pos : ndarray, shape (n, d)
            Positions of the dust particles.

        Returns
        -------
        ndarray, shape (n, 3 + 2 d)
            Properties in the order of `kernels/dust/diffusion.py`; the density is 0 where there is no gas.
        """
        field = np.zeros((len(pos), 3 + 2 * pos.shape[1]))
        field[:, kernels.DENSITY], field[:, kernels.LENGTH] = 1.0, math.inf
        return field

    def subtract_angular_momentum(
        self, gained: np.ndarray, start: np.ndarray, end: np.ndarray, density: np.ndarray, centre: np.ndarray
    ) -> None:
        """Change gas velocities so that the gas loses the angular momentum that grains gain in a substep.

        Gas near the middle of the substep loses the angular momentum or, if there is no gas, gas near `start`.

        Parameters
        ----------
        gained : ndarray, shape (n,)
            Angular momentum that each grain gains.
        start, end : ndarray, shape (n, d)
            Positions of the grains before and after the substep.
        density : ndarray, shape (n,)
            Density of the gas at `start`.
        centre : ndarray, shape (4,)
            Position and velocity of the centre of the disc.
        """


class DiscSampler(GasSampler):
    """Sampler of a prescribed disc."""

    longest = "H/6"

    def at(self, pos: np.ndarray) -> np.ndarray:
        field = np.zeros((len(pos), 3 + 2 * pos.shape[1]))
        disc = self.drag.kernel_disc(self.state.central_mass)
        parallel_for(kernels.write_gas_of_disc, len(pos), pos, disc, field)
        return field


class SphSampler(GasSampler):
    """Sampler of gas particles, by sums over the neighbours of a grain."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self.sph = smoothing.Sph(scene)

    @classmethod
    def nanoseconds(cls, scene: Scene) -> float:
        return PAIR_COST * SMOOTHING[scene.gas.kernel].neighbours(scene.gas.eta)

    def begin(self, state: State) -> None:
        super().begin(state)
        self.gas = meeting.GasCells(self.sph, state.gas)

    def at(self, pos: np.ndarray) -> np.ndarray:
        gas, met = self.state.gas, self.gas.neighbours_of(pos, self.state.dust.global_index)
        speed2 = thermal_speed(self.scene, gas) ** 2
        field = np.zeros((len(met.grain_pos), 3 + 2 * pos.shape[1]))
        parallel_for(
            kernels.gas_driver(self.sph.kernel, pos.shape[1]), len(met.grain_cells.filled), met.grain_cells, met.cells,
            met.grain_pos, met.h, met.gas.with_ghosts(gas.mass), met.gas.with_ghosts(speed2), field,
            least=neighbours.LEAST, each=met.gas_about,
        )  # fmt: skip
        return field[met.grains.local_rows]

    def subtract_angular_momentum(
        self, gained: np.ndarray, start: np.ndarray, end: np.ndarray, density: np.ndarray, centre: np.ndarray
    ) -> None:
        gas = self.state.gas
        middle = 0.5 * (start + end)
        middle_density = self.at(middle)[:, kernels.DENSITY].copy()
        empty = middle_density == 0.0
        middle[empty], middle_density[empty] = start[empty], density[empty]
        met = self.gas.neighbours_of(middle, self.state.dust.global_index)
        per_density = np.divide(gained, middle_density, out=np.zeros(len(gained)), where=middle_density != 0.0)
        vel = met.gas.with_ghosts(gas.vel)
        parallel_for(
            kernels.recoil_driver(self.sph.kernel), len(met.cells.filled), met.cells, met.grain_cells, met.pos, met.h,
            met.grains.with_ghosts(per_density), centre, vel, least=neighbours.LEAST, each=met.grains_about,
        )  # fmt: skip
        gas.vel[:] = vel[met.gas.local_rows]


class PolarSampler(GasSampler):
    """Sampler of gas in polar cells, by quadratic splines (`kernels/polar/sampling.py`)."""

    longest = "half a cell"

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self.geometry = polar.geometry_of(*polar_shape(scene))

    @classmethod
    def nanoseconds(cls, scene: Scene) -> float:
        return CELL_COST

    def begin(self, state: State) -> None:
        super().begin(state)
        self.cells = [state.gas.mass, thermal_speed(self.scene, state.gas) ** 2]

    def at(self, pos: np.ndarray) -> np.ndarray:
        field, grains = np.empty((len(pos), 7)), polar.PolarGrains(self.geometry, self.state, pos)
        cells = grains.with_ghost_rings(self.cells)
        parallel_for(of_cells.sample, len(pos), pos, grains.places, *cells, grains.geometry, field)
        return field

    def subtract_angular_momentum(
        self, gained: np.ndarray, start: np.ndarray, end: np.ndarray, density: np.ndarray, centre: np.ndarray
    ) -> None:
        gas, middle = self.state.gas, 0.5 * (start + end)
        grains = polar.PolarGrains(self.geometry, self.state, middle)
        if world.processes.max(grains.outside.any()):
            middle = np.where(grains.outside[:, None], start, middle)
            grains = polar.PolarGrains(self.geometry, self.state, middle)
        near = grains.sum_weights(gas.mass)
        # A cell takes the fraction w m / near of the angular momentum; its mass cancels in the change of the velocity.
        per_mass = grains.spread(np.divide(gained, near, out=np.zeros(len(gained)), where=near != 0.0))
        turn = per_mass / (gas.pos**2).sum(axis=1)
        gas.vel[:, 0] += turn * gas.pos[:, 1]
        gas.vel[:, 1] -= turn * gas.pos[:, 0]
