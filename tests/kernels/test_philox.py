"""Random numbers by counter: the published words of Philox4x32-10, and the moments of the normal numbers."""

import numpy as np
import pytest
from numba import njit

from discsim.kernels.common import philox

# Of the generator's authors (Random123, kat_vectors): counter, key, words.
KNOWN = [
    ((0, 0, 0, 0), (0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
    ((0xFFFFFFFF,) * 4, (0xFFFFFFFF,) * 2, (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
    (
        (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
        (0xA4093822, 0x299F31D0),
        (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
    ),
]


@njit
def words(key, counter):
    return philox.random_words(key, counter)


@pytest.mark.parametrize(("counter", "key", "known"), KNOWN)
def test_words_are_those_of_its_authors(counter, key, known):
    assert words(*(tuple(map(np.uint64, part)) for part in (key, counter))) == known


def normals(ids, seed=1, step=3):
    out = np.empty((len(ids), 2))
    philox.write_normals(0, len(ids), philox.key_words(seed, 7), ids, step, out)
    return out


def test_moments_of_normal_numbers():
    """Of 2e5 pairs: means, variances, kurtosis and products within 4.5 of their standard errors."""
    n = 200_000
    x = normals(np.arange(n))
    one = 4.5 / np.sqrt(n)
    assert np.abs(x.mean(axis=0)).max() < one
    assert np.abs((x**2).mean(axis=0) - 1.0).max() < one * np.sqrt(2.0)
    assert np.abs((x**4).mean(axis=0) - 3.0).max() < one * np.sqrt(96.0)
    assert abs((x[:, 0] * x[:, 1]).mean()) < one  # of a pair
    assert abs((x[1:, 0] * x[:-1, 0]).mean()) < one  # of ids that follow each other
    later, other = normals(np.arange(n), step=4), normals(np.arange(n), seed=2)
    assert abs((x * later).mean()) < one and abs((x * other).mean()) < one


def test_numbers_go_with_the_id_alone():
    ids = np.random.default_rng(5).permutation(1000)
    assert (normals(ids) == normals(np.arange(1000))[ids]).all()
    far = normals(np.array([2**33, 2**33 + 1, 1]), seed=2**40 + 1)
    assert len(np.unique(far)) == 6  # upper words of ids and seeds count
    assert not (far[2] == normals(np.array([1]))[0]).any()
