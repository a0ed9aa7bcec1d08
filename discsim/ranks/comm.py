"""MPI operations of a run: reductions, exchanges of rows of arrays, and exceptions raised on all ranks.

All calls are collective, except helper functions that begin with an underscore and `group_by_rank`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
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

    def on_root(self, do: Callable[[], Any]) -> Any:
        """Call `do` on rank 0 only; return its result on all ranks, or raise its exception on all."""
        value, raised = self.mpi.bcast(_result_or_exception(do) if self.rank == 0 else None)
        if raised is not None:
            raise raised
        return value

    def raise_on_all(self, do: Callable[[], Any]) -> Any:
        """Call `do` on each rank, and return the rank's own result.

        If `do` raises on some ranks, the exception of the first of these is raised on all. `do` must not communicate.
        """
        value, raised = _result_or_exception(do)
        if self.allreduce(raised is not None, MPI.MAX):
            raise next(each for each in self.mpi.allgather(raised) if each is not None)
        return value

    def allreduce(self, values: Any, operation: MPI.Op) -> Any:
        """Return the element-wise reduction of `values`, a number or an array of any shape, over all ranks."""
        sent = np.ascontiguousarray(values)
        if sent.dtype == bool:
            sent = sent.astype(np.int64)
        received = np.empty_like(sent)
        # Long arrays are reduced in parts, which are then gathered (Thakur, Rabenseifner & Gropp 2005).
        size = sent.nbytes * (self._rounds if sent.nbytes <= LONG_MESSAGE else min(self._rounds, 2))
        with self.traffic.call(size, self._rounds):
            self.mpi.Allreduce(sent, received, operation)
        return received if isinstance(values, np.ndarray) else received.item()

    def allgather(self, array: Array) -> Array:
        """Return the arrays of all ranks stacked, (ranks, ...); `array` has the same shape on each rank."""
        received = np.empty((self.size, *array.shape), array.dtype)
        with self.traffic.call((self.size - 1) * array.nbytes, self._rounds):
            self.mpi.Allgather(np.ascontiguousarray(array), received)
        return received

    def allgatherv(self, array: Array) -> list[Array]:
        """Return the arrays (n,) of all ranks as a list, in rank order; their lengths may differ."""
        counts = self.allgather(np.array(len(array)))
        received = np.empty(int(counts.sum()), array.dtype)
        number = MPI.Datatype.fromcode(array.dtype.char)
        with self.traffic.call((self.size - 1) * array.nbytes, self._rounds):
            self.mpi.Allgatherv([np.ascontiguousarray(array), number], [received, counts, number])
        return np.split(received, np.cumsum(counts)[:-1])

    def alltoallv(self, sent: Array, send_counts: Array, receive_counts: Array) -> Array:
        """Send consecutive rows of `sent` (n, ...) to the ranks, in rank order, and return the rows received.

        The rows received are in the order of the ranks that sent them. send_counts, receive_counts (ranks,): numbers of
        rows sent to each rank, and received from each rank.
        """
        width = math.prod(sent.shape[1:])
        row = MPI.BYTE.Create_contiguous(max(sent.itemsize * width, 1)).Commit()
        received = np.empty((int(receive_counts.sum()), *sent.shape[1:]), sent.dtype)
        starts = [np.cumsum(counts) - counts for counts in (send_counts, receive_counts)]
        elsewhere = np.arange(self.size) != self.rank
        size = int(send_counts[elsewhere].sum()) * sent.itemsize * width
        with self.traffic.call(size, int(np.count_nonzero(send_counts[elsewhere]))):
            self.mpi.Alltoallv([sent, (send_counts, starts[0]), row], [received, (receive_counts, starts[1]), row])
        row.Free()
        return received

    def alltoallw(self, sent: Array, sent_parts: list[Array], received: Array, received_parts: list[Array]) -> None:
        """Send one part of the array `sent` to each rank, and receive one part of the array `received` from each rank.

        sent_parts, received_parts: views of `sent` and of `received`, one for each rank. A view has consecutive rows of
        its array, or a range of the second axis. MPI packs and unpacks the views: copies to contiguous blocks took
        twice the time (2026-11).
        """
        received_parts[self.rank][:] = sent_parts[self.rank]  # a copy is faster than MPI
        elsewhere = [int(rank != self.rank) for rank in range(self.size)]
        sizes = np.array(elsewhere) * [part.nbytes for part in sent_parts]
        messages = [
            [
                array,
                (elsewhere, [_offset_bytes(part, array) for part in parts]),
                [_datatype_of_view(part, array) for part in parts],
            ]
            for array, parts in ((sent, sent_parts), (received, received_parts))
        ]
        with self.traffic.call(int(sizes.sum()), int(np.count_nonzero(sizes))):
            self.mpi.Alltoallw(*messages)


class Route:
    """Selection of rows of this rank's arrays to send to each rank, for repeated exchanges of the same rows.

    rows: indices of the selected rows, by target rank. send_counts, receive_counts (ranks,): number of rows sent to
    each rank, and received from each rank.
    """

    def __init__(self, comm: Comm, rows_by_rank: list[Array]) -> None:
        self.comm = comm
        self.rows = np.concatenate(rows_by_rank)
        self.send_counts = np.array([len(rows) for rows in rows_by_rank], np.int64)
        self.receive_counts = np.empty_like(self.send_counts)
        with comm.traffic.call(8 * (comm.size - 1), comm.size - 1):
            comm.mpi.Alltoall(self.send_counts, self.receive_counts)

    @property
    def count(self) -> int:
        """Number of rows received."""
        return int(self.receive_counts.sum())

    def send(self, array: Array) -> Array:
        """Send the selected rows of this rank's `array` (n, ...); return the rows received, by source rank."""
        return self.send_selected(array[self.rows])

    def send_selected(self, rows: Array) -> Array:
        """Send `rows` (m, ...) that are already selected, by target rank; return the rows received, by source rank."""
        return self.comm.alltoallv(np.ascontiguousarray(rows), self.send_counts, self.receive_counts)

    def send_all(self, arrays: list[Array], into: list[Array] | None = None) -> list[Array]:
        """Send the selected rows of several arrays in one exchange; return the rows received of each array.

        Arrays may have different types. The rows received are in the order of the source ranks. into: arrays
        (count, ...) for the result; None: new arrays. Each message is one block of bytes, with one array after the
        other.
        """
        widths = [_row_bytes(array) for array in arrays]
        sent = np.empty(len(self.rows) * sum(widths), np.uint8)
        for (begin, count), *blocks in self._blocks_by_rank(self.send_counts, widths, sent):
            rows = self.rows[begin : begin + count]
            for array, block in zip(arrays, blocks, strict=True):
                np.take(array, rows, axis=0, out=_view_as_rows(array, block), mode="clip")
        message = self.comm.alltoallv(sent.reshape(-1, sum(widths)), self.send_counts, self.receive_counts)
        received = [np.empty((self.count, *a.shape[1:]), a.dtype) for a in arrays] if into is None else into
        for (begin, count), *blocks in self._blocks_by_rank(self.receive_counts, widths, message.reshape(-1)):
            for array, block in zip(received, blocks, strict=True):
                array[begin : begin + count] = _view_as_rows(array, block)
        return received

    def _blocks_by_rank(self, counts: Array, widths: list[int], message: Array) -> Iterator[tuple[Any, ...]]:
        """Yield (first row, number of rows) of each rank that has rows, followed by the block of each array's bytes.

        Blocks are views of `message`, the bytes for all ranks. counts: number of rows of each rank. widths: bytes in a
        row of each array.
        """
        begin = at = 0
        for count in counts.tolist():
            if count > 0:
                ends = at + count * np.cumsum([0, *widths])
                yield (begin, count), *(message[low:high] for low, high in pairwise(ends.tolist()))
                at = int(ends[-1])
            begin += count


def group_by_rank(entries: Array, owner: Array, size: int) -> list[Array]:
    """Return the `entries` (n,) of each of `size` ranks, in their previous order; owner (n,): rank of each entry."""
    owner = owner.astype(np.min_scalar_type(size))  # for up to 65535 ranks numpy then uses a radix sort
    order = np.argsort(owner, kind="stable")
    return np.split(entries[order], np.searchsorted(owner[order], np.arange(1, size)))


def _result_or_exception(do: Callable[[], Any]) -> tuple[Any, Exception | None]:
    """Return the result of `do` and None, or None and the exception that `do` raised."""
    try:
        return do(), None
    except Exception as fault:
        return None, fault


def _row_bytes(array: Array) -> int:
    """Return the number of bytes in one row of an array (n, ...)."""
    return int(array.itemsize * math.prod(array.shape[1:]))


def _view_as_rows(array: Array, block: Array) -> Array:
    """Return a view of the bytes `block` as rows with the type and shape of the rows of `array` (n, ...)."""
    return np.ndarray((len(block) // max(_row_bytes(array), 1), *array.shape[1:]), array.dtype, block)


def _offset_bytes(view: Array, array: Array) -> int:
    """Return the offset in bytes of a view in its array."""
    return int(view.ctypes.data - array.ctypes.data)


def _datatype_of_view(view: Array, array: Array) -> MPI.Datatype:
    """Return the MPI datatype of a view of an array: consecutive rows, or a range of columns."""
    if view.flags.c_contiguous:
        return _datatype_of_blocks(view.dtype.char, 1, view.size, view.size)
    return _datatype_of_blocks(view.dtype.char, len(view), view[0].size, array[0].size)


@cache
def _datatype_of_blocks(code: str, count: int, length: int, stride: int) -> MPI.Datatype:
    """Return the MPI datatype of `count` blocks of `length` numbers, whose beginnings are `stride` numbers apart.

    code: numpy's character for the type of a number. Types are cached and never freed, as a run needs only a few. An
    MPI subarray type takes twice the time in MPICH.
    """
    number = MPI.Datatype.fromcode(code)
    return (number.Create_contiguous(length) if count == 1 else number.Create_vector(count, length, stride)).Commit()
