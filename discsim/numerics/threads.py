"""Loops shared among threads: a kernel that frees the interpreter takes pieces of a range.

    @njit(nogil=True, cache=True)
    def kernel(first, last, ...):      # for i in range(first, last)

Pieces only divide independent work, so results are bitwise the same for any number of threads. One loop a
kernel, without numba's own parallel lowering, also compiles in a fraction of the time.

A loop is one task: the thread that calls takes pieces too, and its helpers, each asleep behind a lock, are woken once.
A step of 80 loops is as many tasks, and one that a pool hands out piece by piece takes a tenth of its time for that.
"""

import os
from collections.abc import Callable, Iterator
from contextvars import Context, copy_context
from itertools import accumulate, chain
from itertools import count as numbers
from threading import Lock, Thread
from typing import Any

import numpy as np

from discsim.numerics import room
from discsim.parts import Lazy

numba, moves = Lazy("numba"), Lazy("discsim.kernels.move")

BLOCK = 8192  # entries of an array that numpy goes through at once
LIGHT = 65536  # fewest particles of a piece, of some nanoseconds each: waking a thread for fewer gains nothing
SMALLEST = 8  # a thread has as many of the smallest pieces, or fewer: what others may wait for at the end


def use_threads(number: int | None) -> None:
    """Let loops of this Python thread take `number` threads, at most as many (None: as many) as NUMBA_NUM_THREADS."""
    most: int = numba.config.NUMBA_NUM_THREADS
    numba.set_num_threads(most if number is None else min(number, most))


def share(
    kernel: Callable[..., Any], count: int, *arguments: Any, least: int = 4096, light: bool = False,
    each: list[Any] | None = None,
) -> list[Any]:  # fmt: skip
    """Run `kernel(first, last, *arguments)` over [0, count) in pieces of `least` or more, of LIGHT or more where it is
    `light`; what each returned.

    With `each`, what this returned for the same count and `least`, its own part of that is the third argument.
    """
    threads = numba.get_num_threads()
    runs = pieces(count, LIGHT if light else least, threads)
    spans = [span for run in runs for span in run]
    parts = [(*span, *([] if each is None else [each[k]])) for k, span in enumerate(spans)]
    if len(parts) == 1:
        return [kernel(*parts[0], *arguments)]
    return _together(_Loop(kernel, parts, arguments, [len(run) for run in runs]), threads - 1)


def pieces(count: int, least: int, threads: int) -> list[list[tuple[int, int]]]:
    """Pieces (first, last) of [0, count), by the thread that begins with them: half of its part, half of the rest, and
    so on. Large ones first cost little, small ones last leave little to wait for.
    """
    parts = max(1, min(threads, count // least))
    smallest = max(least, -(-count // (SMALLEST * threads)))
    runs = []
    for k in range(parts):
        first, end = k * count // parts, (k + 1) * count // parts
        run = []
        while parts > 1 and end - first >= 2 * smallest:
            last = first + (end - first) // 2
            run.append((first, last))
            first = last
        runs.append([*run, (first, end)])
    return runs


class _Loop:
    """A kernel and the pieces of its range; what they returned, and what they raised, by number."""

    def __init__(
        self, kernel: Callable[..., Any], parts: list[tuple[Any, ...]], arguments: tuple[Any, ...], runs: list[int]
    ) -> None:
        self.kernel, self.parts, self.arguments = kernel, parts, arguments
        self.returned: list[Any] = [None] * len(parts)
        self.raised: dict[int, BaseException] = {}
        # Numbers of the pieces of each thread's own. The interpreter gives each number to one thread.
        self.left = [iter(range(end - run, end)) for run, end in zip(runs, accumulate(runs), strict=True)]
        self.ended = numbers(1)
        self.done = Lock()
        self.done.acquire()

    def take(self, thread: int) -> None:
        """Run pieces until none is left, a thread's own ones first: it has their data at hand from the loops before.

        Whoever ends the last one says so.
        """
        own = thread % len(self.left)
        for k in chain(*self.left[own:], *self.left[:own]):
            if not self.raised or k < min(self.raised):  # the first to raise is the same on any number of threads
                try:
                    self.returned[k] = self.kernel(*self.parts[k], *self.arguments)
                except BaseException as fault:  # for who called, Ctrl-C too
                    self.raised[k] = fault
            if next(self.ended) == len(self.parts):
                self.done.release()


class _Crew:
    """Helpers of one caller at a time, each asleep until its lock is opened."""

    def __init__(self, helpers: int) -> None:
        self.task: tuple[_Loop, list[Context]] | None = None
        self.left = False
        self.locks = [Lock() for _ in range(helpers)]
        for number, lock in enumerate(self.locks):
            lock.acquire()
            Thread(target=self._help, args=(number, lock), name="discsim", daemon=True).start()

    def wake(self, loop: _Loop) -> None:
        # One that has not woken yet since the loop before finds this one.
        self.task = loop, [copy_context() for _ in self.locks]  # settings of numpy's errors are the caller's
        for lock in self.locks[: len(loop.parts) - 1]:
            if lock.locked():
                lock.release()

    def leave(self) -> None:
        """Let the helpers go, at the end of the pieces that they are in."""
        self.left, self.task = True, None
        for lock in self.locks:
            if lock.locked():
                lock.release()

    def _help(self, number: int, lock: Any) -> None:
        while not self.left:
            lock.acquire()
            task = self.task
            if task is not None:
                task[1][number].run(task[0].take, number + 1)
            del task  # and with it the arrays


_idle: dict[int, list[_Crew]] = {}  # by the number of helpers
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_idle.clear)  # a fork has none of the threads: work given to them would wait


def _together(loop: _Loop, helpers: int) -> list[Any]:
    """Run a loop on this thread and helpers of its own; what its pieces returned, or raises what the first raised."""
    idle = _idle.setdefault(helpers, [])
    try:
        crew = idle.pop()
    except IndexError:
        crew = _Crew(helpers)
    try:
        crew.wake(loop)
        loop.take(0)
        loop.done.acquire()
    except BaseException as fault:  # Ctrl-C between two pieces
        loop.raised[-1] = fault  # no more of them
        crew.leave()
        raise
    crew.task = None
    idle.append(crew)
    try:
        if loop.raised:
            raise loop.raised[min(loop.raised)]
    finally:
        loop.raised = {}  # no circle of a fault and the frames that it came through
    return loop.returned


def copied(array: np.ndarray) -> np.ndarray:
    """A copy of an array (n, ...), with as much room behind it."""
    out = room.like(array)
    share(moves.assign, len(out), out, array, light=True)
    return out


def fill(out: np.ndarray, values: Callable[[slice], np.ndarray | float]) -> None:
    """out[:] = values in pieces, each the values of a slice of the first axis."""

    def part(first: int, last: int) -> None:
        for piece in blocks(first, last):
            out[piece] = values(piece)

    share(part, len(out))


def blocks(first: int, last: int) -> Iterator[slice]:
    """[first, last) in slices so short that what numpy makes of one on the way to its result stays in the cache."""
    for begin in range(first, last, BLOCK):
        yield slice(begin, min(begin + BLOCK, last))
