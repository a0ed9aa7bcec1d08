"""Who owns which part of space."""

import tomllib
from importlib.util import find_spec
from types import SimpleNamespace

import numpy as np
import pytest

if find_spec("mpi4py") is None:
    pytest.skip("needs mpi4py: pip install -e '.[mpi]'", allow_module_level=True)

from rank_cut import division_of
from runs import DISC

from discsim import Simulation
from discsim.effects import dust_diffusion
from discsim.numerics import world
from discsim.numerics.neighbours import corners
from discsim.ranks.comm import Comm
from discsim.ranks.division import Division, hilbert_index
from discsim.ranks.start import divide
from discsim.ranks.world import ParallelComm


def divided(number, dim=2, along=1.0):
    """The division of a box [-.5, .5] among a number of ranks."""
    space = SimpleNamespace(dimensions=dim, size=(along,) * dim, cells=64, boundary="open")
    comm = SimpleNamespace(size=number, rank=0, allreduce=lambda values, _: values)
    return Division(SimpleNamespace(space=space, centred=True), comm)


def species(pos):
    return {"gas": SimpleNamespace(pos=pos)}


@pytest.mark.parametrize("bits", [1, 2, 5])
def test_the_curve_goes_from_a_tile_to_one_beside_it(bits):
    x, y = np.divmod(np.arange(4**bits), 2**bits)
    place = hilbert_index(x, y, bits)
    assert np.array_equal(np.sort(place), np.arange(4**bits))
    order = np.argsort(place)
    assert np.all(np.abs(np.diff(x[order])) + np.abs(np.diff(y[order])) == 1)


@pytest.mark.parametrize("dim", [1, 2])
@pytest.mark.parametrize("number", [2, 3, 7])
def test_ranks_have_as_much_to_do(dim, number):
    """Of particles at random, but for those of a tile: some hundred of 20 000 in two dimensions, and in one more."""
    pos = np.random.default_rng(1).uniform(-0.5, 0.5, (20_000, dim))
    division = divided(number, dim)
    assert division.rebalance(species(pos))
    held = np.bincount(division.owner[division.tile_of(pos)], minlength=number)
    in_a_tile = np.bincount(division.tile_of(pos)).max()
    assert np.ptp(held) <= 2 * in_a_tile


def test_particles_off_the_grid_belong_to_the_nearest_tile():
    division = divided(4)
    far = np.array([[-9.0, 0.1], [0.2, 7.0], [3.0, -4.0]])
    np.testing.assert_array_equal(division.tile_of(far), division.tile_of(np.clip(far, -0.4999, 0.4999)))


def test_all_particles_in_one_tile_leave_ranks_empty():
    division = divided(3)
    division.rebalance(species(np.full((50, 2), 0.25)))
    held = np.bincount(division.owner[division.tile_of(np.full((50, 2), 0.25))], minlength=3)
    assert sorted(held) == [0, 0, 50]


@pytest.mark.parametrize("dim", [1, 2])
@pytest.mark.parametrize("boundary", ["open", "periodic"])
def test_near_are_all_places_within_the_margin_of_others(boundary, dim):
    """And few beside them, also where rows of one batch are far apart."""
    division = divided(3, dim)
    division.scene.space.boundary = boundary
    pos = np.random.default_rng(2).uniform(-0.5, 0.5, (40_000, dim))
    division.rebalance(species(pos))
    tile = division.tile_of(pos)
    own = np.flatnonzero(division.owner[tile] == 0)
    pos = pos[own[np.argsort(np.argsort(division.curve)[tile[own]], kind="stable")]]
    mixed = np.random.default_rng(3).choice(len(pos), (2, 10), replace=False)
    pos[mixed[0]], pos[mixed[1]] = pos[mixed[1]], pos[mixed[0]].copy()
    division.margin = margin = 0.3 / division.tiles_per_length
    moved = margin * np.stack(np.meshgrid(*[[-1, 0, 1]] * dim), axis=-1).reshape(-1, 1, dim)
    about = pos + moved
    if boundary == "periodic":
        about = (about + 0.5) % 1.0 - 0.5
    expected = (division.owner[division.tile_of(about.reshape(-1, dim))] != 0).reshape(len(moved), -1).any(axis=0)
    near = np.zeros(len(pos), bool)
    found = division.rows_near_border(pos)
    near[found] = True
    assert len(found) == near.sum() and near[expected].all() and expected.any()
    # All batches at the border: about 4 tiles wide, of 37 across what a rank has. With all rows of batches whose rows
    # are far apart it would be an eighth in one dimension, and all in two.
    assert near.sum() < (0.1 if dim == 1 else 0.3) * len(pos)
    pos[5] = np.nan
    assert 5 in division.rows_near_border(pos)


@pytest.mark.parametrize("dim", [1, 2])
def test_corners_are_those_of_known_bounds_until_places_change(dim):
    """Also where a place is no number, or there is nobody."""
    ranks = ParallelComm.__new__(ParallelComm)
    ranks.division, rng = divided(3, dim), np.random.default_rng(4)
    pos = rng.uniform(-0.5, 0.5, (1000, dim))
    gas = SimpleNamespace(pos=pos, count=1000)
    ranks.division.migrate({"gas": gas})
    np.testing.assert_array_equal(ranks.corners(pos, corners), corners(pos))
    before = corners(pos)
    pos *= 0.5  # in place: whoever does that has to say so
    np.testing.assert_array_equal(ranks.corners(pos, corners), before)
    ranks.division.drop_bounds()
    np.testing.assert_array_equal(ranks.corners(pos, corners), corners(pos))
    pos[500, 0] = np.nan
    np.testing.assert_array_equal(ranks.corners(pos, corners), corners(pos))
    np.testing.assert_array_equal(ranks.corners(pos[:0], corners), corners(pos[:0]))


def test_the_walk_of_the_dust_has_the_corners_of_moved_particles(monkeypatch):
    """They lay its grids of gas and grains, and so say in which order it adds. It comes before `settle`."""
    walk, found = dust_diffusion.Effect.move, []

    def move(effect, state, dt):
        found.extend((world.processes.corners(p.pos, corners), corners(p.pos)) for p in state.species.values())
        walk(effect, state, dt)

    monkeypatch.setattr(dust_diffusion.Effect, "move", move)
    monkeypatch.setattr(world, "processes", world.SerialComm())  # and again after the test
    sim = Simulation(tomllib.loads(DISC) | {"dust_diffusion": {"alpha": 0.01}})
    divide(sim, Comm())
    for _ in range(2):
        sim.step(most=0.1)
    assert len(found) == 4
    np.testing.assert_array_equal(*zip(*found, strict=True))


def test_parts_are_dealt_to_fewer_ranks_in_turn():
    """As `analysis/scaling.py` has it: borders of 16 parts on 2 ranks; the same again where nothing has moved."""
    pos = np.random.default_rng(6).uniform(-0.5, 0.5, (20000, 2))
    given = divided(2)
    found = {parts: division_of(parts)(given.scene, given.comm) for parts in (0, 2, 16)}
    for division in found.values():
        assert division.rebalance(species(pos)) and not division.rebalance(species(pos))
        held = np.bincount(division.owner[division.tile_of(pos)], minlength=2)
        assert len(held) == 2 and held.min() > 0.48 * len(pos)
    borders = {parts: np.count_nonzero(np.diff(each.owner[each.curve])) for parts, each in found.items()}
    assert borders == {0: 1, 2: 1, 16: 15}
    np.testing.assert_array_equal(found[0].owner, found[2].owner)
