"""Arrays with room behind them."""

import numpy as np

from discsim.numerics import alloc
from discsim.numerics.state import Dust


def dust(count, spare):
    values = np.random.default_rng(2).random((count, 2))
    held = Dust(
        pos=values, vel=values.copy(), acc=values.copy(), mass=values[:, 0].copy(), ids=np.arange(count),
        species=np.zeros(count, np.int64), global_index=np.arange(count, dtype=np.uint64),
    )  # fmt: skip
    held.spare = spare
    held.take(np.arange(count))
    return held


def test_what_is_written_behind_leaves_an_array_as_it_is():
    array = alloc.allocate(3, np.zeros((1, 2)), spare=2)
    array[:] = [[1, 2], [3, 4], [5, 6]]
    both = alloc.grow(array, 5)
    both[3:] = 7
    assert np.shares_memory(array, both) and both.shape == (5, 2)
    assert array.tolist() == [[1, 2], [3, 4], [5, 6]] == both[:3].tolist()


def test_there_is_room_only_where_it_was_made():
    """Not beyond it, nor behind a part of an array of somebody's, which has others' entries there."""
    array = alloc.allocate(3, np.zeros(1), spare=2)
    assert alloc.grow(array, 6) is None
    assert alloc.grow(array[1:], 4) is None
    assert alloc.grow(np.zeros(9)[:3], 4) is None and alloc.grow(np.zeros(3), 3) is None
    assert alloc.grow(alloc.allocate(3, np.zeros(1), spare=0), 3) is None


def test_a_like_array_has_as_much_room():
    array = alloc.allocate(3, np.zeros((1, 2)), spare=2)
    other = alloc.allocate_like(array)
    assert other.shape == (3, 2) and not np.shares_memory(array, other)
    assert alloc.grow(other, 5) is not None and alloc.grow(other, 6) is None
    assert alloc.grow(alloc.allocate_like(np.zeros(3)), 4) is None


def test_particles_that_come_take_the_room():
    """One leaves and three come; then more than there is room for."""
    held = dust(10, spare=4)
    before, come = held.pos, {name: array[:3] + array[:3] for name, array in dust(10, 0).arrays().items()}
    expected = {name: np.concatenate([array[:5], come[name][:1], array[6:], come[name][1:]])
                for name, array in held.arrays().items()}  # fmt: skip
    held.replace(np.array([5]), come)
    assert np.shares_memory(held.pos, before) and held.count == 12
    for name, array in held.arrays().items():
        np.testing.assert_array_equal(array, expected[name], err_msg=name)
    held.replace(np.arange(0), come)
    assert not np.shares_memory(held.pos, before) and held.count == 15
    np.testing.assert_array_equal(held.pos, np.concatenate([expected["pos"], come["pos"]]))


def test_aligned_arrays_begin_with_a_cache_line():
    for count in range(1, 40):
        array = alloc.aligned((count, 3), np.float32)
        assert array.ctypes.data % alloc.CACHE_LINE == 0 and array.shape == (count, 3) and array.dtype == np.float32
        array[:] = count  # all of it is there
        assert array.sum() == 3 * count**2
