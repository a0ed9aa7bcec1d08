"""Counting sort in parts: part p of `parts` has the keys from n p / parts on. For `discsim.numerics.threads.share`."""

import numpy as np
from numba import njit

ONE = np.uint32(1)
GAPS = (
    16764929, 9427969, 4188161, 2354689, 1045505, 587521, 260609, 146305, 64769, 36289, 16001, 8929, 3905, 2161, 929,
    505, 209, 109, 41, 19, 5, 1,
)  # fmt: skip


@njit(nogil=True, cache=True, error_model="numpy")
def count_keys(part_from, part_to, key, parts, place):
    """Count the keys (n,) of each part in `place` (1 + keys parts,), by key, within it by part, after a 0."""
    for part in range(part_from, part_to):
        for i in range(len(key) * part // parts, len(key) * (part + 1) // parts):
            place[key[i] * parts + part + 1] += ONE


@njit(nogil=True, cache=True, error_model="numpy")
def put_in_order(part_from, part_to, key, parts, place, order):
    """Put the numbers of the particles where `place` has them, which ends where the next one has its first."""
    for part in range(part_from, part_to):
        for i in range(len(key) * part // parts, len(key) * (part + 1) // parts):
            k = key[i] * parts + part
            order[place[k]] = i
            place[k] += ONE


@njit(nogil=True, cache=True, error_model="numpy")
def sort_members(first, last, start, ids, order):
    """Put the members of each key, order[start[key]:start[key + 1]], in the order of their `ids` (n,), where they are
    not: most are.

    Insertion among members that are `gap` apart, 1 at last (Shell 1959; gaps of Sedgewick 1986). numba's own sorts take
    seconds to compile.
    """
    for key in range(first, last):
        begin, end = start[key], start[key + 1]
        behind = False
        for k in range(begin + 1, end):
            behind |= ids[order[k - 1]] > ids[order[k]]
        if not behind:
            continue
        for gap in GAPS:
            for k in range(begin + gap, end):
                member, at = order[k], k
                while at >= begin + gap and ids[order[at - gap]] > ids[member]:
                    order[at] = order[at - gap]
                    at -= gap
                order[at] = member
