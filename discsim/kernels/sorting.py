"""Counting sort in parts: part p of `parts` has the keys from n p / parts on. For `discsim.numerics.threads.share`."""

import numpy as np
from numba import njit

ONE = np.uint32(1)
FEW = 64  # members of a key up to which insertion, which finds most in order, is the fastest sort


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
    """Put the members of each key, order[start[key]:start[key + 1]], in the order of their `ids` (n,)."""
    for key in range(first, last):
        begin, end = start[key], start[key + 1]
        if end - begin > FEW:
            members = order[begin:end].copy()
            order[begin:end] = members[np.argsort(ids[members])]
            continue
        for k in range(begin + 1, end):
            member, at = order[k], k
            while at > begin and ids[order[at - 1]] > ids[member]:
                order[at] = order[at - 1]
                at -= 1
            order[at] = member
