"""Lists of candidates: all that a cell's particles meet is in them, across the edges of a periodic box too."""

import numpy as np
import pytest
from numba import njit

from discsim.kernels.common.candidates import LANES, find_window, slabs_per_length
from discsim.kernels.common.neighbours import FIRST, NX, REACH, SIDE_X, extremes
from discsim.kernels.mpi.halo import EITHER, OWN, THEIRS, mark_cells
from discsim.numerics.neighbours import candidates, cells_in, corners_of_cells, grids_of, keys_in, sort_into_cells


@pytest.mark.parametrize("h", [0.02, 0.2])  # 0.2: a thousand candidates a cell, so that lists have to grow
def test_candidates_hold_every_neighbour_of_every_image(h):
    pos = np.random.default_rng(3).random((800, 2))
    cells = sort_into_cells(pos, np.full(800, h), 1.0, np.zeros(2), np.ones(2), True)
    (listed,) = candidates(cells, cells, mutual=True)
    for n, cell in enumerate(cells.filled):
        found = slice(listed.begin[n], listed.begin[n + 1])
        j = cells.order[listed.indices[found]]
        image = listed.image_shift[:, found].T if listed.has_images[n] else np.zeros((len(j), 2), int)
        have = set(zip(j.tolist(), *(image + 0).T.tolist(), strict=True))
        for i in cells.order[cells.start[cell] : cells.start[cell + 1]]:
            for turn in np.ndindex(3, 3):
                t = np.array(turn) - 1
                near = np.flatnonzero(np.hypot(*(pos + t - pos[i]).T) < h)
                assert {(k, *t.tolist()) for k in near.tolist()} <= have


@njit
def window_in(n, dx, far, half, reach, begin, end, listed):
    return find_window(n, dx, far, slabs_per_length(half, reach), begin, end, listed)


@pytest.mark.parametrize("stretch", [1.0, 1.5])
@pytest.mark.parametrize("periodic", [False, True])
def test_windows_hold_all_that_are_within_reach_along_x(periodic, stretch):
    """However a cell's candidates are divided; in long cells they hold little more, so that sums have less to do."""
    rng = np.random.default_rng(5)
    pos, h = rng.random((2000, 2)), 0.03 * 2.0 ** rng.uniform(0.0, 2.0, 2000)
    grids = grids_of(pos, h, 1.0, np.zeros(2), np.ones(2), periodic, stretch=stretch)
    cells = cells_in(*grids, pos, h)
    (listed,) = candidates(cells, cells, mutual=True, in_slabs=True)
    looked_at = most = 0
    for n, cell in enumerate(cells.filled):
        first, last = listed.begin[n : n + 2]
        slots, (ox, _, half, _, reach) = listed.indices[first:last], cells.bounds[cell]
        x = cells.x[slots] - ox + (listed.image_shift[0, first:last] if listed.has_images[n] else 0.0)
        assert listed.slab_starts[n, 0] == 0 and np.all(np.diff(listed.slab_starts[n]) >= 0)
        assert listed.largest_radius[n] == cells.radius[slots].max()
        middle = first + (last - first) // 3
        for k in range(cells.start[cell], cells.start[cell + 1]):
            dx, far = cells.x[k] - ox, max(cells.radius[k], listed.largest_radius[n])
            within = np.zeros(last - first, bool)
            for begin, end in ((first, middle), (middle, last)):
                some, count = window_in(n, dx, far, half, reach, begin, end, listed)
                assert some % 4 == 0 and count % LANES == 0  # whole vectors
                within[begin - first + some : min(begin - first + some + count, end - first)] = True
            assert within[np.abs(x - dx) <= far].all()
            looked_at, most = looked_at + within.sum(), most + len(within)
    assert looked_at < (0.85 if stretch == 1.5 else 1.0) * most


def grids_about(periodic):
    """Grids of particles whose h differ, in a box of 2 by 1, with their classes and places."""
    rng = np.random.default_rng(4)
    pos = rng.random((600, 2)) * [2.0, 1.0]
    h = 0.01 * 2.0 ** rng.uniform(0.0, 4.0, 600)
    return *grids_of(pos, h, 1.0, np.zeros(2), np.array([2.0, 1.0]), periodic), pos


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize(
    "box", [[0.5, 0.4, 0.9, 0.6], [0.0, 0.0, 0.1, 0.1], [1.9, 0.2, 2.0, 1.0], [np.inf, np.inf, -np.inf, -np.inf]]
)
def test_a_part_of_grids_numbers_its_cells_as_the_whole_does(periodic, box):
    """Those of all within reach of a box."""
    grids, classes, pos = grids_about(periodic)
    low, high = np.array(box[:2]), np.array(box[2:])
    part = grids.near(low, high, np.full(len(grids.table), 0.05))
    assert part.cells <= grids.cells
    turns = [np.array(turn) - 1 for turn in np.ndindex(3, 3)] if periodic else [np.zeros(2)]
    images = np.array([pos + turn * [2.0, 1.0] for turn in turns])
    near = np.flatnonzero(np.any(np.all((images >= low - 0.05) & (images <= high + 0.05), axis=2), axis=0))
    key = keys_in(part, classes[near], pos[near])
    np.testing.assert_array_equal(part.indices_in_whole()[key], keys_in(grids, classes[near], pos[near]))
    np.testing.assert_array_equal(grids.indices_in_whole(), np.arange(grids.cells))


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("reach_of", [THEIRS, OWN, EITHER])
def test_cells_that_may_be_met_are_marked(periodic, reach_of):
    """All that hold anybody whom a particle of some cells may meet, in whole grids and in a part; and not all."""
    grids, classes, pos = grids_about(periodic)
    some = np.flatnonzero(np.all(np.abs(pos - [1.0, 0.5]) < 0.1, axis=1))
    reach = grids.table[:, REACH]
    part = grids.near(*corners_of_cells(grids, classes[some], pos[some]), np.full(len(reach), 1.2 * reach.max()))
    for each in (grids, part):
        filled = np.unique(keys_in(each, classes[some], pos[some])).astype(np.int64)
        marked = mark_cells(filled, each.table, np.zeros(2), each.table, reach_of, 1.2, False, periodic)
        assert not marked.all()
        found = each.indices_in_whole()[marked]
        keys = keys_in(grids, classes, pos)
        for i in some:
            away = np.abs(pos - pos[i])
            away = np.hypot(*(np.minimum(away, [2.0, 1.0] - away) if periodic else away).T)
            own, theirs = 1.2 * reach[classes[i]], 1.2 * reach[classes]
            met = away <= {THEIRS: theirs, OWN: own, EITHER: np.maximum(own, theirs)}[reach_of]
            assert set(keys[met].tolist()) <= set(found.tolist())


@pytest.mark.parametrize("reach_of", [THEIRS, OWN, EITHER])
def test_all_that_is_marked_is_within_reach(reach_of):
    """Cells are marked by where they lie, but for rounding; of an open box."""
    grids, classes, pos = grids_about(False)
    level = np.searchsorted(grids.table[:, FIRST], np.arange(grids.cells), side="right") - 1
    place = np.arange(grids.cells) - grids.table[level, FIRST]
    side = grids.table[level, SIDE_X : SIDE_X + 2]
    low = np.column_stack([place // grids.table[level, NX + 1], place % grids.table[level, NX + 1]]) * side
    filled = np.unique(keys_in(grids, classes, pos))[::40].astype(np.int64)
    marked = mark_cells(filled, grids.table, np.zeros(2), grids.table, reach_of, 1.2, False, False)
    own, theirs = 1.2 * grids.table[level[filled], REACH], 1.2 * grids.table[level, REACH][:, None]
    reach = {THEIRS: theirs + 0.0 * own, OWN: own + 0.0 * theirs, EITHER: np.maximum(own, theirs)}[reach_of]
    apart = np.maximum(low[:, None] - (low + side)[filled], low[filled] - (low + side)[:, None]).max(axis=2) - reach
    edge = 1e-5 * side.max()
    assert marked[(apart < -edge).any(axis=1)].all()
    assert not marked[(apart > edge).all(axis=1)].any()
    assert 0 < marked.sum() < grids.cells


@pytest.mark.parametrize("columns", [1, 2])
@pytest.mark.parametrize(("first", "last"), [(0, 0), (3, 4), (1, 33), (0, 320), (7, 1000)])
def test_extremes_of_columns(columns, first, last):
    values = np.random.default_rng(5).normal(size=(1000, columns))
    values[3], values[40] = np.nan, -np.inf
    least, most = extremes(first, last, values)
    some = values[first:last]
    np.testing.assert_array_equal(least, np.fmin.reduce(some, initial=np.inf))
    np.testing.assert_array_equal(most, np.fmax.reduce(some, initial=-np.inf))


def test_places_that_are_no_numbers_leave_a_cell_of_each_grid():
    grids, _, _ = grids_about(False)
    part = grids.near(np.array([-np.inf, np.nan]), np.array([np.inf, np.nan]), np.zeros(len(grids.table)))
    assert part.cells == len(grids.table)
