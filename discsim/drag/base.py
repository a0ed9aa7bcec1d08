"""Interface of a drag scheme: arguments and results of a kick, and the properties of a scheme."""

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

# Keys of [drag] that have no meaning for a scheme, by the reason as text for messages.
NO_CELLS: Keys = {"no drag cells": ("cell", "cell_length")}
NO_KERNEL: Keys = {"no drag kernel": ("kernel",)}
OWN_INTEGRATION: Keys = {"a fixed time integration": ("integration",)}

# Names of the ghost particles' arrays that a kick reads. A kick with UNSHARED reads `acc_unshared`, but not `acc`.
EVERYTHING = ("pos", "vel", "acc", "acc_unshared", "mass", "h", "density", "thermal_speed")
UNSHARED = ("pos", "vel", "acc_unshared", "mass", "density", "thermal_speed")


class Gas(NamedTuple):
    """Arrays of the gas, with one row per particle. On several ranks, local particles come before ghost particles.

    pos (n, d): positions. vel (n, d): velocities; a kick changes them in place. acc (n, d): accelerations without
    drag. acc_unshared (n, d): the part of `acc` that dust at the same position does not have; without rows if this part
    is 0. density (n,): excludes small dust carried by the gas. thermal_speed (n,): sqrt(P / rho). global_index (n,):
    sort keys that give all ranks together the order of a serial run; None on one rank. They rise along the array,
    except in the rows `unsorted_rows`. local: number of local particles.
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
    """Arrays of the dust: those of `Gas` except for density and thermal speed, and two of its own.

    class_of (n,): row of `Law.grains` of each grain, the index of its population or size class. per_grain (n,): a
    number for each grain, empty if the law needs none. Where grains have their own sizes, it is the stopping time of
    the grain divided by that of its class. For sparse dust with a constant K, it is the dust density at the grain.
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
    """Law of the stopping time, and the way in which a kick applies it.

    code: form of the law, a constant of `formulas/laws.py`. grains (classes, 5): parameters of each class. nonlinear:
    whether stopping times depend on the slip. several: True if there may be more than one class, else None (numba then
    compiles no code for several classes). two_way: whether drag acts on the gas too. exponential: whether the time
    integration is the exact exponential; False for implicit Euler.
    """

    code: int
    grains: Array
    nonlinear: bool
    several: bool | None
    two_way: bool
    exponential: bool

    def stopping_time(self, population: int, density: Array, thermal_speed: Array, omega: Array, ratio: float) -> Array:
        """Return the stopping time (n,) of a class at zero slip.

        population: index of the class. density, thermal_speed, omega (n,): properties of the gas, with omega the
        orbital frequency. ratio: dust-to-gas mass ratio.
        """
        return laws.stopping_times(self.code, self.grains[population], ratio, density, thermal_speed, omega)


class CellRule(NamedTuple):
    """Rule by which the leaves of a lattice are merged to drag cells (`drag/cells.py`).

    Cells have a target side, and are larger where they would have too few particles.

    dim: number of dimensions. classes: number of dust classes. lattice: `Lattice` before the shift of this step.
    lengths (n,): smoothing lengths of local gas, limited as in `drag/width.py`. size: target side in units of the mean
    of `lengths` in the cell; 0 if `length` sets it. length: target side in code units; 0 if `size` sets it. fewest:
    numbers of gas and dust particles below which a cell grows. soft: largest side, in target sides, to which a cell
    grows for lack of particles. hard: the same for a cell without gas or without the dust that it needs. two_way:
    whether drag acts on the gas too. step: number of steps since the start, which determines the shift.
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

    dim: number of dimensions. period (2,): period of space along each axis, inf where space is open. heat (n,): output,
    the heat per mass that each gas particle gains; empty without heating. buffers: scratch arrays, which a scheme
    reuses in later kicks. new_sph: function that returns an object for SPH sums with the options of the scene. ratios:
    dust-to-gas mass ratio of each population. double_hump: whether the weight of a pair is the double-hump kernel;
    False for the kernel of the gas.
    """

    dim: int
    period: Array
    heat: Array
    buffers: dict[str, Array]
    new_sph: Callable[[], Any]
    ratios: list[float]
    double_hump: bool


class Kicked(NamedTuple):
    """Results of a kick.

    uncoupled: indices of the dust particles without gas, or in a cell that was enlarged for lack of particles.
    stopping_times (n,): stopping times of the dust, inf without gas; or a function that computes them.
    """

    uncoupled: Array
    stopping_times: Array | Callable[[], Array]


@dataclass(frozen=True)
class Cells:
    """Sizes of a scheme's drag cells. A cell is a square block of leaves of a lattice.

    Attributes
    ----------
    leaf : callable
        `leaf(scene, number, h_mean, h_least)` returns the smallest allowed side of a leaf in code units. Cells should
        be `number` gas smoothing lengths wide. `h_mean()` computes the geometric mean of the smoothing lengths;
        `h_least` is the smallest smoothing length.
    few : tuple of float
        Smallest adequate numbers of gas and dust particles in a cell in two dimensions, for dust-to-gas ratios near 1
        and evenly placed dust; scenes with fewer get a warning.
    few_random : tuple of float
        The same numbers for scenes with dust placed at random.
    share : float
        Smallest side of a cell, as a fraction of its target side.
    least : callable, optional
        `least(scene)` returns the numbers of gas and dust particles below which a cell grows. Without it, only empty
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
        `kick(gas, dust, law, frame, dt, cells, work)` applies accelerations and drag over dt together, and returns
        `Kicked`. It changes the velocities of gas and dust in place; with one-way drag the caller discards the gas
        velocities. frame: `kernels.drag.frame.Frame` about the star; its sense of rotation is set only for schemes with
        cells. cells: result of `build`, or None.
    layout : callable, optional
        `layout(gas, dust, rule, frame, ranks)` returns the `Layout` (`drag/cells.py`) of the drag cells, from
        positions, velocities and masses. ranks: `OneRank` of `drag/cells.py`, or its counterpart on several ranks.
        A scheme without `layout` has no cells, and each rank computes the whole kick.
    build : callable, optional
        `build(gas, dust, rule, layout)` returns the argument `cells` of a kick. With several threads, it runs at the
        same time as the computation of accelerations.
    advance : callable, optional
        `advance(law, tube, cells, dt, heating)` returns the fluids in the grid cells of a `ppm.Tube` after dt; `cells`
        (5, n) has the fluids before. Fluxes take the place of accelerations.
    limit : callable, optional
        `limit(gas, dust, law, frame, work)` returns the longest stable step of an explicit scheme, in code units.
    rings : int
        With `layout`: number of rings of nodes around the nine nodes of a cell that affect the particles of this cell;
        negative for a scheme without nodes.
    reads : tuple of str
        With `layout`: names of the ghost particles' arrays that affect the kick of local particles. With heating, the
        kick reads `acc` of ghosts too.
    conserves : bool
        Whether momentum is conserved to rounding.
    sizes : bool
        Whether the grains of a population may have different sizes.
    damps : bool
        Whether the scheme damps waves too much where h > c_s t_stop.
    unused : dict of str to tuple of str
        Keys of [drag] that have no meaning for the scheme, by the reason.
    cells : Cells, optional
        Sizes of drag cells, for schemes with `layout`.
    nanoseconds : float
        CPU time in a step, per particle of gas or dust. The default is for schemes that couple pairs of particles.
    rules : tuple of callable
        Generators that yield the problems of a scene with this scheme.
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
        """True for an explicit scheme, in which stopping times limit the time step."""
        return self.limit is not None

    @property
    def on_grid(self) -> bool:
        """True if gas and dust are fluids on a fixed grid. Each entry of a particle array is then a grid cell."""
        return self.advance is not None
