"""Windows of the grid: the nodes that the particles of a rank touch, one range of columns (y) in each row (x).

With open edges the range differs from row to row. In a periodic box all rows of a window have the same columns, and a
window near an edge has all nodes along that axis.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import reduce
from typing import NamedTuple

import numpy as np

from discsim.kernels.common.grid import BAND
from discsim.kernels.mpi.tiles import copy_spans, write_spans
from discsim.numerics.grid import BORDER, Extent, Grid
from discsim.numerics.threads import parallel_for
from discsim.ranks.comm import Comm

Array = np.ndarray


class Windows(NamedTuple):
    """Windows of all ranks.

    low, high (ranks, 2): first node and end of the box of each window. ring (ranks, 2): width of the ring of nodes
    around the window that the gradient needs. least, most (ranks, bands + 2): smallest and largest index along y in
    each band of rows, as in `Extent`; the first and the last band are empty. off: number of particles off the grid.
    """

    low: Array
    high: Array
    ring: Array
    least: Array
    most: Array
    off: int
    periodic: bool

    @classmethod
    def agreed(cls, extents: Iterable[Extent], grid: Grid, comm: Comm) -> Windows:
        """Return the windows of all ranks. Collective.

        extents: ranges of nodes that the particles of each species on this rank touch.
        """
        mine = reduce(joined, extents)
        some = slice(mine.low // BAND, mine.high // BAND + 1)
        told = np.concatenate([[mine.low, mine.high, mine.off], mine.least[some], mine.most[some]])
        ends, bands = no_nodes(grid, comm.size)
        off = 0
        for rank, each in enumerate(comm.listed(told.astype(np.int32))):
            ends[:, rank], first, number = each[:2], each[0] // BAND, (len(each) - 3) // 2
            bands[:, rank, first : first + number] = each[3:].reshape(2, number)
            off += int(each[2])
        return cls.about(ends, bands, off, grid)

    @classmethod
    def about(cls, ends: Array, bands: Array, off: int, grid: Grid) -> Windows:
        """Return the windows of all ranks, from the nodes that their particles touch.

        Each particle is counted by the index of its first node along each axis, as in `Extent`. ends (2, ranks):
        smallest and largest index along x. bands (2, ranks, bands): smallest and largest index along y, in each band of
        rows. off: number of particles off the grid, on all ranks.
        """
        count = np.array(grid.shape)
        low, high = np.stack([ends, [bands[0].min(axis=1), bands[1].max(axis=1)]], axis=-1)
        empty = low > high
        whole = grid.periodic & ((low < BORDER) | (high + 1 + BORDER >= count))
        low, high = np.where(empty | whole, 0, low), np.where(empty, 0, np.where(whole, count, high + 2))
        none = no_nodes(grid, len(low))[1][:, :, :1]
        least, most = np.concatenate([none, bands, none], axis=2)
        return cls(low, high, np.where(empty | whole, 0, BORDER), least, most, off, grid.periodic)

    def shape(self, rank: int, ring: bool = False) -> tuple[int, int]:
        nx, ny = (self.high - self.low + 2 * ring * self.ring)[rank].tolist()
        return nx, ny

    def columns(self, ranks: slice, rows: Array, ring: bool = False) -> tuple[Array, Array]:
        """Return first column and end, (ranks, rows) each, of the windows of some ranks in some rows of the grid.

        Rows may be beyond the edges of the grid. ring: whether to include the rings of the windows.
        """
        low, high, beyond = self.low[ranks, :, None], self.high[ranks, :, None], BORDER * ring
        if ring:
            low, high = low - self.ring[ranks, :, None], high + self.ring[ranks, :, None]
        begin, end = low[:, 1], high[:, 1]
        if not self.periodic:
            # A row has nodes of particles whose first node is in it or in the row before.
            bands = (rows - 1 - beyond) // BAND + 1, (rows + beyond) // BAND + 1
            least, most = ([each[ranks][:, band] for band in bands] for each in (self.least, self.most))
            begin, end = np.minimum(*least) - beyond, np.maximum(*most) + 2 + beyond
        inside = (rows >= low[:, 0]) & (rows < high[:, 0])
        return np.broadcast_to(begin, inside.shape), np.where(inside, np.maximum(begin, end), begin)


def joined(one: Extent, other: Extent) -> Extent:
    """Return the range of nodes that the particles of two species touch, from the range of each."""
    least, most = np.minimum(one.least, other.least), np.maximum(one.most, other.most)
    return Extent(least, most, min(one.low, other.low), max(one.high, other.high), one.off + other.off)


def no_nodes(grid: Grid, ranks: int) -> tuple[Array, Array]:
    """Return the arguments `ends` and `bands` of `Windows.about` for ranks without particles."""
    nx, ny = grid.shape
    ends, bands = np.full((2, ranks), -1), np.full((2, ranks, (nx - 1) // BAND + 1), -1)
    ends[0], bands[0] = nx, ny
    return ends, bands


class Rows(NamedTuple):
    """Spans of columns in rows of an array, for messages.

    row, begin, end (n,): row, first column and end of each span. start (n + 1,): position of each span in a message,
    which has the spans one after another.
    """

    row: Array
    begin: Array
    end: Array
    start: Array

    @classmethod
    def of(cls, row: Array, begin: Array, end: Array) -> Rows:
        return cls(row, begin, end, np.append(0, np.cumsum(end - begin)))

    def take(self, field: Array) -> Array:
        """Return the entries (m,) of a field (x, y) in all spans."""
        out = np.empty(int(self.start[-1]))
        parallel_for(copy_spans, len(self.row), field, *self, out, least=64)  # rows
        return out

    def put(self, found: Array, field: Array, add: bool = False) -> None:
        """Set the entries of a field (x, y) in all spans to `found` (m,).

        add: whether to add `found` instead; a row may then be in several spans.
        """
        write_spans(found, *self, add, field)
