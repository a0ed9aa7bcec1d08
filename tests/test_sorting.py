"""Counting sort against numpy's, whatever the number of threads."""

import numba
import numpy as np
import pytest

from discsim.sorting import counting_sort, counts


@pytest.fixture(params=[1, 2, 5])
def threads(request, monkeypatch):
    """A number of threads to share work among, whether or not there are as many cores."""
    monkeypatch.setattr(numba, "get_num_threads", lambda: request.param)


@pytest.mark.parametrize("number", [0, 1, 3, 30_000])
def test_order_is_that_of_a_stable_sort(threads, number):
    key = np.random.default_rng(4).integers(0, 40, number).astype(np.uint32)
    order, start = counting_sort(key, 50)
    np.testing.assert_array_equal(order, np.argsort(key, kind="stable"))
    np.testing.assert_array_equal(np.diff(start), np.bincount(key, minlength=50))
    np.testing.assert_array_equal(counts(key, 50), np.bincount(key, minlength=50))


def test_few_particles_of_many_keys(threads):
    key = np.array([70_000, 3, 99_999, 3], np.uint32)
    order, start = counting_sort(key, 100_000)
    np.testing.assert_array_equal(order, [1, 3, 0, 2])
    assert start[0] == 0 and start[4] == 2 and start[70_001] == 3 and start[-1] == 4
