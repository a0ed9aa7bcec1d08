"""The field of a rank's particles beside those of others: `numerics/mesh.py` with the part of the grid that it needs.

A node belongs to who owns its tile of space, who fetches the particles about it that others have, and sums it as one
rank does. A rank has a window of nodes: those about its own particles and the fetched ones. Its own nodes go to the
slabs that have their rows (`slabs.py`), and the potential of the window, with a ring for the gradient, comes back. In a
periodic box a window that meets an edge has all nodes along that axis. A sheet in one dimension is solved by each rank.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from mpi4py import MPI

from discsim.kernels.tiles import leave_own, others_about, pieces_of
from discsim.numerics.grid import BORDER, Grid, Node
from discsim.numerics.mesh import Mesh
from discsim.numerics.poisson import Kernel
from discsim.numerics.state import Particles
from discsim.numerics.threads import share
from discsim.ranks.comm import Route, by_rank
from discsim.ranks.division import Division
from discsim.ranks.exchange import Wide, joined
from discsim.ranks.slabs import Slabs

Array = np.ndarray
Pieces = tuple[Array, Array]  # of rows: their first ones and ends, as `Grid.deposit` has them


class Nodes:
    """Whose the nodes of a grid are."""

    def __init__(self, grid: Grid, division: Division) -> None:
        self.grid, self.division, self.comm = grid, division, division.comm
        along = division.along - 1
        places = [np.clip((grid.nodes(axis) - division.low[0]) * division.per_tile, 0, along) for axis in range(2)]
        if grid.shape[1] == 1:
            places[1][:] = 0.0
        self.tiles = places[0].astype(np.int64), places[1].astype(np.int64)

    @property
    def owner(self) -> Array:
        """Of each tile (along x, along y)."""
        return self.division.owner.reshape(self.division.along, -1)

    def leave_own(self, density: Array, first: Node) -> None:
        """Put 0 at the nodes of others, in a part of the grid."""
        x, y = (tiles[k : k + n] for tiles, k, n in zip(self.tiles, first, density.shape, strict=True))
        share(leave_own, len(x), x, y, self.owner, self.comm.rank, density, least=16)

    def about(self, particles: Particles) -> tuple[Array, Array, Pieces]:
        """Places and masses of own particles and of others about own nodes, and in which order sums go through them."""
        grid, pos = self.grid, particles.pos
        some = self.division.within(pos, ~self.division.inside(grid.cell))
        where = grid.origin, 1.0 / grid.cell, grid.periodic, self.tiles, self.owner, self.comm.rank
        found = share(others_about, len(some), some, pos, *where)  # few
        rows, whose = (joined([each[k] for each in found]) for k in range(2))
        wide = Wide(particles, Route(self.comm, by_rank(rows, whose, self.comm.size)))
        pos, mass = wide.of_all([pos, particles.mass])
        return pos, mass, _in_order(wide.place, particles.count, particles.loose)


def _in_order(place: Array, held: int, loose: Array) -> Pieces:
    """Rows by their `place` (n,), in pieces: of those `held` here it rises but for the `loose` ones."""
    loose = np.sort(loose[loose < held])
    loose = loose[np.append(True, loose[1:] != loose[:-1])[: len(loose)]]
    others = np.concatenate([loose, np.arange(held, len(place))])
    first, last, rises = pieces_of(place, held, loose, others[np.argsort(place[others])])
    if not rises:  # arrays of another making
        first = np.argsort(place)
        last = first + 1
    return first, last


class Window(NamedTuple):
    """Part of a grid: its first node, how many it has along each axis, and how many more beyond on either side."""

    first: Node
    shape: tuple[int, int]
    ring: tuple[int, int]

    @classmethod
    def about(cls, least: Array, most: Array, grid: Grid) -> Window:
        """With the nodes from `least` (2,) to one beyond `most`."""
        axes = []
        for low, high, count in zip(least.tolist(), most.tolist(), grid.shape, strict=True):
            if low > high:
                axes.append((0, 0, 0))
            elif grid.periodic and (low < BORDER or high + 1 + BORDER >= count):
                axes.append((0, count, 0))
            else:
                axes.append((low, high + 2 - low, BORDER))
        (x, nx, ring_x), (y, ny, ring_y) = axes
        return cls((x, y), (nx, ny), (ring_x, ring_y))

    @property
    def ringed(self) -> tuple[int, int]:
        """Its shape with its ring."""
        return self.shape[0] + 2 * self.ring[0], self.shape[1] + 2 * self.ring[1]

    def own_rows(self, rows: slice) -> slice:
        """Of `rows` of the grid those that it has."""
        return _overlap(slice(self.first[0], self.first[0] + self.shape[0]), rows)

    def rows(self, rows: slice, count: int) -> Iterator[tuple[slice, int]]:
        """Of `rows` of a slab those that it has with its ring, and which of its own the first of these is.

        Nodes before the first are the last of `count`.
        """
        begin, end = self.first[0] - self.ring[0], self.first[0] + self.shape[0] + self.ring[0]
        for shift in (0, count):
            some = _overlap(slice(max(begin + shift, 0), min(end + shift, count)), rows)
            if some.stop > some.start:
                yield some, some.start - begin - shift


def _overlap(one: slice, other: slice) -> slice:
    first = max(one.start, other.start)
    return slice(first, max(first, min(one.stop, other.stop)))


class DividedMesh(Mesh):
    """`Mesh` of a rank, with the nodes of its window."""

    def __init__(self, grid: Grid, kernel: Kernel, division: Division) -> None:
        super().__init__(grid, kernel)
        self.nodes, self.comm = Nodes(grid, division), division.comm
        self.slabs = Slabs(self.comm, grid.shape, grid.cell, kernel, grid.periodic, self.border)
        # What is made before the slabs are solved, or after that, may have memory that only they need.
        memory = {"density": self.slabs.by_rows, "gradient": self.slabs.by_tiles}
        self._kept = {name: array.reshape(-1).view(float) for name, array in memory.items()}

    def solve(self, species: Mapping[str, Particles], sources: Iterable[str]) -> None:
        given = {name: self.nodes.about(species[name]) for name in sources}
        windows, off = self._windows(given[name][0] if name in given else p.pos for name, p in species.items())
        here = windows[self.comm.rank]
        self.first, self.density = here.first, self._room("density", here.shape)
        self.density[:] = 0.0
        if self.density.size > 0:
            for pos, mass, pieces in given.values():
                self.grid.deposit(pos, mass, self.density, here.first, pieces)
            self.nodes.leave_own(self.density, here.first)
        self._to_slabs(windows)
        self.slabs.solve()
        self._to_windows(windows)
        self._sums = self._summed() if off else (np.zeros(0), np.zeros(0))

    def differentiate(self) -> None:
        self._gradient = self._room("gradient", (*self.density.shape, 2))
        if self._gradient.size > 0:
            super().differentiate()

    def sums(self) -> tuple[Array, Array]:
        return self._sums

    def _room(self, name: str, shape: tuple[int, ...]) -> Array:
        """An array that is kept while it is large enough."""
        size = int(np.prod(shape))
        if name not in self._kept or len(self._kept[name]) < size:
            self._kept[name] = np.empty(size)
        return self._kept[name][:size].reshape(shape)

    def _windows(self, places: Iterable[Array]) -> tuple[list[Window], bool]:
        """The window of each rank, and whether any particle of any of them is off the grid: none that is fetched is."""
        found = [self.grid.extent(pos) for pos in places]
        off = sum(number for _, number in found)
        least = np.min([extent[0] for extent, _ in found], axis=0)
        most = np.max([extent[1] for extent, _ in found], axis=0)
        all_ranks = self.comm.gathered(np.array([*least, *most, off]))
        windows = [Window.about(row[:2], row[2:4], self.grid) for row in all_ranks]
        return windows, bool(all_ranks[:, 4].any())

    def _to_slabs(self, windows: list[Window]) -> None:
        """The density of the windows to the slabs: of each node one number, and zeros."""
        rows, rank = self.slabs.rows, self.comm.rank
        held = slice(rows.edges[rank], rows.edges[rank] + self.slabs.held)
        mine = windows[rank]
        given = [_length(mine.own_rows(rows.span(other))) * mine.shape[1] for other in range(self.comm.size)]
        parts = [(window, window.own_rows(held)) for window in windows]
        taken = [_length(some) * window.shape[1] for window, some in parts]
        found = self.comm.deal(self.density.reshape(-1), np.array(given), np.array(taken))
        density, begin = self.slabs.density, 0
        density[:] = 0.0
        for (window, some), size in zip(parts, taken, strict=True):
            place = density[some.start - held.start : some.stop - held.start, _columns(window.first[1], window.shape)]
            place += found[begin : begin + size].reshape(place.shape)
            begin += size

    def _to_windows(self, windows: list[Window]) -> None:
        """The potential of the slabs to the windows with their rings."""
        rows, rank, count = self.slabs.rows, self.comm.rank, self.slabs.count
        held, blocks, given = rows.span(rank), [], []
        for window in windows:
            some = _columns(window.first[1] - window.ring[1] + self.border, window.ringed)
            parts = [part for part, _ in window.rows(held, count)]
            blocks += [self.slabs.potential[part.start - held.start : part.stop - held.start, some] for part in parts]
            given.append(sum(map(_length, parts)) * window.ringed[1])
        out, begin = np.empty(sum(given)), 0
        for block in blocks:
            out[begin : begin + block.size].reshape(block.shape)[:] = block
            begin += block.size
        here = windows[rank]
        places = [[*here.rows(rows.span(other), count)] for other in range(self.comm.size)]
        wide = here.ringed[1]
        taken = [sum(_length(part) for part, _ in parts) * wide for parts in places]
        found = self.comm.deal(out, np.array(given), np.array(taken))
        self._potential, begin = self._room("potential", here.ringed), 0
        for part, place in (each for parts in places for each in parts):
            number = _length(part)
            self._potential[place : place + number] = found[begin : begin + number * wide].reshape(number, wide)
            begin += number * wide

    def _summed(self) -> tuple[Array, Array]:
        """Sums of the density along y and along x, with the bits of those of one array.

        Along x rows are added one after another: in pieces of columns, from rank to rank.
        """
        density, rank, last = self.slabs.density, self.comm.rank, self.comm.size - 1
        rows = np.concatenate(self.comm.listed(density.sum(axis=1)))
        with self.comm.traffic.call(8 * self.grid.shape[1], self.comm.size):
            columns = np.zeros(self.grid.shape[1])
            edges = np.linspace(0, len(columns), self.comm.size + 1).astype(int).tolist()
            for begin, end in pairwise(edges):
                piece = columns[begin:end]
                if rank > 0:
                    self.comm.mpi.Recv(piece, rank - 1)
                for row in density[:, begin:end]:
                    piece += row
                if rank < last:
                    self.comm.mpi.Send(piece, rank + 1)
            self.comm.mpi.Bcast(columns, last)
        return rows, columns


def _length(rows: slice) -> int:
    return int(rows.stop - rows.start)


def _columns(first: int, shape: tuple[int, int]) -> slice:
    return slice(first, first + shape[1])


class DividedSheet(Mesh):
    """`Mesh` of a rank in one dimension: the whole of it."""

    def __init__(self, grid: Grid, kernel: Kernel, division: Division) -> None:
        super().__init__(grid, kernel)
        self.nodes, self.comm = Nodes(grid, division), division.comm

    def solve(self, species: Mapping[str, Particles], sources: Iterable[str]) -> None:
        self.density[:] = 0.0
        for name in sources:
            pos, mass, pieces = self.nodes.about(species[name])
            self.grid.deposit(pos, mass, self.density, pieces=pieces)
        self.nodes.leave_own(self.density, self.first)
        self.density[:] = self.comm.reduced(self.density, MPI.SUM)  # one number each, and zeros
        self._poisson.solve(self.density, out=self._potential)


def divided(mesh: Mesh, division: Division) -> Mesh:
    """A mesh as that of this rank."""
    kind = DividedSheet if mesh.grid.shape[1] == 1 else DividedMesh
    return kind(mesh.grid, mesh.kernel, division)
