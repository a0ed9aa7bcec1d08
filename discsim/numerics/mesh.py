"""Particle-mesh gravity (Hockney & Eastwood 1988, ch. 5).

Mass is deposited on a grid. The potential is computed by FFT, its gradient by centred differences. The gradient is then
interpolated to the particles with the weights of the deposit.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cached_property

import numpy as np

from discsim.kernels.common import move as moves
from discsim.numerics.grid import BORDER, ORIGIN, Grid, Node
from discsim.numerics.poisson import Kernel, Poisson
from discsim.numerics.state import Particles
from discsim.numerics.threads import parallel_for

Array = np.ndarray


class Mesh:
    """Gravitational field of particles on the grid of one process.

    Arrays are allocated when first needed and reused in each step, as the first write to new memory takes as much time
    as the computation. border: number of nodes beyond each edge at which the potential is computed.
    """

    first: Node = ORIGIN  # first node of the fields on this process, which has the whole grid

    def __init__(self, grid: Grid, kernel: Kernel) -> None:
        self.grid, self.kernel = grid, kernel
        self.border = 0 if grid.periodic else BORDER

    @cached_property
    def _poisson(self) -> Poisson:
        grid = self.grid
        return Poisson(grid.shape, grid.cell, self.kernel, grid.periodic, self.border)

    @cached_property
    def density(self) -> Array:
        """Surface density (nx, ny) of the last `solve`."""
        return np.empty(self.grid.shape)

    @cached_property
    def _potential(self) -> Array:
        return np.empty((self.grid.shape[0] + 2 * self.border, self.grid.shape[1] + 2 * self.border))

    @cached_property
    def _gradient(self) -> Array:
        return np.empty((*self.grid.shape, 2))

    def solve(self, species: Mapping[str, Particles], sources: Iterable[str]) -> None:
        """Compute the potential of the species named in `sources`, at their present positions.

        species: particles by name of the species; species that are not sources only feel the potential. Raises
        ValueError, as `Poisson`.
        """
        parallel_for(moves.set_to_zero, len(self.density), self.density, least=64)
        for name in sources:
            self._deposit(species[name])
        self._poisson.solve(self.density, out=self._potential)

    def _deposit(self, particles: Particles) -> None:
        """Add the surface density of a species to `density`."""
        self.grid.deposit(particles.pos, particles.mass, out=self.density)

    def differentiate(self) -> None:
        """Compute the gradient of the potential, which `pull` interpolates."""
        self.grid.gradient(self._potential, out=self._gradient)

    def pull(self, several: Iterable[tuple[Array, Array]]) -> list[tuple[float, int]]:
        """Add self-gravity to the accelerations of several species.

        several: for each species its positions and its accelerations (n, d); the accelerations change in place.
        Return for each species the largest acceleration by self-gravity, and the number of particles off the grid.
        """
        return self.grid.pull(self._gradient, several, self.first)

    def potential(self, pos: Array) -> Array:
        """Return the potential (n,) at positions `pos` (n, d); 0 off the grid."""
        return self.grid.gather(self.grid.without_border(self._potential, self.density.shape), pos, self.first)

    def density_sums(self) -> tuple[Array, Array]:
        """Return the sums of the surface density along y (nx,), and along x (ny,)."""
        return self.density.sum(axis=1), self.density.sum(axis=0)
