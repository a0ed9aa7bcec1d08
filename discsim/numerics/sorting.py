"""Stable counting sort of particles by integer keys, on several threads.

The stable order is unique, so it does not depend on the number of threads.
"""

import numpy as np

from discsim.kernels.common import sorting as kernels
from discsim.numerics import thread_pool, threads
from discsim.numerics.threads import parallel_for

Array = np.ndarray


def counting_sort(
    key: Array, count: int, global_index: Array | None = None, unsorted_rows: Array | None = None
) -> tuple[Array, Array]:
    """Return the stable order (n,) of entries by `key`, and the start (count + 1,) of each key in that order.

    key (n,): integers in [0, count); n is below 2^32. global_index (n,): second sort keys, for entries with equal
    `key`; None: such entries keep the order of the arrays. unsorted_rows: rows without which `global_index` ascends;
    None if unknown.
    """
    ends, parts = _count_in_parts(key, count)
    np.cumsum(ends, out=ends)
    start = ends[::parts].astype(np.int64)
    order = np.empty(len(key), np.uint32)
    parallel_for(kernels.write_order, parts, key, parts, ends, order, least=1)
    if global_index is not None:
        if unsorted_rows is None:
            some = _keys_out_of_order(key, global_index, order, start)
        else:
            some = np.unique(key[unsorted_rows])
        parallel_for(kernels.sort_members, len(some), some, start, global_index, order)
    return order, start


def _keys_out_of_order(key: Array, global_index: Array, order: Array, start: Array) -> Array:
    """Return the distinct values of `key` (n,) whose entries are not in the order of `global_index` (n,).

    order, start: stable order by `key`, and start of each key in it, as in `counting_sort`.
    """
    behind = np.empty(len(key) + 1, bool)
    parallel_for(kernels.mark_unsorted, len(key), global_index, order, behind)
    behind[start] = False  # the first member of each key, and the entry beyond the end
    some = key[order[np.flatnonzero(behind)]]
    another = np.ones(len(some), bool)
    another[1:] = some[1:] != some[:-1]
    return some[another]


def key_counts(key: Array, count: int) -> Array:
    """Return the numbers (count,) of entries with each key; key (n,): integers in [0, count)."""
    number, parts = _count_in_parts(key, count)
    # Several times as fast as np.sum.
    return sum((number[1 + part :: parts] for part in range(1, parts)), number[1::parts])


def _count_in_parts(key: Array, count: int) -> tuple[Array, int]:
    """Return the numbers of entries with each key in each part of `key` (n,), after a 0, and the number of parts.

    The numbers are sorted by key and then by part, so that their cumulative sum gives positions in the sorted order.
    """
    # The number of parts is bounded, so that the result is small compared with the arrays of particles.
    many = min(len(key) // threads.MIN_CHUNK_CHEAP, 4 * len(key) // max(count, 1024))
    parts = max(1, min(thread_pool.number_of_threads(), many))
    number = np.zeros(count * parts + 1, np.uint32)
    parallel_for(kernels.count_keys, parts, key, parts, number, least=1)
    return number, parts
