"""Loops shared among threads: a kernel that frees the interpreter takes pieces of a range.

    @njit(nogil=True, cache=True)
    def kernel(first, last, ...):      # for i in range(first, last)

Pieces only divide independent work, so results are bitwise the same for any number of threads. One loop a
kernel, without numba's own parallel lowering, also compiles in a fraction of the time.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numba

PIECES = 8  # a thread, so that a fast one can take more

_pools: dict[int, ThreadPoolExecutor] = {}


def use_threads(number: int | None) -> None:
    """Let loops take `number` threads, at most one a core (or NUMBA_NUM_THREADS); None: that many."""
    most: int = numba.config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]
    numba.set_num_threads(most if number is None else min(number, most))


def share(kernel: Callable, count: int, *arguments, least: int = 4096) -> None:
    """Run `kernel(first, last, *arguments)` over [0, count) in pieces of at least `least`."""
    threads = numba.get_num_threads()
    pieces = min(count // least, PIECES * threads)
    if threads == 1 or pieces <= 1:
        kernel(0, count, *arguments)
        return
    if threads not in _pools:
        _pools[threads] = ThreadPoolExecutor(threads)
    edges = [count * k // pieces for k in range(pieces + 1)]
    tasks = [_pools[threads].submit(kernel, *edges[k : k + 2], *arguments) for k in range(pieces)]
    for task in tasks:
        task.result()
