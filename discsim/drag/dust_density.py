"""SPH smoothing length and density of one dust population, from sums over its own particles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from discsim.drag.base import EMPTY, DragLaw, Dust, Gas, KickContext
from discsim.formulas.laws import CONSTANT
from discsim.numerics import world
from discsim.numerics.sph import Sph
from discsim.numerics.totals import mean

if TYPE_CHECKING:
    from discsim.scene import Scene

Array = np.ndarray
SMALLEST = 0.01  # lower bound of h over its first guess: for particles at one position the equation of h has no root
SPARSE = 0.5  # with fewer dust particles per gas particle, numbers in drag cells estimate the dust density poorly


@dataclass
class DustParticles:
    """The particles of one dust population as arrays (n, ...), as `Sph` needs them.

    members (n,): indices of the particles in the arrays of all dust. h, density, gradh (n,): smoothing length, density
    and the SPH factor Omega of a variable h, which `solve_density` computes. sph: computes the SPH sums.
    global_index: sort keys, as in `Particles`.
    """

    members: Array
    pos: Array
    mass: Array
    acc_unshared: Array
    h: Array
    density: Array
    gradh: Array
    sph: Sph
    global_index: Array | None = None

    @property
    def count(self) -> int:
        return len(self.mass)


def particles_of(dust: Dust, members: Array, sph: Sph) -> DustParticles:
    """Return the dust particles with the indices `members` (n,); their h and density are uninitialised."""
    acc, empty = dust.acc_unshared, np.empty(len(members))
    return DustParticles(
        members, dust.pos[members], dust.mass[members], acc[members] if len(acc) > 0 else acc, empty, empty.copy(),
        empty.copy(), sph, None if dust.global_index is None else dust.global_index[members],
    )  # fmt: skip


def h_at_density(particles: DustParticles, density: Array | float) -> Array:
    """Return the smoothing lengths (n,) at which the particles have the given density: one number for all, or (n,).

    Density 0 gives the largest h.
    """
    with np.errstate(divide="ignore", over="ignore"):  # of a density of 0
        h = particles.sph.eta * (particles.mass / density) ** (1.0 / particles.sph.dim)
    return np.minimum(h, particles.sph.h_most)


def solve_density(particles: DustParticles) -> None:
    """Solve for smoothing lengths and densities, in place; `particles.h` has the first guess on input.

    Where h falls below SMALLEST times the guess, h is raised to this bound and the densities are computed again.
    """
    sph, guess = particles.sph, particles.h.copy()
    sph.density(particles, np.empty((0, sph.dim)))
    if not sph.fixed and world.processes.max(bool((particles.h < SMALLEST * guess).any())):
        particles.h = np.maximum(particles.h, SMALLEST * guess)
        sph.fixed = True
        sph.density(particles, np.empty((0, sph.dim)))
        sph.fixed = False


def densities_of_sparse_dust(gas: Gas, dust: Dust, law: DragLaw, context: KickContext, scene: Scene) -> Array:
    """Return the SPH density (n,) of the dust of sparse populations, and 0 for all other dust.

    The array is empty if no population is sparse, or if the law is not t_stop = rho_d / K, the only law that needs a
    density. Most drag cells have no grain of a sparse population. A density computed from the numbers of grains in
    cells would be that of one grain per cell, whatever the true density, and t_stop = rho_d / K would be wrong by
    the same factor.
    """
    if law.code != CONSTANT:
        return EMPTY
    sparse = [n for n, p in enumerate(scene.dust) if p.particles < SPARSE * scene.gas.particles]
    out = np.zeros(len(dust.mass) if sparse else 0)
    for number in sparse:
        members = np.flatnonzero(dust.class_of == number)
        if world.processes.sum(len(members)) > 0:
            sph = context.new_sph()
            sph.fixed = False  # the spacing of dust may be far above the gas's h
            particles = particles_of(dust, members, sph)
            particles.h[:] = h_at_density(particles, context.ratios[number] * mean(gas.density))
            solve_density(particles)
            out[members] = particles.density
    return out
