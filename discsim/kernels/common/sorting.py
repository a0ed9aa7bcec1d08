"""Parallel counting sort of particles by integer keys, for `discsim.numerics.threads.parallel_for`.

The n keys are divided into `parts` parts of equal length: part p begins at key n p / parts. A kernel processes the
parts `part_from` to `part_to`.
"""

import numpy as np

from discsim.jit.decorators import inline_jit, jit
from discsim.jit.index import index

ONE, TWO, THREE = np.uint32(1), index(2), index(3)
GAPS = (
    16764929, 9427969, 4188161, 2354689, 1045505, 587521, 260609, 146305, 64769, 36289, 16001, 8929, 3905, 2161, 929,
    505, 209, 109, 41, 19, 5, 1,
)  # fmt: skip
FEW = 8  # so many entries or fewer are sorted without larger gaps


@jit
def count_keys(part_from, part_to, key, parts, place):
    """Count how often each key occurs in each part of `key` (n,), and add the counts to `place` (1 + keys * parts,).

    place[1 + k * parts + p] counts key k in part p; place[0] is not changed.
    """
    # Adjacent particles mostly have the same key, and an increment of a count waits until the one before is written.
    # The loop therefore takes keys from four quarters of the part in turn. Unsigned indices need no test for negative
    # ones.
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
def write_order(part_from, part_to, key, parts, place, order):
    """Write the indices of the particles, sorted by `key` (n,), to `order` (n,).

    place: position in `order` of the next particle, for each key and part; the index is key * parts + part. `place`
    changes: at the end, each entry is the start of the next key and part.
    """
    stride = index(parts)
    for part in range(part_from, part_to):
        for i in range(index(len(key) * part // parts), index(len(key) * (part + 1) // parts)):
            k = key[i] * stride + index(part)
            order[place[k]] = i
            place[k] += ONE


@jit
def mark_unsorted(first, last, ids, order, out):
    """Write to out[k] whether the id of particle order[k] is below that of order[k - 1], for k in [first, last).

    ids, order, out: (n,). out[0] is False.
    """
    if first == last:
        return
    before = ids[order[max(first - 1, 0)]]
    for k in range(index(first), index(last)):
        current = ids[order[k]]
        out[k] = current < before
        before = current


@jit
def sort_members(first, last, keys, start, ids, order):
    """Sort the particles order[start[k]:start[k + 1]] of each key k in keys[first:last] by their ids, in place.

    ids (n,): distinct integers. The ids mostly ascend already, so only the particles that are out of order are
    sorted, and then merged with the others.
    """
    most = 0
    for n in range(first, last):
        most = max(most, start[keys[n] + 1] - start[keys[n]])
    rising, rising_ids = np.empty(most, order.dtype), np.empty(most, ids.dtype)
    unsorted, unsorted_ids = np.empty(most, order.dtype), np.empty(most, ids.dtype)
    for n in range(first, last):
        members = order[start[keys[n]] : start[keys[n] + 1]]
        held = _split_rising(members, ids, rising, rising_ids, unsorted, unsorted_ids)
        _shell_sort(len(members) - held, unsorted, unsorted_ids)
        _merge_rising(members, held, rising, rising_ids, unsorted, unsorted_ids)


@inline_jit
def _split_rising(members, ids, rising, rising_ids, unsorted, unsorted_ids):
    """Split the particles `members` into some whose ids ascend, `rising`, and the others, `unsorted`.

    The particles and their ids are written to the beginning of the last four arguments. Returns the number of
    particles in `rising`.
    """
    held = 0
    for k in range(len(members)):
        member, number = members[k], ids[members[k]]
        if held > 0 and number < rising_ids[held - 1]:
            out = k - held
            unsorted[out], unsorted_ids[out] = member, number
            if held == 1 or rising_ids[held - 2] <= number:  # the one before is out of order: move that instead
                unsorted[out], unsorted_ids[out] = rising[held - 1], rising_ids[held - 1]
                rising[held - 1], rising_ids[held - 1] = member, number
            continue
        rising[held], rising_ids[held] = member, number
        held += 1
    return held


@inline_jit
def _shell_sort(count, members, ids):
    """Sort the first `count` entries of `members` and `ids` by id, in place.

    Insertion sort of entries `gap` apart, for decreasing gaps that end with 1 (Shell 1959; Sedgewick 1986). The sorts
    in numba take seconds to compile.
    """
    for step in range(len(GAPS) - 1 if count <= FEW else 0, len(GAPS)):
        gap = GAPS[step]
        for k in range(gap, count):
            member, number, at = members[k], ids[k], k
            while at >= gap and ids[at - gap] > number:
                members[at], ids[at] = members[at - gap], ids[at - gap]
                at -= gap
            members[at], ids[at] = member, number


@inline_jit
def _merge_rising(members, held, rising, rising_ids, unsorted, unsorted_ids):
    """Merge the first `held` particles of `rising` with `unsorted`, both sorted by id, into `members`.

    Particles are written from the last to the first.
    """
    i, j = held - 1, len(members) - held - 1
    for k in range(len(members) - 1, -1, -1):
        if j >= 0 and (i < 0 or unsorted_ids[j] > rising_ids[i]):
            members[k] = unsorted[j]
            j -= 1
        else:
            members[k] = rising[i]
            i -= 1
