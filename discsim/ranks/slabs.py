"""Potential of a grid divided among ranks into slabs of rows, bitwise equal to that of `numerics/poisson.py`.

Each rank transforms its rows along y. After an all-to-all exchange it has whole tiles of columns. It transforms these
along x, multiplies them by the transform of the kernel, and transforms them back. A second exchange returns them to the
ranks that have their rows. Batches of rows are the same as on one rank, and so are the results of the FFT plans.
"""

from __future__ import annotations

from typing import NamedTuple

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
from discsim.ranks.comm import Comm
from discsim.ranks.shares import Share

Array = np.ndarray


class Slabs:
    """Slab of rows that a rank has, of a grid of `shape` (nx, ny) with `border` more nodes on every side.

    rows: division of all rows among ranks: first the nx rows of the grid, then the border after the last row, then the
    border before the first row. held: number of this rank's rows that are in the grid. density (held, ny): input.
    potential (n, ny + 2 border): output, for all n rows of this rank. by_rows, by_tiles: memory that only `solve` uses.
    """

    def __init__(
        self, comm: Comm, shape: tuple[int, int], cell: float, kernel: Kernel, periodic: bool, border: int
    ) -> None:
        self.comm, self.border, self.nx = comm, border, shape[0]
        self.count = shape[0] + 2 * border
        padded = padded_shape(shape, periodic)
        self.rows = Share.of(self.count, ROWS, comm.size)
        self._tiles = Share.of(tiles_of(padded), 1, comm.size)
        rows, tiles = self.rows.count(comm.rank), self._tiles.count(comm.rank)
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
        of_ky = Share([min(TILE * edge, modes) for edge in self._tiles.edges])
        rank = self.comm.rank
        if periodic:
            return periodic_transform(padded, cell, kernel, of_ky.span(rank))
        # A cosine transform along both axes, first along y, as in `scipy.fft.dctn`.
        of_x = Share.of(padded[0] // 2 + 1, 1, self.comm.size)
        given = open_kernel(padded, cell, kernel, of_x.span(rank))
        given = dct(given, type=1, axis=0) if given.size > 0 else given
        taken = np.empty((of_ky.count(rank), padded[0] // 2 + 1))
        AllToAll(self.comm, of_ky, of_x).gather_second_axis(given, taken)
        return even_first(dct(taken, type=1, axis=1)) if taken.size > 0 else taken


class AllToAll(NamedTuple):
    """All-to-all exchange between two divisions of an array (m, n, ...) among ranks.

    Before or after the exchange a rank has its range along one axis and the whole of the other axis.
    """

    comm: Comm
    along_first: Share
    along_second: Share

    def gather_second_axis(self, given: Array, taken: Array) -> None:
        """Send `given`, which has the whole first axis, and fill `taken`, which has the whole second axis."""
        self.comm.swap(given, self._rows(given), taken, self._columns(taken))

    def gather_first_axis(self, given: Array, taken: Array) -> None:
        """Send `given`, which has the whole second axis, and fill `taken`, which has the whole first axis."""
        self.comm.swap(given, self._columns(given), taken, self._rows(taken))

    def _rows(self, array: Array) -> list[Array]:
        """Return the parts of an array for each rank along the first axis."""
        return [array[self.along_first.span(rank)] for rank in range(self.comm.size)]

    def _columns(self, array: Array) -> list[Array]:
        """Return the parts of an array for each rank along the second axis."""
        return [array[:, self.along_second.span(rank)] for rank in range(self.comm.size)]
