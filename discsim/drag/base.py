"""What a drag scheme is: how it kicks gas and dust, and what a scene, a forecast and warnings have to know of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.scene.rules import Rule

if TYPE_CHECKING:
    from discsim.numerics.ppm import Tube
    from discsim.numerics.state import State
    from discsim.scene import Scene

Array = np.ndarray
Keys = dict[str, tuple[str, ...]]

# Keys of [drag] that a scheme may have no use for, by why.
NO_CELLS: Keys = {"no such drag cells": ("cell", "cell_length")}
NO_KERNEL: Keys = {"no kernel of its own": ("kernel",)}
OWN_INTEGRATION: Keys = {"an integration of its own": ("integration",)}

# Arrays that particles in one block may have to know of each other; and where of accelerations that is only those that
# gas and dust do not share (`state.own_acc`).
# Small dust is a part of the mass where dust grows.
EVERYTHING = ("pos", "vel", "acc", "mass", "h", "density", "sound_speed", "small")
UNSHARED = ("pos", "vel", "mass", "density", "sound_speed", "small")


@dataclass(frozen=True)
class Cells:
    """The drag cells of a scheme: their sides, and how many particles they want.

    leaf(scene, number, h_mean, h_least): wanted side of the leaves that cells are made of, where a cell is to be
    `number` smoothing lengths of the gas wide: h_mean() is their geometric mean, made where it is asked for. share: of
    the wanted side that a cell has at least. few: gas and dust particles that a cell of two dimensions wants, where
    eps ~ 1 and dust is placed evenly, and few_random, where any is placed at random. least(scene): those below which
    cells grow, if empty ones are not all that do.
    """

    leaf: Callable[[Scene, float, Callable[[], float], float], float]
    few: tuple[float, float]
    few_random: tuple[float, float]
    share: float = 1.0
    least: Callable[[Scene], tuple[int, int]] | None = None


@dataclass(frozen=True)
class Scheme:
    """A drag scheme, either of particles (`relax`) or of fluids on a fixed grid (`advance`).

    relax(drag, state, dt, gas_vel, heat) kicks gas and dust over dt, accelerations and drag together: dust in place,
    the gas in `gas_vel` (n, d), for one-way drag a copy that nobody reads afterwards. It writes `drag.stopping_times`
    of the dust and `drag.alone`, and if `heat` has entries the heat per mass of each gas particle.

    advance(drag, tube, cells, dt) returns what the `cells` (5, n) of a `ppm.Tube` hold dt later: fluxes are the
    accelerations there.

    limit(drag, state): of an explicit scheme, the longest stable step.
    """

    relax: Callable[[Any, State, float, Array, Array], None] | None = None
    advance: Callable[[Any, Tube, Array, float], Array] | None = None
    limit: Callable[[Any, State], float] | None = None
    conserves: bool = True  # momentum
    sizes: bool = False  # whether grains of a population may have sizes of their own
    damps: bool = False  # waves, too much where h > c_s t_stop
    unused: Keys = field(default_factory=dict)  # keys of [drag], by why
    cells: Cells | None = None  # where drag is that of the particles in a cell
    nanoseconds: float = 3000.0  # CPU time of a particle of either kind in a step: those of pairs
    rules: tuple[Rule, ...] = ()  # what a scene with this scheme must have
    # places(drag, state): what `relax` needs beside accelerations and dt; it takes it from `drag.places(state)`. On
    # several threads it is made while effects accelerate.
    places: Callable[[Any, State], Any] | None = None
    # For runs on several MPI ranks: where the blocks are that it relaxes in, members(drag, state), a `Layout` of
    # `drag/cells.py`, and how many rings of nodes beyond those about a block its particles hang on, below 0 for none at
    # all. Without, each makes the whole kick.
    members: Callable[[Any, State], Any] | None = None
    rings: int = -1
    # Of `members`: arrays of a particle that the kick of others hangs on; where it has heat, `acc` too.
    reads: tuple[str, ...] = EVERYTHING

    @property
    def explicit(self) -> bool:
        """Whether stopping times limit the step."""
        return self.limit is not None

    @property
    def on_grid(self) -> bool:
        """Whether gas and dust are fluids on a fixed grid, and their particles its cells."""
        return self.advance is not None
