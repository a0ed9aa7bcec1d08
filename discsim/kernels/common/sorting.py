"""Counting sort in parts, as a loop of `discsim.numerics.threads.parallel_for`.

Part p of `parts` has the keys from n p / parts on.
"""

import numpy as np

from discsim.jit.decorators import inline_jit, jit
from discsim.jit.index import index

ONE, TWO, THREE = np.uint32(1), index(2), index(3)
GAPS = (
    16764929, 9427969, 4188161, 2354689, 1045505, 587521, 260609, 146305, 64769, 36289, 16001, 8929, 3905, 2161, 929,
    505, 209, 109, 41, 19, 5, 1,
)  # fmt: skip
FEW = 8  # members, up to which insertion sort needs no larger gaps


@jit
def count_keys(part_from, part_to, key, parts, place):
    """Count the keys (n,) of each part in `place` (1 + keys parts,).

    It has a 0, then the counts by key and within it by part.
    """
    # Adjacent particles mostly have the same key, and an increment waits for the one before to be written. The loop
    # therefore takes keys from four quarters in turn. Unsigned indices need no test for negative values.
    stride = index(parts)
    for part in range(part_from, part_to):
        first, end = len(key) * part // parts, len(key) * (part + 1) // parts
        quarter, at = index((end - first) // 4), index(part + 1)
        for i in range(index(first), index(first) + quarter):
            place[key[i] * stride + at] += ONE
            place[key[i + quarter] * stride + at] += ONE
            place[key[i + TWO * quarter] * stride + at] += ONE
            place[key[i + THREE * quarter] * stride + at] += ONE
        for i in range(index(end - (end - first) % 4), index(end)):
            place[key[i] * stride + at] += ONE


@jit
def put_in_order(part_from, part_to, key, parts, place, order):
    """Write the indices of the particles to `order`, sorted by key.

    `place` has the next free position in `order` for each key and part, and is advanced. It ends at the start of the
    next key or part.
    """
    stride = index(parts)
    for part in range(part_from, part_to):
        for i in range(index(len(key) * part // parts), index(len(key) * (part + 1) // parts)):
            k = key[i] * stride + index(part)
            order[place[k]] = i
            place[k] += ONE


@jit
def find_behind(first, last, ids, order, out):
    """Write to `out` (n,) whether the `ids` of each entry of an order, but the first, is below the one before."""
    if first == last:
        return
    before = ids[order[max(first - 1, 0)]]
    for k in range(index(first), index(last)):
        here = ids[order[k]]
        out[k] = here < before
        before = here


@jit
def sort_members(first, last, some, start, ids, order):
    """Sort the members of the keys `some`, order[start[key]:start[key + 1]], by their `ids` (n,), which are distinct.

    The ids mostly rise: members that are out of order are taken out, sorted, and merged with the others.
    """
    most = 0
    for n in range(first, last):
        most = max(most, start[some[n] + 1] - start[some[n]])
    rising, rising_ids = np.empty(most, order.dtype), np.empty(most, ids.dtype)
    late, late_ids = np.empty(most, order.dtype), np.empty(most, ids.dtype)
    for n in range(first, last):
        members = order[start[some[n]] : start[some[n] + 1]]
        held = _take_out(members, ids, rising, rising_ids, late, late_ids)
        _sort(len(members) - held, late, late_ids)
        _merge(members, held, rising, rising_ids, late, late_ids)


@inline_jit
def _take_out(members, ids, rising, rising_ids, late, late_ids):
    """Split members into `rising`, in the order of ids, and the others, `late`; return the number of rising ones."""
    held = 0
    for k in range(len(members)):
        member, mine = members[k], ids[members[k]]
        if held > 0 and mine < rising_ids[held - 1]:
            out = k - held
            late[out], late_ids[out] = member, mine
            if held == 1 or rising_ids[held - 2] <= mine:  # the one before is out of order instead: move that
                late[out], late_ids[out] = rising[held - 1], rising_ids[held - 1]
                rising[held - 1], rising_ids[held - 1] = member, mine
            continue
        rising[held], rising_ids[held] = member, mine
        held += 1
    return held


@inline_jit
def _sort(count, members, ids):
    """Sort by insertion among members `gap` apart, at last 1 apart (Shell 1959; gaps of Sedgewick 1986).

    numba's own sorts take seconds to compile.
    """
    for step in range(len(GAPS) - 1 if count <= FEW else 0, len(GAPS)):
        gap = GAPS[step]
        for k in range(gap, count):
            member, mine, at = members[k], ids[k], k
            while at >= gap and ids[at - gap] > mine:
                members[at], ids[at] = members[at - gap], ids[at - gap]
                at -= gap
            members[at], ids[at] = member, mine


@inline_jit
def _merge(members, held, rising, rising_ids, late, late_ids):
    """Merge both lists into `members`, from the last to the first."""
    i, j = held - 1, len(members) - held - 1
    for k in range(len(members) - 1, -1, -1):
        if j >= 0 and (i < 0 or late_ids[j] > rising_ids[i]):
            members[k] = late[j]
            j -= 1
        else:
            members[k] = rising[i]
            i -= 1
