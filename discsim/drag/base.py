"""Interface of a drag scheme: the arguments and the result of a kick, and the properties of a scheme."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from discsim.parts import Lazy
from discsim.scene.rules import Rule

if TYPE_CHECKING:
    from discsim.numerics.ppm import Tube
    from discsim.scene import Scene

laws = Lazy("discsim.kernels.drag.laws")
Array = np.ndarray
Keys = dict[str, tuple[str, ...]]
EMPTY, NO_ROWS = np.empty(0), np.empty(0, np.int64)

# Keys of [drag] that have no meaning for a scheme, by the reason: a text that completes the message "scheme has ...".
NO_CELLS: Keys = {"no drag cells": ("cell", "cell_length")}
NO_KERNEL: Keys = {"no drag kernel": ("kernel",)}
OWN_INTEGRATION: Keys = {"a fixed time integration": ("integration",)}

# Names of the ghost particles' arrays that a kick reads. A kick with UNSHARED reads `acc_unshared`, but not `acc`.
EVERYTHING = ("pos", "vel", "acc", "acc_unshared", "mass", "h", "density", "thermal_speed")
UNSHARED = ("pos", "vel", "acc_unshared", "mass", "density", "thermal_speed")


class Gas(NamedTuple):
    """Arrays of the gas: one row per particle, in code units; d is the number of dimensions.

    On several MPI ranks the first `local` rows are particles of this rank, and the others are ghost particles. In a
    serial run `local` is the number of particles.

    pos (n, d): positions. vel (n, d): velocities; a kick changes this array in place. acc (n, d): accelerations by all
    forces except drag. acc_unshared (n, d): the part of `acc` that does not act on dust, for example pressure; without
    rows if this part is 0. mass (n,). h (n,): smoothing lengths. density (n,): density of the gas without the small
    dust that it carries. thermal_speed (n,): sqrt(P / rho). global_index (n,): keys by which all ranks together sort
    their particles into the order of a serial run; None on one rank. The keys ascend, except in the rows
    `unsorted_rows`.
    """

    pos: Array
    vel: Array
    acc: Array
    acc_unshared: Array
    mass: Array
    h: Array
    density: Array
    thermal_speed: Array
    global_index: Array | None
    unsorted_rows: Array
    local: int


class Dust(NamedTuple):
    """Arrays of the dust: one row per particle ("grain"). The fields that `Gas` has too have the same meaning here.

    acc_unshared (n, d): the part of `acc` that does not act on gas, for example radiation pressure. class_of (n,):
    the row of `DragLaw.grains` with the parameters of the grain. per_grain (n,): one number per grain, or empty. If
    grains have their own sizes, the number is the stopping time of the grain divided by the stopping time of its
    class. With the law t_stop = rho_d / K and sparse dust, the number is the dust density at the grain.
    """

    pos: Array
    vel: Array
    acc: Array
    acc_unshared: Array
    mass: Array
    class_of: Array
    per_grain: Array
    global_index: Array | None
    unsorted_rows: Array
    local: int


class DragLaw(NamedTuple):
    """Drag law of a kick: how long grains take to stop, on which species drag acts, and how time is integrated.

    code: form of the law, a constant of `formulas/laws.py`. grains (classes, 5): parameters of each class of grains. A
    class is a dust population, or the grains of similar stopping time. nonlinear: whether stopping times depend on the
    slip, the velocity of dust relative to gas. several: True if there may be more than one class, otherwise None (numba
    then compiles no code for several classes). two_way: whether drag acts on the gas too. exponential: whether slips
    relax by the exact exponential; False for implicit Euler.
    """

    code: int
    grains: Array
    nonlinear: bool
    several: bool | None
    two_way: bool
    exponential: bool

    def stopping_time(self, population: int, density: Array, thermal_speed: Array, omega: Array, ratio: Any) -> Array:
        """Return the stopping time (n,) at zero slip of the grains of one class in gas.

        population: index of the class. density, thermal_speed, omega (n,): density, sqrt(P / rho) and orbital frequency
        of the gas. ratio: dust-to-gas mass ratio, one number or (n,).
        """
        ratios = np.full(len(density), ratio)
        return laws.stopping_times(self.code, self.grains[population], ratios, density, thermal_speed, omega)


class CellRule(NamedTuple):
    """Rule by which the leaves of a lattice, which are small squares, are merged to drag cells (`drag/cells.py`).

    A cell has at least its smallest side. A cell with too few particles is larger, up to a limit.

    dim: number of dimensions. classes: number of classes of grains. lattice: `Lattice` of leaves before the shift of
    this step. lengths (n,): smoothing lengths of the gas particles of this rank, reduced as in `drag/width.py`.
    size: smallest side divided by the mean of `lengths` in the cell; 0 if `length` is the smallest side. length:
    smallest side in code units; 0 if `size` determines it. fewest: numbers of gas and of dust particles; a cell with
    fewer is enlarged. soft: a cell with few particles is enlarged to at most this many smallest sides. hard: the
    upper limit, in smallest sides, for a cell without gas, or without dust where the scheme needs dust. two_way:
    whether drag acts on the gas too. step: number of the time step, which determines the shift of the lattice.
    """

    dim: int
    classes: int
    lattice: Any
    lengths: Array
    size: float
    length: float
    fewest: tuple[int, int]
    soft: float
    hard: float
    two_way: bool
    step: int


class KickContext(NamedTuple):
    """Properties of the run that a kick needs, scratch memory, and the output array of the heat.

    dim: number of dimensions. period (2,): period of space along x and y, inf along axes without a period. heat (n,):
    output array for the heat per mass that each gas particle gains in the kick; empty if drag does not heat. buffers:
    scratch arrays by name, which a scheme may keep here for later kicks. new_sph: function without arguments that
    returns a new `Sph`, which computes SPH sums with the options of the scene. ratios: dust-to-gas mass ratio of each
    population. double_hump: whether pairs have the double-hump kernel as weight; False for the kernel of the gas.
    geometry: `Geometry` of the polar cells of the gas (`kernels/polar/geometry.py`), for schemes with `polar`.
    """

    dim: int
    period: Array
    heat: Array
    buffers: dict[str, Array]
    new_sph: Callable[[], Any]
    ratios: list[float]
    double_hump: bool
    geometry: Any = None


class KickResult(NamedTuple):
    """Result of a kick, apart from the velocities that it changes in place.

    uncoupled: indices of the dust particles that have no gas near them, or whose drag cell is enlarged for lack of
    particles. stopping_times (n,): stopping time of each dust particle, inf for particles without gas; or a function
    without arguments that computes this array.
    """

    uncoupled: Array
    stopping_times: Array | Callable[[], Array]


@dataclass(frozen=True)
class CellSizes:
    """Limits of the sizes of a scheme's drag cells. A drag cell is a square of 1, 2, 4, ... by as many leaves.

    Attributes
    ----------
    leaf : callable
        `leaf(scene, number, h_mean, h_least)` returns the smallest allowed side of a leaf in code units, if the target
        side of a cell is `number` smoothing lengths of the gas. `h_mean()` computes the geometric mean of the smoothing
        lengths, and `h_least` is the smallest smoothing length.
    adequate : tuple of float
        Numbers of gas and of dust particles in a cell, in two dimensions. Scenes with fewer get a warning. The numbers
        hold for dust-to-gas ratios near 1 and evenly placed dust.
    adequate_random : tuple of float
        The same numbers for dust placed at random.
    least_side : float
        Smallest side of a cell, as a fraction of its target side.
    minimum : callable, optional
        `minimum(scene)` returns two numbers of particles, of gas and of dust; a run enlarges cells with fewer. Without
        this function only cells without particles of a species are enlarged.
    """

    leaf: Callable[[Scene, float, Callable[[], float], float], float]
    adequate: tuple[float, float]
    adequate_random: tuple[float, float]
    least_side: float = 1.0
    minimum: Callable[[Scene], tuple[int, int]] | None = None


@dataclass(frozen=True)
class Scheme:
    """Drag scheme, either for particles (with `kick`) or for fluids on a fixed grid (with `advance`).

    Attributes
    ----------
    kick : callable, optional
        `kick(gas, dust, law, frame, dt, cells, context)` applies accelerations and drag over the time dt and returns a
        `KickResult`. It changes `gas.vel` and `dust.vel` in place. With one-way drag, `gas.vel` is a copy that the
        caller discards. The arguments are a `Gas`, a `Dust`, a `DragLaw`, a `kernels.drag.frame.Frame` about the star,
        dt, the result of `build` (None without `build`) and a `KickContext`. The sense of rotation in `frame` is set
        only for schemes with cells.
    layout : callable, optional
        `layout(gas, dust, rule, frame, ranks)` returns the `Layout` of the drag cells, from positions, velocities and
        masses. `rule` is a `CellRule`. `ranks` is a `OneRank`, or its counterpart on several MPI ranks (`drag/cells.py`
        has `Layout` and `OneRank`). A scheme without `layout` has no cells, and every rank computes the whole kick.
    build : callable, optional
        `build(gas, dust, rule, layout)` returns the argument `cells` of a kick. If the run has several threads, `build`
        runs at the same time as the computation of accelerations.
    advance : callable, optional
        `advance(law, tube, cells, dt, heating)` returns the fluids after dt. `cells` (5, n) has the fluids in the grid
        cells before, which it does not change. `tube` is a `numerics.ppm.Tube`, which computes fluxes; these replace
        the accelerations of particles. `heating` is true if friction heats the gas.
    limit : callable, optional
        `limit(gas, dust, law, frame, context)` returns the longest stable step of an explicit scheme in code units.
    rings : int
        For schemes with `layout` and nodes: the particles of a cell are affected by its nine nodes and by `rings` rings
        of nodes around them. Negative for a scheme without nodes.
    reads : tuple of str
        For schemes with `layout`: names of the arrays of ghost particles that affect the kick of local particles. With
        heating the kick may read `acc` of ghosts too.
    conserves : bool
        Whether the kick conserves momentum to rounding.
    by_component : bool
        Whether a kick changes each component of the velocities by itself, as a shearing box needs for the azimuthal
        velocity. False for impulses along the line between two particles.
    polar : bool
        Whether the drag cells are the cells of gas on a polar grid.
    sizes : bool
        Whether the grains of a population may have different sizes.
    damps : bool
        Whether the scheme damps waves too strongly where h > c_s t_stop.
    unused : dict of str to tuple of str
        For each reason, as a text: the keys of [drag] that for this reason have no meaning for the scheme.
    cells : CellSizes, optional
        Limits of the sizes of drag cells, for schemes with `layout`.
    nanoseconds : float
        CPU time of one step, per particle of gas or dust. The default is typical of schemes that couple pairs of
        particles.
    rules : tuple of callable
        Generators that yield the problems of a scene that uses this scheme.
    """

    kick: Callable[..., KickResult] | None = None
    layout: Callable[..., Any] | None = None
    build: Callable[..., Any] | None = None
    advance: Callable[[DragLaw, Tube, Array, float, bool], Array] | None = None
    limit: Callable[[Gas, Dust, DragLaw, Any, KickContext], float] | None = None
    rings: int = -1
    reads: tuple[str, ...] = EVERYTHING
    conserves: bool = True
    by_component: bool = True
    polar: bool = False
    sizes: bool = False
    damps: bool = False
    unused: Keys = field(default_factory=dict)
    cells: CellSizes | None = None
    nanoseconds: float = 3000.0
    rules: tuple[Rule, ...] = ()

    @property
    def explicit(self) -> bool:
        """True for an explicit scheme, in which stopping times limit the time step."""
        return self.limit is not None

    @property
    def on_grid(self) -> bool:
        """True if gas and dust are fluids on a fixed grid. Each row of a particle array is then a grid cell."""
        return self.advance is not None
