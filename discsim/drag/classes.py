"""Which grains relax together: a population, or where grains have sizes of their own those of nearly one stopping time.

Classes divide the stopping times that the same gas gives to grains at equal ratios. A class has its mean stopping
time; kernels take it times the mean, by mass, of `relative` over those of the class at a place, so that a grain alone
there has its own.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from discsim.formulas.laws import VALUE
from discsim.numerics import world
from discsim.physics.grains import has_sizes
from discsim.physics.laws import SceneLaw

if TYPE_CHECKING:
    from discsim.numerics.state import Dust
    from discsim.scene import Scene

Array = np.ndarray
NONE = np.empty(0)
GROWN = 8  # classes, about, of grains that have grown to sizes of one to two decades in the whole of a disc
MOST = 32  # classes: there are sums of each at every node of tsc


def classes_of(scene: Scene) -> int:
    """How many classes there will be, about, before any particle is made."""
    sizes = [dust.grain_size for dust in scene.dust or () if has_sizes(dust)]
    width = math.log(scene.drag.class_width)
    if scene.table("growth") is not None:
        return GROWN
    held = [min(given.bins or MOST, math.ceil(math.log(given.largest / given.smallest) / width)) for given in sizes]
    return min(MOST, sum(held) + len(scene.dust or ()) - len(sizes))


class Classes:
    """The classes of a run's grains: their `number`, the law's `grains` (number, 5) of each, the class `of` each grain
    (n,), and its stopping time over that of the class, `relative` (n,), without entries where populations are classes.

    several: True where there may be more than one, else None (kernels leave out what is for many then).
    """

    def __init__(self, scene: Scene, law: SceneLaw):
        self.law = law
        self.width = math.log(scene.drag.class_width)
        self.number, self.grains, self.several = law.populations, law.grains, law.several
        self.of = self.relative = NONE
        self._sorted: Array | None = None

    def sort(self, dust: Dust) -> None:
        """Make the classes of the dust as it is now, of which there is some, and sort that of this process."""
        if dust.size is None:
            self.of = dust.species
        # A new array wherever particles or their sizes have changed.
        elif world.together.most(dust.size is not self._sorted):
            self._sorted = dust.size
            everyone = world.together.everyone(dust)  # whose order decides the last bits of means
            self._divide(self.law.rows(everyone.of(dust.species), everyone.of(dust.size)))
            self.of, self.relative = self.of[everyone.own], self.relative[everyone.own]

    def _divide(self, rows: Array) -> None:
        place = np.log(rows[:, VALUE])
        reach = place.max() - place.min()
        # Whole multiples of the width, so that classes stay what they are while grains grow.
        bins = np.floor(place / (self.width * max(1.0, math.ceil(reach / (self.width * (MOST - 1))))))
        bins = (bins - bins.min()).astype(np.int64)
        count = np.bincount(bins)
        held = count > 0
        self.of = (np.cumsum(held) - 1)[bins]
        self.number, self.several = int(held.sum()), True
        self.grains = np.stack([np.bincount(self.of, column) for column in rows.T], axis=1) / count[held][:, None]
        self.relative = rows[:, VALUE] / self.grains[self.of, VALUE]
