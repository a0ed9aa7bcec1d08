"""Potential on a grid by slab decomposition, bitwise equal to the potential of `numerics/poisson.py`.

Each rank has a slab of consecutive rows, and transforms these along y. After an all-to-all exchange it has whole
tiles of columns. It transforms these along x, multiplies them by the transform of the kernel, and transforms them
back. A second exchange returns the results to the ranks that have the rows. Batches of rows are the same as on one
rank, and so are the results of the FFT plans.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.fft import dct

from discsim.kernels.gravity.poisson import TILE
from discsim.numerics.poisson import (
    ROWS,
    Kernel,
    Workers,
    even_first,
    open_kernel,
    padded_shape,
    periodic_transform,
    tiles_of,
)

if TYPE_CHECKING:  # analysis/rank_sent.py imports this module where mpi4py is not installed
    from discsim.ranks.comm import Comm

Array = np.ndarray


class RankRanges(NamedTuple):
    """Division of consecutive items into one range for each rank, from `edges[rank]` up to `edges[rank + 1]`."""

    edges: list[int]

    @classmethod
    def divide(cls, count: int, unit: int, ranks: int) -> RankRanges:
        """Divide `count` items into ranges of about equal length, with edges at multiples of `unit` items."""
        units = -(-count // unit)
        return cls([min(unit * (units * rank // ranks), count) for rank in range(ranks + 1)])

    def slice_of_rank(self, rank: int) -> slice:
        return slice(self.edges[rank], self.edges[rank + 1])

    def count_of_rank(self, rank: int) -> int:
        return self.edges[rank + 1] - self.edges[rank]


class SlabPoisson:
    """Solver of the potential on a grid (nx, ny), extended by `border` nodes on every side.

    Each rank has a slab of rows. count: number of rows of the extended grid. The order of its rows is: the nx rows of
    the grid, the border after the last of them, and the border before the first of them. rows: range of rows of each
    rank. held: number of this rank's rows that are in the grid. density (held, ny): input of `solve`. potential (n, ny
    + 2 border): output, where n is the number of rows of this rank. by_rows, by_tiles: memory that only `solve` uses.
    """

    def __init__(
        self, comm: Comm, shape: tuple[int, int], cell: float, kernel: Kernel, periodic: bool, border: int
    ) -> None:
        self.comm, self.border, self.nx = comm, border, shape[0]
        self.count = shape[0] + 2 * border
        padded = padded_shape(shape, periodic)
        self.rows = RankRanges.divide(self.count, ROWS, comm.size)
        self._tiles = RankRanges.divide(tiles_of(padded), 1, comm.size)
        rows, tiles = self.rows.count_of_rank(comm.rank), self._tiles.count_of_rank(comm.rank)
        self.held = max(0, min(rows, self.nx - self.rows.edges[comm.rank]))
        self.density = np.empty((self.held, shape[1]))
        self.potential = np.empty((rows, shape[1] + 2 * border))
        self.by_rows = np.empty((tiles_of(padded), rows, TILE), complex)
        self.by_tiles = np.empty((tiles, self.count, TILE), complex)
        self._kernel = self._transform(padded, cell, kernel, periodic) / (padded[0] * padded[1])
        self._workers = Workers(padded, periodic, border)
        self._exchange = AllToAll(comm, self._tiles, self.rows)

    def solve(self) -> None:
        """Compute `potential` from the `density` of all ranks. Collective."""
        by_rows, by_tiles, each = self.by_rows, self.by_tiles, self._workers.run_batches
        each(lambda worker, batch: worker.forward(self.density, batch * ROWS, by_rows), -(-self.held // ROWS))
        self._exchange.gather_second_axis(by_rows, by_tiles)
        each(lambda worker, tile: worker.convolve(by_tiles, tile, self._kernel), len(by_tiles))
        self._exchange.gather_first_axis(by_tiles, by_rows)
        batches = -(-len(self.potential) // ROWS)
        each(lambda worker, batch: worker.backward(by_rows, batch * ROWS, self.potential, 0), batches)

    def _transform(self, padded: tuple[int, int], cell: float, kernel: Kernel, periodic: bool) -> Array:
        """Return the part of the kernel's transform (ky, kx) for the tiles of this rank. Collective."""
        modes = padded[1] // 2 + 1
        along_ky = RankRanges([min(TILE * edge, modes) for edge in self._tiles.edges])
        rank = self.comm.rank
        if periodic:
            return periodic_transform(padded, cell, kernel, along_ky.slice_of_rank(rank))
        # A cosine transform along both axes, first along y, as in `scipy.fft.dctn`.
        along_x = RankRanges.divide(padded[0] // 2 + 1, 1, self.comm.size)
        sent = open_kernel(padded, cell, kernel, along_x.slice_of_rank(rank))
        sent = dct(sent, type=1, axis=0) if sent.size > 0 else sent
        received = np.empty((along_ky.count_of_rank(rank), padded[0] // 2 + 1))
        AllToAll(self.comm, along_ky, along_x).gather_second_axis(sent, received)
        return even_first(dct(received, type=1, axis=1)) if received.size > 0 else received


class AllToAll(NamedTuple):
    """All-to-all exchange between two divisions of an array (m, n, ...) among ranks.

    Before or after the exchange a rank has its range along one axis and the whole of the other axis. along_first,
    along_second: ranges along the two axes.
    """

    comm: Comm
    along_first: RankRanges
    along_second: RankRanges

    def gather_second_axis(self, sent: Array, received: Array) -> None:
        """Send `sent`, which has the whole first axis, and fill `received`, which has the whole second axis."""
        self.comm.alltoallw(sent, self._parts_of_first(sent), received, self._parts_of_second(received))

    def gather_first_axis(self, sent: Array, received: Array) -> None:
        """Send `sent`, which has the whole second axis, and fill `received`, which has the whole first axis."""
        self.comm.alltoallw(sent, self._parts_of_second(sent), received, self._parts_of_first(received))

    def _parts_of_first(self, array: Array) -> list[Array]:
        """Return the part of an array for each rank, a range along the first axis."""
        return [array[self.along_first.slice_of_rank(rank)] for rank in range(self.comm.size)]

    def _parts_of_second(self, array: Array) -> list[Array]:
        """Return the part of an array for each rank, a range along the second axis."""
        return [array[:, self.along_second.slice_of_rank(rank)] for rank in range(self.comm.size)]
