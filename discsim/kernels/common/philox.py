"""Counter-based random numbers: Philox4x32-10 (Salmon, Moraes, Dror & Shaw 2011), made normal (Box & Muller 1958).

The numbers depend only on a key and a counter. The key is made from the seed of the scene, the counter from the id of a
particle and the number of the step. Random numbers are therefore the same in any order of particles and on any number
of threads, and checkpoints need not store the state of a generator. A word is an integer of 32 bits.
"""

import math

import numpy as np

from discsim.jit.decorators import inline_jit, jit

MASK, HALF = np.uint64(0xFFFFFFFF), np.uint64(32)
FIRST, SECOND = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)  # multipliers
GOLDEN, SQRT3 = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)  # increments of the key per round
ROUNDS = 10
TWICE_PI = 2.0 * math.pi


@inline_jit
def random_words(key, counter):
    """Return four random words for a key of two words and a counter of four, all as integers of 64 bits."""
    k, l = key
    a, b, c, d = counter
    for _ in range(ROUNDS):
        p, q = FIRST * a, SECOND * c
        a, b, c, d = (q >> HALF) ^ b ^ k, q & MASK, (p >> HALF) ^ d ^ l, p & MASK
        k, l = (k + GOLDEN) & MASK, (l + SQRT3) & MASK
    return a, b, c, d


@inline_jit
def uniform_number(high, low):
    """Return a uniform random number in (0, 1), made of 52 bits of two random words."""
    return (float(((high << HALF) | low) >> np.uint64(12)) + 0.5) * 2.0**-52


@inline_jit
def normal_pair(key, counter):
    """Return two independent normal random numbers of mean 0 and variance 1."""
    a, b, c, d = random_words(key, counter)
    length = math.sqrt(-2.0 * math.log(uniform_number(a, b)))
    angle = TWICE_PI * uniform_number(c, d)
    return length * math.cos(angle), length * math.sin(angle)


@jit
def write_normals(first, last, key, ids, step, out):
    """Write two normal random numbers for each particle to `out` (n, 2), by its id in `ids` (n,) and the step."""
    for i in range(first, last):
        out[i, 0], out[i, 1] = normal_pair(key, counter_words(ids[i], step))


@inline_jit
def counter_words(particle, step):
    """Return the counter for the id `particle` and a step: four words, two for the id and two for the step."""
    one, other = np.uint64(particle), np.uint64(step)
    return one & MASK, one >> HALF, other & MASK, other >> HALF


def key_words(seed: int, use: int) -> tuple[np.uint64, np.uint64]:
    """Return the key for the seed of a scene and for the purpose of the numbers, an integer `use`: two words."""
    return np.uint64(seed & 0xFFFFFFFF), np.uint64(((seed >> 32) ^ use) & 0xFFFFFFFF)
