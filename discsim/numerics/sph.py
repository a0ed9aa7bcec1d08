"""Smoothed particle hydrodynamics: neighbours, density and forces of the gas (equations in `kernels/sph.py`)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from discsim.kernels.neighbours import Cells, widen
from discsim.kernels.smoothing import KERNELS, SQUEEZED, SUPPORT
from discsim.kernels.sph import ALL_PAIRS, APPROACHING, NO_VISCOSITY, force_columns, force_driver
from discsim.kernels.sph_density import Found, Given, Wanted, Work, density_driver
from discsim.kernels.sph_packs import ENERGY, FLUIDITY, ROWS, STRIDE, Scale
from discsim.numerics import world
from discsim.numerics.neighbours import LEAST, Grids, box_about, candidates, cells_in, grids_of
from discsim.numerics.threads import share
from discsim.numerics.totals import mean

if TYPE_CHECKING:
    from discsim.numerics.state import Gas
    from discsim.scene import Scene

NONE = np.empty(0)
# Over the density of an even gas of the mean h, where h stops. Of particles at one place, or as near as nothing, m W(0)
# h^d is more than m eta^d at any h: without a limit h and the step would fall to nothing. Codes with gravity have it at
# a share of the softening, which not every scene has. One limit for all leaves forces conservative with Omega = 1.
DENSEST = 4096.0
PASSES = 4  # a first guess of h may be too large by DENSEST^((PASSES - 1) / d)
ROOM = 1.03  # how far h may grow in a step without looking for candidates again


class Points(Protocol):
    """Particles that have a density: gas, or dust where drag asks for it."""

    pos: np.ndarray
    mass: np.ndarray
    h: np.ndarray
    density: np.ndarray
    gradh: np.ndarray

    @property
    def count(self) -> int: ...


def binade(values: np.ndarray) -> float:
    """The power of two next to the largest of some values."""
    return 2.0 ** math.frexp(float(values.max(initial=0.0)))[1]


class Sph:
    """The gas's discretisation: what a scene chose, and the neighbour cells of the last density pass."""

    def __init__(self, scene: Scene):
        self.kernel = KERNELS[scene.gas.kernel]
        self.single = scene.gas.precision == "single"
        self.support = SUPPORT[self.kernel]
        self.squeezed = SQUEEZED[self.kernel]
        self.eta = scene.gas.eta
        self.fixed = scene.gas.smoothing_length is not None
        self.dim = scene.space.dimensions
        self.periodic = scene.space.boundary == "periodic"
        self.size = np.zeros(2)
        self.size[: self.dim] = scene.space.size
        # Lone particles have no h that solves eq. (1); none may reach over the whole disc.
        self.h_most = self.size.max() / (1.0 if self.periodic else 8.0)
        self.viscosity = scene.gas.viscosity
        self.conductivity = scene.gas.conductivity
        self.pairs = NO_VISCOSITY
        if self.viscosity is not None:
            self.pairs = ALL_PAIRS if self.viscosity.pairs == "all" else APPROACHING
        self.columns = np.empty((0, ENERGY))
        self.balsara = self.viscosity is not None and self.viscosity.switch == "balsara"

    def box_of(self, points: Points) -> tuple[np.ndarray, np.ndarray]:
        if self.periodic:
            return np.zeros(2), self.size
        return box_about(points.pos, world.together)

    def grids_of(self, points: Points) -> tuple[Grids, np.ndarray]:
        """Grids of the points of all processes, with some room for h to grow, and the size class (n,) of each."""
        extent = (1.0 if self.fixed else ROOM) * self.support
        return grids_of(points.pos, points.h, extent, *self.box_of(points), self.periodic, world.together)

    def cells_of(self, points: Points) -> Cells:
        """Cells of all points, which one process has."""
        return cells_in(*self.grids_of(points), points.pos, points.h)

    def keys(self, gas: Gas) -> tuple[np.ndarray, int]:
        """The neighbour cell of each particle (n,), to sort by for memory locality, and how many cells there are."""
        cells = self.cells_of(gas)
        return cells.key, len(cells.bounds)

    def density(self, gas: Points, vel: np.ndarray) -> None:
        """Density, Omega and, unless fixed, smoothing length of all particles; what a switch needs of `vel`.

        Raises FloatingPointError where a smoothing length is no number: the cells of neighbours would have no size.
        """
        for _ in range(PASSES):
            h_least = self.least(gas)
            if not h_least < np.inf:
                raise FloatingPointError("a smoothing length of the gas is not finite")
            self.settle(gas, vel, h_least)
            # Where h is at its limit, that has to be one of the h found, not of the first guess.
            smallest = world.together.least(float(gas.h.min(initial=np.inf)))
            if self.fixed or smallest > h_least or self.least(gas) > 0.9 * h_least:
                return

    def least(self, gas: Points) -> float:
        return mean(gas.h) * DENSEST ** (-1.0 / self.dim)

    def settle(self, gas: Points, vel: np.ndarray, h_least: float) -> None:
        """`density` with h of no less than h_least."""
        driver = density_driver(self.kernel, self.dim, self.balsara, self.single)
        cells = self.cells = self.cells_of(gas)
        lists = self.lists = self.parts(candidates(cells, cells, mutual=True))
        self.met = np.zeros(len(cells.bounds), np.bool_)  # cells within reach of a particle that outgrew its own
        self.shear = [np.empty(gas.count if self.balsara else 0) for _ in range(2)]
        given, found = Given(gas.pos, vel, gas.mass), Found(gas.h, gas.density, gas.gradh, *self.shear)
        mass = binade(gas.mass)
        wanted = Wanted(self.eta, h_least, self.h_most, self.fixed)
        left = cells.filled
        while len(left) > 0:
            outgrown = np.zeros(len(left), np.bool_)
            share(driver, len(left), left, given, found, wanted, mass, cells, outgrown, least=LEAST, each=lists)
            left = left[outgrown]
            widen(left, 1.2 * self.support, gas.h, cells)
            lists = self.parts(candidates(cells._replace(filled=left), cells, mutual=True))
            for part, _ in lists:
                self.met[cells.key[cells.order[part.slots[: part.begin[-1]]]]] = True

    def driver(self, u: np.ndarray | None, nu: np.ndarray, uneven: bool) -> Any:
        """The sums of forces for what a scene has; only some terms ask whether masses are `uneven`."""
        conductive, shearing = self.conductivity is not None, len(nu) > 0
        bounded = self.pairs != NO_VISCOSITY or conductive or shearing
        return force_driver(
            self.kernel, self.dim, self.pairs, u is not None, conductive, shearing, bounded and uneven, self.single
        )

    def parts(self, lists: list[Any]) -> list[Any]:
        """Lists with what the sums of each work in: kernels that make arrays would count references in their loops."""
        most = int(np.diff(self.cells.start).max())
        return [
            (
                part,
                Work(
                    np.zeros(ROWS * STRIDE, np.float32 if self.single else np.float64),
                    np.empty((3, most)),
                    np.empty((most, 7)),
                ),
            )
            for part in lists
        ]

    def forces(self, gas: Gas, vel: np.ndarray, u: np.ndarray | None, pressure: np.ndarray) -> tuple[np.ndarray, float]:
        """Add to `acc` (and `heating_rate`); return what limits the step: the velocity divergence (n,) and the largest
        rate of conduction.
        """
        terms = self.pairs, u is not None, self.conductivity is not None
        nu = NONE if gas.nu is None else gas.nu
        given, found = Given(gas.pos, vel, gas.mass), Found(gas.h, gas.density, gas.gradh, *self.shear)
        scale = Scale(binade(gas.mass), binade(gas.h), binade(gas.sound_speed))
        driver = self.driver(u, nu, float(gas.mass.max()) > float(gas.mass.min()))
        # Halves of the means over a pair are taken out of its sums.
        alpha, beta = (self.viscosity.alpha / 16.0, self.viscosity.beta / 8.0) if self.viscosity else (0.0, 0.0)
        if len(self.columns) != gas.count:  # kept: new memory costs as much as what is written to it
            more = self.conductivity is not None or len(nu) > 0
            self.columns = np.empty((gas.count, FLUIDITY + 1 if more else ENERGY))
        share(
            force_columns, gas.count, given, found, pressure, gas.sound_speed, NONE if u is None else u, nu, *terms,
            alpha, scale, self.cells.order, self.columns,
        )  # fmt: skip
        divergence, conduction = np.zeros(gas.count), np.zeros(gas.count if self.conductivity else 0)
        met = self.cells._replace(filled=np.flatnonzero(self.met))
        strengths = beta, self.conductivity.alpha if self.conductivity else 0.0
        for cells, again in ((self.cells, False), (met, True)):
            lists = self.parts(candidates(cells, cells, mutual=True)) if again else self.lists
            share(
                driver, len(cells.filled),
                self.columns, gas.acc, NONE if u is None else gas.heating_rate, divergence, conduction, strengths,
                scale, cells, self.met, again, least=LEAST, each=lists,
            )  # fmt: skip
        return divergence, float(conduction.max(initial=0.0))
