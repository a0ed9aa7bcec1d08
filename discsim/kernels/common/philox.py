"""Random numbers by counter: Philox4x32-10 (Salmon, Moraes, Dror & Shaw 2011), and normal ones (Box & Muller 1958).

The numbers depend on a key and a counter alone. The counter of a particle is its id and the step, so its numbers are
the same in any order and on any number of threads. A restart needs no state of a generator.
"""

import math

import numpy as np

from discsim.jit.decorators import inline_jit, jit, jit_subroutine

MASK, HALF = np.uint64(0xFFFFFFFF), np.uint64(32)
FIRST, SECOND = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)  # multipliers
GOLDEN, ROOT = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)  # increments of the key per round
ROUNDS = 10
TWICE_PI = 2.0 * math.pi


@inline_jit
def random_words(key, counter):
    """Return four random 32-bit words of a key (two words) and a counter (four), all as 64-bit numbers."""
    k, l = key
    a, b, c, d = counter
    for _ in range(ROUNDS):
        p, q = FIRST * a, SECOND * c
        a, b, c, d = (q >> HALF) ^ b ^ k, q & MASK, (p >> HALF) ^ d ^ l, p & MASK
        k, l = (k + GOLDEN) & MASK, (l + ROOT) & MASK
    return a, b, c, d


@inline_jit
def share_of_one(high, low):
    """Return a number in (0, 1) of 52 random bits."""
    return (float(((high << HALF) | low) >> np.uint64(12)) + 0.5) * 2.0**-52


@inline_jit
def normal_pair(key, counter):
    """Return two independent normal numbers of mean 0 and variance 1."""
    a, b, c, d = random_words(key, counter)
    length = math.sqrt(-2.0 * math.log(share_of_one(a, b)))
    angle = TWICE_PI * share_of_one(c, d)
    return length * math.cos(angle), length * math.sin(angle)


@jit_subroutine
def words_of(first, last, key, ids, step, out):
    """Write the words (n, 4) of the counters (id, step)."""
    for i in range(first, last):
        a, b, c, d = random_words(key, counter_of(ids[i], step))
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = a, b, c, d


@jit
def normals_of(first, last, key, ids, step, out):
    """Write the normal numbers (n, 2) of the counters (id, step)."""
    for i in range(first, last):
        out[i, 0], out[i, 1] = normal_pair(key, counter_of(ids[i], step))


@inline_jit
def counter_of(particle, step):
    """Return the counter of a particle's id and a step, two words each."""
    one, other = np.uint64(particle), np.uint64(step)
    return one & MASK, one >> HALF, other & MASK, other >> HALF


def key_of(seed: int, use: int) -> tuple[np.uint64, np.uint64]:
    """Return the key of a scene's seed and of the purpose `use` of its numbers."""
    return np.uint64(seed & 0xFFFFFFFF), np.uint64(((seed >> 32) ^ use) & 0xFFFFFFFF)
