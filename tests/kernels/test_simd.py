"""Rows of numbers in vector registers, and what the drag between nodes makes of them."""

import numpy as np
import pytest
from numba import njit

from discsim.kernels.common import simd
from discsim.kernels.common.simd import LANES, extract, horizontal_sums, load, sqrt, store, zeros
from discsim.kernels.drag.tsc.columns import (
    NORMS,
    SCRATCH_COLUMNS,
    number_rows,
    padded_count,
    renormalise_weights,
    weigh_by_mass,
)
from discsim.kernels.drag.tsc.gather import own_moments, write_contributions
from discsim.kernels.drag.tsc.nodes import BX, BY, FIELDS, MASS, RHO
from discsim.kernels.drag.tsc.weights import evaluate, to_polynomial, tsc_weights


@njit
def combine(array, number, out):
    one, other = load(array, 1), load(array, 1 + LANES)
    total = zeros()
    total += number * (one - other)
    total += other + one
    store(out, 2, total)
    return extract(total, 0), extract(total, LANES - 1)


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
    assert isinstance(simd.load(array, 0), np.ndarray)


@njit
def reckon(array, number, out):
    one, other = load(array, 0), load(array, LANES)
    store(out, 0, number - one)
    store(out, LANES, one + number)
    store(out, 2 * LANES, one / other)
    store(out, 3 * LANES, number / sqrt(other))
    store(out, 4 * LANES, horizontal_sums(one, other, one * number, one * other))
    return sqrt(number)


def test_rows_meet_numbers():
    """In place of either side; their quotients, roots and sums over lanes."""
    one, other = np.random.default_rng(5).uniform(1.0, 2.0, (2, LANES))
    found, plain = np.empty((2, 5, LANES))
    assert reckon(np.stack([one, other]), 0.3, found) == reckon.py_func(np.stack([one, other]), 0.3, plain)
    sums = [one.sum(), other.sum(), 0.3 * one.sum(), one @ other]
    for rows_found in (found, plain):  # sums in another order
        expected = [0.3 - one, one + 0.3, one / other, 0.3 / np.sqrt(other), sums]
        np.testing.assert_allclose(rows_found, expected, rtol=1e-15, atol=0)


@njit
def nine(x, y, flat):
    """Weights on the nodes about a cell."""
    out, along, across = np.empty(9), tsc_weights(x), (0.0, 1.0, 0.0) if flat else tsc_weights(y)
    for k in range(9):
        u = along[0] if k < 3 else along[1] if k < 6 else along[2]
        out[k] = u * (across[0] if k % 3 == 0 else across[1] if k % 3 == 1 else across[2])
    return out


@njit
def polynomial(values, x, y, flat):
    table = values.copy()
    to_polynomial(table, 0, flat)
    row = evaluate(table, 0, x, y)
    return np.array([extract(row, k) for k in range(LANES)])


@pytest.mark.parametrize("flat", [False, True])
def test_polynomials_bring_what_the_weights_do(flat):
    """Eq. (5) of `kernels/drag/tsc/weights.py`, of all lanes, up to the edges of a cell."""
    rng = np.random.default_rng(3)
    values = rng.normal(size=(9, LANES))
    for x, y in [*rng.uniform(-0.5, 0.5, (20, 2)), (-0.5, 0.5), (0.5, -0.5)]:
        y = 0.0 if flat else y  # in one dimension all is there
        weights = nine(x, y, flat)
        assert weights.sum() == pytest.approx(1.0, abs=1e-15)
        # Sums of nine products of numbers of about one.
        np.testing.assert_allclose(polynomial(values, x, y, flat), weights @ values, rtol=0, atol=5e-15)


@njit
def given_by(place, mass, fields, flat, dense, sources):
    count = len(mass)
    n = padded_count(count)
    column, room = np.zeros((FIELDS, n)), np.empty(SCRATCH_COLUMNS * n)
    column[:, :count] = fields.T
    column[MASS, :count], column[1, :count], column[2, :count] = mass, place[:, 0], place[:, 1]
    weigh_by_mass(n, flat, 0, column.ravel(), room)
    out, own = np.empty((9, FIELDS)), np.empty((3, FIELDS))
    write_contributions(n, dense, sources, 0, column.ravel(), room, out, 0)
    own_moments(out, 0, own, 0)
    column[MASS] = 1.0  # ONE, to the nodes
    return column[:, :count].T.copy(), out, own


@pytest.mark.parametrize(("dense", "sources"), [(True, True), (False, True), (True, False), (False, False)])
@pytest.mark.parametrize("flat", [False, True])
@pytest.mark.parametrize("count", [0, 1, 2, 4, 13])
def test_what_a_cell_gives_is_the_sum_over_its_particles(count, flat, dense, sources):
    """Of any number of them, none too; and its own moments follow from that, as weights reproduce places. Columns of
    what particles lack are not looked at.
    """
    rng = np.random.default_rng(4)
    place, mass = rng.uniform(-0.5, 0.5, (count, 2)), rng.random(count)
    if flat:
        place[:, 1] = 0.0
    fields = rng.normal(size=(count, FIELDS))
    lacked = [RHO] * (not dense) + [BX, BY] * (not sources)
    fields[:, lacked] = np.nan
    fields, given, own = given_by(place, mass, fields, flat, dense, sources)
    fields[:, lacked] = 0.0
    weights = np.array([nine(x, y, flat) for x, y in place]).reshape(count, 9)
    np.testing.assert_allclose(given, (mass[:, None] * weights).T @ fields, rtol=0, atol=1e-14)
    moments = np.column_stack([np.ones(count), place]) * mass[:, None]
    np.testing.assert_allclose(own, moments.T @ fields, rtol=0, atol=1e-14)


@njit
def left_out(n, about, sums, column, room):
    weigh_by_mass(n, False, 0, column, room)
    renormalise_weights(0, n, about, sums, 0, column, room)


def test_no_weight_on_nodes_without_gas():
    """The others have all of it, if there are any; what fills up a column has none, and no NaN."""
    count, n, gas = 5, 8, np.arange(9) % 2 == 0
    place, mass = np.random.default_rng(6).uniform(-0.5, 0.5, (count, 2)), np.arange(1.0, 1.0 + count)
    column, room = np.zeros((FIELDS, n)), np.full((SCRATCH_COLUMNS, n), np.nan)
    column[MASS, :count], column[1, :count], column[2, :count] = mass, place[:, 0], place[:, 1]
    for some in (gas, np.zeros(9, bool)):
        left_out(n, np.arange(9)[None], some[:, None, None] * np.ones((9, 1, FIELDS)), column.ravel(), room.ravel())
        weights = np.array([nine(x, y, False) for x, y in place]) * some
        total = weights.sum(axis=1)
        norms = np.divide(1.0, total, out=np.zeros(count), where=total > 0.0)
        expected = np.append(weights * (mass * norms)[:, None], np.zeros((n - count, 9)), axis=0)
        np.testing.assert_allclose(room[:9].T, expected, rtol=1e-14, atol=1e-15)  # sums of nine weights
        np.testing.assert_allclose(room[NORMS], np.append(norms, np.zeros(n - count)), rtol=1e-14)


@pytest.mark.parametrize(("blocks", "populations"), [(7, 1), (7, 3), (0, 2)])
def test_where_sums_and_columns_of_blocks_are(blocks, populations):
    """Slots of the gas first, then of what dust there is; whole rows of columns, none of what is outside."""
    random = np.random.default_rng(7)
    gas, dust = random.integers(0, 10, blocks), random.integers(0, 3, (blocks, populations)) * 5
    starts = [np.append(0, np.cumsum(np.append(held.ravel(), [9] * 2 * populations))) for held in (gas, dust)]
    slot = np.empty((blocks, 1 + populations), np.int32)
    gas_rows, dust_rows = np.empty(blocks + 1, np.int64), np.empty(blocks * populations + 1, np.int64)
    assert number_rows(*starts, slot, gas_rows, dust_rows) == blocks + np.count_nonzero(dust)
    assert list(slot[:, 0]) == list(range(blocks)) and np.all((slot[:, 1:] < 0) == (dust == 0))
    assert list(slot[:, 1:][dust > 0]) == list(range(blocks, blocks + np.count_nonzero(dust)))
    for found, held in ((gas_rows, gas), (dust_rows, dust.ravel())):
        assert list(found) == [0, *np.cumsum(-(-held // LANES))]
