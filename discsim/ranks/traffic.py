"""Cost of communication by effect: number of MPI calls, their time, and the time spent waiting for other ranks.

All ranks make the same calls in the same order. The last rank to enter a call does not wait, so the shortest time of
any rank in the call is the time of the exchange itself. Another rank waits for the rest of its time. No barrier is
needed: ranks compare their times once after CALLS_PER_COMPARISON calls.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np
from mpi4py import MPI

CALLS_PER_COMPARISON = 1024


class Sum(NamedTuple):
    """Sums over MPI calls of a rank: their number, CPU and wall-clock seconds, waiting, bytes and messages sent."""

    calls: float = 0.0
    cpu_seconds: float = 0.0
    seconds: float = 0.0
    waiting: float = 0.0
    bytes: float = 0.0
    messages: float = 0.0

    def __sub__(self, other: Sum) -> Sum:
        return Sum(*(a - b for a, b in zip(self, other, strict=True)))


class Traffic:
    """Cost of MPI calls, summed by effect.

    doing: name of the effect to which calls are added at present; "" between effects.
    """

    def __init__(self, mpi: MPI.Comm) -> None:
        self._mpi = mpi
        self.doing = ""
        self._sums: dict[str, list[float]] = {}
        self._times: list[tuple[str, float]] = []  # of calls not yet compared

    @contextmanager
    def call(self, size: int, messages: int) -> Iterator[None]:
        """Measure a collective call, in which this rank sends `size` bytes in `messages`."""
        wall, cpu = time.perf_counter(), time.process_time()
        yield
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        self._add(self.doing, 1, cpu, wall, 0.0, size, messages)
        self._times.append((self.doing, wall))
        if len(self._times) == CALLS_PER_COMPARISON:
            self.fold()

    def _add(self, name: str, *more: float) -> None:
        row = self._sums.setdefault(name, [0.0] * len(Sum._fields))
        for k, number in enumerate(more):
            row[k] += number

    @property
    def sums(self) -> dict[str, Sum]:
        """Sums so far, by the name of the effect."""
        return {name: Sum(*row) for name, row in self._sums.items()}

    def fold(self) -> None:
        """Compare the times of recent calls between ranks, and add the waiting to the sums. Collective."""
        own = np.array([seconds for _, seconds in self._times])
        least = np.empty_like(own)
        self._mpi.Allreduce(own, least, MPI.MIN)
        for (name, _), waited in zip(self._times, (own - least).tolist(), strict=True):
            self._sums[name][Sum._fields.index("waiting")] += waited
        self._times = []

    def mean(self, sums: dict[str, Sum]) -> dict[str, Sum]:
        """Return the means over all ranks of `sums`, which have the same names on each rank. Collective."""
        own = np.array([*sums.values()]).reshape(-1, len(Sum._fields))
        out = np.empty_like(own)
        self._mpi.Allreduce(own, out, MPI.SUM)
        return {name: Sum(*row) for name, row in zip(sums, (out / self._mpi.size).tolist(), strict=True)}
