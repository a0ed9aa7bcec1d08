"""Totals over particles: exact, and the same however the particles are ordered and divided."""

import math

import numpy as np
import pytest

from discsim.kernels.common.totals import add_columns
from discsim.numerics import thread_pool, world
from discsim.numerics.totals import FSUM_ROWS, rounded, total, totals


def wide(number, seed=3):
    """Numbers of both signs over 600 powers of ten, of which most of the sum cancels."""
    stream = np.random.default_rng(seed)
    half = stream.standard_normal(number) * 10.0 ** stream.integers(-300, 300, number)
    return stream.permutation(np.concatenate([half, -half[: number // 2]]))


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("number", [0, 1, 2, 700, 20_000])
def test_total_is_the_exact_sum(monkeypatch, threads, number):
    monkeypatch.setattr(thread_pool, "number_of_threads", lambda: threads)
    values = wide(number)
    assert total(values) == math.fsum(values)
    both = np.stack([values, 3.0 * values], axis=1)
    assert totals(both).tolist() == [math.fsum(column) for column in both.T]


@pytest.mark.parametrize("decades", [0, 5, 18, 19, 25, 40])
def test_numbers_alike_are_summed_as_whole_numbers(decades):
    """Numbers within 70 powers of two of the largest are cut without a rest; beyond, the rest is added by itself."""
    stream = np.random.default_rng(5)
    values = stream.standard_normal(5000) * 10.0 ** stream.uniform(-decades, 0.0, 5000)
    values[stream.integers(0, 5000, 50)] = 0.0
    for scale in (1.0, 2.0**960, 2.0**-900, 2.0**-1000):
        assert total(scale * values) == math.fsum(scale * values)


def test_total_of_the_smallest_numbers():
    tiny = np.array([5e-324, 5e-324, -2e-323, 1e-310])
    assert total(tiny) == math.fsum(tiny)


@pytest.mark.parametrize("wrong", [np.inf, -np.inf, np.nan])
def test_what_is_not_finite_has_no_total(wrong):
    assert math.isnan(total(np.array([1.0, wrong, 2.0])))


def test_a_total_that_overflows_is_infinite():
    assert total(np.full(4, -1e308)) == -math.inf


@pytest.mark.parametrize("number", [1, 2, FSUM_ROWS, FSUM_ROWS + 1])
def test_sums_of_few_and_of_many_have_the_same_bits(monkeypatch, number):
    """Also as on several processes, which never know that all of them have few."""
    values = wide(number)[:number]
    columns = np.stack([values, -0.0 * values, np.full(number, 1e308), np.full(number, 5e-324)], axis=1)
    for wrong in (0.0, np.inf, np.nan):
        columns[-1, 0] += wrong
        few = totals(columns)
        with monkeypatch.context() as many:
            many.setattr(world.processes, "is_parallel", True)
            assert few.tobytes() == totals(columns).tobytes()
        assert math.isfinite(few[0]) == (wrong == 0.0) and math.isfinite(few[2]) == (number == 1)


def test_parts_add_up_to_the_whole():
    """Limbs of the same numbers in another order, cut at any place, give the same bits."""
    values = wide(5000)
    shuffled = np.random.default_rng(4).permutation(values)
    for cut in (0, 1, 2049, len(values)):
        column = shuffled[:, None]
        parts = add_columns(0, cut, column) + add_columns(cut, len(column), column)
        assert rounded(parts)[0] == total(values)
