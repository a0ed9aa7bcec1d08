"""SPH smoothing length and density of one dust population, from sums over its own particles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from discsim.drag.base import EMPTY, Dust, Gas, Law, Work
from discsim.formulas.laws import CONSTANT
from discsim.numerics import world
from discsim.numerics.sph import Sph
from discsim.numerics.totals import mean

if TYPE_CHECKING:
    from discsim.scene import Scene

Array = np.ndarray
SMALLEST = 0.01  # lower bound of h over its first guess: for particles at the same position the h equation has no root
SPARSE = 0.5  # ratio of dust to gas particles below which counts in drag cells estimate the dust density poorly


@dataclass
class Cloud:
    """One dust population and the object for its SPH sums; `members` are its indices in the arrays of the dust."""

    members: Array
    pos: Array
    mass: Array
    acc_unshared: Array
    h: Array
    density: Array
    gradh: Array
    sph: Sph
    global_index: Array | None = None  # as in `Particles`

    @property
    def count(self) -> int:
        return len(self.mass)


def cloud_of(dust: Dust, members: Array, sph: Sph) -> Cloud:
    """Return the dust particles with the indices `members` as a cloud; its h and density are uninitialised."""
    acc, empty = dust.acc_unshared, np.empty(len(members))
    return Cloud(
        members, dust.pos[members], dust.mass[members], acc[members] if len(acc) > 0 else acc, empty, empty.copy(),
        empty.copy(), sph, None if dust.global_index is None else dust.global_index[members],
    )  # fmt: skip


def guess_h(cloud: Cloud, density: Array | float) -> Array:
    """Return the smoothing lengths (n,) that particles have at a given or estimated density."""
    with np.errstate(divide="ignore", over="ignore"):  # a density of 0 gives the longest h
        h = cloud.sph.eta * (cloud.mass / density) ** (1.0 / cloud.sph.dim)
    return np.minimum(h, cloud.sph.h_most)


def solve_density(cloud: Cloud) -> None:
    """Solve for `h` and `density` of a cloud; `cloud.h` has the first guess."""
    sph, guess = cloud.sph, cloud.h.copy()
    sph.density(cloud, np.empty((0, sph.dim)))
    if not sph.fixed and world.processes.most(bool((cloud.h < SMALLEST * guess).any())):
        cloud.h = np.maximum(cloud.h, SMALLEST * guess)
        sph.fixed = True
        sph.density(cloud, np.empty((0, sph.dim)))
        sph.fixed = False


def densities_of_sparse_dust(gas: Gas, dust: Dust, law: Law, work: Work, scene: Scene) -> Array:
    """Return the density (n,) of dust that is too sparse for density estimates by counts in cells; 0 for other dust.

    The array is empty if the law needs no dust density or no dust is sparse. Counts would give a sparse grain the
    t_stop = rho_d / K of a single particle in its cell, whatever the density of the dust.
    """
    if law.code != CONSTANT:
        return EMPTY
    sparse = [n for n, p in enumerate(scene.dust) if p.particles < SPARSE * scene.gas.particles]
    out = np.zeros(len(dust.mass) if sparse else 0)
    for number in sparse:
        members = np.flatnonzero(dust.class_of == number)
        if world.processes.sum(len(members)) > 0:
            sph = work.new_sph()
            sph.fixed = False  # the spacing of dust may be far above the gas's h
            cloud = cloud_of(dust, members, sph)
            cloud.h[:] = guess_h(cloud, work.ratios[number] * mean(gas.density))
            solve_density(cloud)
            out[members] = cloud.density
    return out
