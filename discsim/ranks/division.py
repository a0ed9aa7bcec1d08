"""Ownership of particles by ranks.

Space is divided into square tiles, ordered along a Hilbert curve (Hilbert 1891). Each rank owns consecutive tiles and
all particles in them, such that the costs of all ranks are about equal. The tiles are divided again when the cost of a
rank is more than TOLERANCE above the mean. A particle outside all tiles belongs to the nearest tile.
"""

from __future__ import annotations

import math
import weakref
from typing import TYPE_CHECKING, Any

import numpy as np
from mpi4py import MPI

from discsim.kernels.mpi.tiles import rows_in_marked_tiles, rows_near_marked_tiles, tiles_of
from discsim.numerics import alloc
from discsim.numerics.batches import LEAST, bounds_of, update_bounds
from discsim.numerics.layout import grid_cells
from discsim.numerics.threads import parallel_for
from discsim.ranks.comm import Comm, Route, group_by_rank
from discsim.ranks.exchange import concatenate
from discsim.ranks.sph import DividedSph

if TYPE_CHECKING:
    from discsim.numerics.state import Particles, State
    from discsim.scene import Scene

Array = np.ndarray
PARTICLE_COST = {"gas": 4.0, "dust": 1.0}  # relative cost of a particle per step
NODE_COST = 0.1  # relative cost of a grid node per step, in windows around local particles
TOLERANCE = 0.1
# Arrays have spare capacity for arriving particles and ghosts, which lie along the border of a rank's tiles. For the
# species with the fewest particles, n on a rank, it is BORDER sqrt(n) entries, but at most SPARE n. Other species have
# the same fraction of their length.
BORDER, SPARE = 64.0, 0.25
TILES_PER_SIDE = 32  # smallest number of tiles along a side, over ranks^(1 / dimensions)


class Division:
    """Division of a scene's space into tiles, and of the tiles among ranks; the same on every rank.

    owner (tiles,): rank that owns each tile. along: number of tiles along a side. low (d,): lower corner of the first
    tile. tiles_per_length: tiles per unit length. curve (tiles,): tiles in the order of the Hilbert curve. margin:
    distance used by `rows_near_border`.
    """

    tiles_per_side = TILES_PER_SIDE
    particle_cost = PARTICLE_COST

    def __init__(self, scene: Scene, comm: Comm) -> None:
        self.comm, self.scene, dim = comm, scene, scene.space.dimensions
        size = np.array(scene.space.size)
        bits = int(np.ceil(np.log2(self.tiles_per_side * comm.size ** (1.0 / dim))))
        self.along = 1 << bits
        self.low = -0.5 * size.max() * np.ones(dim) if scene.centred else np.zeros(dim)
        self.tiles_per_length = self.along / size.max()
        self.owner = np.zeros(self.along**dim, np.int64)
        self.margin = 0.0
        self._cached_bounds: list[tuple[Any, Array]] = []  # weak references to arrays of positions, and their bounds
        self.curve = np.arange(self.along)
        if dim == 2:
            self.curve = np.argsort(hilbert_index(*np.divmod(np.arange(self.along**2), self.along), bits))

    def divide_gas(self, effect: Any) -> None:
        """Give the effect of the gas its implementation for several ranks."""
        effect.sph = DividedSph(self.scene, self.comm)

    @property
    def tile_grid(self) -> tuple[Array, float, int]:
        """Arguments `tiles` of kernels: lower corner, tiles per unit length, and number of tiles along a side."""
        return self.low, self.tiles_per_length, self.along

    def tile_of(self, pos: Array) -> Array:
        """Return the index (n,) of the tile that contains each position (n, d)."""
        out = np.empty(len(pos), np.int64)
        parallel_for(tiles_of, len(pos), pos, self.tile_grid, out)
        return out

    def owner_of(self, name: str, particles: Particles, rows: Any = slice(None)) -> Array:
        """Return the rank (m,) that owns each of some particles of the species `name`; rows: their rows."""
        return self.owner[self.tile_of(particles.pos[rows])]

    def leaving_rows(self, name: str, particles: Particles, bounds: Array) -> Array:
        """Return the rows of particles of the species `name` that other ranks own; bounds: as in `rows_in_tiles`."""
        return self.rows_in_tiles(particles.pos, self.owner != self.comm.rank, bounds)

    def rows_in_tiles(self, pos: Array, mask: Array, bounds: Array) -> Array:
        """Return the rows of positions (n, d) that lie in the tiles of `mask` (tiles,).

        bounds: bounds of the batches of `pos`.
        """
        return concatenate(
            parallel_for(rows_in_marked_tiles, len(bounds), pos, bounds, self.tile_grid, mask, least=LEAST)
        )

    def rows_near_border(self, pos: Array) -> Array:
        """Return the rows of positions (n, d) within `margin` of other ranks' tiles or of the edge of a periodic box.

        Other rows may be included.
        """
        dim = pos.shape[1]
        ends = np.array([[-np.inf] * dim, [np.inf] * dim])
        if self.scene.space.boundary == "periodic":
            size = np.array(self.scene.space.size)
            begin = -0.5 * size if self.scene.centred else np.zeros(dim)
            ends = np.array([begin + self.margin, begin + size - self.margin])
        bounds, others = self.bounds(pos), self.owner != self.comm.rank
        given = pos, bounds, self.margin, ends, self.tile_grid, others
        return concatenate(parallel_for(rows_near_marked_tiles, len(bounds), *given, least=LEAST))

    def bounds(self, pos: Array) -> Array:
        """Return the bounds of batches of positions (n, d), as in `numerics/batches.py`, cached if possible."""
        bounds = self.cached_bounds(pos)
        return bounds_of(pos) if bounds is None else bounds

    def cached_bounds(self, pos: Array) -> Array | None:
        """Return the bounds of batches that `migrate` stored for the array `pos`; None for any other array."""
        return next((bounds for array, bounds in self._cached_bounds if array() is pos), None)

    def drop_bounds(self) -> None:
        """Drop the stored bounds, as positions change."""
        self._cached_bounds.clear()

    def rebalance(self, species: dict[str, Particles]) -> bool:
        """Divide the tiles among ranks again if costs are unequal; return whether any owner has changed. Collective."""
        cost = np.zeros(len(self.owner))
        for name, p in species.items():
            cost += self.particle_cost[name] * np.bincount(self.tile_of(p.pos), minlength=len(cost))
        cost = self.comm.allreduce(cost, MPI.SUM)  # whole numbers: an exact sum
        # Nodes of empty tiles cost nothing.
        cost += round(NODE_COST * self._nodes_per_tile(int(cost.sum()))) * (cost > 0.0)
        loads = np.bincount(self.owner, cost, self.comm.size)
        if loads.max() <= (1.0 + TOLERANCE) * loads.mean():
            return False
        until = np.cumsum(cost[self.curve])
        middle = until - 0.5 * cost[self.curve]
        share = max(float(until[-1]), 1.0) / self.comm.size
        owner = np.empty_like(self.owner)
        owner[self.curve] = np.minimum(middle / share, self.comm.size - 1).astype(np.int64)
        changed = not np.array_equal(owner, self.owner)
        self.owner = owner
        return changed

    def _nodes_per_tile(self, particles: int) -> float:
        """Return the number of grid nodes in a tile; particles: number on which the grid may depend."""
        cell, counts = grid_cells(self.scene, particles)
        return float((1.0 / self.tiles_per_length / cell) ** len(counts))

    def distribute(self, state: State) -> None:
        """Send all particles to the ranks that own the tiles of their positions, at the start of a run. Collective.

        Before the call, each rank has a range of the rows of all particles, in the order of ranks. The order of
        these rows becomes the global order.
        """
        counts = [int(self.comm.allreduce(p.count, MPI.SUM)) for p in state.species.values()]
        fewest = min(counts, default=0) / self.comm.size
        spare = min(SPARE, BORDER / math.sqrt(max(fewest, 1.0)))  # over the length of an array
        for name, p in state.species.items():
            before = self.comm.mpi.exscan(p.count) or 0
            p.global_index = np.arange(before, before + p.count, dtype=np.uint64)
            owner = self.owner_of(name, p)
            route = Route(self.comm, group_by_rank(np.arange(p.count), owner, self.comm.size))
            order = np.argsort(route.send(p.global_index))
            p.spare = int(spare * len(order))
            for array_name, array in p.arrays().items():
                received = alloc.allocate(len(order), array, p.spare)
                setattr(p, array_name, np.take(route.send(array), order, axis=0, out=received))
            if name in state.acc_unshared and self.comm.mpi.allreduce(len(state.acc_unshared[name])) > 0:
                state.acc_unshared[name] = route.send(state.acc_unshared[name])[order]

    def migrate(self, species: dict[str, Particles]) -> None:
        """Send particles that have left the tiles of this rank to their new owners. Collective."""
        self.drop_bounds()
        for name, particles in species.items():
            bounds = bounds_of(particles.pos)
            leaving = self.leaving_rows(name, particles, bounds)
            if self.comm.allreduce(len(leaving), MPI.MAX):
                owner = self.owner_of(name, particles, leaving)
                route = Route(self.comm, group_by_rank(leaving, owner, self.comm.size))
                arrays, known = particles.arrays(), len(particles.unsorted_rows)
                particles.replace(leaving, dict(zip(arrays, route.send_all([*arrays.values()]), strict=True)))
                bounds = update_bounds(bounds, particles.pos, particles.unsorted_rows[known:])
            self._cached_bounds.append((weakref.ref(particles.pos), bounds))


def hilbert_index(x: Array, y: Array, bits: int) -> Array:
    """Return the position (n,) along the Hilbert curve of points with integer coordinates x, y (n,) below 2^bits."""
    x, y, out = x.copy(), y.copy(), np.zeros_like(x)
    for k in range(bits - 1, -1, -1):
        right, up = x >> k & 1, y >> k & 1
        out += (3 * right ^ up) << 2 * k
        # Rotate or reflect the quadrant, so that its curve joins those of its neighbours.
        turned = up == 0
        flipped = turned & (right == 1)
        x, y = np.where(flipped, ~x, x), np.where(flipped, ~y, y)
        x, y = np.where(turned, y, x), np.where(turned, x, y)
        x, y = x & (1 << k) - 1, y & (1 << k) - 1
    return out
