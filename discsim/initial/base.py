"""What an initial condition is, whatever its kind: all that is asked of it, from its keys to its exact solution."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from discsim.initial.measure import ErrorMeasure
from discsim.physics.profile import Radial
from discsim.scene.fields import Table
from discsim.scene.rules import Problem, Rule

if TYPE_CHECKING:
    from discsim.physics.orbits import UnderWay

Array = np.ndarray
Arrays = dict[str, Array]  # of one species: pos (n, d), vel (n, d), mass (n,), ...
Curve = tuple[Array, Array, Array]  # places, densities and velocities (n,) of a species


@dataclass(frozen=True)
class Places:
    """The gas of a start at some places, arrays (n,) in code units.

    names: for sentences, like "midplane"; "everywhere" for the only one. radius: from the origin, of a start that has
    one. pressure: of a start that brings its own. relative_mass: of a gas particle there, over their mean; None: 1.
    jump: of the velocity, in a shock there.
    """

    names: list[str]
    density: Array
    radius: Array | None = None
    pressure: Array | None = None
    relative_mass: Array | None = None
    jump: Array | None = None


@dataclass(frozen=True)
class Start:
    """An initial condition: the keys of `[initial]` with its kind, what makes its particles, and what follows from it.

    Functions take the validated Scene; numbers are in code units.

    What is made:
        particles(scene): arrays by species, pos, vel (n, d), mass (n,), and where it matters density (n,), a first
            guess for h, u (n,), species and immobile (n,).
        radial(scene): the disc that it is, as functions of the radius (`physics/profile.py`). None: it is none.
        settle(state, effects): velocities, once forces are known.
        take_up(state): gives a state what the run had that it goes on from, at last.
        begins(scene): the time at which a run begins. None: 0.
        under_way(scene): star (0) and companions that are on their way at t = 0, by number. None: all begin.
        thermal_speed(scene, r): sqrt(P / Sigma) of a temperature of its own; None where gas.eos has it.
        cells(scene, x, dx): the same on a fixed grid of cells at x (n,), dx wide: density (n,), velocities (n,) by
            species, and u (n,) or None. None: there is no such start on a grid.
    What it goes with, of which the rules of scenes are made:
        dimensions, boundary (None: any), eos (kinds of equations of state; None: any, and no gas).
        brings_pressure: it needs no temperature of the equation of state.
        column: whether its density in one dimension is a surface density, as self-gravity there needs.
        reach: a key of a length, and how many of it half a side of space has to hold.
        rules: what else a scene with it must have.
        faults(scene): what is wrong with a scene whose tables are right by themselves.
    What a preview shows:
        kernel: the smoothing kernel of its gas where the scene names none (None: as of any scene).
        places(scene): its gas at a few places that tell most.
        masses(scene, population): mass of its gas, where a population of dust (None: of all) is. None: places has one
            density, that of all space.
        spread(scene): places all over the gas, and weights (n,) of the gas there, by mass up to a factor. None: places,
            each weighing the same.
        on_lattice: whether particles that are placed evenly are whole rows and columns, as many as fit.
        edges(scene): inner and outer radius, of a start about the origin. None: radii mean nothing to it.
        reference_density(scene): Sigma at the radius that laws of drag refer to. None: it has no such radius.
        later(scene, time): the gas that sets the step at a time, for forecasts. None: that of the start, all over.
        warnings(scene): what will run, but perhaps not as meant.
    What its answer is:
        measure(scene): its error against the exact solution; None where this scene has none.
        exact_with: effects beside gas, dust and drag that the exact solution knows.
        uniform: whether nothing moves but by drag, so that only rounding errors could grow in long steps.
        curves(scene, time, x): exact curves by species, in 1D at x (n,), else at the distances x from the middle of
            space; of species that have one in this scene. A start may choose other places than x.
        around: in 2D, the velocity that its figure shows against that distance; None: it shows none.
    """

    keys: type[Table]
    particles: Callable[[Any], dict[str, dict[str, Any]]]
    places: Callable[[Any], Places]
    radial: Callable[[Any], Radial] | None = None
    settle: Callable[[Any, dict[str, Any]], None] | None = None
    take_up: Callable[[Any], None] | None = None
    begins: Callable[[Any], float] | None = None
    under_way: Callable[[Any], dict[int, UnderWay]] | None = None
    thermal_speed: Callable[[Any, Array], Array | None] | None = None
    cells: Callable[[Any, Array, float], tuple[Array, Arrays, Array | None]] | None = None
    dimensions: tuple[int, ...] = (1, 2)
    boundary: Literal["open", "periodic"] | None = "periodic"
    eos: tuple[str, ...] | None = None
    brings_pressure: bool = False
    column: bool = False
    reach: tuple[str, float] | None = None
    rules: tuple[Rule, ...] = ()
    faults: Callable[[Any], Iterator[Problem]] | None = None
    kernel: str | None = None
    masses: Callable[[Any, Any], float] | None = None
    spread: Callable[[Any], tuple[Places, Array]] | None = None
    on_lattice: bool = True
    edges: Callable[[Any], tuple[float, float]] | None = None
    reference_density: Callable[[Any], float] | None = None
    later: Callable[[Any, float], Places] | None = None
    warnings: Callable[[Any], Iterator[str]] | None = None
    measure: Callable[[Any], ErrorMeasure | None] | None = None
    exact_with: tuple[str, ...] = ()
    uniform: bool = False
    curves: Callable[[Any, float, Array], dict[str, Curve]] | None = None
    around: Literal["radial", "azimuthal"] | None = None

    def mass(self, scene: Any, population: Any = None) -> float:
        """Mass of the gas where a population of dust is, or of all of it (mass over area in one dimension)."""
        if self.masses is not None:
            return self.masses(scene, population)
        return float(self.places(scene).density[0]) * math.prod(scene.space.size)

    def all_over(self, scene: Any) -> tuple[Places, Array]:
        """Places all over the gas, and weights (n,) of the gas there, by mass up to a factor."""
        if self.spread is not None:
            return self.spread(scene)
        places = self.places(scene)
        return places, np.ones_like(places.density)
