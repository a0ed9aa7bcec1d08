"""Exact sums of floating-point numbers: superaccumulators (Neal 2015, arXiv:1505.05571, sec. 2).

A number m 2^(e - 1075), of a whole m and an e >= 1, is m 2^e in units of 2^-1075. Those whole numbers are added in
LIMBS limbs of 32 bits each, without any rounding: sums depend on no order, and sums of parts add up to that of all.
"""

import numpy as np
from numba import njit

LIMBS = 67  # of which the last counts what is not finite
NOT_FINITE = LIMBS - 1
ONE = np.uint64(1)
SOME = 1024  # numbers that limbs of 64 bits have room for: each adds less than 2^53
EXPONENT, MANTISSA = np.int64(0x7FF), np.int64((1 << 52) - 1)
HIDDEN, LOW = np.int64(1 << 52), np.int64(0xFFFFFFFF)


@njit(nogil=True, cache=True, error_model="numpy", forceinline=True)
def add(bits, limbs):
    """Add a number, given as the bits of it (int64), to `limbs` (LIMBS,)."""
    e, m, sign = bits >> 52 & EXPONENT, bits & MANTISSA, bits >> 63
    if e == EXPONENT:
        limbs[NOT_FINITE] += 1
        return
    if e > 0:
        m |= HIDDEN
    else:
        e = np.int64(1)
    k, shift = np.uint64(e >> 5), e & 31
    limbs[k] += (m << shift & LOW ^ sign) - sign
    limbs[k + np.uint64(1)] += (m >> 32 - shift ^ sign) - sign


@njit(nogil=True, cache=True, error_model="numpy", forceinline=True)
def carry(limbs):
    """Take what is beyond 32 bits of each limb to the next one, which leaves room for SOME numbers more."""
    for k in range(NOT_FINITE - 1):
        limbs[k + 1] += limbs[k] >> 32
        limbs[k] &= LOW


@njit(nogil=True, cache=True, error_model="numpy")
def add_columns(first, last, bits):
    """Limbs (columns, LIMBS) of the sums over the rows `first` to `last` of numbers (n, columns), given as bits."""
    limbs = np.zeros((bits.shape[1], LIMBS), np.int64)
    others = np.zeros(LIMBS, np.int64)
    for column in range(bits.shape[1]):
        mine = limbs[column]
        for begin in range(first, last, SOME):
            end = min(begin + SOME, last)
            for i in range(np.uint64(begin + 1), np.uint64(end), 2):  # in turns: none waits for the one before
                add(bits[i - ONE, column], mine)
                add(bits[i, column], others)
            if (end - begin) % 2 == 1:
                add(bits[end - 1, column], mine)
            carry(mine)
            carry(others)
        mine += others
        others[:] = 0
    return limbs
