"""Ownership of particles by ranks.

Space is divided into square tiles, ordered along a Hilbert curve (Hilbert 1891). Each rank owns consecutive tiles and
all particles in them, such that the costs of all ranks are about equal. Tiles are divided again when the cost of a rank
is more than TOLERANCE above the mean. A particle outside all tiles belongs to the nearest one.
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
from discsim.ranks.comm import Comm, Route, by_rank
from discsim.ranks.exchange import joined

if TYPE_CHECKING:
    from discsim.numerics.state import Particles, State
    from discsim.scene import Scene

Array = np.ndarray
PARTICLE_COST = {"gas": 4.0, "dust": 1.0}  # relative cost of a particle per step
NODE_COST = 0.1  # relative cost of a grid node per step, in windows around own particles
TOLERANCE = 0.1
# Arrays have spare capacity for arriving particles and ghosts, which lie along the border of a rank's tiles. For the
# species with the fewest particles, n on a rank, it is BORDER sqrt(n) entries, but at most SPARE n. Other species have
# the same fraction of their length.
BORDER, SPARE = 64.0, 0.25
TILES_PER_SIDE = 32  # smallest number of tiles along a side, over ranks^(1 / dimensions)


class Division:
    """Tiles of a scene's space, and the rank that owns each, `owner` (tiles,); both are the same on every rank."""

    def __init__(self, scene: Scene, comm: Comm) -> None:
        self.comm, self.scene, dim = comm, scene, scene.space.dimensions
        size = np.array(scene.space.size)
        bits = int(np.ceil(np.log2(TILES_PER_SIDE * comm.size ** (1.0 / dim))))
        self.along = 1 << bits
        self.low = -0.5 * size.max() * np.ones(dim) if scene.centred else np.zeros(dim)
        self.per_tile = self.along / size.max()
        self.owner = np.zeros(self.along**dim, np.int64)
        self.margin = 0.0  # distance to other ranks' tiles, for `near`
        self._known_batches: list[tuple[Any, Array]] = []  # arrays of positions after `settle`, and their bounds
        if dim == 2:
            x, y = np.divmod(np.arange(self.along**2), self.along)
            self.curve = np.argsort(hilbert(x, y, bits))
        else:
            self.curve = np.arange(self.along)

    @property
    def tiles(self) -> tuple[Array, float, int]:
        """Arguments of kernels: lower corner, tiles per unit length, and number of tiles along a side."""
        return self.low, self.per_tile, self.along

    def tile_of(self, pos: Array) -> Array:
        """Return the index (n,) of the tile that contains each position (n, d)."""
        out = np.empty(len(pos), np.int64)
        parallel_for(tiles_of, len(pos), pos, self.tiles, out)
        return out

    def near(self, pos: Array) -> Array:
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
        given = pos, bounds, self.margin, ends, self.tiles, others
        return joined(parallel_for(rows_near_marked_tiles, len(bounds), *given, least=LEAST))

    def bounds(self, pos: Array) -> Array:
        """Return the bounds of batches of positions (n, d), as in `numerics/batches.py`, cached if possible."""
        known = self.known_bounds(pos)
        return bounds_of(pos) if known is None else known

    def known_bounds(self, pos: Array) -> Array | None:
        """Return the bounds of batches that `settle` stored for the array `pos`; None for any other array."""
        return next((bounds for of, bounds in self._known_batches if of() is pos), None)

    def forget(self) -> None:
        """Drop the stored bounds, before positions change."""
        self._known_batches.clear()

    def within(self, pos: Array, marked: Array, bounds: Array) -> Array:
        """Return the rows of positions (n, d) that are in marked tiles.

        marked (tiles,): mask of tiles. bounds: bounds of the batches of `pos`.
        """
        return joined(parallel_for(rows_in_marked_tiles, len(bounds), pos, bounds, self.tiles, marked, least=LEAST))

    def cut(self, species: dict[str, Particles], whole: bool = False) -> bool:
        """Divide the tiles among ranks again if costs are unequal; return whether any owner has changed.

        whole: whether each rank has all particles; the tiles are then always divided. Otherwise collective.
        """
        cost = np.zeros(len(self.owner))
        for name, p in species.items():
            cost += PARTICLE_COST[name] * np.bincount(self.tile_of(p.pos), minlength=len(cost))
        if not whole:
            cost = self.comm.reduced(cost, MPI.SUM)  # whole numbers: an exact sum
        # Nodes of empty tiles cost nothing.
        cost += round(NODE_COST * self._nodes_per_tile(int(cost.sum()))) * (cost > 0.0)
        if not whole:
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
        """Return the number of grid nodes in a tile."""
        cell, counts = grid_cells(self.scene, particles)
        return float((1.0 / self.per_tile / cell) ** len(counts))

    def _spare_fraction(self, counts: list[int]) -> float:
        """Return the spare capacity of arrays as a fraction of their length.

        counts: number of particles of each species, over all ranks.
        """
        fewest = min(counts, default=0) / self.comm.size
        return min(SPARE, BORDER / math.sqrt(max(fewest, 1.0)))

    def drop_others(self, state: State) -> None:
        """Drop the particles of other ranks, at a start where each rank has all particles."""
        spare = self._spare_fraction([p.count for p in state.species.values()])
        for name, p in state.species.items():
            p.global_index = np.arange(p.count, dtype=np.uint64)
            own = self.within(p.pos, self.owner == self.comm.rank, bounds_of(p.pos))
            p.spare = int(spare * len(own))
            p.take(own)
            acc = state.acc_unshared.get(name)  # of a resumed run
            if acc is not None and len(acc) > 0:
                state.acc_unshared[name] = acc[own]

    def deal(self, state: State) -> None:
        """Send particles to their owners, at a start where each rank has a range of rows, in the order of ranks."""
        spare = self._spare_fraction([int(self.comm.reduced(p.count, MPI.SUM)) for p in state.species.values()])
        for name, p in state.species.items():
            before = self.comm.mpi.exscan(p.count) or 0
            p.global_index = np.arange(before, before + p.count, dtype=np.uint64)
            owner = self.owner[self.tile_of(p.pos)]
            route = Route(self.comm, by_rank(np.arange(p.count), owner, self.comm.size))
            order = np.argsort(route.send(p.global_index))
            p.spare = int(spare * len(order))
            for array_name, array in p.arrays().items():
                held = alloc.allocate(len(order), array, p.spare)
                setattr(p, array_name, np.take(route.send(array), order, axis=0, out=held))
            if name in state.acc_unshared and self.comm.mpi.allreduce(len(state.acc_unshared[name])) > 0:
                state.acc_unshared[name] = route.send(state.acc_unshared[name])[order]

    def settle(self, species: dict[str, Particles]) -> None:
        """Send particles that have left the tiles of this rank to their new owners. Collective."""
        self.forget()
        for particles in species.values():
            self._migrate(particles)

    def _migrate(self, particles: Particles) -> None:
        bounds = bounds_of(particles.pos)
        away = self.within(particles.pos, self.owner != self.comm.rank, bounds)
        if self.comm.reduced(len(away), MPI.MAX):
            owner = self.owner[self.tile_of(particles.pos[away])]
            route = Route(self.comm, by_rank(away, owner, self.comm.size))
            arrays, known = particles.arrays(), len(particles.unsorted_rows)
            particles.replace(away, dict(zip(arrays, route.send_all([*arrays.values()]), strict=True)))
            bounds = update_bounds(bounds, particles.pos, particles.unsorted_rows[known:])
        self._known_batches.append((weakref.ref(particles.pos), bounds))


def hilbert(x: Array, y: Array, bits: int) -> Array:
    """Return the index (n,) along the Hilbert curve of points with integer coordinates x, y (n,) below 2^bits."""
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
