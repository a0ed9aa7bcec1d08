"""Classes of grains that drag kernels treat together.

A class is a population or, if grains of a population have different sizes, the grains in one range of stopping times.
All ranges have the same ratio of largest to smallest stopping time in the same gas. The parameters of a class give its
mean stopping time. Kernels multiply it by the mass-weighted mean of `relative` over the grains of the class in a cell,
so that a grain alone in a cell has its own stopping time.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.drag.base import EMPTY, NO_ROWS, Law
from discsim.formulas.laws import VALUE
from discsim.numerics import world
from discsim.physics.grains import has_sizes
from discsim.physics.laws import SceneLaw

if TYPE_CHECKING:
    from discsim.scene import Scene

Array = np.ndarray
GROWN = 8  # typical number of classes of grown grains, whose sizes span one to two decades in a disc
MOST = 32  # largest number of classes; it bounds the memory of tsc, which has sums of each class at every node


def classes_of(scene: Scene) -> int:
    """Estimate the number of classes from the scene alone."""
    sizes = [dust.grain_size for dust in scene.dust or () if has_sizes(dust)]
    width = math.log(scene.drag.class_width)
    if scene.table("growth") is not None:
        return GROWN
    held = [min(given.bins or MOST, math.ceil(math.log(given.largest / given.smallest) / width)) for given in sizes]
    return min(MOST, sum(held) + len(scene.dust or ()) - len(sizes))


def law_of(scene: Scene, law: SceneLaw) -> Law:
    """Return the law for kicks in which each population is a class."""
    two_way, exponential = scene.drag.direction == "two-way", scene.drag.integration == "exponential"
    return Law(law.code, law.grains, law.nonlinear, law.several, two_way, exponential)


class Classes:
    """Classes of the grains of a run.

    law: the law with the parameters of each class. of (n,): class of each grain. relative (n,): stopping time of each
    grain divided by that of its class; empty if each population is a class.
    """

    def __init__(self, scene: Scene, law: SceneLaw):
        self.law, self._rows = law_of(scene, law), law.rows
        self.width = math.log(scene.drag.class_width)
        self.of, self.relative = NO_ROWS, EMPTY
        self._sorted: Array | None = None

    @property
    def number(self) -> int:
        return len(self.law.grains)

    def sort(self, dust: Any) -> None:
        """Update the classes and the class of each local grain from the grain sizes. The run must have dust."""
        if dust.size is None:
            self.of = dust.species
        # Particles or sizes that have changed are in a new array.
        elif world.processes.most(dust.size is not self._sorted):
            self._sorted = dust.size
            everyone = world.processes.everyone(dust)  # in the order of a serial run, as the order affects rounding
            self._divide(self._rows(everyone.of(dust.species), everyone.of(dust.size)))
            self.of, self.relative = self.of[everyone.own], self.relative[everyone.own]

    def _divide(self, rows: Array) -> None:
        """Divide grains with the parameters `rows` (n, 5) into classes."""
        place = np.log(rows[:, VALUE])
        reach = place.max() - place.min()
        # Edges at whole multiples of the width, so that classes persist while grains grow.
        bins = np.floor(place / (self.width * max(1.0, math.ceil(reach / (self.width * (MOST - 1))))))
        bins = (bins - bins.min()).astype(np.int64)
        count = np.bincount(bins)
        held = count > 0
        self.of = (np.cumsum(held) - 1)[bins]
        grains = np.stack([np.bincount(self.of, column) for column in rows.T], axis=1) / count[held][:, None]
        self.law = self.law._replace(grains=grains, several=True)
        self.relative = rows[:, VALUE] / grains[self.of, VALUE]
