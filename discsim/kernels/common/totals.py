"""Exact sums of floating-point numbers: superaccumulators (Neal 2015, arXiv:1505.05571, sec. 2).

A number m 2^(e - 1075), of an integer m and an e >= 1, is m 2^e in units of 2^-1075. These integers are added in
LIMBS limbs of 32 bits each, without any rounding. Sums are independent of the order, and partial sums add up to the
sum of all.
"""

import numpy as np

from discsim.jit.decorators import inline_jit, jit, jit_subroutine

LIMBS = 67  # of which the last counts non-finite numbers
NOT_FINITE = LIMBS - 1
SOME = 1024  # numbers that 64-bit limbs can take before a carry: each adds less than 2^53
EXPONENT, MANTISSA = np.int64(0x7FF), np.int64((1 << 52) - 1)
HIDDEN, LOW, HALF = np.int64(1 << 52), np.int64(0xFFFFFFFF), np.int64(1 << 51)
CUT = 41  # bits of a number that are summed as one integer: SOME of them stay below 2^53


@inline_jit
def add(bits, limbs):
    """Add a number, given as its bits (int64), to `limbs` (LIMBS,)."""
    e, m, sign = bits >> 52 & EXPONENT, bits & MANTISSA, bits >> 63
    if e == EXPONENT:
        limbs[NOT_FINITE] += 1
        return
    if e > 0:
        m |= HIDDEN
    else:
        e = np.int64(1)
    _add_whole(m, e, sign, limbs)


@inline_jit
def _add_whole(m, e, sign, limbs):
    """Add m 2^e, m below 2^53; subtract it where `sign` is -1 instead of 0."""
    k, shift = np.uint64(e >> 5), e & 31
    limbs[k] += (m << shift & LOW ^ sign) - sign
    limbs[k + np.uint64(1)] += (m >> 32 - shift ^ sign) - sign


@inline_jit
def carry(limbs):
    """Carry the bits beyond 32 of each limb to the next limb, to make room for SOME more numbers."""
    for k in range(NOT_FINITE - 1):
        limbs[k + 1] += limbs[k] >> 32
        limbs[k] &= LOW


@jit_subroutine
def add_some(number, values, spare, limbs):
    """Add the first `number`, at most SOME, of values (SOME,) to `limbs` (LIMBS,); spare: (2, SOME), overwritten.

    Each value is cut into integers of at most 2^CUT units, two as a rule and three at most, which are added as such.
    Let b be so large that its last bit is the unit. Then y + b - b is y in whole units (Rump et al. 2008, SIAM J.
    Sci. Comput. 31, 189, algorithm 3.2), and the bits of y + b less those of b are their number. No loop has a
    branch: all are vectorised. Any remainder after that, of numbers far smaller than the largest, is added one by
    one.
    """
    bits, left, sums = values.view(np.int64), spare[0], spare[1]
    rest, sum_bits = left.view(np.int64), sums.view(np.int64)
    top = np.int64(0)
    for k in range(np.uint64(number)):
        left[k] = values[k]
        top = max(top, bits[k] >> 52 & EXPONENT)
    e = top + 53 - CUT
    if top > EXPONENT - 53 or e - 2 * CUT < 1:  # non-finite, or too large or small for such units
        for k in range(np.uint64(number)):
            add(bits[k], limbs)
        carry(limbs)
        return
    for _ in range(3):
        sum_bits[0] = bound_bits = e << 52 | HALF
        bound = sums[0]
        whole = missed = np.int64(0)
        for k in range(np.uint64(number)):
            sums[k] = left[k] + bound
            left[k] -= sums[k] - bound
            whole += sum_bits[k] - bound_bits
            missed |= rest[k] << 1
        sign = whole >> 63
        _add_whole((whole ^ sign) - sign, e, sign, limbs)
        if missed == 0:
            break
        e -= CUT
    if missed != 0:
        for k in range(np.uint64(number)):
            add(rest[k], limbs)
    carry(limbs)


@jit
def add_columns(first, last, values):
    """Return the limbs (columns, LIMBS) of the sums over the rows `first` to `last` of numbers (n, columns)."""
    limbs, spare = np.zeros((values.shape[1], LIMBS), np.int64), np.empty((3, SOME))
    for column in range(values.shape[1]):
        for begin in range(first, last, SOME):
            number = min(SOME, last - begin)
            for k in range(np.uint64(number)):
                spare[2, k] = values[begin + k, column]
            add_some(number, spare[2], spare[:2], limbs[column])
    return limbs
