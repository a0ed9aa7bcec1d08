"""What a rank needs of others: kernels by themselves, against plain loops."""

from importlib.util import find_spec
from types import SimpleNamespace

import numpy as np
import pytest

if find_spec("mpi4py") is None:
    pytest.skip("needs mpi4py: pip install 'discsim[mpi]'", allow_module_level=True)

from discsim.kernels.halo import add_blocks, all_there, cut_blocks, held_blocks, others_about
from discsim.kernels.neighbours import widen
from discsim.numerics.grid import Grid
from discsim.numerics.neighbours import sort_into_cells
from discsim.ranks.comm import by_rank
from discsim.ranks.division import Division
from discsim.ranks.leaves import Leaves


@pytest.mark.parametrize("dim", [1, 2])
def test_places_in_marked_tiles(dim):
    """As the tiles of the places say, of those beyond the grid and of what is no number too."""
    space = SimpleNamespace(dimensions=dim, size=(1.0,) * dim, cells=64, boundary="open")
    division = Division(SimpleNamespace(space=space, centred=True), SimpleNamespace(size=3, rank=0))
    rng = np.random.default_rng(3)
    pos, marked = rng.uniform(-0.7, 0.7, (3000, dim)), rng.random(len(division.owner)) < 0.3
    pos[7], pos[8], pos[9] = np.nan, np.inf, -np.inf
    np.testing.assert_array_equal(division.within(pos, marked), np.flatnonzero(marked[division.tile_of(pos)]))


@pytest.mark.parametrize("periodic", [False, True])
def test_others_about_particles(periodic):
    """Of the four nodes about each, whose they are but this rank's, each once; none of one off an open grid."""
    rng, rank = np.random.default_rng(4), 2
    grid = Grid((0.0, 0.0), 0.1, (10, 12), periodic)
    owner, tiles = rng.integers(0, 4, (5, 6)), (np.arange(10) // 2, np.arange(12) // 2)
    pos = rng.uniform(0.0, 1.0, (400, 2)) * [1.0, 1.2]
    some = np.arange(1, 400, 3)
    rows, whose = others_about(0, len(some), some, pos, grid.origin, 10.0, periodic, tiles, owner, rank)
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
    out = expected.copy()
    for x, y in np.argwhere((gas > 0) | (dust > 0)):
        expected[x // side, y // side] = True
    held_blocks(0, len(out), gas, dust, side, out)
    np.testing.assert_array_equal(out, expected)
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
    widen(some, 2.0, h, cells)
    alone = all_there(some, cells, there)
    away = np.abs(pos[strangers][None] - cells.bounds[some][:, None, :2])
    if periodic:
        away = np.minimum(away, 1.0 - away)
    away = np.maximum(away - cells.bounds[some][:, None, 2:4], 0.0)
    meets = (np.hypot(away[..., 0], away[..., 1]) <= cells.bounds[some, 4][:, None]).any(axis=1)
    assert not (alone & meets).any()
    assert np.count_nonzero(alone) > 0.3 * len(some)  # they are not few for nothing


def test_rows_by_rank_keep_their_order():
    parts = by_rank(np.array([5, 7, 8, 9]), np.array([2, 0, 2, 0]), 4)
    assert [part.tolist() for part in parts] == [[7, 9], [], [5, 8], []]


def test_the_reach_is_the_largest_of_the_last_kicks():
    leaves = Leaves(None)
    assert [leaves.suffices(wanted) for wanted in (2, 2, 1, 2, 3)] == [False, True, True, True, False]
    assert all(leaves.suffices(1) for _ in range(16)) and leaves.reach == 1
