"""Parallel loops: compiled functions ("kernels") that release the GIL run on chunks of a range of indices.

    @njit(nogil=True, cache=True)
    def kernel(first, last, ...):      # for i in range(first, last)

Chunks only divide independent work, so results are bitwise the same for any number of threads. One loop per kernel,
without numba's own parallel lowering, also compiles in a fraction of the time. `numerics/thread_pool.py` assigns
chunks to threads.
"""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from discsim.numerics import alloc, thread_pool
from discsim.parts import Lazy

numba, moves = Lazy("numba"), Lazy("discsim.kernels.common.move")

BLOCK = 8192  # entries per block of numpy operations
MIN_CHUNK_CHEAP = (
    65536  # least particles in a chunk of a cheap kernel (some ns each); waking a thread for fewer gains nothing
)
SMALLEST = 8  # the smallest chunk is at least 1 / SMALLEST of a thread's share, which bounds the wait at the end


def set_threads(number: int | None) -> None:
    """Set the number of threads in parallel loops of this Python thread.

    At most NUMBA_NUM_THREADS are used; None: all of these.
    """
    most = int(numba.config.NUMBA_NUM_THREADS)
    thread_pool.thread_limit.set(most if number is None else min(number, most))


def parallel_for(
    kernel: Callable[..., Any], count: int, *arguments: Any, least: int = 4096, light: bool = False,
    each: list[Any] | None = None,
) -> list[Any]:  # fmt: skip
    """Run `kernel(first, last, *arguments)` on chunks of [0, count); return the list of results, one for each chunk.

    least: smallest length of a chunk. light: whether the kernel is cheap; MIN_CHUNK_CHEAP then replaces `least`. each:
    list returned by an earlier call with the same count and `least`; the kernel gets the entry for its chunk as third
    argument.
    """
    threads = thread_pool.number_of_threads()
    runs = chunks(count, MIN_CHUNK_CHEAP if light else least, threads)
    spans = [span for run in runs for span in run]
    parts = [(*span, *([] if each is None else [each[k]])) for k, span in enumerate(spans)]
    return _run(kernel, parts, arguments, [len(run) for run in runs], threads)


def parallel_for_ranges(
    kernel: Callable[..., Any], several: list[tuple[Any, ...]], *, least: int = 4096, light: bool = False
) -> list[list[Any]]:
    """Run a kernel over several ranges in one parallel loop; return a list of results for each range.

    several: tuples (count, *arguments), one for each range [0, count). Other arguments as in `parallel_for`. Threads do
    not wait for each other between ranges.
    """
    threads = thread_pool.number_of_threads()
    counts = [count for count, *_ in several]
    begins = [sum(counts[:k]) for k in range(len(counts))]
    parts: list[tuple[Any, ...]] = []
    of: list[int] = []
    lengths = []
    for run in chunks(sum(counts), MIN_CHUNK_CHEAP if light else least, threads):
        before = len(parts)
        for first, last in run:
            for k, ((count, *given), begin) in enumerate(zip(several, begins, strict=True)):
                low, high = max(first - begin, 0), min(last - begin, count)
                if low < high or (count == 0 and k not in of):  # called for empty ranges too, as in `parallel_for`
                    parts.append((low, max(low, high), *given))
                    of.append(k)
        lengths.append(len(parts) - before)
    found = _run(kernel, parts, (), lengths, threads)
    return [[one for one, whose in zip(found, of, strict=True) if whose == k] for k in range(len(several))]


def parallel_for_fused(kernels: list[tuple[Any, ...]], count: int, *, least: int = 4096) -> None:
    """Run several kernels over [0, count) in one parallel loop; on each chunk they run one after another.

    kernels: tuples (kernel, *arguments). Threads do not wait for each other between kernels. A kernel may therefore
    read results of earlier kernels only within its own chunk. least: as in `parallel_for`.
    """
    threads = thread_pool.number_of_threads()

    def kernel(first: int, last: int) -> None:
        for one, *arguments in kernels:
            one(first, last, *arguments)

    runs = chunks(count, least, threads)
    _run(kernel, [span for run in runs for span in run], (), [len(run) for run in runs], threads)


def _run(
    kernel: Callable[..., Any],
    parts: list[tuple[Any, ...]],
    arguments: tuple[Any, ...],
    lengths: list[int],
    threads: int,
) -> list[Any]:
    if len(lengths) < 2:
        return [kernel(*part, *arguments) for part in parts]
    return thread_pool.run_loop(thread_pool.Loop(kernel, parts, arguments, lengths), threads)


def chunks(count: int, least: int, threads: int) -> list[list[tuple[int, int]]]:
    """Return the chunks (first, last) of [0, count), one list for each thread.

    A thread's part is halved repeatedly: large first chunks have little overhead, and small last chunks keep the wait
    at the end short. least: smallest length of a chunk.
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
    """Return a copy of an array (n, ...) with the same spare capacity."""
    out = alloc.allocate_like(array)
    parallel_for(moves.assign, len(out), out, array, light=True)
    return out


def fill(out: np.ndarray, values: Callable[[slice], np.ndarray | float]) -> None:
    """Assign `values(slice)` to `out[slice]` for slices of the first axis, on several threads."""

    def part(first: int, last: int) -> None:
        for piece in blocks(first, last):
            out[piece] = values(piece)

    parallel_for(part, len(out))


def blocks(first: int, last: int) -> Iterator[slice]:
    """Yield slices of [first, last) that are short enough for numpy's temporary arrays to stay in the cache."""
    for begin in range(first, last, BLOCK):
        yield slice(begin, min(begin + BLOCK, last))
