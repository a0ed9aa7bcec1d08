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


class CallCost(NamedTuple):
    """Cost of MPI calls on a rank, summed over the calls, or the mean of such sums over the ranks.

    calls: number of calls. cpu_seconds, seconds: CPU time and wall-clock time in the calls. waiting: part of `seconds`
    spent waiting for other ranks. bytes, messages: amount of data, and number of messages, that the rank sent.
    """

    calls: float = 0.0
    cpu_seconds: float = 0.0
    seconds: float = 0.0
    waiting: float = 0.0
    bytes: float = 0.0
    messages: float = 0.0

    def __sub__(self, other: CallCost) -> CallCost:
        return CallCost(*(a - b for a, b in zip(self, other, strict=True)))


class Traffic:
    """Cost of the MPI calls of a rank, summed by effect.

    effect: name of the effect to which the cost of the next calls is added; "" between effects.
    """

    def __init__(self, mpi: MPI.Comm) -> None:
        self._mpi = mpi
        self.effect = ""
        self._sums: dict[str, list[float]] = {}
        self._times: list[tuple[str, float]] = []  # effect and seconds of the calls that ranks have not yet compared

    @contextmanager
    def call(self, size: int, messages: int) -> Iterator[None]:
        """Measure a collective call within the context, in which this rank sends `size` bytes in `messages`."""
        wall, cpu = time.perf_counter(), time.process_time()
        yield
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        row = self._sums.setdefault(self.effect, [0.0] * len(CallCost._fields))
        for k, number in enumerate(CallCost(1, cpu, wall, 0.0, size, messages)):
            row[k] += number
        self._times.append((self.effect, wall))
        if len(self._times) == CALLS_PER_COMPARISON:
            self.add_waiting()

    @property
    def sums(self) -> dict[str, CallCost]:
        """Cost of all calls so far, by the name of the effect."""
        return {name: CallCost(*row) for name, row in self._sums.items()}

    def add_waiting(self) -> None:
        """Compare the times of recent calls between ranks, and add the time spent waiting to the sums. Collective."""
        own = np.array([seconds for _, seconds in self._times])
        least = np.empty_like(own)
        self._mpi.Allreduce(own, least, MPI.MIN)
        for (name, _), waited in zip(self._times, (own - least).tolist(), strict=True):
            self._sums[name][CallCost._fields.index("waiting")] += waited
        self._times = []

    def mean(self, costs: dict[str, CallCost]) -> dict[str, CallCost]:
        """Return the means over all ranks of `costs`, which have the same names on each rank. Collective."""
        own = np.array([*costs.values()]).reshape(-1, len(CallCost._fields))
        out = np.empty_like(own)
        self._mpi.Allreduce(own, out, MPI.SUM)
        return {name: CallCost(*row) for name, row in zip(costs, (out / self._mpi.size).tolist(), strict=True)}
