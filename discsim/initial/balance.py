"""Local equilibrium of a disc: velocities of gas and dust that balance the forces on them.

Gas: v_phi^2 / r = g(r) + (1/Sigma) dP/dr, with g(r) the mean inward pull of star, companions and self-gravity at r.
With [alpha_viscosity], v_r is the flow that the viscosity drives.

Dust with drag: the steady drift of Nakagawa, Sekiya & Hayashi (1986) about that circle of the gas (eqs. 9 and 10 of
`exact/nsh.py`), for the local Stokes numbers and dust-to-gas ratios of all populations. With two-way drag the gas
drifts too; one-way dust has the drift for a ratio of zero.
Dust without drag, or with `initial.dust_velocity` "balance": circles, v_phi^2 / r = g(r).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field

from discsim.exact import nsh
from discsim.initial import start_of, support
from discsim.numerics.operators import accelerate
from discsim.parts import Lazy
from discsim.physics import profile, radiation
from discsim.physics.centre import star_pull
from discsim.physics.grains import has_sizes, sizes_of, typical_size
from discsim.scene.fields import Default, Orbits, Table

if TYPE_CHECKING:
    from discsim.numerics.state import State
    from discsim.scene import Scene
    from discsim.scene.rules import Draft, Problem

companions = Lazy("discsim.physics.companions")
growth = Lazy("discsim.physics.growth")
viscosity = Lazy("discsim.physics.viscosity")
MOST_ORBITS = 1000.0  # upper bound of initial.relax
SLOW = 1.0  # upper bound of a viscous flow, in sound speeds
Array = np.ndarray
KINDS = 32  # sizes that represent a continuous distribution: enough for the sums over it
PIECE = 1 << 17  # particles per chunk: velocities need temporary arrays of many times the memory of positions
RING = 32  # least number of particles in a ring that is averaged


class Settled(Table):
    """Keys of a start whose velocities balance the forces."""

    dust_velocity: Annotated[Literal["balance", "drift"] | None, Default('"drift" with drag, else "balance"')] = Field(
        None,
        description="initial velocity of dust: circular orbits, or the steady drift of all populations with the gas",
    )
    relax: Orbits = Field(
        0.0,
        ge=0,
        le=MOST_ORBITS,
        description="orbits at reference_radius of damped relaxation of the gas before t = 0",
    )


def relaxes_gas(draft: Draft) -> Iterator[Problem]:
    """Yield problems of `initial.relax`: it needs [gas] and [star], and no perturbation."""
    if draft.initial.relax == 0.0:
        return
    for table, why in (("gas", "relaxation needs gas"), ("star", "relaxation is measured in orbits about a star")):
        if not draft.has(table):
            yield ("initial", "relax"), f"{why}; expected a table [{table}] too, or no relax"
    if getattr(draft.initial, "perturbation", 0.0) > 0.0:
        wrong = "initial.perturbation is also given, and relaxation would remove it"
        yield ("initial", "relax"), f"{wrong}; expected only one of the two"


class Balance:
    """The equilibrium of the disc in `state` under the forces of `effects`.

    Self-gravity and companions enter by their mean over azimuth at each radius.
    """

    def __init__(self, state: State, effects: dict[str, Any]) -> None:
        self.scene, self.effects = state.scene, effects
        self.gravity = mean_gravity(state, effects)
        self.laden = "growth" in effects and growth.small_dust_in_mass(state.scene)
        self.drifts = "drag" in effects and getattr(self.scene.initial, "dust_velocity", None) != "balance"

    def velocities(
        self, name: str, pos: Array, species: Array | None, size: Array | None = None
    ) -> tuple[Array, Array]:
        """Return radial and azimuthal velocity (n,) of gas, or of dust of populations `species` (n,), at `pos` (n, 2).

        size: radii (n,) of grains with individual sizes; None: the mean size of each population.
        """
        scene = self.scene
        r = np.sqrt((pos**2).sum(axis=1))
        # No rotation balances gravity that points outwards; `settle` refuses discs with much of that.
        keplerian = np.sqrt(np.maximum(self.gravity(r) * r, 1e-300))
        radial, lag = np.zeros(len(r)), np.zeros(len(r))
        if scene.model.given is not None:
            if self.drifts:
                radial, lag = self.effects["drag"].steady_drift(pos, species, size).T
        elif name == "dust" and not self.drifts and scene.radiation_pressure is not None:
            lag = radiation.lag(scene, species, r, keplerian)
        elif scene.gas is not None:
            disc = profile.radial(scene)
            headwind = 0.5 * disc.pressure_acceleration(r) * r / keplerian  # eta v_K
            if self.laden:  # pressure is the gas's alone, but accelerates the small dust with it
                headwind = headwind / (1.0 + growth.small_at(scene, r, disc.dust_share))
            headwind[keplerian <= 1e-100] = 0.0
            if self.drifts and (name == "dust" or scene.drag.direction == "two-way"):
                radial, lag = self._drift(disc, species, r, keplerian / r, headwind, size)
            elif name == "gas":
                # Without drag the balance of gas is known exactly, not only to first order in the headwind.
                lag = np.sqrt(np.maximum(keplerian**2 - 2.0 * headwind * keplerian, 0.0)) - keplerian
            if name == "gas" and scene.table("alpha_viscosity") is not None:
                radial = radial + viscous_flow(scene, disc, r)
        return radial, keplerian + lag

    def without_drag(self, pos: Array) -> tuple[Array, Array]:
        """Return the `velocities` of gas without drag by dust."""
        drifts, self.drifts = self.drifts, False
        try:
            return self.velocities("gas", pos, None)
        finally:
            self.drifts = drifts

    def _drift(
        self, disc: profile.Radial, species: Array | None, r: Array, omega: Array, headwind: Array, size: Array | None
    ) -> tuple[Array, Array]:
        """Return the steady radial and azimuthal velocity (n,) of dust relative to Keplerian; species None: of gas."""
        # A few sizes with mass represent each population in the back-reaction. The grains in question are added as
        # one more kind, without mass.
        scene, drag = self.scene, self.effects["drag"]
        density = disc.surface_density(r)
        sound = profile.thermal_speed(scene, r, density)
        typical, kinds, loads, pushed = np.empty((len(scene.dust), len(r))), [], [], []
        push = radiation.pushes(scene, r, omega * r)
        for k, population in enumerate(scene.dust):
            # Beyond an edge there is no gas and the stopping time is infinite; the bound avoids inf * 0.
            typical[k] = np.minimum(omega * drag.stopping_time(k, density, sound, omega, population.ratio), 1e100)
            ratio = population.ratio if disc.dust_share is None else population.ratio * disc.dust_share(r)
            there = (r >= (population.inner or 0.0)) & (r <= (population.outer or np.inf))
            load = np.where(there & (scene.drag.direction == "two-way"), ratio, 0.0)
            if self.laden:
                small = growth.small_at(scene, r, disc.dust_share)
                load = (load - small) / (1.0 + small)
            for over_typical, share in _kinds(population):
                kinds.append(over_typical * typical[k])
                loads.append(share * load)
                pushed.append(None if push is None else push[k])
        if species is not None:
            at = species, np.arange(len(r))
            factor = 1.0 if size is None else size / np.array([typical_size(p) for p in scene.dust])[species]
            kinds.append(factor * typical[at])
            loads.append(np.zeros(len(r)))
            pushed.append(None if push is None else push[at])
        found = nsh.about_circles(
            np.array(kinds), np.array(loads), headwind, omega * r, None if push is None else np.array(pushed)
        )
        if species is None:
            return found.gas_radial, found.gas_azimuthal
        return found.dust_radial[-1], found.dust_azimuthal[-1]


def _kinds(population: Any) -> Iterator[tuple[float, float]]:
    """Yield, for each representative size of a population, its stopping time over that of the mean size, and its share
    of the mass.
    """
    if not has_sizes(population):
        return iter([(1.0, 1.0)])
    size, weight = sizes_of(population, population.grain_size.bins or KINDS)
    return zip(size / typical_size(population), weight / weight.sum(), strict=True)


def gas_alone(scene: Scene) -> Scene:
    """Return the scene with its gas alone, which star, companions, pressure and viscosity move."""
    gone = dict.fromkeys(("dust", "drag", "cooling", "self_gravity", "damping"))
    if scene.table("growth") is not None:
        gone.pop("drag")  # its direction decides whether small dust is a part of the gas's mass
    return scene.model_copy(update={**gone, "gas": scene.gas.model_copy(update={"conductivity": None})})


def settle(state: State, effects: dict[str, Any]) -> None:
    """Set the velocities of gas and dust to balance the forces of `effects`.

    Raises ValueError if more than `support.MOST` of a species has no rotation in balance.
    """
    found = Balance(state, effects)
    # The mean pull of companions is tabulated over the radii of a call: all particles have to be in one call.
    most = PIECE if state.scene.table("companion") is None else np.iinfo(np.int64).max
    for name, particles in state.species.items():
        own = getattr(particles, "species", None), getattr(particles, "size", None)
        for first in range(0, particles.count, most):
            piece = slice(first, first + most)
            pos = particles.pos[piece]
            radial, azimuthal = found.velocities(name, pos, *(None if array is None else array[piece] for array in own))
            direction = pos / np.sqrt((pos**2).sum(axis=1))[:, None]
            across = np.stack([-direction[:, 1], direction[:, 0]], axis=1)
            particles.vel[piece] = radial[:, None] * direction + azimuthal[:, None] * across
        if state.scene.model.given is None:
            _refuse_falling(found, name, particles)


def faults(scene: Scene) -> Iterator[Problem]:
    """Yield problems that keep the disc of a scene from rotating in balance."""
    yield from support.faults(scene)


def _refuse_falling(found: Balance, name: str, particles: Any) -> None:
    """Raise ValueError if more than `support.MOST` of a species' mass has no rotation in balance with all forces."""
    r = np.sqrt((particles.pos**2).sum(axis=1))
    pull = found.gravity(r)
    turning = (particles.pos[:, 0] * particles.vel[:, 1] - particles.pos[:, 1] * particles.vel[:, 0]) / r
    falling = turning <= 2.0 * nsh.SLOWEST * np.sqrt(np.abs(pull) * r)
    share = float(particles.mass[falling].sum() / particles.mass.sum())
    if share > support.MOST:
        where = found.scene.units.show(float(np.median(r[falling])), "length")
        what = (
            "self-gravity acts outwards"
            if np.median(pull[falling]) <= 0.0
            else "pressure or radiation pressure exceeds gravity"
        )
        raise ValueError(
            f"a fraction of {share:.2g} of the {name} has no circular orbit, near r = {where}, where {what}; "
            "expected lower "
            "H/r or beta, or a wider taper there"
        )


def viscous_flow(scene: Scene, disc: profile.Radial, r: Array) -> Array:
    """Return the radial velocity (n,) of gas that its viscosity drives, clipped to SLOW c_s as it diverges at edges."""
    if disc.inflow is not None:
        return disc.inflow(r)
    with np.errstate(divide="ignore", invalid="ignore"):
        flow = viscosity.radial_flow(scene, r, disc.surface_density)
    most = SLOW * profile.sound_speed(scene, r, disc.surface_density(r))
    return np.clip(np.where(np.isfinite(flow), flow, 0.0), -most, most)


def tabulated(state: State, effects: dict[str, Any], radius: Array) -> Array:
    """Return radial and azimuthal velocities (kinds, n, 2) at `radius` (n,) of gas, if any, and each dust population.

    They are those of equilibrium for a given disc or a start with a radial profile, else the mean over azimuth of the
    particles' velocities.
    """
    scene: Any = state.scene
    kinds = [("gas", 0)] if state.gas is not None else []
    kinds += [("dust", k) for k in range(len(scene.dust or ()))]
    known = scene.model.given is not None or (scene.initial is not None and start_of(scene).radial is not None)
    found = Balance(state, effects) if known else None
    out = np.empty((len(kinds), len(radius), 2))
    for row, (name, k) in enumerate(kinds):
        if found is not None:
            pos = np.stack([radius, np.zeros_like(radius)], axis=1)
            species = np.full(len(radius), k) if name == "dust" else None
            out[row] = np.stack(found.velocities(name, pos, species), axis=1)
        else:
            out[row] = _mean_velocities(state.species[name], k, radius)
    return out


def _mean_velocities(particles: Any, population: int, radius: Array) -> Array:
    """Return mean radial and azimuthal velocities (n, 2) at `radius` (n,), from rings of equal particle number."""
    chosen = np.flatnonzero(getattr(particles, "species", np.zeros(particles.count, int)) == population)
    pos, vel = particles.pos[chosen], particles.vel[chosen]
    r = np.sqrt((pos**2).sum(axis=1))
    order = np.argsort(r, kind="stable")
    turning = pos[:, 0] * vel[:, 1] - pos[:, 1] * vel[:, 0]
    rings = np.array_split(order, max(1, len(order) // max(RING, math.isqrt(len(order)))))
    middle = [r[ring].mean() for ring in rings]
    means = [[(values[ring] / r[ring]).mean() for ring in rings] for values in ((pos * vel).sum(axis=1), turning)]
    return np.stack([np.interp(radius, middle, mean) for mean in means], axis=1)


def mean_gravity(state: State, effects: dict[str, Any]) -> Callable[[Array], Array]:
    """Return a function of radius (n,): inward acceleration by star, companions and self-gravity, averaged in azimuth.

    Self-gravity is sampled at the particles of `state.limiting`, as one-way dust must not change the gas.
    """

    def pull(radius: Array) -> Array:
        if state.scene.star is None:
            return np.zeros(len(radius))
        own = star_pull(state.scene, radius)
        return own if state.scene.table("companion") is None else own + companions.mean_pull(state.scene, radius)

    if "self_gravity" not in effects:
        return pull
    r = np.concatenate([np.sqrt((p.pos**2).sum(axis=1)) for p in state.limiting])
    for p in state.species.values():
        p.acc[:] = 0.0
    accelerate(effects["self_gravity"], state)
    inward = -np.concatenate([(p.acc * p.pos).sum(axis=1) for p in state.limiting]) / r
    edges = np.linspace(r.min(), r.max(), max(2, int(np.ptp(r) / state.grid.cell)) + 1)
    number, _ = np.histogram(r, edges)
    total, _ = np.histogram(r, edges, weights=inward)
    filled = number > 0
    centre, mean = 0.5 * (edges[1:] + edges[:-1])[filled], total[filled] / number[filled]
    return lambda radius: pull(radius) + np.interp(radius, centre, mean)
