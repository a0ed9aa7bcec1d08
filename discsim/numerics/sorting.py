"""Stable counting sort, shared among threads: each counts and places a part of the particles.

The order is unique, and so the same for any number of threads.
"""

import numpy as np

from discsim.kernels.common import sorting as kernels
from discsim.numerics import teams, threads
from discsim.numerics.threads import share

Array = np.ndarray


def counting_sort(
    key: Array, count: int, place: Array | None = None, loose: Array | None = None
) -> tuple[Array, Array]:
    """Stable order (n,) by `key` (n,) in [0, count), and where in it each key starts (count + 1,); n is below 2^32.
    Those of one key are in the order of `place` (n,) where that is given, which rises but for the rows `loose`, if
    these are known.
    """
    ends, parts = _count(key, count)
    np.cumsum(ends, out=ends)
    start = ends[::parts].astype(np.int64)
    order = np.empty(len(key), np.uint32)
    share(kernels.put_in_order, parts, key, parts, ends, order, least=1)
    if place is not None:
        some = _behind(key, place, order, start) if loose is None else _keys_of(loose, key, count)
        share(kernels.sort_members, len(some), some, start, place, order)
    return order, start


def _behind(key: Array, place: Array, order: Array, start: Array) -> Array:
    """The keys whose members are not in the order of their `place` (n,): few."""
    behind = np.empty(len(key) + 1, bool)
    share(kernels.find_behind, len(key), place, order, behind)
    behind[start] = False  # of each key the first one; and what is beyond the end
    some = key[order[np.flatnonzero(behind)]]
    another = np.ones(len(some), bool)
    another[1:] = some[1:] != some[:-1]
    return some[another]


def _keys_of(rows: Array, key: Array, count: int) -> Array:
    """The keys in [0, count) of some rows, each once."""
    held = np.zeros(count, bool)
    held[key[rows]] = True
    return np.flatnonzero(held)


def by_ids(key: Array, count: int, ids: Array) -> Array:
    """Order (n,) by `key` (n,) in [0, count), those of one key by `ids` (n,): whatever order they had before."""
    return counting_sort(key, count, ids)[0]


def counts(key: Array, count: int) -> Array:
    """How many of `key` (n,) in [0, count) there are of each (count,)."""
    place, parts = _count(key, count)
    return sum((place[1 + part :: parts] for part in range(1, parts)), place[1::parts])  # some times faster than .sum


def _count(key: Array, count: int) -> tuple[Array, int]:
    # How many of each key each part has, after a 0: summed up, where they go. No more parts than that is small beside
    # the particles.
    parts = max(1, min(teams.number_of_threads(), len(key) // threads.LIGHT, 4 * len(key) // max(count, 1024)))
    place = np.zeros(count * parts + 1, np.uint32)
    share(kernels.count_keys, parts, key, parts, place, least=1)
    return place, parts
