"""Self-gravity on several ranks: `numerics/mesh.py` with the part of the grid that a rank needs.

A node of the grid belongs to the rank that owns its tile of space (`division.py`). This rank fetches the ghosts near
the node, and sums its density in the same order as on one rank. Each rank has a window of the nodes that its particles
touch (`windows.py`). It sends the density at its nodes to the ranks whose slabs have their rows (`slabs.py`). It
receives the potential at all nodes of the window, and in the ring around the window that the gradient needs. In one
dimension each rank computes the potential on the whole grid.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import pairwise, starmap
from typing import NamedTuple

import numpy as np
from mpi4py import MPI

from discsim.kernels.mpi.tiles import particles_near_other_ranks, rows_in_global_order, zero_nodes_of_others
from discsim.numerics.batches import update_bounds
from discsim.numerics.grid import Grid, Node
from discsim.numerics.mesh import Mesh
from discsim.numerics.poisson import Kernel
from discsim.numerics.state import Particles
from discsim.numerics.threads import parallel_for
from discsim.ranks.comm import Route, group_by_rank
from discsim.ranks.division import Division
from discsim.ranks.exchange import FetchedGhosts, concatenate, sorted_distinct
from discsim.ranks.slabs import SlabPoisson
from discsim.ranks.windows import Spans, Windows

Array = np.ndarray
NO_ROWS = np.empty(0, np.int64)
RowRanges = tuple[Array, Array]  # first rows and ends of ranges, as in `Grid.deposit`


class Sources(NamedTuple):
    """Local particles of a species, and the ghosts that touch the nodes of this rank.

    pos (n, d): positions. bounds: bounds of the batches of `pos`. mass (n,): masses. pieces: ranges of rows in the
    order of summation, as in `Grid.deposit`.
    """

    pos: Array
    bounds: Array
    mass: Array
    pieces: RowRanges


class Nodes:
    """Nodes of a grid, and the ranks that own them.

    tiles: two arrays, (nx,) and (ny,), the index along x and along y of the tile that contains each node.
    """

    def __init__(self, grid: Grid, division: Division) -> None:
        self.grid, self.division, self.comm = grid, division, division.comm
        division.margin = (1.0 + 1e-6) * grid.cell  # with a margin for rounding
        last = division.along - 1
        x, y = (np.clip((grid.nodes(k) - division.low[0]) * division.tiles_per_length, 0, last) for k in range(2))
        if grid.shape[1] == 1:
            y[:] = 0.0
        self.tiles = x.astype(np.int64), y.astype(np.int64)

    @property
    def owner(self) -> Array:
        """Rank that owns each tile, (tiles along x, tiles along y)."""
        return self.division.owner.reshape(self.division.along, -1)

    def clear_others(self, density: Array, first: Node, begin: Array, end: Array) -> None:
        """Set `density` to 0 at the nodes of other ranks.

        density (nx, ny): field on a part of the grid that begins at the node `first`. begin, end (nx,): first column
        and end in each row of this part; other columns are not changed.
        """
        x, y = (tiles[k : k + n] for tiles, k, n in zip(self.tiles, first, density.shape, strict=True))
        parallel_for(zero_nodes_of_others, len(x), x, y, self.owner, self.comm.rank, begin, end, density, least=16)

    def sources(self, particles: Particles) -> Sources:
        """Return the particles from which the density at this rank's nodes is summed, for one species. Collective."""
        grid, pos = self.grid, particles.pos
        some = self.division.rows_near_border(pos)
        where = grid.origin, 1.0 / grid.cell, grid.periodic, self.tiles, self.owner, self.comm.rank
        found = parallel_for(particles_near_other_ranks, len(some), some, pos, *where)  # few
        rows, ranks = (concatenate([each[k] for each in found]) for k in range(2))
        both = FetchedGhosts(particles, Route(self.comm, group_by_rank(rows, ranks, self.comm.size)))
        pos, mass = both.all_with_ghosts([pos, particles.mass])
        bounds = update_bounds(self.division.bounds(particles.pos), pos, NO_ROWS)
        order = _ranges_in_global_order(both.global_index, particles.count, particles.unsorted_rows)
        return Sources(pos, bounds, mass, order)


def _ranges_in_global_order(global_index: Array, local_count: int, unsorted_rows: Array) -> RowRanges:
    """Return the order of the keys `global_index` (n,), as ranges of rows: the first row of each range, and its end.

    The keys of the first `local_count` rows ascend, except in the rows `unsorted_rows`.
    """
    unsorted_rows = sorted_distinct(unsorted_rows[unsorted_rows < local_count])
    others = np.concatenate([unsorted_rows, np.arange(local_count, len(global_index))])
    in_order = np.argsort(global_index[others], kind="stable")  # stable: 3 times as fast, as keys mostly ascend
    first, end, ascends = rows_in_global_order(global_index, local_count, unsorted_rows, others[in_order])
    if not ascends:  # arrays in another order
        first = np.argsort(global_index)
        end = first + 1
    return first, end


class DividedMesh(Mesh):
    """`Mesh` of one rank of several, with fields at the nodes of its window."""

    def __init__(self, grid: Grid, kernel: Kernel, division: Division) -> None:
        super().__init__(grid, kernel)
        self.nodes, self.comm = Nodes(grid, division), division.comm
        self.slabs = SlabPoisson(self.comm, grid.shape, grid.cell, kernel, grid.periodic, self.border)
        # The density is needed only before `slabs.solve`, the gradient only after it: they use the memory of the slabs.
        memory = {"density": self.slabs.by_rows, "gradient": self.slabs.by_tiles}
        self._memory = {name: array.reshape(-1).view(float) for name, array in memory.items()}

    def solve(self, species: Mapping[str, Particles], sources: Iterable[str]) -> None:
        given = {name: self.nodes.sources(species[name]) for name in sources}
        positions = (
            given[name][:2] if name in given else (p.pos, self.nodes.division.bounds(p.pos))
            for name, p in species.items()
        )
        self.windows = windows = Windows.gather(starmap(self.grid.extent, positions), self.grid, self.comm)
        x, y = windows.low[self.comm.rank].tolist()
        self.first, self.density = (x, y), self._reused_array("density", windows.shape(self.comm.rank))
        self.density[:] = 0.0
        self._spans = spans = self._spans_of_window()
        if self.density.size > 0:
            for pos, _, mass, pieces in given.values():
                self.grid.deposit(pos, mass, self.density, self.first, pieces)
            self.nodes.clear_others(self.density, self.first, spans.begin, spans.end)
        self._send_density_to_slabs()
        self.slabs.solve()
        self._send_potential_to_windows()
        self._sums = self._summed_density() if windows.off else (np.zeros(0), np.zeros(0))

    def differentiate(self) -> None:
        self._gradient = self._reused_array("gradient", (*self.density.shape, 2))
        if self._gradient.size > 0:
            self.grid.gradient(self._potential, self._gradient, (self._spans.begin, self._spans.end))

    def density_sums(self) -> tuple[Array, Array]:
        return self._sums

    def _reused_array(self, name: str, shape: tuple[int, ...]) -> Array:
        """Return an array of `shape` in the memory stored under `name`, which is allocated again if it is too small."""
        size = int(np.prod(shape))
        if name not in self._memory or len(self._memory[name]) < size:
            self._memory[name] = np.empty(size)
        return self._memory[name][:size].reshape(shape)

    def _spans_of_window(self) -> Spans:
        """Return the spans of columns in the rows of this rank's window, without its ring."""
        rank, (x, y) = self.comm.rank, self.first
        rows = np.arange(x, x + self.density.shape[0])
        begin, end = (ends[0] - y for ends in self.windows.column_ranges(slice(rank, rank + 1), rows))
        return Spans.from_columns(rows - x, begin, end)

    def _send_density_to_slabs(self) -> None:
        """Send the density from the windows to the slabs, and add the values of all ranks at each node.

        Only the value from the owner of a node is not 0.
        """
        slabs, first, spans = self.slabs, self.slabs.rows.edges[self.comm.rank], self._spans
        columns = self.windows.column_ranges(slice(None), np.arange(first, first + slabs.held))
        ends = np.clip(np.array(slabs.rows.edges) - self.first[0], 0, len(spans.row))
        send_counts, receive_counts = np.diff(spans.start[ends]), (columns[1] - columns[0]).sum(axis=1)
        message = self.comm.alltoallv(spans.pack(self.density), send_counts, receive_counts)
        slabs.density[:] = 0.0
        rows = np.tile(np.arange(slabs.held), self.comm.size)
        Spans.from_columns(rows, *(each.ravel() for each in columns)).unpack(message, slabs.density, add=True)

    def _send_potential_to_windows(self) -> None:
        """Send the potential from the slabs to the windows, including their rings."""
        slabs, rank, size, border = self.slabs, self.comm.rank, self.comm.size, self.border
        held = np.arange(*slabs.rows.edges[rank : rank + 2])
        begin, end = self.windows.column_ranges(slice(None), nodes_of_slab_rows(held, slabs.nx, border), ring=True)
        rows = np.tile(np.arange(len(held)), size)
        sent = Spans.from_columns(rows, begin.ravel() + border, end.ravel() + border)
        shape, (x, y) = self.windows.shape(rank, ring=True), (self.windows.low - self.windows.ring)[rank].tolist()
        nodes = np.arange(x, x + shape[0])
        nodes = nodes[np.argsort(nodes % slabs.count)]  # in the order of slabs
        columns = self.windows.column_ranges(slice(rank, rank + 1), nodes, ring=True)
        received = Spans.from_columns(nodes - x, *(each[0] - y for each in columns))
        ends = np.searchsorted(nodes % slabs.count, slabs.rows.edges)
        send_counts, receive_counts = (end - begin).sum(axis=1), np.diff(received.start[ends])
        message = self.comm.alltoallv(sent.pack(slabs.potential), send_counts, receive_counts)
        self._potential = self._reused_array("potential", shape)
        received.unpack(message, self._potential)

    def _summed_density(self) -> tuple[Array, Array]:
        """Return the density summed along y (nx,) and along x (ny,), bitwise equal to the sums on one rank. Collective.

        For the sum along x, rows are added one after another: each rank adds its rows to a part of the columns, and
        sends this part to the next rank.
        """
        density, rank, last = self.slabs.density, self.comm.rank, self.comm.size - 1
        rows = np.concatenate(self.comm.allgatherv(density.sum(axis=1)))
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


def nodes_of_slab_rows(rows: Array, nx: int, border: int) -> Array:
    """Return the index along x (n,) of the grid nodes in each of some `rows` (n,) of the slabs.

    The last `border` rows of the slabs have negative indices: they are the border before the first of the `nx` nodes.
    """
    return np.where(rows < nx + border, rows, rows - nx - 2 * border)


class DividedSheet(Mesh):
    """`Mesh` of one rank of several in one dimension, with the whole grid."""

    def __init__(self, grid: Grid, kernel: Kernel, division: Division) -> None:
        super().__init__(grid, kernel)
        self.nodes, self.comm = Nodes(grid, division), division.comm

    def solve(self, species: Mapping[str, Particles], sources: Iterable[str]) -> None:
        self.density[:] = 0.0
        for name in sources:
            pos, _, mass, pieces = self.nodes.sources(species[name])
            self.grid.deposit(pos, mass, self.density, pieces=pieces)
        self.nodes.clear_others(self.density, self.first, *np.array([[0], [1]]).repeat(len(self.density), axis=1))
        self.density[:] = self.comm.allreduce(self.density, MPI.SUM)  # the value of a node's owner, and zeros
        self._poisson.solve(self.density, out=self._potential)


def divided_mesh(mesh: Mesh, division: Division) -> Mesh:
    """Return the mesh of this rank that replaces `mesh`, the mesh of a serial run."""
    kind = DividedSheet if mesh.grid.shape[1] == 1 else DividedMesh
    return kind(mesh.grid, mesh.kernel, division)
