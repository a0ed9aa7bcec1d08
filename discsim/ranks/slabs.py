"""Potential of a grid divided among ranks: `numerics/poisson.py` by slabs, with the same bits.

A rank transforms some batches of rows along y. An all-to-all exchange then brings it whole tiles of columns. It
transforms these along x, multiplies them by its columns of the kernel, and transforms them back. A second exchange
brings them to its rows again. Batches are those of one rank, and so are the results of FFT plans.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.fft import dct

from discsim.kernels.gravity.poisson import TILE
from discsim.numerics import thread_pool
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
    """Slab of a rank, of a grid (nx, ny) with `border` more nodes on every side.

    rows: rows of each rank; those of the grid are followed by nodes beyond the last and then by those before the
    first. density (held, ny): input, at the `held` rows in the grid. potential (rows, ny + 2 border): output.
    by_rows, by_tiles: memory that only `solve` needs.
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
        self._workers = Workers(padded, periodic, border, thread_pool.number_of_threads())
        self._turn = Turn(comm, self._tiles, self.rows)

    def solve(self) -> None:
        """Compute the potential of the density of all ranks."""
        by_rows, by_tiles, each = self.by_rows, self.by_tiles, self._workers.each
        each(lambda worker, batch: worker.forward(self.density, batch * ROWS, by_rows), -(-self.held // ROWS))
        self._turn.forth(by_rows, by_tiles)
        each(lambda worker, tile: worker.convolve(by_tiles, tile, self._kernel), len(by_tiles))
        self._turn.back(by_tiles, by_rows)
        batches = -(-len(self.potential) // ROWS)
        each(lambda worker, batch: worker.backward(by_rows, batch * ROWS, self.potential, 0), batches)

    def _transform(self, padded: tuple[int, int], cell: float, kernel: Kernel, periodic: bool) -> Array:
        """Return the rows of the kernel's transform (ky, kx) for this rank's tiles."""
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
        Turn(self.comm, of_ky, of_x).forth(given, taken)
        return even_first(dct(taken, type=1, axis=1)) if taken.size > 0 else taken


class Turn(NamedTuple):
    """Exchange between two divisions of an array (m, n, ...) among ranks.

    Before and after it a rank has all along one axis, and its share along the other.
    """

    comm: Comm
    along_first: Share
    along_second: Share

    def forth(self, given: Array, taken: Array) -> None:
        """Exchange from arrays with the whole first axis to arrays with the whole second axis."""
        self.comm.swap(given, self._rows(given), taken, self._columns(taken))

    def back(self, given: Array, taken: Array) -> None:
        """Exchange from arrays with the whole second axis to arrays with the whole first axis."""
        self.comm.swap(given, self._columns(given), taken, self._rows(taken))

    def _rows(self, array: Array) -> list[Array]:
        """Return the share of each rank along the first axis."""
        return [array[self.along_first.span(rank)] for rank in range(self.comm.size)]

    def _columns(self, array: Array) -> list[Array]:
        """Return the share of each rank along the second axis."""
        return [array[:, self.along_second.span(rank)] for rank in range(self.comm.size)]
