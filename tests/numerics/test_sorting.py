"""Counting sort against numpy's, whatever the number of threads."""

import numpy as np
import pytest

from discsim.numerics import thread_pool
from discsim.numerics.sorting import counting_sort, key_counts


@pytest.fixture(params=[1, 2, 5])
def threads(request, monkeypatch):
    """A number of threads to share work among, whether or not there are as many cores."""
    monkeypatch.setattr(thread_pool, "number_of_threads", lambda: request.param)


@pytest.mark.parametrize("most", [40, 5000])
@pytest.mark.parametrize("number", [0, 1, 3, 30_000])
def test_order_is_that_of_a_stable_sort(threads, number, most):
    key = np.random.default_rng(4).integers(0, most, number).astype(np.uint32)
    order, start = counting_sort(key, most + 10)
    np.testing.assert_array_equal(order, np.argsort(key, kind="stable"))
    np.testing.assert_array_equal(start, np.searchsorted(key[order], np.arange(most + 11)))
    np.testing.assert_array_equal(key_counts(key, most + 10), np.bincount(key, minlength=most + 10))


@pytest.mark.parametrize("told", [False, True])
@pytest.mark.parametrize("number", [0, 1, 9000])
def test_members_of_a_key_are_in_the_order_of_their_places(threads, number, told):
    """Of which most are in rising order as they come; some have no key in common with anybody."""
    stream = np.random.default_rng(6)
    key, place = stream.integers(0, 3000, number).astype(np.uint32), np.arange(number, dtype=np.uint64)
    some = stream.permutation(number)[: number // 10]
    place[some] = np.roll(place[some], 1)
    order, start = counting_sort(key, 3000, place, np.append(some, some[:3]) if told else None)
    np.testing.assert_array_equal(order, np.lexsort((place, key)))
    np.testing.assert_array_equal(start, np.searchsorted(key[order], np.arange(3001)))


@pytest.mark.parametrize("most", [5, 4000])
def test_an_order_by_ids_is_that_of_key_and_id(threads, most):
    """With keys of thousands of particles each, and of few."""
    stream = np.random.default_rng(5)
    key, ids = stream.integers(0, most, 9000).astype(np.uint32), stream.permutation(20_000)[:9000]
    np.testing.assert_array_equal(counting_sort(key, most, ids)[0], np.lexsort((ids, key)))


@pytest.mark.parametrize(
    "ids",
    [
        range(30, 0, -1), [9, 1, 2, 3], [1, 8, 9, 2, 3, 4, 5, 6, 7, 0, 11, 10], [*range(1, 40, 2), *range(0, 40, 2)],
        [1, 2, 3, 0], [0, 30, 1, 31, 2, 32, *range(3, 25)],
    ],
)  # fmt: skip
def test_members_that_are_out_of_order_in_every_way(ids):
    """Falling; the first, the last or two in a row too large; many late ones; and members of other keys about them."""
    ids = np.array([100, *ids, 50], np.uint64)
    key = np.ones(len(ids), np.uint32)
    key[0], key[-1] = 0, 2
    np.testing.assert_array_equal(counting_sort(key, 3, ids)[0], np.lexsort((ids, key)))
