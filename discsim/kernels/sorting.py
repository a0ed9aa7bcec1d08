"""Counting sort in parts: part p of `parts` has the keys from n p / parts on. For `discsim.numerics.threads.share`."""

import numpy as np
from numba import njit

ONE = np.uint32(1)


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
