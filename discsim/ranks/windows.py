"""Windows of the grid on ranks: the nodes that their particles touch, from one column up to another in each row.

In a periodic box a window that touches an edge has all nodes along that axis, and every row has the whole window's
columns.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import reduce
from typing import NamedTuple

import numpy as np

from discsim.kernels.common.grid import BAND
from discsim.kernels.mpi.tiles import put_spans, take_spans
from discsim.numerics.grid import BORDER, Extent, Grid
from discsim.numerics.threads import parallel_for
from discsim.ranks.comm import Comm

Array = np.ndarray


class Windows(NamedTuple):
    """Windows of all ranks: nodes from `low` up to `high` (ranks, 2), and a ring for the gradient.

    ring (ranks, 2): its width on each side. least, most (ranks, bands + 2): range of the first nodes along y of a
    rank's particles, in each band of rows; the first and the last band are empty. off: number of particles off the
    grid.
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
        """Return windows about the particles of some species of each rank. Collective."""
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
        """Return windows about the particles of each rank.

        ends (2, ranks): least and largest first nodes of particles along x. bands (2, ranks, bands): the same along
        y, by bands of rows.
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
        """Return where the nodes of `ranks` begin and end (ranks, rows) in `rows` of the grid.

        ring: with their ring. Some rows may be beyond the edges of the grid.
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
    """Return the extent of two species together."""
    least, most = np.minimum(one.least, other.least), np.maximum(one.most, other.most)
    return Extent(least, most, min(one.low, other.low), max(one.high, other.high), one.off + other.off)


def no_nodes(grid: Grid, ranks: int) -> tuple[Array, Array]:
    """Return the arguments of `Windows.about` for ranks without particles."""
    nx, ny = grid.shape
    ends, bands = np.full((2, ranks), -1), np.full((2, ranks, (nx - 1) // BAND + 1), -1)
    ends[0], bands[0] = nx, ny
    return ends, bands


class Rows(NamedTuple):
    """Spans of the rows `row` (n,) of an array, from columns `begin` up to `end` (n,).

    A message has them one after another, from `start` (n + 1,) on.
    """

    row: Array
    begin: Array
    end: Array
    start: Array

    @classmethod
    def of(cls, row: Array, begin: Array, end: Array) -> Rows:
        return cls(row, begin, end, np.append(0, np.cumsum(end - begin)))

    def take(self, field: Array) -> Array:
        """Return the entries (m,) of the spans in a field (x, y)."""
        out = np.empty(int(self.start[-1]))
        parallel_for(take_spans, len(self.row), field, *self, out, least=64)  # rows
        return out

    def put(self, found: Array, field: Array, add: bool = False) -> None:
        """Set the spans of a field (x, y) to `found` (m,), or `add` these: rows may occur several times."""
        put_spans(found, *self, add, field)
