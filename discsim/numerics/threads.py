"""Parallel loops: compiled functions ("kernels") that release the GIL run on chunks of a range of indices.

    @njit(nogil=True, cache=True)
    def kernel(first, last, ...):      # for i in range(first, last)

Chunks only divide independent work, so results are bitwise the same for any number of threads. One loop per kernel,
without numba's own parallel lowering, also compiles in a fraction of the time. `numerics/thread_pool.py` assigns
chunks to threads.
"""

from collections.abc import Callable, Iterator
from functools import partial
from itertools import accumulate
from typing import Any

import numpy as np

from discsim.numerics import alloc, thread_pool
from discsim.parts import Lazy

numba, moves = Lazy("numba"), Lazy("discsim.kernels.common.move")

BLOCK = 8192  # entries per block of numpy operations
# Smallest length of a chunk for cheap kernels, which take some ns per particle: to wake a thread for fewer particles
# gains nothing.
MIN_CHUNK_CHEAP = 65536
SMALLEST = 8  # the smallest chunk is at least 1 / SMALLEST of a thread's share, so that there are few chunks


def set_threads(number: int | None) -> None:
    """Set the number of threads in parallel loops of this Python thread.

    None: NUMBA_NUM_THREADS, which is also the largest number that is used.
    """
    most = int(numba.config.NUMBA_NUM_THREADS)
    thread_pool.thread_limit.set(most if number is None else min(number, most))


def parallel_for(
    kernel: Callable[..., Any], count: int, *arguments: Any, least: int = 4096, light: bool = False,
    each: list[Any] | None = None,
) -> list[Any]:  # fmt: skip
    """Run `kernel(first, last, *arguments)` on chunks of [0, count); return the list of results, one for each chunk.

    least: smallest length of a chunk. light: whether the kernel is cheap; MIN_CHUNK_CHEAP then replaces `least`. each:
    list with one entry per chunk, from an earlier call with the same `count` and `least`; the kernel is then called as
    `kernel(first, last, entry, *arguments)`.
    """
    runs = chunks(count, MIN_CHUNK_CHEAP if light else least, thread_pool.number_of_threads())
    spans = [span for run in runs for span in run]
    parts = spans if each is None else [(*span, entry) for span, entry in zip(spans, each, strict=True)]
    return _run_chunks([partial(kernel, *part, *arguments) for part in parts], [len(run) for run in runs])


def parallel_for_ranges(
    kernel: Callable[..., Any], several: list[tuple[Any, ...]], *, least: int = 4096, light: bool = False
) -> list[list[Any]]:
    """Run a kernel over several ranges in one parallel loop; return a list of results for each range.

    several: tuples (count, *arguments), one for each range [0, count). least, light: as in `parallel_for`. Threads do
    not wait for each other between ranges.
    """
    begins = [0, *accumulate(count for count, *_ in several)]
    calls: list[Callable[[], Any]] = []
    ranges: list[int] = []  # index in `several` of the range of each call
    lengths = []
    for run in chunks(begins[-1], MIN_CHUNK_CHEAP if light else least, thread_pool.number_of_threads()):
        before = len(calls)
        for first, last in run:
            for k, (count, *given) in enumerate(several):
                low, high = max(first - begins[k], 0), min(last - begins[k], count)
                if low < high or (count == 0 and k not in ranges):  # called for empty ranges too, as in `parallel_for`
                    calls.append(partial(kernel, low, max(low, high), *given))
                    ranges.append(k)
        lengths.append(len(calls) - before)
    found = _run_chunks(calls, lengths)
    return [[one for one, own in zip(found, ranges, strict=True) if own == k] for k in range(len(several))]


def parallel_for_fused(kernels: list[tuple[Any, ...]], count: int, *, least: int = 4096) -> None:
    """Run several kernels over [0, count) in one parallel loop; on each chunk they run one after another.

    kernels: tuples (kernel, *arguments). Threads do not wait for each other between kernels. A kernel may therefore
    read results of earlier kernels only within its own chunk. least: as in `parallel_for`.
    """

    def run_all(first: int, last: int) -> None:
        for kernel, *arguments in kernels:
            kernel(first, last, *arguments)

    parallel_for(run_all, count, least=least)


def _run_chunks(calls: list[Callable[[], Any]], lengths: list[int]) -> list[Any]:
    """Return the results of `calls`, one for each chunk; lengths: number of chunks with which each thread begins."""
    if len(lengths) < 2:
        return [call() for call in calls]
    return thread_pool.run_loop(thread_pool.Loop(calls, lengths), thread_pool.number_of_threads())


def chunks(count: int, least: int, threads: int) -> list[list[tuple[int, int]]]:
    """Return the chunks (first, last) of [0, count), a list of chunks for each thread.

    The range of a thread is halved repeatedly: large first chunks have little overhead, and small last chunks keep the
    wait at the end short. least: smallest length of a chunk. If `count` is small, fewer threads have chunks.
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


def copied(array: np.ndarray) -> np.ndarray:
    """Return a copy of `array` (n, ...), made on several threads, with the same spare capacity."""
    out = alloc.allocate_like(array)
    parallel_for(moves.copy, len(out), out, array, light=True)
    return out


def fill(out: np.ndarray, values: Callable[[slice], np.ndarray | float]) -> None:
    """Assign `values(slice)` to `out[slice]` for slices of the first axis, on several threads."""

    def part(first: int, last: int) -> None:
        for piece in block_slices(first, last):
            out[piece] = values(piece)

    parallel_for(part, len(out))


def block_slices(first: int, last: int) -> Iterator[slice]:
    """Yield slices of [first, last) of at most BLOCK entries, so that numpy's temporary arrays stay in the cache."""
    for begin in range(first, last, BLOCK):
        yield slice(begin, min(begin + BLOCK, last))
