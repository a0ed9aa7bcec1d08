"""Exact sums of floating-point numbers: superaccumulators (Neal 2015, arXiv:1505.05571, sec. 2).

A finite double-precision number is m 2^(e - 1075) with an integer m below 2^53 and an integer e >= 1: the integer m 2^e
in units of 2^-1075. These integers are added without rounding to a long integer, which is stored as `limbs` (LIMBS,)
of 32 bits each; the last limb counts numbers that are not finite. The sum of numbers is independent of their order,
and the limbs of partial sums can be added.
"""

import numpy as np

from discsim.jit.decorators import inline_jit, jit, jit_subroutine

LIMBS = 67
NOT_FINITE = LIMBS - 1
MAX_TERMS = 1024  # numbers that may be added before a carry: each adds less than 2^53 to a limb, an int64
EXPONENT, MANTISSA = np.int64(0x7FF), np.int64((1 << 52) - 1)
HIDDEN, LOW, HALF = np.int64(1 << 52), np.int64(0xFFFFFFFF), np.int64(1 << 51)
PIECE_BITS = 41  # bits of the pieces that numbers are cut into: the sum of MAX_TERMS pieces stays below 2^53


@inline_jit
def add_number(bits, limbs):
    """Add a number, whose bits are given as an int64, to `limbs` (LIMBS,)."""
    e, m, sign = bits >> 52 & EXPONENT, bits & MANTISSA, bits >> 63
    if e == EXPONENT:
        limbs[NOT_FINITE] += 1
        return
    if e > 0:
        m |= HIDDEN
    else:
        e = np.int64(1)
    _add_integer(m, e, sign, limbs)


@inline_jit
def _add_integer(m, e, sign, limbs):
    """Add m 2^e, m below 2^53, to `limbs` if `sign` is 0; subtract it if `sign` is -1."""
    k, shift = np.uint64(e >> 5), e & 31
    limbs[k] += (m << shift & LOW ^ sign) - sign
    limbs[k + np.uint64(1)] += (m >> 32 - shift ^ sign) - sign


@inline_jit
def carry(limbs):
    """Carry the bits of each limb beyond 32 to the next limb, so that MAX_TERMS more numbers may be added."""
    for k in range(NOT_FINITE - 1):
        limbs[k + 1] += limbs[k] >> 32
        limbs[k] &= LOW


@jit_subroutine
def add_terms(number, values, spare, limbs):
    """Add the first `number` entries of `values` (MAX_TERMS,) to `limbs` (LIMBS,).

    spare (2, MAX_TERMS): scratch, overwritten.

    Each value is cut into two or three pieces, integer multiples (up to 2^PIECE_BITS) of a unit that is smaller for
    each further piece. Let b be so large that its last bit is the unit. Then y + b - b is y rounded to the unit (Rump
    et al. 2008, SIAM J. Sci. Comput. 31, 189, algorithm 3.2), and the difference of the bits of y + b and of b, as
    integers, is the multiple. No loop has a branch, so all are vectorised. What remains of values far smaller than the
    largest is added value by value.
    """
    bits, left, sums = values.view(np.int64), spare[0], spare[1]
    rest, sum_bits = left.view(np.int64), sums.view(np.int64)
    top = np.int64(0)
    for k in range(np.uint64(number)):
        left[k] = values[k]
        top = max(top, bits[k] >> 52 & EXPONENT)
    e = top + 53 - PIECE_BITS
    if top > EXPONENT - 53 or e - 2 * PIECE_BITS < 1:  # not finite, or too large or small for these units
        for k in range(np.uint64(number)):
            add_number(bits[k], limbs)
        carry(limbs)
        return
    for _ in range(3):
        sum_bits[0] = bound_bits = e << 52 | HALF
        bound = sums[0]
        total = missed = np.int64(0)
        for k in range(np.uint64(number)):
            sums[k] = left[k] + bound
            left[k] -= sums[k] - bound
            total += sum_bits[k] - bound_bits
            missed |= rest[k] << 1
        sign = total >> 63
        _add_integer((total ^ sign) - sign, e, sign, limbs)
        if missed == 0:
            break
        e -= PIECE_BITS
    if missed != 0:
        for k in range(np.uint64(number)):
            add_number(rest[k], limbs)
    carry(limbs)


@jit
def add_columns(first, last, values):
    """Return the limbs (c, LIMBS) of the sums of the columns of `values` (n, c) over the rows `first` to `last`."""
    limbs, spare = np.zeros((values.shape[1], LIMBS), np.int64), np.empty((3, MAX_TERMS))
    for column in range(values.shape[1]):
        for begin in range(first, last, MAX_TERMS):
            number = min(MAX_TERMS, last - begin)
            for k in range(np.uint64(number)):
                spare[2, k] = values[begin + k, column]
            add_terms(number, spare[2], spare[:2], limbs[column])
    return limbs
