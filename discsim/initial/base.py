"""The interface of an initial condition ("start"): keys, particles, previews, exact solution."""

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
    from discsim.physics.orbits import ContinuedBody

Array = np.ndarray
Arrays = dict[str, Array]  # arrays of one species: pos (n, d), vel (n, d), mass (n,), ...
Curve = tuple[Array, Array, Array]  # positions, densities and velocities (n,) of an exact solution for a species


@dataclass(frozen=True)
class Places:
    """Sample points in the gas of a start, with the properties of the gas there; arrays (n,) in code units.

    Attributes
    ----------
    names : list of str
        Names of the points for messages, like "midplane"; "everywhere" for a single point.
    density : ndarray
        Density of the gas, in 2D its surface density.
    radius : ndarray or None
        Distance from the origin, if the start has a centre.
    pressure : ndarray or None
        Pressure, if the start sets it. None: it follows from the equation of state.
    relative_mass : ndarray or None
        Mass of a gas particle over the mean mass; None: 1.
    jump : ndarray or None
        Velocity jump of the shock at each point, 0 at points without a shock. None: no shock.
    """

    names: list[str]
    density: Array
    radius: Array | None = None
    pressure: Array | None = None
    relative_mass: Array | None = None
    jump: Array | None = None


@dataclass(frozen=True)
class Start:
    """An initial condition: its keys in `[initial]`, its particles, and data for rules, previews and error measures.

    Functions take the validated Scene unless noted; numbers are in code units. Only `keys`, `particles` and `places`
    are required. The meaning of None is given for each attribute.

    Attributes
    ----------
    keys : type of Table
        Keys of `[initial]` for this kind.
    particles : callable (scene)
        Return arrays by species: pos, vel (n, d), mass (n,) and, optionally, density (n,), a first guess for h, u (n,),
        species and immobile (n,).
    places : callable (scene)
        Return `Places`, a few representative points of the gas.
    radial : callable (scene), optional
        Return the disc as functions of radius (`physics/profile.py`). None: the start is not a disc.
    settle : callable (state, effects), optional
        Set velocities once forces are known.
    take_up : callable (state), optional
        Copy the time of an earlier run and, if the new run continues it, its state into the new state. Called last.
    begins : callable (scene), optional
        Return the time at which a run begins. None: 0.
    under_way : callable (scene), optional
        Return those of the star (number 0) and the companions (from 1) that already move when the run begins, as
        {number: ContinuedBody}. None: none of them.
    thermal_speed : callable (scene, r), optional
        Return sqrt(P / Sigma) (n,) of the start's own temperature, or None if `gas.eos` sets it.
    cells : callable (scene, x, dx), optional
        Return density (n,), velocities (n,) by species and u (n,) or None in grid cells of width dx at x (n,).
        None: this start cannot be used on a fixed grid.
    dimensions : tuple of int
        Dimensions of space that the start supports.
    boundary : {"open", "periodic"} or None
        Boundary that the start needs. None: any.
    eos : tuple of str or None
        Kinds of equations of state that the start supports; gas is then required. None: any kind, or no gas.
    brings_pressure : bool
        Whether the start sets the pressure, so that the equation of state needs no temperature.
    column : bool
        Whether the density of the start in 1D is a surface density, as self-gravity in 1D requires.
    reach : (str, float) or None
        Key of `[initial]` with a length, and a factor: half a side of space must be at least the factor times the
        length. None: any size.
    rules : tuple of Rule
        Further rules for a scene with this start.
    faults : callable (scene), optional
        Yield problems that can be found only in the validated scene.
    kernel : str or None
        Default smoothing kernel of the gas; None: the default of any scene.
    masses : callable (scene, population), optional
        Return the mass of gas in the region of a dust population, or of all gas if population is None. If masses is
        None: the first density of `places` fills all space.
    spread : callable (scene), optional
        Return `Places` throughout the gas, and relative masses (n,) of the gas there. None: those of `places` with
        equal masses.
    on_lattice : bool
        Whether particles with even placement form a lattice, so that their number is a product of rows and columns.
    edges : callable (scene), optional
        Return inner and outer radius about the origin. None: the start has no centre.
    reference_density : callable (scene), optional
        Return Sigma at the reference radius of drag laws. None: the start has no such radius.
    later : callable (scene, time), optional
        Return `Places` with the gas that limits the time step at a later time, for forecasts. None: the gas of the
        start.
    warnings : callable (scene), optional
        Yield warnings about scenes that run, but perhaps not as intended.
    measure : callable (scene), optional
        Return the error against the exact solution, or None if this scene has no exact solution.
    exact_with : tuple of str
        Effects, besides gas, dust and drag, that the exact solution includes.
    uniform : bool
        Whether gas stays uniform, so that drag alone changes relative velocities; long steps then amplify only
        rounding errors.
    curves : callable (scene, time, x), optional
        Return the exact solution as {species: Curve}, for the species that have one. `x` (n,): positions in 1D, and
        distances from the middle of space in 2D. A curve may have other positions than `x`.
    around : {"radial", "azimuthal"} or None
        In 2D, the velocity component that the figure shows against the distance from the middle. None: no component.
    """

    keys: type[Table]
    particles: Callable[[Any], dict[str, dict[str, Any]]]
    places: Callable[[Any], Places]
    radial: Callable[[Any], Radial] | None = None
    settle: Callable[[Any, dict[str, Any]], None] | None = None
    take_up: Callable[[Any], None] | None = None
    begins: Callable[[Any], float] | None = None
    under_way: Callable[[Any], dict[int, ContinuedBody]] | None = None
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
        """Return the mass of gas in the region of a dust population; None: of all gas. In 1D it is a mass over area."""
        if self.masses is not None:
            return self.masses(scene, population)
        return float(self.places(scene).density[0]) * math.prod(scene.space.size)

    def all_over(self, scene: Any) -> tuple[Places, Array]:
        """Return sample points throughout the gas, and relative masses (n,) of the gas there."""
        if self.spread is not None:
            return self.spread(scene)
        places = self.places(scene)
        return places, np.ones_like(places.density)
