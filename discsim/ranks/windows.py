"""Windows of the grid: the nodes that the particles of a rank touch, one range of columns (y) in each row (x).

With open edges the range differs from row to row. In a periodic box all rows of a window have the same columns, and a
window near an edge has all nodes along that axis. The ring of a window is the nodes next to it that the gradient at its
nodes also needs.
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

    low, high (ranks, 2): first node, and end, of the smallest rectangle that contains each window. ring (ranks, 2):
    width of the ring along each axis; 0 where the window has all nodes. least, most (ranks, bands + 2): smallest and
    largest index along y in each band of rows, as in `Extent`; the first and the last band are empty. off: number of
    particles off the grid, on all ranks. periodic: whether the grid is periodic.
    """

    low: Array
    high: Array
    ring: Array
    least: Array
    most: Array
    off: int
    periodic: bool

    @classmethod
    def gather(cls, extents: Iterable[Extent], grid: Grid, comm: Comm) -> Windows:
        """Return the windows of all ranks. Collective.

        extents: ranges of nodes that the particles of each species on this rank touch.
        """
        own = reduce(combine_extents, extents)
        some = slice(own.low // BAND, own.high // BAND + 1)
        sent = np.concatenate([[own.low, own.high, own.off], own.least[some], own.most[some]])
        ends, bands = empty_node_ranges(grid, comm.size)
        off = 0
        for rank, each in enumerate(comm.allgatherv(sent.astype(np.int32))):
            ends[:, rank], first, number = each[:2], each[0] // BAND, (len(each) - 3) // 2
            bands[:, rank, first : first + number] = each[3:].reshape(2, number)
            off += int(each[2])
        return cls.from_node_ranges(ends, bands, off, grid)

    @classmethod
    def from_node_ranges(cls, ends: Array, bands: Array, off: int, grid: Grid) -> Windows:
        """Return the windows of all ranks, from the ranges of the nodes that their particles touch.

        Along each axis a particle counts with the index of its first node, as in `Extent`. ends (2, ranks): smallest
        and largest index along x. bands (2, ranks, bands): smallest and largest index along y, in each band of rows.
        off: number of particles off the grid, on all ranks.
        """
        count = np.array(grid.shape)
        low, high = np.stack([ends, [bands[0].min(axis=1), bands[1].max(axis=1)]], axis=-1)
        empty = low > high
        whole = grid.periodic & ((low < BORDER) | (high + 1 + BORDER >= count))
        low, high = np.where(empty | whole, 0, low), np.where(empty, 0, np.where(whole, count, high + 2))
        none = empty_node_ranges(grid, len(low))[1][:, :, :1]
        least, most = np.concatenate([none, bands, none], axis=2)
        return cls(low, high, np.where(empty | whole, 0, BORDER), least, most, off, grid.periodic)

    def shape(self, rank: int, ring: bool = False) -> tuple[int, int]:
        """Return the numbers of nodes along x and y of the rectangle of a window; ring: whether to include the ring."""
        nx, ny = (self.high - self.low + 2 * ring * self.ring)[rank].tolist()
        return nx, ny

    def column_ranges(self, ranks: slice, rows: Array, ring: bool = False) -> tuple[Array, Array]:
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


def combine_extents(one: Extent, other: Extent) -> Extent:
    """Return the range of nodes that the particles of two species touch, from the range of each species."""
    least, most = np.minimum(one.least, other.least), np.maximum(one.most, other.most)
    return Extent(least, most, min(one.low, other.low), max(one.high, other.high), one.off + other.off)


def empty_node_ranges(grid: Grid, ranks: int) -> tuple[Array, Array]:
    """Return the arguments `ends` and `bands` of `Windows.from_node_ranges` for ranks without particles."""
    nx, ny = grid.shape
    ends, bands = np.full((2, ranks), -1), np.full((2, ranks, (nx - 1) // BAND + 1), -1)
    ends[0], bands[0] = nx, ny
    return ends, bands


class Spans(NamedTuple):
    """Spans of columns in rows of an array, which a message contains one after another.

    row, begin, end (n,): row, first column and end of each span. start (n + 1,): index in the message at which each
    span begins; the last entry is the length of the message.
    """

    row: Array
    begin: Array
    end: Array
    start: Array

    @classmethod
    def from_columns(cls, row: Array, begin: Array, end: Array) -> Spans:
        """Return spans with these rows and ranges of columns, (n,) each."""
        return cls(row, begin, end, np.append(0, np.cumsum(end - begin)))

    def pack(self, field: Array) -> Array:
        """Return a message (m,) with the entries of a field (x, y) in all spans."""
        out = np.empty(int(self.start[-1]))
        parallel_for(copy_spans, len(self.row), field, *self, out, least=64)  # rows
        return out

    def unpack(self, message: Array, field: Array, add: bool = False) -> None:
        """Write a message (m,) to the entries of a field (x, y) in all spans.

        add: whether to add the message to these entries instead; a row may then be in several spans.
        """
        write_spans(message, *self, add, field)
