"""The potential of a grid that is divided among ranks: `numerics/poisson.py` by slabs, with the same bits.

A rank transforms some batches of rows along y; an exchange between all brings it some tiles of columns whole, which it
transforms along x, multiplies with the kernel, of which it has these columns alone, and transforms back; another one
brings them to its rows again. Batches are those of one rank, and so are what comes out of their plans.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from mpi4py import MPI
from scipy.fft import dct

from discsim.kernels.poisson import TILE
from discsim.numerics.poisson import (
    ROWS,
    Kernel,
    Workers,
    open_kernel,
    padded_shape,
    periodic_transform,
    tiles_of,
)
from discsim.ranks.comm import Comm

Array = np.ndarray


class Share(NamedTuple):
    """What each rank has of some things in a row: from `edges[rank]` to `edges[rank + 1]`."""

    edges: list[int]

    @classmethod
    def of(cls, count: int, size: int, ranks: int) -> Share:
        """Of `count`, in whole pieces of a `size`."""
        pieces = -(-count // size)
        return cls([min(size * (pieces * rank // ranks), count) for rank in range(ranks + 1)])

    def span(self, rank: int) -> slice:
        return slice(self.edges[rank], self.edges[rank + 1])

    def count(self, rank: int) -> int:
        return self.edges[rank + 1] - self.edges[rank]


class Slabs:
    """The slab of a rank of a grid (nx, ny) with `border` nodes more on every side.

    rows: those of the grid of each rank; nodes beyond the last and then those before the first follow as more rows.
    density (rows, ny): to be filled, of which rows from `held` on are beyond the grid. potential (rows, ny + 2 border).
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
        self._by_rows = np.empty((tiles_of(padded), rows, TILE), complex)
        self._by_tiles = np.empty((tiles, self.count, TILE), complex)
        self._kernel = self._transform(padded, cell, kernel, periodic) / (padded[0] * padded[1])
        self._workers = Workers(padded, border, numba.get_num_threads())
        self._types = self._parts()

    def solve(self) -> None:
        """The potential of the density, of all ranks."""
        by_rows, by_tiles, each = self._by_rows, self._by_tiles, self._workers.each
        each(lambda worker, batch: worker.forward(self.density, batch * ROWS, by_rows), -(-self.held // ROWS))
        of_rows, of_tiles = self._types
        self.comm.swap(by_rows, of_rows, by_tiles, of_tiles)
        by_tiles[:, self.nx :] = 0.0
        each(lambda worker, tile: worker.convolve(by_tiles, tile, self._kernel), len(by_tiles))
        self.comm.swap(by_tiles, of_tiles, by_rows, of_rows)
        batches = -(-len(self.potential) // ROWS)
        each(lambda worker, batch: worker.backward(by_rows, batch * ROWS, self.potential, 0), batches)

    def _parts(self) -> tuple[list[MPI.Datatype], list[MPI.Datatype]]:
        """What of its rows and of its tiles a rank exchanges with each other one."""
        ranks = range(self.comm.size)
        of_rows = [part_of(self._by_rows, 0, self._tiles.span(other)) for other in ranks]
        return of_rows, [part_of(self._by_tiles, 1, self.rows.span(other)) for other in ranks]

    def _transform(self, padded: tuple[int, int], cell: float, kernel: Kernel, periodic: bool) -> Array:
        """The rows of the kernel's transform (ky, kx) that this rank's tiles have."""
        modes = padded[1] // 2 + 1
        of_ky = Share([min(TILE * edge, modes) for edge in self._tiles.edges])
        rank, ranks = self.comm.rank, range(self.comm.size)
        if periodic:
            return periodic_transform(padded, cell, kernel, of_ky.span(rank))
        # A cosine transform along both axes, first that along y, as `scipy.fft.dctn` has it.
        of_x = Share.of(padded[0] // 2 + 1, 1, self.comm.size)
        given = open_kernel(padded, cell, kernel, of_x.span(rank))
        given = dct(given, type=1, axis=0) if given.size > 0 else given
        taken = np.empty((of_ky.count(rank), padded[0] // 2 + 1))
        sent = [part_of(given, 0, of_ky.span(other)) for other in ranks]
        places = [part_of(taken, 1, of_x.span(other)) for other in ranks]
        self.comm.swap(given, sent, taken, places)
        for part in (*sent, *places):
            part.Free()
        return dct(taken, type=1, axis=1) if taken.size > 0 else taken


def part_of(array: Array, axis: int, span: slice) -> MPI.Datatype:
    """A span along an axis of an array, as what is sent or received."""
    sides, start = list(array.shape), [0] * array.ndim
    sides[axis], start[axis] = span.stop - span.start, span.start
    if 0 in sides:
        return MPI.BYTE.Create_contiguous(0).Commit()
    of = MPI.C_DOUBLE_COMPLEX if array.dtype == complex else MPI.DOUBLE
    return of.Create_subarray(array.shape, sides, start).Commit()
