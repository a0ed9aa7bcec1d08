"""Lists of candidates: all that a cell's particles meet is in them, across the edges of a periodic box too."""

import numpy as np
import pytest

from discsim.numerics.neighbours import candidates, sort_into_cells


@pytest.mark.parametrize("h", [0.02, 0.2])  # 0.2: a thousand candidates a cell, so that lists have to grow
def test_candidates_hold_every_neighbour_of_every_image(h):
    pos = np.random.default_rng(3).random((800, 2))
    cells = sort_into_cells(pos, np.full(800, h), 1.0, np.zeros(2), np.ones(2), True)
    (listed,) = candidates(cells, cells, mutual=True)
    for n, cell in enumerate(cells.filled):
        found = slice(listed.begin[n], listed.begin[n + 1])
        j = cells.order[listed.slots[found]]
        image = listed.turned[:, found].T if listed.crossing[n] else np.zeros((len(j), 2), int)
        have = set(zip(j.tolist(), *(image + 0).T.tolist(), strict=True))
        for i in cells.order[cells.start[cell] : cells.start[cell + 1]]:
            for turn in np.ndindex(3, 3):
                t = np.array(turn) - 1
                near = np.flatnonzero(np.hypot(*(pos + t - pos[i]).T) < h)
                assert {(k, *t.tolist()) for k in near.tolist()} <= have
