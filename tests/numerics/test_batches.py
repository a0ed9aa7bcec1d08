"""Bounds of batches of rows."""

import numpy as np
import pytest
from runs import WAVE, scene_of

from discsim import Simulation
from discsim.kernels.mpi.batches import BATCH
from discsim.numerics import world
from discsim.numerics.batches import bounds_of, update_bounds
from discsim.numerics.operators import Operator, Slot


def places(count, dim, seed=1):
    return np.random.default_rng(seed).normal(size=(count, dim))


@pytest.mark.parametrize("dim", [1, 2])
@pytest.mark.parametrize("count", [0, 1, 7, BATCH, BATCH + 1, 5 * BATCH - 3])
def test_bounds_are_the_least_and_largest_of_each_batch(count, dim):
    pos = places(count, dim)
    parts = [pos[first : first + BATCH] for first in range(0, count, BATCH)]
    expected = np.zeros((len(parts), 4))
    for row, part in zip(expected, parts, strict=True):
        row[0 : 2 * dim : 2], row[1 : 2 * dim : 2] = part.min(axis=0), part.max(axis=0)
    np.testing.assert_array_equal(bounds_of(pos), expected)


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_has_no_bounds(wrong):
    for row in (0, BATCH - 1, 2 * BATCH - 1):
        pos = places(2 * BATCH, 2)
        pos[row, 1] = wrong
        here = np.arange(2) == row // BATCH
        np.testing.assert_array_equal(np.isnan(bounds_of(pos)).all(axis=1), here)


@pytest.mark.parametrize("count", [0, 1, 3 * BATCH, 3 * BATCH + 9, 6 * BATCH, 6 * BATCH + 1])
@pytest.mark.parametrize("left", [3 * BATCH - 1, 3 * BATCH, 3 * BATCH + 9])
def test_bounds_of_changed_rows_are_made_anew(count, left):
    """Of an array that has become shorter or longer; what was there and has not changed is not looked at again."""
    before, after = places(left, 2), places(count, 2, seed=2)
    same = min(count, left)
    after[:same] = before[:same]
    rows = np.array([0, 5, 2 * BATCH, 9 * BATCH])
    here = rows[rows < count]
    after[here] = 9.0
    bounds = bounds_of(before)
    expected = bounds_of(after)
    np.testing.assert_array_equal(update_bounds(bounds, after, rows), expected)
    if count > 2 * BATCH:
        bounds[1] = expected[1] = -1.0
        np.testing.assert_array_equal(update_bounds(bounds, after, rows), expected)


def test_what_is_known_of_places_goes_when_they_move(tmp_path, monkeypatch):
    """And before a kick where somebody may have changed them; not in other kicks, which ask for it."""
    sim, forgotten = Simulation(scene_of(tmp_path, WAVE)), []

    class Noting(world.SerialComm):
        def drop_caches(self):
            forgotten.append(sim.gas.pos.copy())

    monkeypatch.setattr(world, "processes", Noting())
    sim.operators.forces()
    sim.operators.arrays_exposed = True
    for expected in (1, 1):
        sim.operators.kick(0.01)
        assert len(forgotten) == expected
    sim.operators.move(0.01)
    assert len(forgotten) == 2
    np.testing.assert_array_equal(forgotten[-1], sim.gas.pos)


def test_what_is_known_of_places_goes_before_operators_use_the_new_ones(tmp_path, monkeypatch):
    """As the walk of the dust does; the results of the last kick, which it needs, go after it."""
    sim, order, places = Simulation(scene_of(tmp_path, WAVE)), [], []

    class Noting(world.SerialComm):
        def drop_caches(self):
            order.append("all")

        def drop_position_caches(self):
            order.append("positions")
            places.append(sim.gas.pos.copy())

    def move(state, dt):
        order.append("move")
        places.append(state.gas.pos.copy())

    sim.operators.plan[Slot.MOVE].append(("gas", Operator("gas.walk", Slot.MOVE, move)))
    monkeypatch.setattr(world, "processes", Noting())
    sim.operators.move(0.01)
    assert order == ["positions", "move", "all"]
    np.testing.assert_array_equal(*places)
