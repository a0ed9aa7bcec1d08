"""Interface of a drag scheme: its kick of gas and dust, and its properties for scenes, forecasts and warnings."""

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

# Keys of [drag] that have no meaning for a scheme, by the reason.
NO_CELLS: Keys = {"no such drag cells": ("cell", "cell_length")}
NO_KERNEL: Keys = {"no kernel of its own": ("kernel",)}
OWN_INTEGRATION: Keys = {"an integration of its own": ("integration",)}

# Arrays of other particles in a block that a kick reads. Schemes with UNSHARED read `state.own_acc` in place of `acc`.
# `small` is among them, as small dust is part of the mass where dust grows.
EVERYTHING = ("pos", "vel", "acc", "mass", "h", "density", "sound_speed", "small")
UNSHARED = ("pos", "vel", "mass", "density", "sound_speed", "small")


@dataclass(frozen=True)
class Cells:
    """Drag cells of a scheme: their sides, and the numbers of particles that they need.

    Attributes
    ----------
    leaf : callable
        `leaf(scene, number, h_mean, h_least)` returns the least side of the leaves that cells are made of, in code
        units, for cells `number` smoothing lengths of the gas wide. `h_mean()` computes the geometric mean of the
        smoothing lengths; `h_least` is the least of them.
    few : tuple of float
        Numbers of gas and dust particles that a cell in two dimensions needs, for eps ~ 1 and evenly placed dust.
    few_random : tuple of float
        The same numbers for scenes with dust placed at random.
    share : float
        Least side of a cell, in wanted sides.
    least : callable, optional
        `least(scene)` returns the numbers of gas and dust particles below which cells grow. Without it only empty
        cells grow.
    """

    leaf: Callable[[Scene, float, Callable[[], float], float], float]
    few: tuple[float, float]
    few_random: tuple[float, float]
    share: float = 1.0
    least: Callable[[Scene], tuple[int, int]] | None = None


@dataclass(frozen=True)
class Scheme:
    """Drag scheme, either of particles (`relax`) or of fluids on a fixed grid (`advance`).

    Attributes
    ----------
    relax : callable, optional
        `relax(drag, state, dt, gas_vel, heat)` kicks gas and dust over dt, accelerations and drag together. It
        changes the dust in place and the gas in `gas_vel` (n, d), which for one-way drag is a copy that is dropped
        afterwards. It sets `drag.stopping_times` (n,) of the dust, and `drag.alone`, the indices of uncoupled dust. If
        `heat` (n,) has entries, it writes the heat per mass of each gas particle there.
    advance : callable, optional
        `advance(drag, tube, cells, dt)` returns the contents `cells` (5, n) of a `ppm.Tube` after dt. Fluxes take the
        place of accelerations.
    limit : callable, optional
        `limit(drag, state)` returns the longest stable step of an explicit scheme, in code units.
    conserves : bool
        Whether momentum is exact.
    sizes : bool
        Whether grains of one population may have sizes of their own.
    damps : bool
        Whether waves are damped too much where h > c_s t_stop.
    unused : dict of str to tuple of str
        Keys of [drag] that have no meaning for the scheme, by the reason.
    cells : Cells, optional
        Drag cells, for schemes in which the particles of a cell relax together.
    nanoseconds : float
        CPU time in a step, per particle of either species. The default is that of schemes of pairs.
    rules : tuple of callable
        Generators of the problems of a scene with this scheme.
    places : callable, optional
        `places(drag, state)` returns what `relax` needs besides accelerations and dt; `relax` takes it from
        `drag.places(state)`. On several threads it is computed while effects accelerate.
    members : callable, optional
        `members(drag, state)` returns the `Layout` (`drag/cells.py`) of the blocks that relax, for runs on several
        MPI ranks. Without it each rank makes the whole kick.
    rings : int
        Number of rings of nodes, beyond those about a block, on which the particles of the block depend; below 0 for
        no nodes at all.
    reads : tuple of str
        With `members`: particle arrays that the kick of other particles depends on. With heat `acc` is one of them too.
    """

    relax: Callable[[Any, State, float, Array, Array], None] | None = None
    advance: Callable[[Any, Tube, Array, float], Array] | None = None
    limit: Callable[[Any, Any], float] | None = None
    conserves: bool = True
    sizes: bool = False
    damps: bool = False
    unused: Keys = field(default_factory=dict)
    cells: Cells | None = None
    nanoseconds: float = 3000.0
    rules: tuple[Rule, ...] = ()
    places: Callable[[Any, Any], Any] | None = None
    members: Callable[[Any, State], Any] | None = None
    rings: int = -1
    reads: tuple[str, ...] = EVERYTHING

    @property
    def explicit(self) -> bool:
        """True if stopping times limit the step."""
        return self.limit is not None

    @property
    def on_grid(self) -> bool:
        """True if gas and dust are fluids on a fixed grid, and their particles its cells."""
        return self.advance is not None
