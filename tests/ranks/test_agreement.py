"""Drag cells of a rank: those that its particles depend on."""

from importlib.util import find_spec

import numpy as np
import pytest

if find_spec("mpi4py") is None:
    pytest.skip("needs mpi4py: pip install -e '.[mpi]'", allow_module_level=True)

from discsim.drag.cells import Layout, Merged
from discsim.ranks.drag import keep_needed_blocks


def test_blocks_that_are_left_are_numbered_anew():
    """Of three blocks on four leaves the second is not needed: its leaves are in none, nor is what lies outside. The
    third, which holds own particles, comes first.
    """
    corners, level = np.array([[0, 0], [1, 0], [3, 0]], np.int32), np.array([0, 1, 0])
    blocks = Merged(np.array([0, 1, 1, 2, -1], np.int32), corners, level, np.array([False, True, True]))
    layout = Layout(None, blocks, 3, None, np.arange(0), np.arange(0))
    layout = keep_needed_blocks(layout, np.array([False, False, True]), np.array([True, False, True]))
    left = layout.merged
    assert left.number.tolist() == [1, -1, -1, 0, -1]
    assert left.first_leaf.tolist() == [[3, 0], [0, 0]]
    assert left.level.tolist() == [0, 0] and left.enlarged.tolist() == [True, False]
    assert layout.own == 1
