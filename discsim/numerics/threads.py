"""Loops shared among threads: a kernel that frees the interpreter takes pieces of a range.

    @njit(nogil=True, cache=True)
    def kernel(first, last, ...):      # for i in range(first, last)

Pieces only divide independent work, so results are bitwise the same for any number of threads. One loop a
kernel, without numba's own parallel lowering, also compiles in a fraction of the time.
"""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from discsim.parts import Lazy

numba = Lazy("numba")

PIECES = 8  # a thread, so that a fast one can take more

_pools: dict[int, ThreadPoolExecutor] = {}
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pools.clear)  # a fork has none of the threads: work given to them would wait


def use_threads(number: int | None) -> None:
    """Let loops of this Python thread take `number` threads, at most as many (None: as many) as NUMBA_NUM_THREADS."""
    most: int = numba.config.NUMBA_NUM_THREADS
    numba.set_num_threads(most if number is None else min(number, most))


def share(
    kernel: Callable[..., Any], count: int, *arguments: Any, least: int = 4096, each: list[Any] | None = None
) -> list[Any]:
    """Run `kernel(first, last, *arguments)` over [0, count) in pieces of at least `least`; what each returned.

    With `each`, what this returned for the same count and `least`, its own part of that is the third argument.
    """
    threads = numba.get_num_threads()
    pieces = max(1, min(count // least, PIECES * threads)) if threads > 1 else 1
    edges = [count * k // pieces for k in range(pieces + 1)]
    parts = [(*edges[k : k + 2], *([] if each is None else [each[k]])) for k in range(pieces)]
    if pieces == 1:
        return [kernel(*parts[0], *arguments)]
    tasks = [pool(threads).submit(kernel, *part, *arguments) for part in parts]
    return [task.result() for task in tasks]


def pool(threads: int) -> ThreadPoolExecutor:
    """The pool of so many threads, which all loops share."""
    if threads not in _pools:
        _pools[threads] = ThreadPoolExecutor(threads)
    return _pools[threads]


def copied(array: np.ndarray) -> np.ndarray:
    """A copy, made in pieces."""
    out = np.empty_like(array)
    fill(out, lambda piece: array[piece])
    return out


def fill(out: np.ndarray, values: Callable[[slice], np.ndarray | float]) -> None:
    """out[:] = values in pieces, each the values of a slice of the first axis."""

    def part(first: int, last: int) -> None:
        out[first:last] = values(slice(first, last))

    share(part, len(out))
