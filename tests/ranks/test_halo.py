"""What a rank needs of others: kernels by themselves, against plain loops."""

from importlib import import_module
from importlib.util import find_spec
from types import SimpleNamespace

import numpy as np
import pytest

if find_spec("mpi4py") is None:
    pytest.skip("needs mpi4py: pip install -e '.[mpi]'", allow_module_level=True)

from discsim.drag.cells import Lattice, merge
from discsim.kernels.common.neighbours import FIRST, update_radii
from discsim.kernels.drag.blocks import LEVELS, NEAR
from discsim.kernels.drag.tsc import levels
from discsim.kernels.mpi.batches import BATCH
from discsim.kernels.mpi.halo import (
    EITHER,
    add_blocks,
    batches_near,
    cells_within_halo,
    cut_blocks,
    mark_blocks,
    mark_blocks_of_leaves,
    mark_cells,
    mark_leaves,
    number_runs,
    particles_in_runs,
)
from discsim.kernels.mpi.tiles import particles_near_other_ranks, zero_nodes_of_others
from discsim.numerics import alloc
from discsim.numerics.batches import bounds_of
from discsim.numerics.grid import BORDER, Grid
from discsim.numerics.neighbours import sort_into_cells
from discsim.numerics.state import Particles
from discsim.ranks.comm import group_by_rank
from discsim.ranks.division import Division
from discsim.ranks.drag import _needed_blocks, _with_leaves_of_ghosts, leaf_number_ranges
from discsim.ranks.gravity import _ranges_in_global_order
from discsim.ranks.leaves import DividedLeaves
from discsim.ranks.windows import Windows, combine_extents, empty_node_ranges
from discsim.ranks.world import _rows_of_largest


@pytest.mark.parametrize("dim", [1, 2])
def test_places_in_marked_tiles(dim):
    """As the tiles of the places say, of those beyond the grid and of what is no number too."""
    space = SimpleNamespace(dimensions=dim, size=(1.0,) * dim, cells=64, boundary="open")
    division = Division(SimpleNamespace(space=space, centred=True), SimpleNamespace(size=3, rank=0))
    rng = np.random.default_rng(3)
    pos, marked = rng.uniform(-0.7, 0.7, (3000, dim)), rng.random(len(division.owner)) < 0.3
    pos[7], pos[8], pos[9] = np.nan, np.inf, -np.inf
    np.testing.assert_array_equal(
        division.rows_in_tiles(pos, marked, bounds_of(pos)), np.flatnonzero(marked[division.tile_of(pos)])
    )
    # Rows in the order of their tiles, few of which are marked: most of them are not looked at one by one.
    pos = pos[np.argsort(division.tile_of(pos), kind="stable")]
    marked[:] = False
    marked[division.tile_of(pos[[40, 1700]])] = True
    np.testing.assert_array_equal(
        division.rows_in_tiles(pos, marked, bounds_of(pos)), np.flatnonzero(marked[division.tile_of(pos)])
    )


@pytest.mark.parametrize("periodic", [False, True])
def test_others_about_particles(periodic):
    """Of the four nodes about each, whose they are but this rank's, each once; none of one off an open grid."""
    rng, rank = np.random.default_rng(4), 2
    grid = Grid((0.0, 0.0), 0.1, (10, 12), periodic)
    owner, tiles = rng.integers(0, 4, (5, 6)), (np.arange(10) // 2, np.arange(12) // 2)
    pos = rng.uniform(0.0, 1.0, (400, 2)) * [1.0, 1.2]
    some = np.arange(1, 400, 3)
    rows, whose = particles_near_other_ranks(0, len(some), some, pos, grid.origin, 10.0, periodic, tiles, owner, rank)
    lonely = 0
    for p in some:
        first, found = np.floor(pos[p] * 10.0 - 0.5).astype(int), whose[rows == p].tolist()
        nodes = [first + np.array([i, j]) for i in (0, 1) for j in (0, 1)]
        off = not periodic and any(n.min() < 0 or n[0] > 9 or n[1] > 11 for n in nodes)
        expected = set() if off else {int(owner[tiles[0][n[0] % 10], tiles[1][n[1] % 12]]) for n in nodes} - {rank}
        assert set(found) == expected and len(found) == len(expected)
        lonely += off
    assert (lonely > 0) != periodic


@pytest.mark.parametrize("shape", [(64, 96), (70, 37)])
def test_blocks_of_leaves_that_are_cut_and_added(shape):
    rng, side = np.random.default_rng(5), 32
    gas, dust = (rng.integers(0, 2, shape) * (rng.random(shape) < 1e-3) for _ in range(2))
    gas, expected = gas.astype(np.uint32), np.zeros((-(-shape[0] // side), -(-shape[1] // side)), bool)
    out, leaves = expected.copy(), np.empty(shape, bool)
    for x, y in np.argwhere((gas > 0) | (dust > 0)):
        expected[x // side, y // side] = True
    mark_leaves(0, len(out), gas, dust, side, leaves, out)
    np.testing.assert_array_equal(out, expected)
    np.testing.assert_array_equal(leaves, (gas > 0) | (dust > 0))
    number, held = rng.integers(0, 50, leaves.size + 1), np.zeros(50, bool)
    mark_blocks_of_leaves(0, leaves.size, leaves.ravel(), number, held)
    np.testing.assert_array_equal(np.flatnonzero(held), np.unique(number[:-1][leaves.ravel()]))
    blocks = np.argwhere(np.ones_like(out))
    rows, doubled = np.zeros((len(blocks), 2, side, side)), gas.copy()
    cut_blocks(blocks, gas, 1, rows)
    assert rows[:, 0].sum() == 0 and rows[:, 1].sum() == gas.sum()
    add_blocks(blocks, rows, 1, doubled)
    np.testing.assert_array_equal(doubled, 2 * gas)


@pytest.mark.parametrize("periodic", [False, True])
def test_cells_that_reach_others_are_not_alone(periodic):
    """Whoever is within the widened reach of a cell that is, is in cells that are there."""
    rng = np.random.default_rng(6)
    pos, h = rng.random((3000, 2)), rng.choice([0.01, 0.05], 3000, p=[0.95, 0.05])
    cells = sort_into_cells(pos, h, 1.0, np.zeros(2), np.ones(2), periodic)
    there = np.ones(len(cells.bounds), bool)
    strangers = pos[:, 0] > 0.5
    there[cells.key[strangers]] = False
    some = cells.filled[::3]
    update_radii(some, 2.0, h, cells)
    alone = cells_within_halo(some, cells, there)
    away = np.abs(pos[strangers][None] - cells.bounds[some][:, None, :2])
    if periodic:
        away = np.minimum(away, 1.0 - away)
    away = np.maximum(away - cells.bounds[some][:, None, 2:4], 0.0)
    meets = (np.hypot(away[..., 0], away[..., 1]) <= cells.bounds[some, 4][:, None]).any(axis=1)
    assert not (alone & meets).any()
    assert np.count_nonzero(alone) > 0.3 * len(some)  # they are not few for nothing


def test_own_leaves_are_known_whether_or_not_a_scheme_has_summed_them():
    lattice, own, held = SimpleNamespace(shape=(4, 5)), DividedLeaves(None), np.isin(np.arange(20), [0, 3, 7])
    leaves = [np.array([3, 20, 7]), np.array([7, 0])]  # 20: outside
    np.testing.assert_array_equal(own.local_leaves(lattice, leaves), held)
    own._local_leaves = ~held  # as `summed` leaves it
    np.testing.assert_array_equal(own.local_leaves(lattice, leaves), ~held)


@pytest.mark.parametrize("spare", [0, 4])
def test_leaves_of_ghosts_come_behind_own_ones(spare):
    """In their memory where this has room."""
    pos, asked = np.arange(9.0).reshape(9, 1), []

    def find(positions):
        asked.append(len(positions))
        out = alloc.allocate(len(positions), np.empty(0, np.uint32), spare)
        out[:] = positions[:, 0]
        return out

    own = find(pos[:5])
    both = _with_leaves_of_ghosts(own, pos, find)
    assert own.tolist() == [0, 1, 2, 3, 4] and both.tolist() == [*range(9)] and asked == [5, 4]
    assert np.shares_memory(own, both) == (spare > 0)


def test_rows_by_rank_keep_their_order():
    parts = group_by_rank(np.array([5, 7, 8, 9]), np.array([2, 0, 2, 0]), 4)
    assert [part.tolist() for part in parts] == [[7, 9], [], [5, 8], []]


@pytest.mark.parametrize("size", [1, 255, 256, 257, 70_000])  # numbers of one byte, of two and of more
def test_rows_go_to_the_last_of_many_ranks_too(size):
    parts = group_by_rank(np.arange(3), np.array([size - 1, 0, size - 1]), size)
    assert len(parts) == size and parts[-1].tolist() == ([0, 2] if size > 1 else [0, 1, 2])
    assert sum(map(len, group_by_rank(np.arange(0), np.arange(0), size))) == 0


def test_the_reach_is_the_largest_of_the_last_kicks():
    leaves = DividedLeaves(None)
    assert [leaves.update_reach(wanted) for wanted in (2, 2, 1, 2, 3)] == [False, True, True, True, False]
    assert all(leaves.update_reach(1) for _ in range(16)) and leaves.reach == 1


@pytest.mark.parametrize("of", [False, True])
def test_particles_in_runs_of_cells(of):
    """Runs that meet and lie in each other; keys that are cells, or lead to them."""
    rng = np.random.default_rng(7)
    first = rng.integers(0, 190, 12)
    last = first + rng.integers(1, 10, 12)
    number, held = np.zeros(201, np.uint32), np.zeros(200, bool)
    for begin, end in zip(first, last, strict=True):
        held[begin:end] = True
    number_runs(first, last, number)
    np.testing.assert_array_equal(number, np.append(0, np.cumsum(held)))
    cells = rng.integers(0, 200, 300).astype(np.int32) if of else None
    key = rng.integers(0, 300 if of else 200, 1000).astype(np.uint32)
    wanted, some = held[cells[key] if of else key], np.array([0, 2, 3, 6, 7])  # batches, of which the last is short
    wanted &= np.isin(np.arange(1000) // BATCH, some)
    parts = [particles_in_runs(0, 3, some, key, cells, number), particles_in_runs(3, 5, some, key, cells, number)]
    found, numbers = (np.concatenate(each) for each in zip(*parts, strict=True))
    np.testing.assert_array_equal(found, np.flatnonzero(wanted))
    np.testing.assert_array_equal(numbers, number[cells[key[found]] if of else key[found]])


@pytest.mark.parametrize(("periodic", "dim"), [(False, 2), (True, 2), (False, 1), (True, 1)])
def test_batches_near_marked_blocks(periodic, dim):
    """Each that has any place in a marked block; few others; each without numbers, and each that is far across."""
    rng, rows, whole = np.random.default_rng(9), 8, np.array([64, 64 if dim == 2 else 1])
    first, shape = np.array([16, 24 if dim == 2 else 0]), np.array([40, 32 if dim == 2 else 1])
    origin, side = np.array([-1.3, 0.7 if dim == 2 else 0.0]), 0.05
    low = -3.0 if periodic else 0.2
    middle = origin[:dim] + side * 64 * rng.uniform(low, 3.0 if periodic else 0.8, (200, 1, dim))
    pos = (middle + side * rng.uniform(-3.0, 3.0, (200, BATCH, dim))).reshape(-1, dim)
    pos[BATCH] = np.nan
    pos[2 * BATCH] += 1e3
    marked = rng.random(-(-shape // rows)) < 0.1
    period = whole * [1.0, dim - 1.0] if periodic else np.zeros(2)
    given = origin, side, (*first.astype(float), *period), rows, marked
    found = batches_near(0, 200, bounds_of(pos), *given)
    leaf = np.zeros((len(pos), 2))
    leaf[:, :dim] = np.floor((pos - origin[:dim]) / side)
    leaf = (leaf % whole if periodic else leaf) - first
    inside = np.all((leaf >= 0) & (leaf < shape), axis=1)
    block = np.where(inside[:, None], leaf, 0).astype(int) // rows
    rows_in_marked_tiles = (inside & marked[block[:, 0], block[:, 1]]).reshape(200, BATCH).any(axis=1)
    assert (
        rows_in_marked_tiles.any()
        and set(np.flatnonzero(rows_in_marked_tiles)) <= set(found.tolist())
        and {1, 2} <= set(found.tolist())
    )
    # Besides these, of 200: boxes of 6 leaves, with one more on each side, that meet a block of 8; or are in two turns.
    assert len(found) < np.count_nonzero(rows_in_marked_tiles) + 80


@pytest.mark.parametrize("periodic", [False, True])
def test_cells_in_a_row_mark_what_each_does(periodic):
    rng = np.random.default_rng(8)
    pos, h = rng.random((2000, 2)) * [1.0, 0.6], rng.choice([0.01, 0.05], 2000, p=[0.9, 0.1])
    cells = sort_into_cells(pos, h, 1.0, np.zeros(2), np.array([1.0, 0.6]), periodic)
    x, y = cells.bounds[cells.filled, :2].T
    some = cells.filled[(np.hypot(x - 0.8, y - 0.3) < 0.05) & (cells.filled < cells.grids[1, FIRST])]  # small ones
    given = cells.grids, np.zeros(2), cells.grids, EITHER, 1.3, False, periodic
    each = np.logical_or.reduce([mark_cells(some[k : k + 1], *given) for k in range(len(some))])
    np.testing.assert_array_equal(mark_cells(some, *given), each)
    assert not each.all() and np.any(np.diff(some) == 1)


def merged(shape, seed):
    """Blocks of leaves with gas everywhere and dust in some, of all levels."""
    rng = np.random.default_rng(seed)
    gas, dust = rng.poisson(1.5, shape).ravel(), rng.poisson(0.2, shape).ravel()
    gas[rng.random(len(gas)) < 0.3] = 0
    return merge(gas, dust, 0.9 * gas, shape, 1.0, 2.0, 0.0, 2, 1, 2.0, 4.0, NEAR)


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("rings", [0, 3])
def test_blocks_that_own_ones_hang_on_are_those_of_all_nodes(periodic, rings):
    """Though nodes are listed about those near others alone."""
    shape = 256, 160
    blocks, joined = merged(shape, 9), np.array([periodic, periodic])
    lattice = Lattice(np.zeros(2), np.array(shape), 0, 1.0, shape, periodic, (0, 0), shape)
    own = blocks.first_leaf[:, 0] < 90 + 10 * (blocks.first_leaf[:, 1] // 32 % 3)
    away = -(-(rings + 2 << int(blocks.level.max())) // 32)
    found = _needed_blocks(blocks, lattice, own, away, rings, False)
    lattices = levels.lattice_levels(*shape, joined, LEVELS + 1)
    home, _, about, near = levels.list_nodes(blocks.level, blocks.first_leaf, lattices, False)
    expected = own.copy()
    mark_blocks(np.flatnonzero(own), home, about, near, rings, expected)
    np.testing.assert_array_equal(found, expected)
    assert own.sum() < found.sum() < len(own)


def test_numbers_of_blocks_are_those_of_their_leaves():
    """Each block of a part has the numbers of its leaves, one after another, along a Z-curve in each largest block."""
    shape, first = (64, 96), (32, 64)
    blocks = merged(shape, 10)
    begin, end = leaf_number_ranges(blocks, Lattice(np.zeros(2), np.zeros(2), 0, 1.0, (128, 192), False, first, shape))
    number = np.full((64, 96), -1)
    for (x, y), level, low, high in zip(blocks.first_leaf, blocks.level, begin, end, strict=False):
        for ix in range(1 << level):
            for iy in range(1 << level):
                z = sum((ix >> k & 1) << 2 * k + 1 | (iy >> k & 1) << 2 * k for k in range(level))
                number[x + ix, y + iy] = low + z
        assert high - low == 4**level
    held = number >= 0
    assert len(np.unique(number[held])) == held.sum()  # none twice
    x, y = np.nonzero(held)
    np.testing.assert_array_equal(number[held] // 1024, (x + 32) // 32 * 6 + (y + 64) // 32)
    assert begin[-1] > begin[:-1].max() and np.all(np.diff(begin) > 0) and np.all(end[:-1] <= begin[1:])


def test_density_of_own_nodes_stays():
    rng = np.random.default_rng(11)
    x, y, owner = np.sort(rng.integers(0, 4, 30)), np.sort(rng.integers(0, 5, 20)), rng.integers(0, 3, (4, 5))
    density, (begin, end) = rng.random((30, 20)), np.sort(rng.integers(0, 21, (2, 30)), axis=0)
    others = (owner[np.ix_(x, y)] != 1) & (np.arange(20) >= begin[:, None]) & (np.arange(20) < end[:, None])
    expected = np.where(others, 0.0, density)
    zero_nodes_of_others(0, 30, x, y, owner, 1, begin, end, density)
    np.testing.assert_array_equal(density, expected)


def test_counts_of_windows_are_the_same_by_any_number_of_ranks_at_once(monkeypatch):
    counts = import_module("rank_counts")
    grid, rng = Grid((0.0, 0.0), 1.0, (300, 200), periodic=False), np.random.default_rng(8)
    ends = np.sort(rng.integers(0, 299, (2, 5)), axis=0)
    bands = np.sort(rng.integers(0, 199, (2, 5, 10)), axis=0)
    windows = Windows.from_node_ranges(ends, bands, 0, grid)
    whole = counts.of_windows(windows, grid, 5)
    monkeypatch.setattr(counts, "AT_ONCE", 2)
    np.testing.assert_equal(counts.of_windows(windows, grid, 5), whole)
    assert whole[1].all() and whole[0]["density"].total.any()


@pytest.mark.parametrize("ring", [False, True])
def test_windows_have_the_nodes_about_particles(ring):
    """And of their gradient; about two circles side by side little more than half of the rectangle."""
    grid = Grid((0.0, 0.0), 1.0, (300, 200), periodic=False)
    rng = np.random.default_rng(3)
    places = 40.0 * rng.uniform(-1.0, 1.0, (2, 20000, 2))
    clouds = [
        some[np.hypot(*some.T) < 40.0] + middle
        for some, middle in zip(places, ([155.0, 85.0], [85.0, 155.0]), strict=True)
    ]
    both = combine_extents(*(grid.extent(pos, bounds_of(pos)) for pos in clouds))
    ends, bands = empty_node_ranges(grid, 2)  # a rank without particles
    ends[:, 0], bands[:, 0] = (both.low, both.high), (both.least, both.most)
    windows = Windows.from_node_ranges(ends, bands, 0, grid)
    rows = np.arange(-BORDER, 300 + BORDER)
    begin, end = windows.column_ranges(slice(None), rows, ring)
    assert np.array_equal(begin[1], end[1])
    columns = np.arange(200)
    found = (columns >= begin[0, :, None]) & (columns < end[0, :, None])
    touched = np.zeros_like(found)
    first = np.concatenate([np.floor(pos - 0.5).astype(int) for pos in clouds])
    beyond = BORDER * ring
    for i in range(-beyond, 2 + beyond):
        for j in range(-beyond, 2 + beyond):
            touched[first[:, 0] + BORDER + i, first[:, 1] + j] = True
    assert np.all(found[touched])
    assert found.sum() < 1.35 * touched.sum() < 0.8 * np.prod(windows.shape(0, ring))  # rows are taken in bands


@pytest.mark.parametrize("number", [0, 1, 5, 400, 2000])
def test_the_largest_of_values_that_nearly_rise(number):
    """The last few too may be small ones, and the largest of all the first."""
    values = np.arange(1000, 2000, dtype=np.uint64)
    rng = np.random.default_rng(12)
    some = rng.permutation(1000)[:100]
    values[some] = values[np.roll(some, 1)]
    values[[0, 999]] = values[[999, 0]]
    values[900:] = rng.permutation(1000)[:100]  # have come
    loose = np.concatenate([some, [0, 999, 999, 1000], np.arange(900, 1000)])  # some twice, or gone
    found = _rows_of_largest(values, number, loose)
    np.testing.assert_array_equal(np.sort(values[found]), np.sort(values)[max(1000 - number, 0) :])


def test_rows_by_their_places_in_few_pieces():
    """After particles have left and come, and others have got places of those that are gone."""
    rng = np.random.default_rng(12)
    place = np.sort(rng.choice(1 << 40, 5000, replace=False)).astype(np.uint64)
    arrays = {name: np.zeros((5000, 2)) for name in ("pos", "vel", "acc")}
    own = Particles(**arrays, mass=np.zeros(5000), ids=np.arange(5000), global_index=place.copy())
    for leaving, coming in ((30, 10), (5, 40), (20, 20), (0, 3)):
        come = {name: np.zeros((coming, *array.shape[1:]), array.dtype) for name, array in own.arrays().items()}
        come["global_index"] = rng.choice(1 << 40, coming, replace=False).astype(np.uint64)
        own.replace(np.sort(rng.choice(own.count, leaving, replace=False)), come)
    own.global_index[[60, 61, 4000]] = rng.choice(1 << 40, 3)
    own.unsorted_rows = np.append(own.unsorted_rows, [60, 61, 4000])
    ghosts = rng.choice(1 << 40, 50).astype(np.uint64)
    both = np.concatenate([own.global_index, ghosts])
    first, last = _ranges_in_global_order(both, own.count, own.unsorted_rows)
    rows = np.concatenate([np.arange(a, b) for a, b in zip(first, last, strict=True)])
    np.testing.assert_array_equal(rows, np.argsort(both))
    assert len(first) < 500


def test_rows_out_of_order_that_nobody_has_told_of():
    place = np.array([3, 9, 5, 7], np.uint64)
    first, last = _ranges_in_global_order(place, 3, np.empty(0, np.int64))
    assert first.tolist() == [0, 2, 3, 1] and last.tolist() == [1, 3, 4, 2]


def test_rows_that_fall_where_one_is_out_of_order():
    place = np.array([0, 10, 3, 5, 20], np.uint64)
    first, last = _ranges_in_global_order(place, 5, np.array([2]))
    rows = np.concatenate([np.arange(a, b) for a, b in zip(first, last, strict=True)])
    np.testing.assert_array_equal(rows, np.argsort(place))


@pytest.mark.parametrize("row", [0, 1, 40, 98])
def test_two_rows_that_have_changed_places(row):
    place = np.arange(0, 300, 2, dtype=np.uint64)
    place[100:] -= 141  # of others, between own ones
    place[[row, row + 1]] = place[[row + 1, row]]
    first, last = _ranges_in_global_order(place, 100, np.empty(0, np.int64))
    rows = np.concatenate([np.arange(a, b) for a, b in zip(first, last, strict=True)])
    np.testing.assert_array_equal(rows, np.argsort(place))
