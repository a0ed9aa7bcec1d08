"""The nodes of the grid that ranks have: those that their particles touch, in each row from one column up to another.

In a periodic box a window that meets an edge has all nodes along that axis, and each row is whole.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import reduce
from typing import NamedTuple

import numpy as np

from discsim.kernels.grid import BAND
from discsim.kernels.tiles import put_spans, take_spans
from discsim.numerics.grid import BORDER, Extent, Grid
from discsim.numerics.threads import share
from discsim.ranks.comm import Comm

Array = np.ndarray


class Windows(NamedTuple):
    """Of each rank the nodes from `low` up to `high` (ranks, 2), and how many more on either side, `ring` (ranks, 2), a
    gradient in them asks for; off: how many particles are off the grid.

    least, most (ranks, bands + 2): the first nodes along y about its particles, in bands of rows and beyond these.
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
        """About particles of some species of each rank."""
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
        """About the particles of each rank: their least and largest first nodes along x, `ends` (2, ranks), and along
        y, `bands` (2, ranks, bands).
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
        """Where nodes of `ranks` begin and end (ranks, rows) in `rows` of the grid, of which some may be beyond its
        edges; with their ring or without.
        """
        low, high, beyond = self.low[ranks, :, None], self.high[ranks, :, None], BORDER * ring
        if ring:
            low, high = low - self.ring[ranks, :, None], high + self.ring[ranks, :, None]
        begin, end = low[:, 1], high[:, 1]
        if not self.periodic:
            # A row has nodes of particles whose first ones are in it and in the row before.
            bands = (rows - 1 - beyond) // BAND + 1, (rows + beyond) // BAND + 1
            least, most = ([each[ranks][:, band] for band in bands] for each in (self.least, self.most))
            begin, end = np.minimum(*least) - beyond, np.maximum(*most) + 2 + beyond
        inside = (rows >= low[:, 0]) & (rows < high[:, 0])
        return np.broadcast_to(begin, inside.shape), np.where(inside, np.maximum(begin, end), begin)


def joined(one: Extent, other: Extent) -> Extent:
    """Of two species."""
    least, most = np.minimum(one.least, other.least), np.maximum(one.most, other.most)
    return Extent(least, most, min(one.low, other.low), max(one.high, other.high), one.off + other.off)


def no_nodes(grid: Grid, ranks: int) -> tuple[Array, Array]:
    """What `Windows.about` takes, of ranks without particles."""
    nx, ny = grid.shape
    ends, bands = np.full((2, ranks), -1), np.full((2, ranks, (nx - 1) // BAND + 1), -1)
    ends[0], bands[0] = nx, ny
    return ends, bands


class Rows(NamedTuple):
    """Pieces of the rows `row` (n,) of an array, from columns `begin` up to `end` (n,), which lie one after another
    where they are sent, from `start` (n + 1,) on.
    """

    row: Array
    begin: Array
    end: Array
    start: Array

    @classmethod
    def of(cls, row: Array, begin: Array, end: Array) -> Rows:
        return cls(row, begin, end, np.append(0, np.cumsum(end - begin)))

    def take(self, field: Array) -> Array:
        """Their entries (m,) of a field (x, y)."""
        out = np.empty(int(self.start[-1]))
        share(take_spans, len(self.row), field, *self, out, least=64)  # rows
        return out

    def put(self, found: Array, field: Array, add: bool = False) -> None:
        """Let them be `found` (m,) in a field (x, y), or `add` these: rows may come several times."""
        put_spans(found, *self, add, field)
