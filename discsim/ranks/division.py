"""Who owns which particles: square tiles of space along a Hilbert curve (Hilbert 1891), a run of them for each rank.

Runs are cut so that the costs of their particles are alike, and anew where those of a rank are TOLERANCE above the
mean. A particle off the grid belongs to the nearest tile.
"""

from __future__ import annotations

import math
import weakref
from typing import TYPE_CHECKING, Any

import numpy as np
from mpi4py import MPI
from scipy.ndimage import minimum_filter

from discsim.kernels.tiles import in_marked, owners_of, tiles_of
from discsim.numerics import room
from discsim.numerics.batches import LEAST, bounds_anew, bounds_of
from discsim.numerics.layout import grid_cells
from discsim.numerics.threads import share
from discsim.ranks.comm import Comm, Route, by_rank
from discsim.ranks.exchange import joined

if TYPE_CHECKING:
    from discsim.numerics.state import Particles, State
    from discsim.scene import Scene

Array = np.ndarray
COST = {"gas": 4.0, "dust": 1.0}  # of a particle in a step
NODE = 0.1  # of a node of the grid, in windows about own particles
TOLERANCE = 0.1
# At first arrays have room for a share of more entries: for arrivals and ghosts, which lie along a border. Of n own
# particles of the species that has the fewest BORDER sqrt(n) are ghosts, and of others as large a part, at most SPARE.
BORDER, SPARE = 64.0, 0.25
TILES = 32  # along a side for each doubling of the ranks, at least


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
        self.margin = 0.0  # within which of others' tiles particles are to be known
        self._inside = self.owner[:0], 0.0, self.owner[:0]  # of which owners and margin, and what they are
        # Of places that have been settled, those near others' tiles, and bounds.
        self._known: list[tuple[Any, Array, Array]] = []
        if dim == 2:
            x, y = np.divmod(np.arange(self.along**2), self.along)
            self.curve = np.argsort(hilbert(x, y, bits))
        else:
            self.curve = np.arange(self.along)

    @property
    def tiles(self) -> tuple[Array, float, int]:
        """As kernels take them."""
        return self.low, self.per_tile, self.along

    @property
    def inside(self) -> Array:
        """Own tiles (tiles,) with no other's, and no edge of a periodic box, within the margin."""
        owner, margin, found = self._inside
        if owner is not self.owner or margin != self.margin:
            found = self._find_inside(self.margin)
            self._inside = self.owner, self.margin, found
        return found

    def _find_inside(self, margin: float) -> Array:
        own = (self.owner == self.comm.rank).reshape(self.along, -1)
        if self.scene.space.boundary == "periodic":
            size = np.array(self.scene.space.size)
            begin = -0.5 * size if self.scene.centred else np.zeros(len(size))
            ends = (np.array([begin + margin, begin + size - margin]) - self.low) * self.per_tile
            for axis, (first, last) in enumerate(np.floor(ends).astype(np.int64).T.tolist()):
                edges = np.r_[: first + 1, last : self.along]
                own[(slice(None),) * axis + (edges,)] = False
        return minimum_filter(own, 2 * math.ceil(margin * self.per_tile) + 1, mode="constant", cval=False).ravel()

    def tile_of(self, pos: Array) -> Array:
        """The tile (n,) of each place (n, d)."""
        out = np.empty(len(pos), np.int64)
        share(tiles_of, len(pos), pos, self.tiles, out)
        return out

    def near(self, pos: Array) -> Array:
        """Numbers of the places (n, d) in tiles that are not inside, and maybe of some more."""
        near, _ = self._known_of(pos)
        return self.within(pos, ~self.inside, self.bounds(pos)) if near is None else near

    def bounds(self, pos: Array) -> Array:
        """Bounds of batches of places (n, d), as of `numerics/batches.py`."""
        _, bounds = self._known_of(pos)
        return bounds_of(pos) if bounds is None else bounds

    def _known_of(self, pos: Array) -> tuple[Array | None, Array | None]:
        return next(((near, bounds) for of, near, bounds in self._known if of() is pos), (None, None))

    def forget(self) -> None:
        """Let go of what is known of places: they are others."""
        self._known.clear()

    def within(self, pos: Array, marked: Array, bounds: Array) -> Array:
        """Numbers of the places (n, d), of such bounds, that are in `marked` tiles (tiles,)."""
        return joined(share(in_marked, len(bounds), pos, bounds, self.tiles, marked, least=LEAST))

    def cut(self, species: dict[str, Particles], whole: bool = False) -> bool:
        """Divide the tiles anew where that is due; whether it was. `whole`: each rank has all the particles."""
        cost = np.zeros(len(self.owner))
        for name, p in species.items():
            cost += COST[name] * np.bincount(self.tile_of(p.pos), minlength=len(cost))
        if not whole:
            cost = self.comm.reduced(cost, MPI.SUM)  # whole numbers
        cost += round(NODE * self._nodes(int(cost.sum()))) * (cost > 0.0)  # nodes that nobody is near cost nothing
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
        """Nodes of the grid in a tile."""
        cell, counts = grid_cells(self.scene, particles)
        return float((1.0 / self.per_tile / cell) ** len(counts))

    def _spare(self, counts: list[int]) -> float:
        """Of species of so many particles on all ranks."""
        fewest = min(counts, default=0) / self.comm.size
        return min(SPARE, BORDER / math.sqrt(max(fewest, 1.0)))

    def keep_own(self, state: State) -> None:
        """Of particles that each rank has all of, keep own ones."""
        spare = self._spare([p.count for p in state.species.values()])
        for name, p in state.species.items():
            p.place = np.arange(p.count, dtype=np.uint64)
            own = self.within(p.pos, self.owner == self.comm.rank, bounds_of(p.pos))
            p.spare = int(spare * len(own))
            p.take(own)
            acc = state.own_acc.get(name)  # of a run that goes on
            if acc is not None and len(acc) > 0:
                state.own_acc[name] = acc[own]

    def deal(self, state: State) -> None:
        """Of particles of which each rank has a run of rows, in the order of ranks, bring all to their owners."""
        spare = self._spare([int(self.comm.reduced(p.count, MPI.SUM)) for p in state.species.values()])
        for name, p in state.species.items():
            before = self.comm.mpi.exscan(p.count) or 0
            p.place = np.arange(before, before + p.count, dtype=np.uint64)
            owner = self.owner[self.tile_of(p.pos)]
            route = Route(self.comm, by_rank(np.arange(p.count), owner, self.comm.size))
            order = np.argsort(route.send(p.place))
            p.spare = int(spare * len(order))
            for array_name, array in p.arrays().items():
                held = room.empty(len(order), array, p.spare)
                setattr(p, array_name, np.take(route.send(array), order, axis=0, out=held))
            if name in state.own_acc and self.comm.mpi.allreduce(len(state.own_acc[name])) > 0:
                state.own_acc[name] = route.send(state.own_acc[name])[order]

    def settle(self, species: dict[str, Particles]) -> None:
        """Bring particles to their owners, once they have moved."""
        self.forget()
        for particles in species.values():
            self._migrate(particles)

    def _migrate(self, particles: Particles) -> None:
        bounds = bounds_of(particles.pos)
        near = self.within(particles.pos, ~self.inside, bounds)
        owner = np.empty(len(near), np.int64)
        share(owners_of, len(near), near, particles.pos, self.tiles, self.owner, owner)
        away = owner != self.comm.rank
        if self.comm.reduced(int(np.count_nonzero(away)), MPI.MAX):
            route = Route(self.comm, by_rank(near[away], owner[away], self.comm.size))
            arrays, known = particles.arrays(), len(particles.loose)
            particles.replace(near[away], dict(zip(arrays, route.send_all([*arrays.values()]), strict=True)))
            near = near[~away]
            changed = particles.loose[known:]
            near = np.concatenate([near[near < particles.count], changed])
            bounds = bounds_anew(bounds, particles.pos, changed)
        self._known.append((weakref.ref(particles.pos), near, bounds))


def hilbert(x: Array, y: Array, bits: int) -> Array:
    """Place (n,) along the Hilbert curve of whole numbers x, y (n,) below 2^bits."""
    x, y, out = x.copy(), y.copy(), np.zeros_like(x)
    for k in range(bits - 1, -1, -1):
        right, up = x >> k & 1, y >> k & 1
        out += (3 * right ^ up) << 2 * k
        # Turn the quadrant, so that the curve begins and ends where its neighbours do.
        turned = up == 0
        flipped = turned & (right == 1)
        x, y = np.where(flipped, ~x, x), np.where(flipped, ~y, y)
        x, y = np.where(turned, y, x), np.where(turned, x, y)
        x, y = x & (1 << k) - 1, y & (1 << k) - 1
    return out
