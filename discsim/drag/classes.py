"""Classes of grains: the grains of a class in a drag cell have a common stopping time.

A class is a population or, if grains have individual sizes, the grains in one range of stopping times. In the same gas
all ranges have the same ratio of largest to smallest stopping time. The parameters of a class are the means over its
grains. Kernels multiply the stopping time of the class by the mass-weighted mean, over its grains in the cell, of the
factors `relative`. A grain that is alone in a cell thus has its own stopping time.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.drag.base import EMPTY, NO_ROWS, DragLaw
from discsim.formulas.laws import VALUE
from discsim.numerics import world
from discsim.physics.grains import has_sizes
from discsim.physics.laws import SceneLaw

if TYPE_CHECKING:
    from discsim.scene import Scene

Array = np.ndarray
GROWN = 8  # estimate of the number of classes with [growth]; sizes in a disc span one to two decades
MOST = 32  # largest number of classes; it bounds the memory of tsc, which stores sums of each class at every node


def estimated_class_count(scene: Scene) -> int:
    """Return an estimate of the number of classes in a run of a scene, from the scene alone."""
    sizes = [dust.grain_size for dust in scene.dust or () if has_sizes(dust)]
    width = math.log(scene.drag.class_width)
    if scene.table("growth") is not None:
        return GROWN
    held = [min(given.bins or MOST, math.ceil(math.log(given.largest / given.smallest) / width)) for given in sizes]
    return min(MOST, sum(held) + len(scene.dust or ()) - len(sizes))


def law_of(scene: Scene, law: SceneLaw) -> DragLaw:
    """Return the drag law of a scene for kicks in which each population is a class."""
    two_way, exponential = scene.drag.direction == "two-way", scene.drag.integration == "exponential"
    return DragLaw(law.code, law.grains, law.nonlinear, law.several, two_way, exponential)


class Classes:
    """Classes of the grains of a run, as `sort` found them last.

    law: drag law with the parameters of each class. of (n,): index of the class of each local grain. relative (n,):
    stopping time of each local grain divided by the stopping time of its class; empty if each population is a class.
    width: ln of the ratio of largest to smallest stopping time in a class.
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
        """Update `law`, `of` and `relative` if the grains or their sizes have changed.

        dust: `Particles` of the dust.
        """
        if dust.size is None:
            self.of = dust.species
        # A change of the particles or of their sizes makes a new array of sizes.
        elif world.processes.max(dust.size is not self._sorted):
            self._sorted = dust.size
            everyone = world.processes.allgather(dust)  # grains of all ranks in serial order, which affects rounding
            self._divide(self._rows(everyone.with_ghosts(dust.species), everyone.with_ghosts(dust.size)))
            self.of, self.relative = self.of[everyone.local_rows], self.relative[everyone.local_rows]

    def _divide(self, rows: Array) -> None:
        """Divide grains of all ranks with the parameters `rows` (n, 5) into classes."""
        log = np.log(rows[:, VALUE])
        extent = log.max() - log.min()
        # Ranges begin at whole multiples of the width, so that classes persist while grains grow.
        bins = np.floor(log / (self.width * max(1.0, math.ceil(extent / (self.width * (MOST - 1))))))
        bins = (bins - bins.min()).astype(np.int64)
        count = np.bincount(bins)
        held = count > 0
        self.of = (np.cumsum(held) - 1)[bins]
        grains = np.stack([np.bincount(self.of, column) for column in rows.T], axis=1) / count[held][:, None]
        self.law = self.law._replace(grains=grains, several=True)
        self.relative = rows[:, VALUE] / grains[self.of, VALUE]
