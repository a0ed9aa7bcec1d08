"""Smoothed particle hydrodynamics: neighbours, density and forces of the gas (equations in `kernels/sph/forces.py`)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from discsim.kernels.common.candidates import list_candidates
from discsim.kernels.common.neighbours import Cells, update_radii
from discsim.kernels.sph.density import (
    DIV_CURL,
    NO_DERIVATIVES,
    SLOPES,
    TILE,
    DensityInput,
    DensityOutput,
    Scratch,
    SmoothingRule,
    density_driver,
)
from discsim.kernels.sph.density import ROWS as MEMBER_ROWS
from discsim.kernels.sph.forces import (
    ALL_PAIRS,
    APPROACHING,
    NO_VISCOSITY,
    RECONSTRUCTED,
    Strengths,
    force_driver,
    write_force_columns,
)
from discsim.kernels.sph.packs import FLUIDITY, ROWS, STRIDE, SWITCH, SYY, Scale
from discsim.kernels.sph.smoothing import KERNELS, MEAN_Q2, NORM, SQUEEZED, SUPPORT
from discsim.numerics import alloc, world
from discsim.numerics.neighbours import LEAST, Grids, box_about, candidates, cells_in, grids_of, keys_in
from discsim.numerics.threads import parallel_for
from discsim.numerics.totals import mean

if TYPE_CHECKING:
    from discsim.numerics.state import Gas
    from discsim.scene import Scene

EMPTY, NONE_IMMOBILE = np.empty(0), np.empty(0, np.bool_)
PAIRS = {"approaching": APPROACHING, "all": ALL_PAIRS, "reconstructed": RECONSTRUCTED}
# The lower bound of h is the h at this multiple of the density at which even gas has the mean h. For particles at
# nearly one position m W(0) h^d exceeds m eta^d at any h, and without a bound h and the step would go to 0. Codes with
# gravity use a fraction of the softening, which not every scene has. With one bound for all particles, forces are
# conservative with Omega = 1.
MAX_COMPRESSION = 4096.0
MAX_PASSES = 4  # the first guess of h may be too large by a factor of MAX_COMPRESSION^((MAX_PASSES - 1) / d)
# Factor by which cells are longer along x. Longer cells have more candidates, but a particle's `window` fewer of them.
STRETCH = 2.0
LIST_MARGIN = 1.03  # factor by which h may grow in a step before candidate lists have to be made again


class Points(Protocol):
    """Protocol of particles with an SPH density: gas, or dust in some drag schemes."""

    pos: np.ndarray
    mass: np.ndarray
    h: np.ndarray
    density: np.ndarray
    gradh: np.ndarray
    global_index: np.ndarray | None

    @property
    def count(self) -> int: ...


def power_of_two_above(values: np.ndarray) -> float:
    """Return the smallest power of two above the largest of `values`."""
    return 2.0 ** math.frexp(float(values.max(initial=0.0)))[1]


class PointsWithGhosts(NamedTuple):
    """Local particles combined with the ghosts that may be their neighbours.

    both: `world.ParticlesWithGhosts`. h, mass: combined arrays. cells: cells of all particles,
    ghosts included; `cells.filled` lists only the cells with local particles.
    """

    both: Any
    h: np.ndarray
    mass: np.ndarray
    cells: Cells


class Sph:
    """SPH sums with the options of [gas], and the cells and candidate lists of the last `density`, for `forces`."""

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
        # For isolated particles no h solves eq. (1); the bound keeps their support smaller than the disc.
        self.h_most = self.size.max() / (1.0 if self.periodic else 8.0)
        self.viscosity = scene.gas.viscosity
        self.conductivity = scene.gas.conductivity
        self.pairs, self.derived = NO_VISCOSITY, NO_DERIVATIVES
        if self.viscosity is not None:
            self.pairs = PAIRS[self.viscosity.pairs]
            switched = self.viscosity.switch == "balsara"
            self.derived = SLOPES if self.pairs == RECONSTRUCTED else DIV_CURL if switched else NO_DERIVATIVES
        self.columns = np.empty((0, 0))

    def ignore_velocities(self) -> None:
        """Omit the derivatives of the velocity in all later calls of `density`."""
        self.derived = NO_DERIVATIVES

    @contextmanager
    def in_double(self) -> Iterator[None]:
        """Use double precision in sums within the context."""
        kept, self.single = self.single, False
        try:
            yield
        finally:
            self.single = kept

    def box_of(self, points: Points) -> tuple[np.ndarray, np.ndarray]:
        """Return the lower corner and the widths (2,) of the periodic box, or of the box around the points."""
        if self.periodic:
            return np.zeros(2), self.size
        return box_about(points.pos, world.processes)

    def grids_of(self, points: Points) -> tuple[Grids, np.ndarray]:
        """Return grids for the points of all processes, with a margin for growth of h, and size classes (n,)."""
        extent = (1.0 if self.fixed else LIST_MARGIN) * self.support
        stretch = 1.0 if self.single else STRETCH
        return grids_of(points.pos, points.h, extent, *self.box_of(points), self.periodic, world.processes, stretch)

    def cells_of(self, points: Points) -> Cells:
        """Return the cells of the points of a single process."""
        return cells_in(*self.grids_of(points), points.pos, points.h)

    def keys(self, gas: Gas) -> tuple[np.ndarray, int]:
        """Return the neighbour cell (n,) of each gas particle, for sorting in memory, and the number of cells."""
        grids, classes = self.grids_of(gas)
        return keys_in(grids, classes, gas.pos), grids.cells

    def with_ghosts(self, points: Points) -> PointsWithGhosts:
        """Return the points combined with the ghosts that may be their neighbours."""
        return PointsWithGhosts(world.ParticlesWithGhosts(), points.h, points.mass, self.cells_of(points))

    def candidate_lists(self, cells: Cells) -> list[Any]:
        """Return the candidates of all cells with local particles: lists for each chunk of `parallel_for`.

        In single precision the lists are not sorted into slabs, as sorting takes more time than it saves in sums.
        """
        return candidates(cells, cells, mutual=True, in_slabs=not self.single)

    def candidates_of(self, cells: Cells, some: np.ndarray, first: int, last: int) -> Any:
        """Return the candidates of the cells some[first:last], as an entry of `candidate_lists`."""
        return list_candidates(first, last, some, cells.bounds, 1.0, True, not self.single, cells)

    def mark_cells(self, lists: Any) -> None:
        """Set `marked` for the cells of all particles in the candidate lists `lists`."""
        cells = self.cells
        self.marked[cells.key[cells.order[lists.indices[: lists.begin[-1]]]]] = True

    def outgrown_cells(self, own: np.ndarray) -> np.ndarray:
        """Return all cells with a particle whose support exceeds the reach of the cell's candidate list.

        own: such cells with local particles.
        """
        return own

    def halo_suffices(self, outgrown: np.ndarray) -> bool:
        """Return whether the ghosts include all particles within the present reach of the cells `outgrown`."""
        return True

    def density(self, gas: Points, vel: np.ndarray) -> None:
        """Set density, Omega and, unless it is fixed, smoothing length of `gas`.

        Also store the derivatives of `vel` (n, d) that the viscosity needs. Raises FloatingPointError if a smoothing
        length is not finite, as neighbour cells then have no size.
        """
        for _ in range(MAX_PASSES):
            h_least = self.lower_bound_of_h(gas)
            if not h_least < np.inf:
                raise FloatingPointError("a smoothing length of the gas is not finite")
            self.find_h_and_density(gas, vel, h_least)
            # If h is at its lower bound, this bound has to follow from the resulting h, not from the first guess.
            smallest = world.processes.min(float(gas.h.min(initial=np.inf)))
            if self.fixed or smallest > h_least or self.lower_bound_of_h(gas) > 0.9 * h_least:
                return

    def lower_bound_of_h(self, gas: Points) -> float:
        """Return the lower bound of h, which follows from the mean h of all gas."""
        return mean(gas.h) * MAX_COMPRESSION ** (-1.0 / self.dim)

    def find_h_and_density(self, gas: Points, vel: np.ndarray, h_least: float) -> bool:
        """Compute `density` with h of at least h_least; return False if it has to be repeated with more ghosts."""
        driver = density_driver(self.kernel, self.dim, self.derived, self.single)
        both, h, mass, cells = self.with_ghosts(gas)
        self.both, self.cells, self.fullest = both, cells, int(np.diff(cells.start).max())
        lists = self.lists = self.with_scratch(self.candidate_lists(cells))
        # Cells within reach of a particle whose h exceeds the reach of its cell's list.
        self.marked = np.zeros(len(cells.bounds), np.bool_)
        div, curl = (np.empty(len(h) if self.derived == DIV_CURL else 0) for _ in range(2))
        slopes = np.empty((len(h) if self.derived == SLOPES else 0, 3))
        found = self.found = DensityOutput(
            h, both.with_empty_ghosts(gas.density), both.with_empty_ghosts(gas.gradh), div, curl, slopes
        )
        given = DensityInput(vel if self.derived == NO_DERIVATIVES else both.with_ghosts(vel), mass)
        norm = NORM[self.dim - 1][self.kernel]
        wanted, unit = (
            SmoothingRule(self.eta, h_least, self.h_most, self.fixed, norm, self.support),
            power_of_two_above(mass),
        )

        def repeat(first: int, last: int) -> None:
            (part,) = self.with_scratch([self.candidates_of(cells, left, first, last)])
            self.mark_cells(part[0])
            driver(first, last, part, left, given, found, wanted, unit, cells, True, outgrown)

        left, outgrown = cells.filled, np.zeros(len(cells.filled), np.bool_)
        parallel_for(
            driver, len(left), left, given, found, wanted, unit, cells, False, outgrown, least=LEAST, each=lists
        )
        while True:
            both.update_ghosts(h)
            left = left[outgrown]
            some = self.outgrown_cells(left)
            if not world.processes.max(len(some)):
                break
            update_radii(some, 1.2 * self.support, h, cells)
            if not self.halo_suffices(some):
                return False
            outgrown = np.zeros(len(left), np.bool_)
            parallel_for(repeat, len(left), least=LEAST)
            if len(left) < len(some):
                others = np.setdiff1d(some, left, assume_unique=True)
                self.mark_cells(self.candidates_of(cells, others, 0, len(others)))
        for own, found_ones in ((gas.h, h), (gas.density, found.rho), (gas.gradh, found.gradh)):
            both.set_local(own, found_ones)
        return True

    @property
    def slopes(self) -> np.ndarray:
        """Slopes (n, 3) of the velocity of local particles, eq. (7), if velocities are reconstructed."""
        return self.found.slopes[self.both.local_rows]

    def _compiled_forces(self, gas: Gas, u: np.ndarray | None, nu: np.ndarray) -> Any:
        """Return the compiled force sums for the terms of this scene. Collective.

        u (n,): specific energies; None without them. nu: kinematic viscosities, no entries without a shear viscosity.
        """
        largest, smallest = float(gas.mass.max(initial=0.0)), float(gas.mass.min(initial=np.inf))
        uneven = bool(world.processes.max(largest) > world.processes.min(smallest))
        conductive, shearing = self.conductivity is not None, len(nu) > 0
        bounded = self.pairs != NO_VISCOSITY or conductive or shearing
        kinds = self.pairs, u is not None, conductive, shearing, bounded and uneven
        return force_driver(self.kernel, self.dim, *kinds, self.single)

    def with_scratch(self, lists: list[Any]) -> list[Any]:
        """Return (candidates, scratch arrays) for each entry of `lists`.

        The scratch arrays are made here, because arrays that kernels allocate are slowed by reference counting.
        """
        most, real = self.fullest, np.float32 if self.single else np.float64
        packs = alloc.aligned((len(lists), ROWS * STRIDE), real)
        packs[:] = 0.0
        members = (most + TILE - 1) // TILE * TILE * MEMBER_ROWS
        return [(part, Scratch(packs[k], np.zeros(members), np.empty((most, 5)))) for k, part in enumerate(lists)]

    def forces(self, gas: Gas, acc: np.ndarray, vel: np.ndarray, u: np.ndarray | None, pressure: np.ndarray) -> float:
        """Add pressure, viscosity and conduction to `acc` (n, d) and, with energies, to `gas.heating_rate`.

        vel (n, d), u (n,) or None, pressure (n,): velocities, energies and pressure at the time of the positions.
        Return the longest time step before the Courant factor.
        """
        terms = self.pairs, u is not None, self.conductivity is not None
        both, found = self.both, self.found
        derivatives = {NO_DERIVATIVES: (), DIV_CURL: (found.div, found.curl), SLOPES: (found.slopes,)}[self.derived]
        for array in (found.rho, found.gradh, *derivatives):
            both.update_ghosts(array)  # a collective call, also for processes without particles
        optional = [array for array in (u, gas.immobile, gas.nu) if array is not None]
        moving, mass, pressure, sound, *rest = both.all_with_ghosts(
            [vel, gas.mass, pressure, gas.sound_speed, *optional]
        )
        energy, nu = EMPTY if u is None else rest[0], EMPTY if gas.nu is None else rest[-1]
        immobile = NONE_IMMOBILE if gas.immobile is None else rest[u is not None]
        viscosity, conductivity = self.viscosity, self.conductivity
        alpha, beta = (viscosity.alpha, viscosity.beta) if viscosity else (0.0, 0.0)
        of_step = (viscosity.signal, viscosity.closing) if viscosity else (1.0, 1.0)
        shear = 2.0 * self.dim / MEAN_Q2[self.kernel]
        strengths = Strengths(beta, conductivity.alpha if conductivity else 0.0, *of_step, shear)
        scale = Scale(*map(power_of_two_above, (mass, found.h, sound)))
        with_fluidity = conductivity is not None or len(nu) > 0
        last = SYY if self.pairs == RECONSTRUCTED else FLUIDITY if with_fluidity else SWITCH
        columns = self._column_buffer(len(mass), last + 1)
        parallel_for(
            write_force_columns, len(mass), DensityInput(moving, mass), found, pressure, sound, energy, nu, *terms,
            alpha, scale, self.cells.order, columns,
        )  # fmt: skip
        sums, rate = both.with_empty_ghosts(acc), EMPTY if u is None else both.with_empty_ghosts(gas.heating_rate)
        driver, filled = self._compiled_forces(gas, u, nu), self.cells.filled
        cells = self.cells._replace(filled=filled[self.marked[filled]])
        given = columns, sound, immobile, sums, rate, strengths, scale

        def in_marked_cells(first: int, last: int) -> Any:
            (part,) = self.with_scratch([self.candidates_of(cells, cells.filled, first, last)])
            return driver(first, last, part, *given, cells, self.marked, True)

        rates = parallel_for(driver, len(filled), *given, self.cells, self.marked, False, least=LEAST, each=self.lists)
        rates += parallel_for(in_marked_cells, len(cells.filled), least=LEAST)
        both.set_local(acc, sums)
        if u is not None:
            both.set_local(gas.heating_rate, rate)
        # The rate of conduction: in a step of 1 / rate a particle reaches the mean energy of its neighbours. In a
        # longer step, next to heavier neighbours, it exchanges more energy than there is.
        fastest = np.max(rates)
        return 1.0 / float(fastest) if fastest != 0.0 else np.inf

    def _column_buffer(self, count: int, width: int) -> np.ndarray:
        """Return an uninitialised array (count, width) for the columns of forces.

        Its memory is reused in each step, as allocating it takes as much time as filling it.
        """
        if len(self.columns) < count:
            spare = min(len(self.columns), count // 16)  # if it had to grow once, it may grow again
            self.columns = alloc.aligned((count + spare, width))
        return self.columns[:count]
