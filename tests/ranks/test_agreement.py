"""What a first look at drag cells has found, told to the kick."""

from importlib.util import find_spec

import numpy as np
import pytest

if find_spec("mpi4py") is None:
    pytest.skip("needs mpi4py: pip install -e '.[mpi]'", allow_module_level=True)

from discsim.drag.cells import Merged
from discsim.ranks.drag import Agreement


def test_what_was_found_is_told_by_its_name():
    """In whatever order the kick asks; nothing is found twice."""
    agreement = Agreement(None)
    for name in ("frame", "wanted leaf"):
        assert agreement(name, lambda name=name: [name]) == [name]
    assert agreement("wanted leaf", lambda: pytest.fail("found again")) == ["wanted leaf"]
    assert agreement("frame", lambda: pytest.fail("found again")) == ["frame"]


def test_blocks_that_are_left_are_numbered_anew():
    """Of three blocks on four leaves the second is not needed: its leaves are in none, nor is what lies outside. The
    third, which holds own particles, comes first.
    """
    agreement = Agreement(None)
    corners, level = np.array([[0, 0], [1, 0], [3, 0]], np.int32), np.array([0, 1, 0])
    blocks = Merged(np.array([0, 1, 1, 2, -1], np.int32), corners, level, np.array([False, True, True]))
    agreement("blocks", lambda: blocks)
    agreement.leave(np.array([False, False, True]), np.array([True, False, True]))
    left = agreement("blocks", lambda: pytest.fail("found again"))
    assert left.number.tolist() == [1, -1, -1, 0, -1]
    assert left.first_leaf.tolist() == [[3, 0], [0, 0]]
    assert left.level.tolist() == [0, 0] and left.enlarged.tolist() == [True, False]
    assert agreement.own_blocks(2) == 1
