"""Ownership of particles: square tiles of space along a Hilbert curve (Hilbert 1891), a run of tiles for each rank.

Runs are cut for equal costs of their particles, and are cut again when a rank's cost is TOLERANCE above the mean. A
particle off the grid belongs to the nearest tile.
"""

from __future__ import annotations

import math
import weakref
from typing import TYPE_CHECKING, Any

import numpy as np
from mpi4py import MPI

from discsim.kernels.mpi.tiles import in_marked, near_marked, tiles_of
from discsim.numerics import alloc
from discsim.numerics.batches import LEAST, bounds_anew, bounds_of
from discsim.numerics.layout import grid_cells
from discsim.numerics.threads import parallel_for
from discsim.ranks.comm import Comm, Route, by_rank
from discsim.ranks.exchange import joined

if TYPE_CHECKING:
    from discsim.numerics.state import Particles, State
    from discsim.scene import Scene

Array = np.ndarray
COST = {"gas": 4.0, "dust": 1.0}  # of a particle per step, relative
NODE = 0.1  # of a grid node per step, in windows about own particles
TOLERANCE = 0.1
# Arrays begin with spare memory for arrivals and ghosts, which lie along a border. For the species with the fewest
# particles, n on a rank, it is for BORDER sqrt(n) more; for others it is the same fraction. SPARE is the largest.
BORDER, SPARE = 64.0, 0.25
TILES = 32  # along a side, at least, times ranks^(1 / dimensions)


class Division:
    """Tiles of a scene's space and their owners (tiles,), the same on every rank."""

    def __init__(self, scene: Scene, comm: Comm) -> None:
        self.comm, self.scene, dim = comm, scene, scene.space.dimensions
        size = np.array(scene.space.size)
        bits = int(np.ceil(np.log2(TILES * comm.size ** (1.0 / dim))))
        self.along = 1 << bits
        self.low = -0.5 * size.max() * np.ones(dim) if scene.centred else np.zeros(dim)
        self.per_tile = self.along / size.max()
        self.owner = np.zeros(self.along**dim, np.int64)
        self.margin = 0.0  # distance to other ranks' tiles, for `near`
        self._known: list[tuple[Any, Array]] = []  # arrays of positions after `settle`, and their bounds
        if dim == 2:
            x, y = np.divmod(np.arange(self.along**2), self.along)
            self.curve = np.argsort(hilbert(x, y, bits))
        else:
            self.curve = np.arange(self.along)

    @property
    def tiles(self) -> tuple[Array, float, int]:
        """Lower corner, tiles per length and tiles along a side, as kernels take them."""
        return self.low, self.per_tile, self.along

    def tile_of(self, pos: Array) -> Array:
        """Return the tile (n,) of each position (n, d)."""
        out = np.empty(len(pos), np.int64)
        parallel_for(tiles_of, len(pos), pos, self.tiles, out)
        return out

    def near(self, pos: Array) -> Array:
        """Return the indices of positions (n, d) near other ranks' tiles or the edge of a periodic box.

        Near is within the margin. Other positions in the same batches are included.
        """
        dim = pos.shape[1]
        ends = np.array([[-np.inf] * dim, [np.inf] * dim])
        if self.scene.space.boundary == "periodic":
            size = np.array(self.scene.space.size)
            begin = -0.5 * size if self.scene.centred else np.zeros(dim)
            ends = np.array([begin + self.margin, begin + size - self.margin])
        bounds, others = self.bounds(pos), self.owner != self.comm.rank
        given = pos, bounds, self.margin, ends, self.tiles, others
        return joined(parallel_for(near_marked, len(bounds), *given, least=LEAST))

    def bounds(self, pos: Array) -> Array:
        """Return the bounds of batches of positions (n, d), as in `numerics/batches.py`."""
        known = self.known_bounds(pos)
        return bounds_of(pos) if known is None else known

    def known_bounds(self, pos: Array) -> Array | None:
        """Return the stored bounds of positions from `settle`, None for other positions."""
        return next((bounds for of, bounds in self._known if of() is pos), None)

    def forget(self) -> None:
        """Drop stored bounds: positions change."""
        self._known.clear()

    def within(self, pos: Array, marked: Array, bounds: Array) -> Array:
        """Return the indices of positions (n, d), with batch `bounds`, that are in `marked` tiles (tiles,)."""
        return joined(parallel_for(in_marked, len(bounds), pos, bounds, self.tiles, marked, least=LEAST))

    def cut(self, species: dict[str, Particles], whole: bool = False) -> bool:
        """Divide the tiles again if the balance requires it; return whether owners changed.

        whole: each rank has all the particles.
        """
        cost = np.zeros(len(self.owner))
        for name, p in species.items():
            cost += COST[name] * np.bincount(self.tile_of(p.pos), minlength=len(cost))
        if not whole:
            cost = self.comm.reduced(cost, MPI.SUM)  # whole numbers: an exact sum
        cost += round(NODE * self._nodes(int(cost.sum()))) * (cost > 0.0)  # nodes of empty tiles cost nothing
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

    def _nodes(self, particles: int) -> float:
        """Return the number of grid nodes in a tile."""
        cell, counts = grid_cells(self.scene, particles)
        return float((1.0 / self.per_tile / cell) ** len(counts))

    def _spare(self, counts: list[int]) -> float:
        """Return the fraction of spare entries for species with `counts` particles on all ranks."""
        fewest = min(counts, default=0) / self.comm.size
        return min(SPARE, BORDER / math.sqrt(max(fewest, 1.0)))

    def keep_own(self, state: State) -> None:
        """Keep own particles alone, where each rank starts with all of them."""
        spare = self._spare([p.count for p in state.species.values()])
        for name, p in state.species.items():
            p.global_index = np.arange(p.count, dtype=np.uint64)
            own = self.within(p.pos, self.owner == self.comm.rank, bounds_of(p.pos))
            p.spare = int(spare * len(own))
            p.take(own)
            acc = state.acc_unshared.get(name)  # of a resumed run
            if acc is not None and len(acc) > 0:
                state.acc_unshared[name] = acc[own]

    def deal(self, state: State) -> None:
        """Send particles to their owners, where each rank starts with a range of rows, in the order of ranks."""
        spare = self._spare([int(self.comm.reduced(p.count, MPI.SUM)) for p in state.species.values()])
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
        """Send particles that have moved to their owners."""
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
            bounds = bounds_anew(bounds, particles.pos, particles.unsorted_rows[known:])
        self._known.append((weakref.ref(particles.pos), bounds))


def hilbert(x: Array, y: Array, bits: int) -> Array:
    """Return the index (n,) along the Hilbert curve of integers x, y (n,) below 2^bits."""
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
