"""Counting sort in parts: part p of `parts` has the keys from n p / parts on. For `discsim.numerics.threads.share`."""

import numpy as np

from discsim.jit.decorators import compiled, inner

ONE, TWO, THREE = np.uint32(1), np.uint64(2), np.uint64(3)
GAPS = (
    16764929, 9427969, 4188161, 2354689, 1045505, 587521, 260609, 146305, 64769, 36289, 16001, 8929, 3905, 2161, 929,
    505, 209, 109, 41, 19, 5, 1,
)  # fmt: skip
FEW = 8  # members, of whom each is put straight where it belongs


@compiled
def count_keys(part_from, part_to, key, parts, place):
    """Count the keys (n,) of each part in `place` (1 + keys parts,), by key, within it by part, after a 0."""
    # Neighbours have the same key as a rule, and an addition would wait for the one before to be written: so they come
    # from four places in turn. Unsigned numbers are no indices from the end, which would have to be asked for.
    stride = np.uint64(parts)
    for part in range(part_from, part_to):
        first, end = len(key) * part // parts, len(key) * (part + 1) // parts
        quarter, at = np.uint64((end - first) // 4), np.uint64(part + 1)
        for i in range(np.uint64(first), np.uint64(first) + quarter):
            place[key[i] * stride + at] += ONE
            place[key[i + quarter] * stride + at] += ONE
            place[key[i + TWO * quarter] * stride + at] += ONE
            place[key[i + THREE * quarter] * stride + at] += ONE
        for i in range(np.uint64(end - (end - first) % 4), np.uint64(end)):
            place[key[i] * stride + at] += ONE


@compiled
def put_in_order(part_from, part_to, key, parts, place, order):
    """Put the numbers of the particles where `place` has them, which ends where the next one has its first."""
    stride = np.uint64(parts)
    for part in range(part_from, part_to):
        for i in range(np.uint64(len(key) * part // parts), np.uint64(len(key) * (part + 1) // parts)):
            k = key[i] * stride + np.uint64(part)
            order[place[k]] = i
            place[k] += ONE


@compiled
def find_behind(first, last, ids, order, out):
    """Write to `out` (n,) of each in an order, but for the first of all, whether its `ids` is below that before it."""
    if first == last:
        return
    before = ids[order[max(first - 1, 0)]]
    for k in range(np.uint64(first), np.uint64(last)):
        here = ids[order[k]]
        out[k] = here < before
        before = here


@compiled
def sort_members(first, last, some, start, ids, order):
    """Put the members of `some` keys, order[start[key]:start[key + 1]], in the order of their `ids` (n,), which differ
    and mostly rise: members that are out of order are taken out, sorted, and merged with the others.
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


@inner
def _take_out(members, ids, rising, rising_ids, late, late_ids):
    """Members in `rising` order of ids, how many these are, and others, `late`."""
    held = 0
    for k in range(len(members)):
        member, mine = members[k], ids[members[k]]
        if held > 0 and mine < rising_ids[held - 1]:
            out = k - held
            late[out], late_ids[out] = member, mine
            if held == 1 or rising_ids[held - 2] <= mine:  # rather the one before, which is above more than this one
                late[out], late_ids[out] = rising[held - 1], rising_ids[held - 1]
                rising[held - 1], rising_ids[held - 1] = member, mine
            continue
        rising[held], rising_ids[held] = member, mine
        held += 1
    return held


@inner
def _sort(count, members, ids):
    """Insertion among members that are `gap` apart, 1 at last (Shell 1959; gaps of Sedgewick 1986). numba's own sorts
    take seconds to compile.
    """
    for step in range(len(GAPS) - 1 if count <= FEW else 0, len(GAPS)):
        gap = GAPS[step]
        for k in range(gap, count):
            member, mine, at = members[k], ids[k], k
            while at >= gap and ids[at - gap] > mine:
                members[at], ids[at] = members[at - gap], ids[at - gap]
                at -= gap
            members[at], ids[at] = member, mine


@inner
def _merge(members, held, rising, rising_ids, late, late_ids):
    """All members in order, from the last to the first."""
    i, j = held - 1, len(members) - held - 1
    for k in range(len(members) - 1, -1, -1):
        if j >= 0 and (i < 0 or late_ids[j] > rising_ids[i]):
            members[k] = late[j]
            j -= 1
        else:
            members[k] = rising[i]
            i -= 1
