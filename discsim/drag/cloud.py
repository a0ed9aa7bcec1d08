"""SPH smoothing length and density of one dust population, by sums over its own particles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from discsim.formulas.laws import CONSTANT
from discsim.numerics import world
from discsim.numerics.sph import Sph
from discsim.numerics.totals import mean

if TYPE_CHECKING:
    from discsim.effects.drag import Effect as Drag
    from discsim.numerics.state import State

Array = np.ndarray
NONE = np.empty(0)
SMALLEST = 0.01  # least h over that of evenly mixed dust: particles at one place have no h of their own
SPARSE = 0.5  # dust over gas particles below which counts in a drag cell are a poor estimate of the dust's density


@dataclass
class Cloud:
    """One dust population with its SPH sums; `members` are its indices in the state's arrays."""

    members: Array
    pos: Array
    mass: Array
    own: Array  # accelerations that gas does not share (n, d), or empty
    h: Array
    density: Array
    gradh: Array
    sph: Sph
    place: Array | None = None  # as in `Particles`

    @property
    def count(self) -> int:
        return len(self.mass)


def cloud_of(state: State, members: Array, sph: Sph) -> Cloud:
    """Return the dust with the indices `members` as a cloud whose h and density are uninitialised."""
    dust, own = state.dust, state.own_acc["dust"]
    empty = np.empty(len(members))
    return Cloud(
        members, dust.pos[members], dust.mass[members], own[members] if len(own) > 0 else own,
        empty, empty.copy(), empty.copy(), sph, None if dust.place is None else dust.place[members],
    )  # fmt: skip


def guess_h(cloud: Cloud, density: Array | float) -> Array:
    """Return smoothing lengths (n,) at a given or estimated density."""
    with np.errstate(divide="ignore", over="ignore"):  # a density of 0 gives the longest h
        h = cloud.sph.eta * (cloud.mass / density) ** (1.0 / cloud.sph.dim)
    return np.minimum(h, cloud.sph.h_most)


def settle_density(cloud: Cloud) -> None:
    """Solve for h and density, from the guess in `cloud.h`."""
    sph, guess = cloud.sph, cloud.h.copy()
    sph.density(cloud, np.empty((0, sph.dim)))
    if not sph.fixed and world.together.most(bool((cloud.h < SMALLEST * guess).any())):
        cloud.h = np.maximum(cloud.h, SMALLEST * guess)
        sph.fixed = True
        sph.density(cloud, np.empty((0, sph.dim)))
        sph.fixed = False


def densities_of_sparse_dust(drag: Drag, state: State) -> Array:
    """Return the density (n,) of dust that is too sparse to be counted in cells; 0 of other dust.

    The array is empty if the law needs no density or no dust is sparse. With few particles in cells t_stop = rho_d /
    K would be that of a single particle in its own cell.
    """
    gas, dust = state.gas, state.dust
    if drag.law.code != CONSTANT:
        return NONE
    sparse = [n for n, p in enumerate(state.scene.dust) if p.particles < SPARSE * state.scene.gas.particles]
    out = np.zeros(dust.count if sparse else 0)
    for number in sparse:
        members = np.flatnonzero(dust.species == number)
        if world.together.sum(len(members)) > 0:
            sph = world.together.sph(Sph, state.scene)
            sph.ignore_velocities()
            sph.fixed = False  # the spacing of dust may be far above the gas's h
            cloud = cloud_of(state, members, sph)
            cloud.h[:] = guess_h(cloud, state.scene.dust[number].ratio * mean(gas.density))
            settle_density(cloud)
            out[members] = cloud.density
    return out
