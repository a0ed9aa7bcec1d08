"""Surface density, potential and pull of particles on a grid: deposit, potential by FFT, centred difference, gather
with the deposit's weights (particle mesh; Hockney & Eastwood 1988, ch. 5).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cached_property

import numpy as np

from discsim.kernels.common import move as moves
from discsim.numerics import teams
from discsim.numerics.grid import BORDER, ORIGIN, Grid, Node
from discsim.numerics.poisson import Kernel, Poisson
from discsim.numerics.state import Particles
from discsim.numerics.threads import share

Array = np.ndarray


class Mesh:
    """The field of some species on a grid, of one process.

    Its arrays are made when they are first needed, and kept from step to step: memory that is new costs as much as what
    is made in it.
    """

    first: Node = ORIGIN  # of the nodes that it has

    def __init__(self, grid: Grid, kernel: Kernel) -> None:
        self.grid, self.kernel = grid, kernel
        self.border = 0 if grid.periodic else BORDER

    @cached_property
    def _poisson(self) -> Poisson:
        grid = self.grid
        return Poisson(grid.shape, grid.cell, self.kernel, grid.periodic, teams.number_of_threads(), self.border)

    @cached_property
    def density(self) -> Array:
        """Surface density (nx, ny)."""
        return np.empty(self.grid.shape)

    @cached_property
    def _potential(self) -> Array:
        return np.empty((self.grid.shape[0] + 2 * self.border, self.grid.shape[1] + 2 * self.border))

    @cached_property
    def _gradient(self) -> Array:
        return np.empty((*self.grid.shape, 2))

    def solve(self, species: Mapping[str, Particles], sources: Iterable[str]) -> None:
        """The potential of the `sources` where they are now, for what asks at the places of any of the `species`.

        Raises ValueError as `Poisson`.
        """
        share(moves.blank, len(self.density), self.density, least=64)
        for name in sources:
            self._deposit(species[name])
        self._poisson.solve(self.density, out=self._potential)

    def _deposit(self, particles: Particles) -> None:
        self.grid.deposit(particles.pos, particles.mass, out=self.density)

    def differentiate(self) -> None:
        """The gradient of the potential, for `pull`."""
        self.grid.gradient(self._potential, out=self._gradient)

    def pull(self, several: Iterable[tuple[Array, Array]]) -> list[tuple[float, int]]:
        """Add to accelerations what particles on the grid feel, `several` places and accelerations (n, d); of each the
        strongest, and how many are off the grid.
        """
        return self.grid.pull(self._gradient, several, self.first)

    def potential(self, pos: Array) -> Array:
        """The potential (n,) at particles; 0 off the grid."""
        return self.grid.gather(self.grid.within(self._potential, self.density.shape), pos, self.first)

    def sums(self) -> tuple[Array, Array]:
        """The density summed along y (nx,) and along x (ny,)."""
        return self.density.sum(axis=1), self.density.sum(axis=0)
