"""The interface of an initial condition ("start"): keys, particles, and data for previews and error measures."""

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
Arrays = dict[str, Array]  # arrays of one species by name: pos (n, d), vel (n, d), mass (n,), ...
Curve = tuple[Array, Array, Array]  # exact solution of a species: positions, densities and velocities, each (n,)


@dataclass(frozen=True)
class SamplePoints:
    """Properties of the gas of a start at n sample points; arrays (n,) in code units.

    Attributes
    ----------
    names : list of str
        Names of the points for messages, like "midplane"; "everywhere" for the single point of uniform gas. Empty if
        no message needs names.
    density : ndarray
        Density of the gas; in 2D its surface density.
    radius : ndarray or None
        Distance of the point from the origin. None: the start has no centre.
    pressure : ndarray or None
        Pressure of the gas. None: it follows from the equation of state.
    relative_mass : ndarray or None
        Mass of a gas particle at the point, divided by the mean mass of all gas particles. None: all masses are equal.
    jump : ndarray or None
        Velocity jump of the shock at the point, 0 at points without a shock. None: the start has no shock.
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

    The argument `scene` of the functions is the validated Scene. Numbers are in code units. Only `keys`, `particles`
    and `sample_points` are required; for the others, the meaning of None is given.

    Attributes
    ----------
    keys : type of Table
        Keys of `[initial]` for this kind.
    particles : callable (scene)
        Return the particles as {species: {name: array}}: pos, vel (n, d), mass (n,) and, optionally, density (n,) (a
        first guess for h), u, species and immobile (n,).
    sample_points : callable (scene)
        Return `SamplePoints`, a few representative points of the gas.
    radial : callable (scene), optional
        Return the radial profiles of the disc (`physics/profile.py`). None: the start is not a disc.
    settle : callable (state, effects), optional
        Set the velocities, or shift the particles, in `state` so that the forces of `effects` balance. None: particles
        start as `particles` returns them.
    restore : callable (state), optional
        Set the time of `state` to that of an earlier run and, if the new run continues the earlier one, restore its
        arrays too. It is called last. None: the start does not come from an earlier run.
    start_time : callable (scene), optional
        Return the time at which the run begins. None: 0.
    moving_bodies : callable (scene), optional
        Return position, velocity and history of the star (number 0) and of companions (from 1) that continue from an
        earlier run, as {number: ContinuedBody}. None: all bodies start as in their tables.
    thermal_speed : callable (scene, r), optional
        Return sqrt(P / Sigma) (n,) at the radii r (n,), if this scene's start sets the temperature, else None. None:
        the start never does.
    cell_values : callable (scene, x, dx), optional
        Return density (n,), {species: velocity (n,)}, and u (n,) or None, in grid cells of width dx centred at x (n,).
        None: the start cannot be used on a fixed grid.
    dimensions : tuple of int
        Dimensions of space that the start supports.
    boundary : {"open", "periodic"} or None
        Boundary that the start needs. None: any boundary.
    eos : tuple of str or None
        Kinds of equations of state that the start supports; a table [gas] is then required. None: the start supports
        all kinds, and scenes without gas.
    sets_pressure : bool
        Whether the start sets the pressure, so that the equation of state needs no temperature.
    has_surface_density : bool
        Whether the density of the start in 1D is a surface density, as self-gravity in 1D requires.
    min_half_side : (str, float) or None
        Key of `[initial]` with a length, and a factor. Half a side of space must be at least the factor times this
        length. None: space may have any size.
    rules : tuple of Rule
        Further rules for scenes with this start.
    problems : callable (scene), optional
        Yield problems that can be found only in the validated scene. None: there are none.
    kernel : str or None
        Default smoothing kernel of the gas. None: the default of all scenes.
    region_mass : callable (scene, population), optional
        Return the mass of gas in the region of a dust population, or of all gas if `population` is None. None: the gas
        fills space with the density of the first sample point.
    samples_of_all_gas : callable (scene), optional
        Return `SamplePoints` throughout the gas, and the relative gas mass (n,) that each point represents. None: the
        few `sample_points`, with equal masses.
    on_lattice : bool
        Whether particles with even placement form a lattice, so that their number is a product of rows and columns.
    edges : callable (scene), optional
        Return inner and outer radius of the gas about the origin. None: the start has no centre.
    reference_density : callable (scene), optional
        Return Sigma at the reference radius of drag laws. None: the start has no such radius.
    limiting_gas : callable (scene, time), optional
        Return `SamplePoints` of the gas that limits the time step at `time`, for forecasts. None: the gas at the start
        limits the step at all times.
    warnings : callable (scene), optional
        Yield warnings about scenes that run, but perhaps not as intended. None: there are none.
    measure : callable (scene), optional
        Return the `ErrorMeasure` against the exact solution, or None if this scene has no exact solution. None: no
        scene with this start has an exact solution.
    exact_effects : tuple of str
        Effects, besides gas, dust and drag, that the exact solution includes.
    stays_uniform : bool
        Whether gas and dust stay uniform, so that drag alone changes their relative velocities. Long steps then
        amplify only rounding errors.
    exact_curves : callable (scene, time, x), optional
        Return the exact solution as {species: Curve}, without species that have none. `x` (n,) are positions in 1D,
        and distances from the middle of space in 2D. A curve may have positions other than `x`. None: no curves.
    figure_velocity : {"radial", "azimuthal"} or None
        In 2D, the velocity component that the figure shows against the distance from the middle of space. None: the
        figure shows no velocity.
    """

    keys: type[Table]
    particles: Callable[[Any], dict[str, dict[str, Any]]]
    sample_points: Callable[[Any], SamplePoints]
    radial: Callable[[Any], Radial] | None = None
    settle: Callable[[Any, dict[str, Any]], None] | None = None
    restore: Callable[[Any], None] | None = None
    start_time: Callable[[Any], float] | None = None
    moving_bodies: Callable[[Any], dict[int, ContinuedBody]] | None = None
    thermal_speed: Callable[[Any, Array], Array | None] | None = None
    cell_values: Callable[[Any, Array, float], tuple[Array, Arrays, Array | None]] | None = None
    dimensions: tuple[int, ...] = (1, 2)
    boundary: Literal["open", "periodic"] | None = "periodic"
    eos: tuple[str, ...] | None = None
    sets_pressure: bool = False
    has_surface_density: bool = False
    min_half_side: tuple[str, float] | None = None
    rules: tuple[Rule, ...] = ()
    problems: Callable[[Any], Iterator[Problem]] | None = None
    kernel: str | None = None
    region_mass: Callable[[Any, Any], float] | None = None
    samples_of_all_gas: Callable[[Any], tuple[SamplePoints, Array]] | None = None
    on_lattice: bool = True
    edges: Callable[[Any], tuple[float, float]] | None = None
    reference_density: Callable[[Any], float] | None = None
    limiting_gas: Callable[[Any, float], SamplePoints] | None = None
    warnings: Callable[[Any], Iterator[str]] | None = None
    measure: Callable[[Any], ErrorMeasure | None] | None = None
    exact_effects: tuple[str, ...] = ()
    stays_uniform: bool = False
    exact_curves: Callable[[Any, float, Array], dict[str, Curve]] | None = None
    figure_velocity: Literal["radial", "azimuthal"] | None = None

    def gas_mass(self, scene: Any, population: Any = None) -> float:
        """Return the mass of the gas in the region of a dust population; in 1D a mass per area.

        population: the table of the population; None: return the mass of all gas.
        """
        if self.region_mass is not None:
            return self.region_mass(scene, population)
        return float(self.sample_points(scene).density[0]) * math.prod(scene.space.size)

    def sample_all_gas(self, scene: Any) -> tuple[SamplePoints, Array]:
        """Return sample points throughout the gas, and the relative gas mass (n,) that each point represents."""
        if self.samples_of_all_gas is not None:
            return self.samples_of_all_gas(scene)
        points = self.sample_points(scene)
        return points, np.ones_like(points.density)
