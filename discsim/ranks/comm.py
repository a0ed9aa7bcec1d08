"""MPI as a run uses it: reductions that are exact, and rows of arrays to other ranks."""

from __future__ import annotations

from typing import Any

import numpy as np
from mpi4py import MPI

Array = np.ndarray


class Comm:
    """The ranks of a run; counts what it sends, in `bytes` and `messages`."""

    def __init__(self) -> None:
        self.mpi = MPI.COMM_WORLD.Dup()
        self.rank, self.size = self.mpi.rank, self.mpi.size
        self.bytes = self.messages = 0

    def reduced(self, values: Any, operation: MPI.Op) -> Any:
        """Of each of `values`, a number or an array of any shape, what the operation makes of those of all ranks."""
        given = np.ascontiguousarray(values)
        if given.dtype == bool:
            given = given.astype(np.int64)
        out = np.empty_like(given)
        self.mpi.Allreduce(given, out, operation)
        self.messages += 1
        self.bytes += given.nbytes
        return out if isinstance(values, np.ndarray) else out.item()

    def gathered_bits(self, mask: Array) -> Array:
        """Masks (size, n) of all ranks, of this one's mask (n,)."""
        packed = np.packbits(mask)
        out = np.empty((self.size, len(packed)), np.uint8)
        self.mpi.Allgather(packed, out)
        self.messages += 1
        self.bytes += packed.nbytes
        return np.unpackbits(out, axis=1, count=len(mask)).view(bool)


class Route:
    """Rows of arrays that go to other ranks again and again: `to`, the numbers of those for each rank."""

    def __init__(self, comm: Comm, to: list[Array]) -> None:
        self.comm = comm
        self.rows = np.concatenate(to)
        self.given = np.array([len(one) for one in to], np.int64)
        self.taken = np.empty_like(self.given)
        comm.mpi.Alltoall(self.given, self.taken)
        comm.messages += 1

    @property
    def count(self) -> int:
        """How many rows come here."""
        return int(self.taken.sum())

    def send(self, array: Array) -> Array:
        """The rows of this rank's `array` (n, ...) to where they go; those that come here, by the rank they are of."""
        out = np.ascontiguousarray(array[self.rows])
        found = np.empty((self.count, *array.shape[1:]), array.dtype)
        wide = array.itemsize * int(np.prod(array.shape[1:], dtype=np.int64))
        counts = [(numbers * wide).tolist() for numbers in (self.given, self.taken)]
        starts = [[0, *np.cumsum(numbers)[:-1].tolist()] for numbers in counts]
        self.comm.mpi.Alltoallv([out, (counts[0], starts[0]), MPI.BYTE], [found, (counts[1], starts[1]), MPI.BYTE])
        self.comm.messages += int(np.count_nonzero(self.given))
        self.comm.bytes += out.nbytes
        return found
