"""MPI as a run uses it: reductions that are exact, and rows of arrays to other ranks. All calls are of all ranks."""

from __future__ import annotations

from typing import Any

import numpy as np
from mpi4py import MPI

from discsim.ranks.traffic import Traffic

Array = np.ndarray
LONG = 2048  # bytes, above which MPI libraries reduce in parts


class Comm:
    """The ranks of a run; what they send is counted in `traffic`."""

    def __init__(self) -> None:
        self.mpi = MPI.COMM_WORLD.Dup()
        self.rank, self.size = self.mpi.rank, self.mpi.size
        self.traffic = Traffic(self.mpi)
        self._rounds = (self.size - 1).bit_length()  # of messages, in which all hear of all

    def reduced(self, values: Any, operation: MPI.Op) -> Any:
        """Of each of `values`, a number or an array of any shape, what the operation makes of those of all ranks."""
        given = np.ascontiguousarray(values)
        if given.dtype == bool:
            given = given.astype(np.int64)
        out = np.empty_like(given)
        # What is long is summed in parts, which are then gathered (Thakur, Rabenseifner & Gropp 2005).
        sent = given.nbytes * (self._rounds if given.nbytes <= LONG else min(self._rounds, 2))
        with self.traffic.call(sent, self._rounds):
            self.mpi.Allreduce(given, out, operation)
        return out if isinstance(values, np.ndarray) else out.item()

    def gathered(self, array: Array) -> Array:
        """Arrays (ranks, ...) of all ranks, of this one's of the same shape on all."""
        out = np.empty((self.size, *array.shape), array.dtype)
        with self.traffic.call((self.size - 1) * array.nbytes, self._rounds):
            self.mpi.Allgather(np.ascontiguousarray(array), out)
        return out

    def listed(self, array: Array) -> list[Array]:
        """Arrays (n,) of all ranks, each of its own length."""
        counts = self.gathered(np.array(len(array)))
        out = np.empty(int(counts.sum()), array.dtype)
        of = MPI.Datatype.fromcode(array.dtype.char)
        with self.traffic.call((self.size - 1) * array.nbytes, self._rounds):
            self.mpi.Allgatherv([np.ascontiguousarray(array), of], [out, counts, of])
        return np.split(out, np.cumsum(counts)[:-1])

    def deal(self, out: Array, given: Array, taken: Array) -> Array:
        """Rows of `out`, numbers `given` (ranks,) of them to each rank in turn; those that come here, `taken`."""
        wide = int(np.prod(out.shape[1:], dtype=np.int64))
        item = MPI.BYTE.Create_contiguous(max(out.itemsize * wide, 1)).Commit()
        found = np.empty((int(taken.sum()), *out.shape[1:]), out.dtype)
        starts = [np.cumsum(numbers) - numbers for numbers in (given, taken)]
        elsewhere = np.arange(self.size) != self.rank
        size = int(given[elsewhere].sum()) * out.itemsize * wide
        with self.traffic.call(size, int(np.count_nonzero(given[elsewhere]))):
            self.mpi.Alltoallv([out, (given, starts[0]), item], [found, (taken, starts[1]), item])
        item.Free()
        return found

    def swap(self, out: Array, parts: list[MPI.Datatype], found: Array, places: list[MPI.Datatype]) -> None:
        """A part of `out` to each rank, to its place in what is `found` there."""
        ones, zeros = [1] * self.size, [0] * self.size
        sizes = [part.Get_size() for rank, part in enumerate(parts) if rank != self.rank]
        with self.traffic.call(sum(sizes), int(np.count_nonzero(sizes))):
            self.mpi.Alltoallw([out, (ones, zeros), parts], [found, (ones, zeros), places])


class Route:
    """Rows of arrays that go to other ranks again and again: `to`, the numbers of those for each rank."""

    def __init__(self, comm: Comm, to: list[Array]) -> None:
        self.comm = comm
        self.rows = np.concatenate(to)
        self.given = np.array([len(one) for one in to], np.int64)
        self.taken = np.empty_like(self.given)
        with comm.traffic.call(8 * (comm.size - 1), comm.size - 1):
            comm.mpi.Alltoall(self.given, self.taken)

    @property
    def count(self) -> int:
        """How many rows come here."""
        return int(self.taken.sum())

    def send(self, array: Array) -> Array:
        """The rows of this rank's `array` (n, ...) to where they go; those that come here, by the rank they are of."""
        return self.pass_on(array[self.rows])

    def pass_on(self, rows: Array) -> Array:
        """The same, of the rows that go."""
        return self.comm.deal(np.ascontiguousarray(rows), self.given, self.taken)
