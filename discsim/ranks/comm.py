"""MPI operations of a run: reductions, and exchanges of rows of arrays. All calls are collective."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
from mpi4py import MPI

from discsim.ranks.traffic import Traffic

Array = np.ndarray
LONG_MESSAGE = 2048  # size in bytes above which MPI libraries reduce a message in parts


class Comm:
    """MPI communicator of a run; `traffic` measures the time, bytes and messages of its calls."""

    def __init__(self) -> None:
        self.mpi = MPI.COMM_WORLD.Dup()
        self.rank, self.size = self.mpi.rank, self.mpi.size
        self.traffic = Traffic(self.mpi)
        self._rounds = (self.size - 1).bit_length()  # rounds of messages in a collective call

    def reduced(self, values: Any, operation: MPI.Op) -> Any:
        """Return the element-wise reduction of `values`, a number or an array of any shape, over all ranks."""
        given = np.ascontiguousarray(values)
        if given.dtype == bool:
            given = given.astype(np.int64)
        out = np.empty_like(given)
        # Long arrays are reduced in parts, which are then gathered (Thakur, Rabenseifner & Gropp 2005).
        sent = given.nbytes * (self._rounds if given.nbytes <= LONG_MESSAGE else min(self._rounds, 2))
        with self.traffic.call(sent, self._rounds):
            self.mpi.Allreduce(given, out, operation)
        return out if isinstance(values, np.ndarray) else out.item()

    def gathered(self, array: Array) -> Array:
        """Return the arrays of all ranks stacked, (ranks, ...); `array` has the same shape on each rank."""
        out = np.empty((self.size, *array.shape), array.dtype)
        with self.traffic.call((self.size - 1) * array.nbytes, self._rounds):
            self.mpi.Allgather(np.ascontiguousarray(array), out)
        return out

    def listed(self, array: Array) -> list[Array]:
        """Return the arrays (n,) of all ranks as a list; their lengths may differ."""
        counts = self.gathered(np.array(len(array)))
        out = np.empty(int(counts.sum()), array.dtype)
        of = MPI.Datatype.fromcode(array.dtype.char)
        with self.traffic.call((self.size - 1) * array.nbytes, self._rounds):
            self.mpi.Allgatherv([np.ascontiguousarray(array), of], [out, counts, of])
        return np.split(out, np.cumsum(counts)[:-1])

    def deal(self, out: Array, given: Array, taken: Array) -> Array:
        """Send consecutive rows of `out` to the ranks, in rank order, and return the rows received, by source rank.

        given, taken (ranks,): numbers of rows sent to each rank, and received from each rank.
        """
        wide = math.prod(out.shape[1:])
        item = MPI.BYTE.Create_contiguous(max(out.itemsize * wide, 1)).Commit()
        found = np.empty((int(taken.sum()), *out.shape[1:]), out.dtype)
        starts = [np.cumsum(numbers) - numbers for numbers in (given, taken)]
        elsewhere = np.arange(self.size) != self.rank
        size = int(given[elsewhere].sum()) * out.itemsize * wide
        with self.traffic.call(size, int(np.count_nonzero(given[elsewhere]))):
            self.mpi.Alltoallv([out, (given, starts[0]), item], [found, (taken, starts[1]), item])
        item.Free()
        return found

    def swap(self, out: Array, parts: list[Array], found: Array, places: list[Array]) -> None:
        """Send one part of the array `out` to each rank, and receive one part of the array `found` from each.

        parts, places: views of `out` and `found`, one for each rank. A view has consecutive rows of its array, or a
        range of the second axis. MPI packs and unpacks the views: copies to contiguous blocks took twice the time
        (2026-11).
        """
        places[self.rank][:] = parts[self.rank]  # a copy is faster than MPI
        elsewhere = [int(rank != self.rank) for rank in range(self.size)]
        sizes = np.array(elsewhere) * [part.nbytes for part in parts]
        given, taken = (
            [
                array,
                (elsewhere, [_offset_bytes(view, array) for view in views]),
                [_datatype_of_view(view, array) for view in views],
            ]
            for array, views in ((out, parts), (found, places))
        )
        with self.traffic.call(int(sizes.sum()), int(np.count_nonzero(sizes))):
            self.mpi.Alltoallw(given, taken)


class Route:
    """Route that sends rows of arrays to other ranks, for repeated use; `to`: row indices for each rank.

    given, taken (ranks,): number of rows sent to each rank, and received from each rank.
    """

    def __init__(self, comm: Comm, to: list[Array]) -> None:
        self.comm = comm
        self.rows = np.concatenate(to)
        self.given = np.array([len(one) for one in to], np.int64)
        self.taken = np.empty_like(self.given)
        with comm.traffic.call(8 * (comm.size - 1), comm.size - 1):
            comm.mpi.Alltoall(self.given, self.taken)

    @property
    def count(self) -> int:
        """Number of rows received."""
        return int(self.taken.sum())

    def send(self, array: Array) -> Array:
        """Send rows of this rank's `array` (n, ...); return the rows received, by source rank."""
        return self.send_rows(array[self.rows])

    def send_all(self, arrays: list[Array], into: list[Array] | None = None) -> list[Array]:
        """Send rows of several arrays in one exchange; return the rows received of each array, by source rank.

        Arrays may have different types. into: arrays (count, ...) for the result. Each message is one block of bytes,
        with one array after the other.
        """
        width = [_row_bytes(array) for array in arrays]
        out = np.empty(len(self.rows) * sum(width), np.uint8)
        for (begin, count), *blocks in self._blocks(self.given, width, out):
            rows = self.rows[begin : begin + count]
            for array, block in zip(arrays, blocks, strict=True):
                np.take(array, rows, axis=0, out=_view_as_rows(array, block), mode="clip")
        found = self.comm.deal(out.reshape(-1, sum(width)), self.given, self.taken).reshape(-1)
        taken = [np.empty((self.count, *a.shape[1:]), a.dtype) for a in arrays] if into is None else into
        for (begin, count), *blocks in self._blocks(self.taken, width, found):
            for array, block in zip(taken, blocks, strict=True):
                array[begin : begin + count] = _view_as_rows(array, block)
        return taken

    def _blocks(self, counts: Array, width: list[int], whole: Array) -> Iterator[tuple[Any, ...]]:
        """Yield for each rank that has rows: (first row, number of rows), then the bytes of each array in `whole`.

        counts: number of rows of each rank. width: bytes in a row of each array.
        """
        begin = at = 0
        for count in counts.tolist():
            if count > 0:
                ends = at + count * np.cumsum([0, *width])
                yield (begin, count), *(whole[low:high] for low, high in pairwise(ends.tolist()))
                at = int(ends[-1])
            begin += count

    def send_rows(self, rows: Array) -> Array:
        """Send `rows`, which are already selected and in order of their target rank; return the rows received."""
        return self.comm.deal(np.ascontiguousarray(rows), self.given, self.taken)


def _row_bytes(array: Array) -> int:
    """Return the number of bytes in one row of an array (n, ...)."""
    return int(array.itemsize * math.prod(array.shape[1:]))


def _offset_bytes(view: Array, array: Array) -> int:
    """Return the offset in bytes of a view in its array."""
    return int(view.ctypes.data - array.ctypes.data)


def _datatype_of_view(view: Array, array: Array) -> MPI.Datatype:
    """Return the MPI datatype of a view of an array: consecutive rows, or a range of columns."""
    if view.flags.c_contiguous:
        return _datatype(view.dtype.char, 1, view.size, view.size)
    return _datatype(view.dtype.char, len(view), view[0].size, array[0].size)


@cache
def _datatype(code: str, count: int, length: int, stride: int) -> MPI.Datatype:
    """Return the MPI datatype of `count` blocks of `length` numbers, whose beginnings are `stride` numbers apart.

    code: numpy's character for the type of a number. Types are cached and never freed, as a run needs only a few. An
    MPI subarray type takes twice the time in MPICH.
    """
    of = MPI.Datatype.fromcode(code)
    return (of.Create_contiguous(length) if count == 1 else of.Create_vector(count, length, stride)).Commit()


def _view_as_rows(array: Array, block: Array) -> Array:
    """Return a view of the bytes `block` as rows with the type and shape of those of `array`."""
    return np.ndarray((len(block) // max(_row_bytes(array), 1), *array.shape[1:]), array.dtype, block)


def by_rank(some: Array, owner: Array, size: int) -> list[Array]:
    """Return the entries of `some` (n,) for each rank, in their previous order; owner (n,): rank of each entry."""
    owner = owner.astype(np.min_scalar_type(size))  # for up to 65535 ranks numpy then uses a radix sort
    order = np.argsort(owner, kind="stable")
    return np.split(some[order], np.searchsorted(owner[order], np.arange(1, size)))
