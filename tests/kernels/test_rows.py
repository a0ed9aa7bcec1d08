"""Rows of numbers in vector registers, and what the drag between nodes makes of them."""

import numpy as np
import pytest
from numba import njit

from discsim.kernels import rows
from discsim.kernels.nodes import FIELDS
from discsim.kernels.nodes_gather import own_moments, sum_rows, weigh
from discsim.kernels.nodes_weights import cloud, to_polynomial, value_at
from discsim.kernels.rows import LANES, empty_row, lane, load, store


@njit
def combine(array, number, out):
    one, other = load(array, 1), load(array, 1 + LANES)
    total = empty_row()
    total += number * (one - other)
    total += other + one
    store(out, 2, total)
    return lane(total, 0), lane(total, LANES - 1)


def test_rows_are_reckoned_lane_by_lane():
    """Wherever in an array they begin; what is beside them stays."""
    array, out = np.random.default_rng(1).random((3, 5)), np.full((2, 4), 7.0)
    one, other = array.ravel()[1 : 1 + LANES], array.ravel()[1 + LANES : 1 + 2 * LANES]
    ends = combine(array, 0.3, out)
    expected = 0.3 * (one - other) + (other + one)
    np.testing.assert_allclose(out.ravel()[2 : 2 + LANES], expected, rtol=1e-15)  # products and sums may be fused
    assert ends == (out.ravel()[2], out.ravel()[1 + LANES])
    assert (np.delete(out.ravel(), np.arange(2, 2 + LANES)) == 7.0).all()


def test_rows_are_arrays_where_nothing_is_compiled():
    array = np.random.default_rng(2).random((3, 5))
    compiled, plain = np.zeros((2, 4)), np.zeros((2, 4))
    combine(array, 0.3, compiled)
    combine.py_func(array, 0.3, plain)
    np.testing.assert_allclose(compiled, plain, rtol=1e-15)
    assert isinstance(rows.load(array, 0), np.ndarray)


@njit
def nine(x, y, flat):
    """Weights on the nodes about a cell."""
    out, along, across = np.empty(9), cloud(x, False), cloud(y, flat)
    for k in range(9):
        u = along[0] if k < 3 else along[1] if k < 6 else along[2]
        out[k] = u * (across[0] if k % 3 == 0 else across[1] if k % 3 == 1 else across[2])
    return out


@njit
def polynomial(values, x, y, flat):
    table = values.copy()
    to_polynomial(table, 0, flat)
    row = value_at(table, 0, x, y)
    return np.array([lane(row, k) for k in range(LANES)])


@pytest.mark.parametrize("flat", [False, True])
def test_polynomials_bring_what_the_weights_do(flat):
    """Eq. (5) of `kernels/nodes_weights.py`, of all lanes, up to the edges of a cell."""
    rng = np.random.default_rng(3)
    values = rng.normal(size=(9, LANES))
    for x, y in [*rng.uniform(-0.5, 0.5, (20, 2)), (-0.5, 0.5), (0.5, -0.5)]:
        y = 0.0 if flat else y  # in one dimension all is there
        weights = nine(x, y, flat)
        assert weights.sum() == pytest.approx(1.0, abs=1e-15)
        # Sums of nine products of numbers of about one.
        np.testing.assert_allclose(polynomial(values, x, y, flat), weights @ values, rtol=0, atol=5e-15)


@njit
def give(place, mass, fields, flat):
    count = len(mass)
    row, weight = np.zeros((count, FIELDS)), np.zeros((count, 10))
    row[:] = fields
    for k in range(count):
        row[k, 0], row[k, 1], row[k, 2] = 1.0, place[k, 0], place[k, 1]
        weigh(k, k, mass[k], flat, row, weight)
    given, own = np.empty((9, FIELDS)), np.empty((3, FIELDS))
    sum_rows(0, count, weight, row, 0, given, 0)
    sum_rows(0, count, weight, row, LANES, given, LANES)
    own_moments(given, 0, own, 0)
    return row, given, own


@pytest.mark.parametrize("flat", [False, True])
@pytest.mark.parametrize("count", [0, 1, 2, 13])
def test_what_a_cell_gives_is_the_sum_over_its_particles(count, flat):
    """Of any number of them, none too; and its own moments follow from that, as weights reproduce places."""
    rng = np.random.default_rng(4)
    place, mass = rng.uniform(-0.5, 0.5, (count, 2)), rng.random(count)
    if flat:
        place[:, 1] = 0.0
    row, given, own = give(place, mass, rng.normal(size=(count, FIELDS)), flat)
    weights = np.array([nine(x, y, flat) for x, y in place]).reshape(count, 9)
    np.testing.assert_allclose(given, (mass[:, None] * weights).T @ row, rtol=0, atol=1e-14)
    moments = np.column_stack([np.ones(count), place]) * mass[:, None]
    np.testing.assert_allclose(own, moments.T @ row, rtol=0, atol=1e-14)
