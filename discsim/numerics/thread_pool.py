"""Thread pool for parallel loops and concurrent jobs.

A loop is divided into chunks (`numerics/threads.py`), run by the calling thread and by idle threads of the pool
("helpers"). Each thread begins with its own part of the range, whose data are in its cache from earlier loops, and
continues with chunks that no thread has begun. Results do not depend on which thread runs a chunk.

Independent jobs run concurrently (`run_concurrently`) on another pool, while their caller waits. Threads without a job
help in the loops of the others.
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

thread_limit: ContextVar[int] = ContextVar("allowed", default=0)  # number of threads of loops; 0: numba's number
_pool_of_job: ContextVar[ThreadPoolExecutor | None] = ContextVar("pool_of_job", default=None)


class _HelperTime(threading.local):
    seconds = 0.0  # CPU time of helpers in loops of this thread


_helper_time = _HelperTime()


def number_of_threads() -> int:
    """Return the number of threads that loops of this Python thread may use."""
    return thread_limit.get() or int(numba.config.NUMBA_NUM_THREADS)


def several_threads() -> bool:
    """Return whether `run_concurrently` runs jobs of this thread concurrently: on several threads, outside a job."""
    return number_of_threads() > 1 and _pool_of_job.get() is None


def cpu_time() -> float:
    """Return the CPU seconds of this thread so far, including those of helpers in its loops."""
    return time.thread_time() + _helper_time.seconds


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, "discsim")


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pool.cache_clear)  # threads do not survive a fork


class Loop:
    """Parallel loop: a kernel, and the chunks of its range.

    parts: arguments for each chunk. arguments: further arguments, the same for all. runs: number of chunks in the part
    of each thread. returned: result of each chunk. raised: exceptions by number of the chunk.
    """

    def __init__(
        self, kernel: Callable[..., Any], parts: list[tuple[Any, ...]], arguments: tuple[Any, ...], runs: list[int]
    ) -> None:
        self.kernel, self.parts, self.arguments = kernel, parts, arguments
        self.returned: list[Any] = [None] * len(parts)
        self.raised: dict[int, BaseException] = {}
        # Numbers of the chunks in the part of each thread. An iterator yields each number to one thread only.
        self.left = [iter(range(end - run, end)) for run, end in zip(runs, accumulate(runs), strict=True)]

    def run_chunks(self, thread: int) -> float:
        """Run chunks until none is left, first those in the part of `thread`; return the CPU seconds spent."""
        begun = time.thread_time()
        for number in chain(*self.left[thread:], *self.left[:thread]):
            if not self.raised or number < min(self.raised):  # the first exception is the same on any threads
                try:
                    self.returned[number] = self.kernel(*self.parts[number], *self.arguments)
                except BaseException as fault:  # re-raised in the caller, Ctrl-C too
                    self.raised[number] = fault
        return time.thread_time() - begun


def run_loop(loop: Loop, threads: int) -> list[Any]:
    """Run a loop on this thread and helpers; return the results of its chunks.

    If chunks raise exceptions, that of the first chunk is raised.
    """
    helpers: list[Future[float]] = []
    try:
        pool = _pool_of_job.get() or _pool(threads - 1)
        for thread in range(1, min(threads, len(loop.left))):
            helpers.append(pool.submit(copy_context().run, loop.run_chunks, thread))
        loop.run_chunks(0)
    except BaseException as fault:  # Ctrl-C between two chunks
        loop.raised[-1] = fault
    finally:
        _cancel_or_wait(helpers, loop.raised)
    _helper_time.seconds += sum(helper.result() for helper in helpers if not helper.cancelled())
    _raise_first(loop.raised)
    return loop.returned


def run_concurrently(*jobs: Callable[[], object]) -> None:
    """Run independent jobs concurrently, and wait for all of them.

    If jobs raise exceptions, that of the first job in the list is raised. With one thread, or when called within a job,
    they run one after another until one raises.
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
        _cancel_or_wait(begun, raised)
    if not raised:
        raised = {number: job.exception() for number, job in enumerate(begun) if job.exception() is not None}
    begun.clear()
    _raise_first(raised)


def _raise_first(raised: dict[int, Any]) -> None:
    try:
        if raised:
            raise raised[min(raised)]
    finally:
        raised.clear()  # avoids a reference cycle of an exception and the frames of its traceback


def _cancel_or_wait(futures: list[Any], raised: dict[int, Any]) -> None:
    """Cancel futures that have not begun, and wait for the others, so that no thread changes arrays afterwards.

    A Ctrl-C during the wait is stored in `raised` with the number -1.
    """
    while True:
        try:
            wait([future for future in futures if not future.cancel()])
            return
        except KeyboardInterrupt as fault:
            raised[-1] = fault
