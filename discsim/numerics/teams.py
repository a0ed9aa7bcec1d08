"""Threads that share loops, and jobs that run at the same time.

A loop is cut into pieces (`numerics/threads.py`). The thread that calls takes pieces, and so does each helper from a
pool that is free; each begins with a part of its own, whose data it has at hand from the loops before, and goes on with
what others have not begun. Which thread takes a piece changes no number.

Jobs that do not need each other run `beside` each other on a pool with as many threads, while their caller waits. Each
may share its loops with threads that have no job left.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextvars import ContextVar, copy_context
from functools import cache
from itertools import accumulate, chain
from typing import Any

from discsim.parts import Lazy

numba = Lazy("numba")

allowed: ContextVar[int] = ContextVar("allowed", default=0)  # threads that loops may take; 0: numba's number
_pool_of_job: ContextVar[ThreadPoolExecutor | None] = ContextVar("pool_of_job", default=None)


class _Helped(threading.local):
    seconds = 0.0  # CPU time of helpers in loops of this thread


_helped = _Helped()


def number_of_threads() -> int:
    """Return how many threads loops of this Python thread may take."""
    return allowed.get() or int(numba.config.NUMBA_NUM_THREADS)


def several_threads() -> bool:
    """Return whether jobs of this thread run at the same time."""
    return number_of_threads() > 1 and _pool_of_job.get() is None


def cpu_time() -> float:
    """Return the CPU seconds of this thread until now, with those of helpers in its loops."""
    return time.thread_time() + _helped.seconds


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, "discsim")


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pool.cache_clear)  # a fork has none of the threads


class Loop:
    """A kernel and the pieces of its range; what they returned, and what they raised, by number.

    runs: how many of the pieces each thread begins with.
    """

    def __init__(
        self, kernel: Callable[..., Any], parts: list[tuple[Any, ...]], arguments: tuple[Any, ...], runs: list[int]
    ) -> None:
        self.kernel, self.parts, self.arguments = kernel, parts, arguments
        self.returned: list[Any] = [None] * len(parts)
        self.raised: dict[int, BaseException] = {}
        # Numbers of the pieces that each thread begins with. An iterator gives each number to one thread.
        self.left = [iter(range(end - run, end)) for run, end in zip(runs, accumulate(runs), strict=True)]

    def take(self, thread: int) -> float:
        """Run pieces until none is left, those of a thread's own run first; return its CPU seconds."""
        begun = time.thread_time()
        for number in chain(*self.left[thread:], *self.left[:thread]):
            if not self.raised or number < min(self.raised):  # the first to raise is the same on any threads
                try:
                    self.returned[number] = self.kernel(*self.parts[number], *self.arguments)
                except BaseException as fault:  # for the caller, Ctrl-C too
                    self.raised[number] = fault
        return time.thread_time() - begun


def share(loop: Loop, threads: int) -> list[Any]:
    """Run a loop on this thread and helpers; return what its pieces returned, or raise what the first raised."""
    helpers: list[Future[float]] = []
    try:
        pool = _pool_of_job.get() or _pool(threads - 1)
        for thread in range(1, min(threads, len(loop.left))):
            helpers.append(pool.submit(copy_context().run, loop.take, thread))
        loop.take(0)
    except BaseException as fault:  # Ctrl-C between two pieces
        loop.raised[-1] = fault
    finally:
        _end(helpers, loop.raised)
    _helped.seconds += sum(helper.result() for helper in helpers if not helper.cancelled())
    _raise_first(loop.raised)
    return loop.returned


def beside(*jobs: Callable[[], object]) -> None:
    """Run jobs that do not need each other at the same time, and wait for all; raise what the first of them raised.

    On one thread, and within a job, they run one after another, until one raises.
    """
    if len(jobs) < 2 or not several_threads():
        for work in jobs:
            work()
        return
    pool = _pool(number_of_threads())
    begun: list[Future[object]] = []
    raised: dict[int, BaseException | None] = {}
    token = _pool_of_job.set(pool)
    try:
        for work in jobs:
            begun.append(pool.submit(copy_context().run, work))
        wait(begun)
    except BaseException as fault:  # Ctrl-C
        raised[-1] = fault
    finally:
        _pool_of_job.reset(token)
        _end(begun, raised)
    if not raised:
        raised = {number: job.exception() for number, job in enumerate(begun) if job.exception() is not None}
    begun.clear()
    _raise_first(raised)


def _raise_first(raised: dict[int, Any]) -> None:
    try:
        if raised:
            raise raised[min(raised)]
    finally:
        raised.clear()  # no circle of a fault and the frames that it came through


def _end(futures: list[Any], raised: dict[int, Any]) -> None:
    """Cancel what has not begun and wait for the rest: nothing goes on that still changes arrays."""
    while True:
        try:
            wait([future for future in futures if not future.cancel()])
            return
        except KeyboardInterrupt as fault:
            raised[-1] = fault
