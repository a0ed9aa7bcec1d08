"""Self-gravity: a = -grad phi, phi(x) = G int Sigma(x') w(|x - x'|) d^2x'.

    kernel = "plummer"     w(d) = -1 / sqrt(d^2 + softening^2)
    kernel = "thin-disc"   w(d) = -exp(x) K_0(x) / (2 sqrt(pi) H), x = d^2 / 8H^2, H = thickness

The kernel "thin-disc" is, without approximation, the mean over height of a disc that is Gaussian in height, of
constant H (Rendon Restrepo et al. 2025, arXiv:2506.10812).

A particle mesh computes the field (`numerics/mesh.py`), with centred differences of fourth order. Particles outside an
open grid attract nothing. The mass on the grid attracts them like one particle at its barycentre.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import chain
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from discsim.effects import base
from discsim.formulas.smoothing import SMOOTHING
from discsim.numerics.state import Particles, State
from discsim.parts import Lazy
from discsim.scene.keys import SelfGravity as Keys
from discsim.scene.rules import Draft, Problem, quoted, starts_where

if TYPE_CHECKING:
    from discsim.numerics.mesh import Mesh
    from discsim.numerics.poisson import Kernel
    from discsim.scene import Scene

meshes = Lazy("discsim.numerics.mesh")
poisson = Lazy("discsim.numerics.poisson")
totals = Lazy("discsim.numerics.totals")

Array = np.ndarray
CELL_COST, PARTICLE_COST = 50.0, 18.0  # CPU nanoseconds in a step: per grid cell, and per particle (deposit and pull)
KERNEL_KEYS = {"plummer": "softening", "thin-disc": "thickness"}  # key of the length of each kernel


def kernel_length(scene: Scene) -> float:
    """Return the length of the scene's kernel, `softening` or `thickness`."""
    return float(getattr(scene.self_gravity, KERNEL_KEYS[scene.self_gravity.kernel]))


def _space_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of an open space in 1D, and of an open grid with too few cells."""
    space = draft.space
    if not space or space.boundary == "periodic":
        return
    if draft.dimensions == 1:
        yield ("space", "boundary"), 'self-gravity in 1D needs periodic boundaries; set space.boundary = "periodic"'
    if space.cells and min(space.size) / max(space.size) * space.cells < 5:
        wrong = "there are too few cells for self-gravity, whose derivative uses five cells"
        yield ("space", "cells"), f"{wrong}; expected at least 5 cells along each side"


def _density_problems(draft: Draft) -> Iterator[Problem]:
    """Yield a problem of 1D self-gravity with a start that has a volume density instead of a surface density.

    Scenes in code units and particles given by the caller may have either density, and yield no problem.
    """
    start = draft.start
    if draft.dimensions != 1 or draft.in_code_units or not start or start.has_surface_density:
        return
    if 1 in start.dimensions and start.boundary == "periodic":  # other rules report the remaining starts
        wrong = f'self-gravity in 1D is for surface densities, but initial.kind "{draft.kind}" has a volume density'
        words = quoted(starts_where(lambda start: start.has_surface_density))
        yield ("self_gravity",), f"{wrong}; set initial.kind = {words}, or space.dimensions = 2"


def _kernel_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of the length of the gravity kernel, `softening` or `thickness`."""
    kernel = draft.self_gravity.kernel
    needed = KERNEL_KEYS[kernel]
    if draft.self_gravity.thickness is not None and not draft.gives("self_gravity", "kernel"):
        yield (
            ("self_gravity", "thickness"),
            'used only with self_gravity.kernel = "thin-disc"; set this kernel, or remove the key',
        )
    elif getattr(draft.self_gravity, needed) is None:
        yield ("self_gravity", needed), f'missing, but required by self_gravity.kernel = "{kernel}"; add a length'


def _source_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of the key `sources`, if the scene gives it."""
    if draft.gives("self_gravity", "sources"):
        yield from base.source_problems(draft, ("self_gravity", "sources"), draft.self_gravity.sources)


STABLE_Q = 3.0  # Toomre's Q above which nothing is amplified (Toomre 1981), with any softening
CLUMP_SIZE = 6  # required particles of a collapsing mass, in neighbour numbers of the kernel (Nelson 2006, abstract)
CELLS = 4  # required width of a collapsing region in grid cells


def _kernel_warnings(scene: Scene, at: base.GasSamples) -> Iterator[str]:
    """Yield warnings of a kernel length that is unused, below a grid cell or above the scale height."""
    kernel = scene.self_gravity.kernel
    name, length = KERNEL_KEYS[kernel], kernel_length(scene)
    shown = scene.units.show(length, "length")
    for other in set(KERNEL_KEYS.values()) - {name}:
        if getattr(scene.self_gravity, other) is not None:
            yield f'self_gravity.{other} is not used with self_gravity.kernel = "{kernel}": remove the key'
    cell = at.cell
    if length < cell:
        needed = math.ceil(max(scene.space.size) / length)
        yield (
            f"self_gravity.{name} = {shown} is {length / cell:.2g} grid cells, below 1: "
            f"raise space.cells to {needed}, or self_gravity.{name} to {scene.units.show(cell, 'length')}"
        )
    if at.scale_height is not None and at.toomre_q is not None:
        # A softening has to be below H wherever self-gravity matters, a thickness only below the largest H.
        matters = at.toomre_q <= max(STABLE_Q, at.toomre_q.min())
        thinnest = np.where(matters, at.scale_height, np.inf).argmin()
        worst = int(thinnest if kernel == "plummer" else at.scale_height.argmax())
        height = at.scale_height[worst]
        if length > height:
            yield (
                f"self_gravity.{name} = {shown} is {length / height:.2g} H {at.where(worst)}, above 1 H: "
                f"lower self_gravity.{name} to {scene.units.show(height, 'length')}"
            )


def _collapse_warnings(scene: Scene, at: base.GasSamples) -> Iterator[str]:
    """Yield warnings of collapsing regions with too few particles or grid cells, where Q < 2.

    A collapsing region is 2 c_s^2 / (G Sigma) wide and has a mass of pi c_s^4 / (G^2 Sigma) (Nelson 2006, sec. 2).
    """
    if not scene.gas or at.sound_speed is None or at.h is None or scene.space.dimensions == 1:
        return
    length = 2 * at.sound_speed**2 / at.density
    mass = math.pi * at.sound_speed**4 / at.density
    collapses = np.ones(len(at.density), bool) if at.toomre_q is None else at.toomre_q < 2
    if not collapses.any():
        return
    worst = int(np.argmin(np.where(collapses, mass, np.inf)))
    where = at.where(worst)
    neighbours = math.pi * (SMOOTHING[scene.gas.kernel].support * scene.gas.eta) ** 2
    size = mass[worst] / (neighbours * at.particle_mass * at.relative_mass[worst])
    if size < CLUMP_SIZE:
        yield (
            f"the smallest collapsing mass {where} has {size:.2g} times as many particles as a kernel, below "
            f"{CLUMP_SIZE}: "
            f"raise gas.particles by a factor of {CLUMP_SIZE / size:.2g}"
        )
    cell, across = at.cell, max(scene.space.size)
    if length[worst] < CELLS * cell:
        yield (
            f"the smallest collapsing region {where} is {length[worst] / cell:.2g} grid cells wide, below {CELLS}: "
            f"raise space.cells from {across / cell:.0f} to {math.ceil(CELLS * across / length[worst])}"
        )


POTENTIAL = "self_gravity.potential"  # name of the operator that computes the potential


class Effect(base.Effect):
    """Gravity of the species in `self_gravity.sources`, which acts on all species.

    outside: number of particles outside the grid at the last computation of forces. The constructor raises ValueError
    for open boundaries in one dimension, or for an open grid with fewer than five cells on a side.
    """

    keys = Keys
    rules = (_space_problems, _density_problems, _kernel_problems, _source_problems)
    role = base.Role(grid=True)

    def __init__(self, scene: Scene, state: State) -> None:
        self.grid = grid = state.grid
        self.sources = [name for name in state.species if name in scene.self_gravity.sources]
        self.remedy = "a longer self_gravity.softening"
        self.kernel: Kernel = poisson.Plummer(scene.self_gravity.softening)
        self.smallest = scene.self_gravity.softening  # length over which the force changes
        if scene.self_gravity.kernel == "thin-disc":
            # In the plane of the disc this kernel is as sharp as the grid.
            self.kernel, self.smallest = poisson.ThinDisc(scene.self_gravity.thickness), grid.cell
            self.remedy = "fewer space.cells"
        self.mesh: Mesh = meshes.Mesh(grid, self.kernel)
        self.outside = 0

    @classmethod
    def report(cls, scene: Scene, at: base.GasSamples) -> base.Report:
        return base.Report(warnings=chain(_kernel_warnings(scene, at), _collapse_warnings(scene, at)))

    @classmethod
    def nanoseconds(cls, scene: Scene, counts: base.Counts) -> float:
        return CELL_COST * counts.cells + PARTICLE_COST * (counts.gas + counts.dust)

    @classmethod
    def grid_bytes(cls, scene: Scene, shape: tuple[int, ...]) -> int:
        """Return the memory in bytes of density, potential, its gradient, and their Fourier transforms."""
        pad = 1 if scene.space.boundary == "periodic" else 2
        columns = pad * shape[-1] // 2 + 1
        return 8 * (4 * math.prod(shape) + 2 * shape[0] * columns + (pad * shape[0] // 2 + 1) * columns)

    def operators(self, state: State) -> list[base.Operator]:
        sources, pos, slots = base.arrays(state.species, "pos mass"), base.arrays(state.species, "pos"), base.Slot
        acc, force = base.arrays(state.species, "acc"), "self_gravity.pull"
        return [
            base.Operator(POTENTIAL, slots.FIELD, self.solve, sources),
            base.Operator(force, slots.FORCE, self.accelerate, pos | {POTENTIAL}, acc),
            base.Operator("self_gravity.limit", slots.LIMIT, self.limit, frozenset({force})),
        ]

    def solve(self, view: base.View) -> None:
        """Compute the potential and its gradient on the mesh."""
        self.mesh.solve(view.species, self.sources)
        self.mesh.differentiate()

    def accelerate(self, view: base.View) -> dict[str, float]:
        """Add the accelerations to `acc`, and return the largest acceleration of each species."""
        monopole: _Monopole | None = None
        largest, self.outside = {}, 0
        found = self.mesh.pull((p.pos, p.acc) for p in view.species.values())
        for (name, particles), (strongest, missing) in zip(view.species.items(), found, strict=True):
            if missing > 0:
                outside = self.grid.outside(particles.pos)
                monopole = monopole or self._monopole()
                acceleration = monopole.acceleration(particles.pos[outside])
                particles.acc[outside] += acceleration
                strongest = max(strongest, float(_vector_lengths(acceleration).max()))
            self.outside += missing
            largest[name] = strongest
        return largest

    @classmethod
    def expected_limit(cls, scene: Scene, outlook: base.ForecastState) -> base.Expected:
        """Estimate the limit with the pull 2 pi G Sigma of a thin sheet, at the largest density."""
        if outlook.at.radius is None:  # a uniform sheet, which has no pull
            return base.Expected()
        keys, densest = scene.self_gravity, int(np.argmax(outlook.at.density))
        length = keys.softening if keys.kernel == "plummer" else outlook.at.cell
        pull = 2.0 * np.pi * float(outlook.at.density[densest])
        return base.Expected(math.sqrt(length / pull), outlook.at.where(densest))

    def limit(self, view: base.View) -> dict[str, base.Limit]:
        """Return the smallest sqrt(l / |a|) of each species; l is the softening, or the grid cell for thin-disc."""
        return {
            name: base.Limit(float(np.sqrt(self.smallest / largest)), remedy=self.remedy)
            for name, largest in view["self_gravity.pull"].items() if largest > 0
        }  # fmt: skip

    def potential_energy(self, state: State) -> float:
        """Return half the sum of m phi over the sources, with the potential of the last computation of forces."""
        if POTENTIAL not in state.results:
            self.mesh.solve(state.species, self.sources)
        return 0.5 * sum(self._energy(state.species[name]) for name in self.sources)

    def _energy(self, particles: Particles) -> float:
        """Return the sum of m phi over particles."""
        potential = self.mesh.potential(particles.pos)
        outside = self.grid.outside(particles.pos)
        if len(outside) > 0:
            potential[outside] = self._monopole().potential(particles.pos[outside])
        return float(totals.total(particles.mass * potential))

    def _monopole(self) -> _Monopole:
        """Return the mass that was on the grid at the last computation of the potential, as one point."""
        # Cloud-in-cell deposition conserves mass and first moments, so the grid has the barycentre of the particles.
        sums = self.mesh.density_sums()
        total = float(sums[0].sum())
        if total == 0.0:
            return _Monopole(0.0, np.zeros(2), self.kernel)
        centre = np.array([(sums[axis] * self.grid.nodes(axis)).sum() / total for axis in (0, 1)])
        return _Monopole(total * self.grid.cell**2, centre, self.kernel)


class _Monopole(NamedTuple):
    """Point mass that represents the mass on the grid, at its barycentre `centre` (2,)."""

    mass: float
    centre: Array
    kernel: Kernel

    def potential(self, pos: Array) -> Array:
        """Return the potential (n,) at the positions `pos` (n, d)."""
        return self.mass * self.kernel.potential(_vector_lengths(self._separation(pos)))

    def acceleration(self, pos: Array) -> Array:
        """Return the acceleration (n, d) at the positions `pos` (n, d)."""
        separation = self._separation(pos)
        return -self.mass * self.kernel.pull(_vector_lengths(separation))[:, None] * separation

    def _separation(self, pos: Array) -> Array:
        return pos - self.centre[: pos.shape[1]]


def _vector_lengths(vectors: Array) -> Array:
    """Return the lengths (n,) of vectors (n, d)."""
    return np.sqrt((vectors**2).sum(axis=1))
