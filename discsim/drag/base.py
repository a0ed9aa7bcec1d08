"""Interface of a drag scheme: the arrays that it gets and returns, and its properties for scenes and forecasts."""

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

# Keys of [drag] that have no meaning for a scheme, by the reason.
NO_CELLS: Keys = {"no drag cells": ("cell", "cell_length")}
NO_KERNEL: Keys = {"no drag kernel": ("kernel",)}
OWN_INTEGRATION: Keys = {"a fixed time integration": ("integration",)}

# Arrays of ghosts that a kick reads. With UNSHARED it reads `acc_unshared` in place of `acc`.
EVERYTHING = ("pos", "vel", "acc", "acc_unshared", "mass", "h", "density", "thermal_speed")
UNSHARED = ("pos", "vel", "acc_unshared", "mass", "density", "thermal_speed")


class Gas(NamedTuple):
    """Arrays (n, ...) of the gas. On several ranks local particles come first, and then ghosts.

    pos, vel (n, d): a kick changes `vel[:]`. acc (n, d): accelerations without drag. acc_unshared (n, d): the
    part of `acc` that dust at the same position does not have; no entries if there is none. density (n,): without
    small dust that the gas carries. thermal_speed (n,): sqrt(P / rho). global_index (n,): keys of the order of all
    particles of a run, rising except in `unsorted_rows`; None on one rank. local: number of local particles.
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
    """Arrays (n, ...) of the dust, as those of `Gas`, and two more.

    class_of (n,): population or class of each grain, its row in `Law.grains`. per_grain (n,): stopping time of each
    grain over that of its class or, for sparse dust with a constant K, its density; no entries if neither applies.
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


class Law(NamedTuple):
    """Law of the stopping time, and how a kick applies it.

    code: form of the law (`formulas/laws.py`). grains (classes, 5): its parameters. nonlinear: whether stopping times
    depend on the slip. several: True if there may be more than one class, else None, for which kernels compile no code
    for many. two_way: whether the gas is kicked too. exponential: exact exponential, else implicit Euler.
    """

    code: int
    grains: Array
    nonlinear: bool
    several: bool | None
    two_way: bool
    exponential: bool

    def stopping_time(self, population: int, density: Array, thermal_speed: Array, omega: Array, ratio: float) -> Array:
        """Return the stopping time (n,) at zero slip of a class in gas of these properties (n,)."""
        return laws.stopping_times(self.code, self.grains[population], ratio, density, thermal_speed, omega)


class CellRule(NamedTuple):
    """Rule by which drag cells are made of the leaves of a lattice (`drag/cells.py`).

    dim: dimensions. classes: number of classes of the dust. lattice: a `Lattice` that has not moved. lengths (n,):
    smoothing lengths of local gas, limited as in `drag/width.py`. size: wanted side in these lengths, or 0. length:
    wanted side as a length, or 0. fewest: numbers of gas and dust particles below which cells grow. soft, hard: limits
    of the growth in wanted sides. step: number of steps since the start, with which a lattice moves.
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


class Work(NamedTuple):
    """Further arguments of a kick.

    dim: dimensions. period (2,): that of space, inf where it is open. heat (n,): output, the heat per mass of each gas
    particle; no entries without heating. buffers: scratch arrays that a scheme reuses in every kick. new_sph: create
    SPH sums with the options of the scene. ratios: dust-to-gas mass ratio of each population. double_hump: whether the
    weights of pairs are the double-hump kernel, else that of the gas.
    """

    dim: int
    period: Array
    heat: Array
    buffers: dict[str, Array]
    new_sph: Callable[[], Any]
    ratios: list[float]
    double_hump: bool


class Kicked(NamedTuple):
    """Results of a kick: rows of the dust that it did not couple to gas, and the stopping times (n,) of the dust.

    The stopping times may be given as a function that computes them; they are inf without gas.
    """

    uncoupled: Array
    stopping_times: Array | Callable[[], Array]


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
    """Drag scheme, either of particles (`kick`) or of fluids on a fixed grid (`advance`).

    Attributes
    ----------
    kick : callable, optional
        `kick(gas, dust, law, frame, dt, cells, work)` kicks gas and dust over dt, accelerations and drag together, and
        returns `Kicked`. It changes both velocities in place; those of the gas are dropped if the drag is one-way.
        frame: `kernels.drag.frame.Frame` about the star; its sense of rotation is only set for schemes with cells.
        cells: result of `build`, or None.
    layout : callable, optional
        `layout(gas, dust, rule, frame, ranks)` returns the `Layout` (`drag/cells.py`) of the cells that relax, from
        positions, velocities and masses. ranks: `OneRank` of `drag/cells.py`, or its counterpart on several ranks.
        Without it the scheme has no cells, and each rank makes the whole kick.
    build : callable, optional
        `build(gas, dust, rule, layout)` returns the `cells` of a kick. On several threads it is computed while effects
        accelerate.
    advance : callable, optional
        `advance(law, tube, cells, dt, heating)` returns the contents `cells` (5, n) of a `ppm.Tube` after dt. Fluxes
        take the place of accelerations.
    limit : callable, optional
        `limit(gas, dust, law, frame, work)` returns the longest stable step of an explicit scheme, in code units.
    rings : int
        With `layout`: number of rings of nodes, beyond those about a cell, on which the particles of the cell depend;
        below 0 for no nodes at all.
    reads : tuple of str
        With `layout`: arrays of ghosts that the kick of local particles depends on. With heat `acc` is one of them too.
    conserves : bool
        Whether momentum is exact.
    sizes : bool
        Whether grains of one population may have sizes of their own.
    damps : bool
        Whether waves are damped too much where h > c_s t_stop.
    unused : dict of str to tuple of str
        Keys of [drag] that have no meaning for the scheme, by the reason.
    cells : Cells, optional
        Sides of drag cells, for schemes with `layout`.
    nanoseconds : float
        CPU time in a step, per particle of either species. The default is that of schemes of pairs.
    rules : tuple of callable
        Generators of the problems of a scene with this scheme.
    """

    kick: Callable[..., Kicked] | None = None
    layout: Callable[..., Any] | None = None
    build: Callable[..., Any] | None = None
    advance: Callable[[Law, Tube, Array, float, bool], Array] | None = None
    limit: Callable[[Gas, Dust, Law, Any, Work], float] | None = None
    rings: int = -1
    reads: tuple[str, ...] = EVERYTHING
    conserves: bool = True
    sizes: bool = False
    damps: bool = False
    unused: Keys = field(default_factory=dict)
    cells: Cells | None = None
    nanoseconds: float = 3000.0
    rules: tuple[Rule, ...] = ()

    @property
    def explicit(self) -> bool:
        """True if stopping times limit the step."""
        return self.limit is not None

    @property
    def on_grid(self) -> bool:
        """True if gas and dust are fluids on a fixed grid, and their particles its cells."""
        return self.advance is not None
