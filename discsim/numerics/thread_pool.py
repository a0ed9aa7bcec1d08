"""Thread pool for parallel loops and concurrent jobs.

A loop is divided into chunks (`numerics/threads.py`), which run on the calling thread and on idle threads of the pool
("helpers"). Each thread begins with its own part of the range, whose data are in its cache from earlier loops, and
continues with chunks that no thread has begun. Results do not depend on which thread runs a chunk.

Independent jobs run concurrently (`run_concurrently`) on another pool, while their caller waits. Threads of that pool
without a job are the helpers in the loops of the jobs.
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

thread_limit: ContextVar[int] = ContextVar("allowed", default=0)  # number of threads of loops; 0: NUMBA_NUM_THREADS
_pool_of_job: ContextVar[ThreadPoolExecutor | None] = ContextVar("pool_of_job", default=None)  # None outside a job


class _HelperTime(threading.local):
    seconds = 0.0  # CPU time of helpers in the loops of this thread


_helper_time = _HelperTime()


def number_of_threads() -> int:
    """Return the number of threads that loops of this Python thread may use."""
    return thread_limit.get() or int(numba.config.NUMBA_NUM_THREADS)


def several_threads() -> bool:
    """Return whether `run_concurrently` of this thread uses several threads; within a job it does not."""
    return number_of_threads() > 1 and _pool_of_job.get() is None


def cpu_time() -> float:
    """Return the CPU seconds of this thread so far, including those of helpers in its loops."""
    return time.thread_time() + _helper_time.seconds


@cache
def _pool_of_threads(threads: int) -> ThreadPoolExecutor:
    """Return the pool with this number of threads; the pool is made at the first call, and kept."""
    return ThreadPoolExecutor(threads, "discsim")


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pool_of_threads.cache_clear)  # threads do not survive a fork


class Loop:
    """Parallel loop: `calls` of a kernel, one for each chunk of a range.

    lengths: number of chunks with which each thread begins. returned: result of each chunk. raised: exceptions by
    index of the chunk.
    """

    def __init__(self, calls: list[Callable[[], Any]], lengths: list[int]) -> None:
        self.calls = calls
        self.returned: list[Any] = [None] * len(calls)
        self.raised: dict[int, BaseException] = {}
        # Numbers of the chunks that are left to each thread. An iterator yields each number to one thread only.
        self.left = [iter(range(end - length, end)) for length, end in zip(lengths, accumulate(lengths), strict=True)]

    def run_chunks(self, thread: int) -> float:
        """Run chunks until none is left, beginning with the chunks of `thread`; return the CPU seconds spent."""
        begun = time.thread_time()
        for number in chain(*self.left[thread:], *self.left[:thread]):
            # The exception of the lowest chunk number is raised in the end, so that it does not depend on the threads.
            if not self.raised or number < min(self.raised):
                try:
                    self.returned[number] = self.calls[number]()
                except BaseException as fault:  # re-raised in the caller, Ctrl-C too
                    self.raised[number] = fault
        return time.thread_time() - begun


def run_loop(loop: Loop, threads: int) -> list[Any]:
    """Run a loop on this thread and helpers; return the results of its chunks.

    If chunks raise exceptions, the exception of the first of these chunks is raised.
    """
    helpers: list[Future[float]] = [Future() for _ in range(1, min(threads, len(loop.left)))]
    try:
        pool = _pool_of_job.get() or _pool_of_threads(threads - 1)
        for number in range(len(helpers)):
            pool.submit(copy_context().run, _complete, helpers, number, loop.run_chunks, number + 1)
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

    If jobs raise exceptions, the exception of the first of these jobs is raised. On one thread, or within a job, the
    jobs run one after another until one raises an exception.
    """
    if len(jobs) < 2 or not several_threads():
        for job in jobs:
            job()
        return
    pool = _pool_of_threads(number_of_threads())
    begun: list[Future[object]] = [Future() for _ in jobs]
    raised: dict[int, BaseException | None] = {}
    token = _pool_of_job.set(pool)
    try:
        for number, job in enumerate(jobs):
            pool.submit(copy_context().run, _complete, begun, number, job)
        wait(begun)
    except BaseException as fault:  # Ctrl-C
        raised[-1] = fault
    finally:
        _pool_of_job.reset(token)
        _cancel_or_wait(begun, raised)
    if not raised:
        raised = {number: future.exception() for number, future in enumerate(begun) if future.exception() is not None}
    begun.clear()
    _raise_first(raised)


def _complete(futures: list[Future[Any]], number: int, call: Callable[..., Any], *given: Any) -> None:
    """Store the result of a call, or its exception, in `futures[number]`; make no call if the future is cancelled.

    The future exists before the call is submitted to a pool. An interrupt within `submit` then loses no future. The
    caller clears the list to avoid reference cycles of exceptions and frames.
    """
    future = futures[number] if futures else None
    if future is None or not future.set_running_or_notify_cancel():
        return
    try:
        future.set_result(call(*given))
    except BaseException as fault:  # re-raised in the caller
        future.set_exception(fault)
        future = None  # a reference of this frame, which the exception refers to


def _raise_first(raised: dict[int, Any]) -> None:
    """Raise the exception with the lowest number in `raised`, if there is one, and clear `raised`."""
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
