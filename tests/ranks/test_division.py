"""Who owns which part of space."""

from importlib.util import find_spec
from types import SimpleNamespace

import numpy as np
import pytest

if find_spec("mpi4py") is None:
    pytest.skip("needs mpi4py: pip install 'discsim[mpi]'", allow_module_level=True)

from discsim.numerics.neighbours import corners
from discsim.ranks.division import Division, hilbert
from discsim.ranks.world import Ranks


def divided(number, dim=2, along=1.0):
    """The division of a box [-.5, .5] among a number of ranks."""
    space = SimpleNamespace(dimensions=dim, size=(along,) * dim, cells=64, boundary="open")
    return Division(SimpleNamespace(space=space, centred=True), SimpleNamespace(size=number, rank=0))


def species(pos):
    return {"gas": SimpleNamespace(pos=pos)}


@pytest.mark.parametrize("bits", [1, 2, 5])
def test_the_curve_goes_from_a_tile_to_one_beside_it(bits):
    x, y = np.divmod(np.arange(4**bits), 2**bits)
    place = hilbert(x, y, bits)
    assert np.array_equal(np.sort(place), np.arange(4**bits))
    order = np.argsort(place)
    assert np.all(np.abs(np.diff(x[order])) + np.abs(np.diff(y[order])) == 1)


@pytest.mark.parametrize("dim", [1, 2])
@pytest.mark.parametrize("number", [2, 3, 7])
def test_ranks_have_as_much_to_do(dim, number):
    """Of particles at random, but for those of a tile: some hundred of 20 000 in two dimensions, and in one more."""
    pos = np.random.default_rng(1).uniform(-0.5, 0.5, (20_000, dim))
    division = divided(number, dim)
    assert division.cut(species(pos), whole=True)
    held = np.bincount(division.owner[division.tile_of(pos)], minlength=number)
    in_a_tile = np.bincount(division.tile_of(pos)).max()
    assert np.ptp(held) <= 2 * in_a_tile


def test_particles_off_the_grid_belong_to_the_nearest_tile():
    division = divided(4)
    far = np.array([[-9.0, 0.1], [0.2, 7.0], [3.0, -4.0]])
    np.testing.assert_array_equal(division.tile_of(far), division.tile_of(np.clip(far, -0.4999, 0.4999)))


def test_all_particles_in_one_tile_leave_ranks_empty():
    division = divided(3)
    division.cut(species(np.full((50, 2), 0.25)), whole=True)
    held = np.bincount(division.owner[division.tile_of(np.full((50, 2), 0.25))], minlength=3)
    assert sorted(held) == [0, 0, 50]


@pytest.mark.parametrize("boundary", ["open", "periodic"])
def test_inside_are_own_tiles_with_only_own_ones_about_them(boundary):
    division = divided(3)
    division.scene.space.boundary = boundary
    division.cut(species(np.random.default_rng(2).uniform(-0.5, 0.5, (20_000, 2))), whole=True)
    along, margin = division.along, 1.5 / division.per_tile
    own = division.owner.reshape(along, along) == 0
    expected = np.logical_and.reduce([np.roll(own, (i, j), (0, 1)) for i in range(-2, 3) for j in range(-2, 3)])
    beyond = 2 + 2 * (boundary == "periodic")  # nothing is known beyond the edge; of a box that goes on, of its edge
    division.margin = margin
    inside = division.inside.reshape(along, along)
    core = (slice(beyond, -beyond),) * 2
    np.testing.assert_array_equal(inside[core], expected[core])
    inside[core] = False
    assert not inside.any() and expected[core].any()


@pytest.mark.parametrize("dim", [1, 2])
def test_corners_are_those_of_known_bounds_until_places_change(dim):
    """Also where a place is no number, or there is nobody."""
    ranks = Ranks.__new__(Ranks)
    ranks.division, rng = divided(3, dim), np.random.default_rng(4)
    ranks.division.comm.reduced = lambda value, _: value
    pos = rng.uniform(-0.5, 0.5, (1000, dim))
    gas = SimpleNamespace(pos=pos, count=1000)
    ranks.division.settle({"gas": gas})
    np.testing.assert_array_equal(ranks.corners(pos, corners), corners(pos))
    before = corners(pos)
    pos *= 0.5  # in place: whoever does that has to say so
    np.testing.assert_array_equal(ranks.corners(pos, corners), before)
    ranks.division.forget()
    np.testing.assert_array_equal(ranks.corners(pos, corners), corners(pos))
    pos[500, 0] = np.nan
    np.testing.assert_array_equal(ranks.corners(pos, corners), corners(pos))
    np.testing.assert_array_equal(ranks.corners(pos[:0], corners), corners(pos[:0]))
