"""What ranks send, and how much of it to other machines."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import csr_array

from discsim.kernels.gravity.poisson import TILE
from discsim.numerics.grid import BORDER
from discsim.numerics.poisson import ROWS, padded_shape, tiles_of
from discsim.ranks.slabs import RankRanges

Array = np.ndarray
EXCHANGES = ("sph gas", "drag gas", "drag dust", "grid gas", "grid dust")
PER_MACHINE = 32  # ranks, one after the other


class Sent(NamedTuple):
    """What each rank (ranks,) sends: in all, to ranks of other machines than its own, and to how many ranks."""

    total: Array
    away: Array
    messages: Array

    @classmethod
    def of(cls, matrix: Any) -> Sent:
        """Of a matrix [receiver, sender]."""
        some = csr_array(matrix).tocoo()
        total, away = (
            np.bincount(some.col, some.data * mask, some.shape[0])
            for mask in (1.0, some.row // PER_MACHINE != some.col // PER_MACHINE)
        )
        return cls(total, away, np.bincount(some.col[some.data > 0], minlength=some.shape[0]))


def of_transforms(shape: tuple[int, int], periodic: bool, ranks: int) -> tuple[dict[str, Sent], Array]:
    """Bytes of both exchanges between the transforms, and rows of the grid (ranks,) that each transforms."""
    count = shape[0] + (0 if periodic else 2 * BORDER)
    padded, machine = padded_shape(shape, periodic), np.arange(ranks) // PER_MACHINE
    held, columns = (np.diff(RankRanges.divide(*of, ranks).edges) for of in ((count, ROWS), (tiles_of(padded), 1)))
    out = {}
    for name, mine, theirs in (("rows to columns", held, columns), ("columns to rows", columns, held)):
        elsewhere = theirs.sum() - np.bincount(machine, theirs)[machine]
        total, away = (16 * TILE * mine * others for others in (theirs.sum() - theirs, elsewhere))
        out[name] = Sent(total, away, (mine > 0) * (np.count_nonzero(theirs) - (theirs > 0)))
    return out, held
