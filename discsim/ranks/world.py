"""What `numerics/world.py` asks, answered by all ranks of a run."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from mpi4py import MPI

from discsim.effects.base import to_sort
from discsim.kernels.halo import near_others, owners_about
from discsim.numerics.threads import share
from discsim.ranks.comm import Comm, Route
from discsim.ranks.division import Division
from discsim.ranks.exchange import Wide, in_cells
from discsim.ranks.sph import DividedSph

if TYPE_CHECKING:
    from discsim.numerics.grid import Grid
    from discsim.numerics.state import Particles, State
    from discsim.scene import Scene

Array = np.ndarray


class Ranks:
    """All ranks of a run of a scene, each with its own particles."""

    many = True

    def __init__(self, scene: Scene, comm: Comm) -> None:
        self.comm, self.division = comm, Division(scene, comm)
        self._nodes: dict[Any, Array] = {}  # owners of the nodes of a grid, of the present division

    def least(self, values: Any) -> Any:
        # What is no number would be lost on the way: no limit, as what asks for the least takes it.
        known = np.where(np.isnan(values), -np.inf, values) if np.ndim(values) > 0 else values
        return self.comm.reduced(known, MPI.MIN)

    def most(self, values: Any) -> Any:
        return self.comm.reduced(values, MPI.MAX)

    def sum(self, values: Any) -> Any:
        return self.comm.reduced(values, MPI.SUM)

    def divide(self, state: State) -> None:
        """Of a state that each rank has the whole of, keep own particles."""
        self.division.cut(state.species, whole=True)
        self.division.keep_own(state)

    def settle(self, state: State) -> None:
        if to_sort(state.step) and self.division.cut(state.species):
            self._nodes = {}
        for particles in state.species.values():
            self.division.migrate(particles)

    def about_nodes(self, grid: Grid, particles: Particles) -> tuple[Array, Array]:
        pos, owner, rank = particles.pos, self._owner_of_nodes(grid), self.comm.rank
        near, where = np.empty(len(pos), bool), (grid.origin, 1.0 / grid.cell, grid.periodic)
        share(near_others, len(pos), pos, *where, owner, rank, near)
        some = np.flatnonzero(near)
        owners = np.zeros((self.comm.size, len(some)), bool)
        owners_about(some, pos, *where, owner, owners)
        owners[rank] = False
        wide = Wide(particles, Route(self.comm, [some[row] for row in owners]))
        return wide.of(pos), wide.of(particles.mass)

    def join_nodes(self, grid: Grid, field: Array) -> None:
        field[self._owner_of_nodes(grid) != self.comm.rank] = 0.0
        field[:] = self.comm.reduced(field, MPI.SUM)  # one number each, and zeros

    def _owner_of_nodes(self, grid: Grid) -> Array:
        if grid not in self._nodes:
            axes = [grid.nodes(axis) for axis in range(2 if grid.shape[1] > 1 else 1)]
            places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
            tiles = self.division.tile_of(places.reshape(-1, len(axes)))
            self._nodes[grid] = self.division.owner[tiles].reshape(grid.shape)
        return self._nodes[grid]

    def everyone(self, particles: Particles) -> Wide:
        return in_cells(self.comm, particles, np.zeros(particles.count, np.int64), np.ones(1, bool))

    def in_cells(self, particles: Any, key: Array, needed: Callable[[], Array]) -> Wide:
        return in_cells(self.comm, particles, key, needed())

    def sph(self, kind: Any, scene: Scene) -> DividedSph:
        return DividedSph(scene, self.comm)

    def sample(self, columns: Array, place: Array | None, some: Array) -> Array:
        assert place is not None
        found = self.comm.mpi.allgather((place[some], columns))
        return np.concatenate([rows for _, rows in found])[np.argsort(np.concatenate([at for at, _ in found]))]
