"""Equilibrium of a disc: velocities of gas and dust that balance the forces on them.

Gas: v_phi^2 / r = g(r) + (1/Sigma) dP/dr. g(r) is the inward acceleration by star, companions and self-gravity at r,
averaged over azimuth. With [alpha_viscosity], viscosity drives a radial flow v_r.

Dust with drag: the steady drift of Nakagawa, Sekiya & Hayashi (1986) about circular orbits of the gas (eqs. 9 and 10
of `exact/nsh.py`), for the local Stokes numbers and dust-to-gas ratios of all populations. With two-way drag the gas
drifts too. With one-way drag, dust drifts as at a dust-to-gas ratio of zero.
Dust without drag, or with `initial.dust_velocity` "balance": circular orbits, v_phi^2 / r = g(r).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field

from discsim.exact import nsh
from discsim.initial import start_of, support
from discsim.numerics.operators import accelerate
from discsim.parts import Lazy
from discsim.physics import profile, radiation
from discsim.physics.centre import star_pull
from discsim.physics.grains import has_sizes, sampled_sizes, typical_size
from discsim.scene.fields import Default, Orbits, Table

if TYPE_CHECKING:
    from discsim.numerics.state import State
    from discsim.scene import Scene
    from discsim.scene.rules import Draft, Problem

companions = Lazy("discsim.physics.companions")
growth = Lazy("discsim.physics.growth")
viscosity = Lazy("discsim.physics.viscosity")
MAX_ORBITS = 1000.0  # upper bound of initial.relax
MAX_MACH = 1.0  # largest radial velocity that viscosity drives, in sound speeds
Array = np.ndarray
SIZE_SAMPLES = 32  # number of grain sizes that represent a continuous size distribution in sums
CHUNK = 1 << 17  # particles per chunk: velocities need temporary arrays of many times the memory of the positions
MIN_RING_PARTICLES = 32  # smallest number of particles in a ring whose velocities are averaged


class BalanceKeys(Table):
    """Keys of a start whose velocities balance the forces."""

    dust_velocity: Annotated[Literal["balance", "drift"] | None, Default('"drift" with drag, else "balance"')] = Field(
        None,
        description='initial velocity of dust: "balance" for circular orbits, "drift" for the steady drift '
        "with the gas",
    )
    relax: Orbits = Field(
        0.0,
        ge=0,
        le=MAX_ORBITS,
        description="orbits at reference_radius of damped relaxation of the gas before t = 0",
    )


def relaxation_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of `initial.relax`, which needs [gas] and [star], and excludes a perturbation."""
    if draft.initial.relax == 0.0:
        return
    for table, why in (("gas", "relaxation needs gas"), ("star", "relaxation is measured in orbits about a star")):
        if not draft.has(table):
            yield ("initial", "relax"), f"{why}; add a table [{table}], or remove this key"
    if getattr(draft.initial, "perturbation", 0.0) > 0.0:
        wrong = "initial.perturbation is also given, and relaxation would remove it"
        yield ("initial", "relax"), f"{wrong}; remove initial.perturbation or this key"


class Equilibrium:
    """Equilibrium of the disc in `state` under the forces of `effects`.

    The accelerations by self-gravity and companions are averaged over azimuth at each radius.
    gravity: inward acceleration by gravity, as a function of radii (n,). pressure: outward acceleration of gas by
    pressure, as a function of radii; None for that of the initial profile. has_small_dust: whether the mass of gas
    particles includes small dust. drifts: whether dust starts with its drift.
    """

    def __init__(self, state: State, effects: dict[str, Any]) -> None:
        self.scene, self.effects = state.scene, effects
        self.pressure: Callable[[Array], Array] | None = None
        self.gravity = mean_gravity(state, effects)
        self.has_small_dust = "growth" in effects and growth.gas_mass_includes_small_dust(state.scene)
        self.drifts = "drag" in effects and getattr(self.scene.initial, "dust_velocity", None) != "balance"

    def velocities(
        self, name: str, pos: Array, species: Array | None, size: Array | None = None, pull: Array | None = None
    ) -> tuple[Array, Array]:
        """Return the radial and the azimuthal velocity (n,) of gas or dust particles at the positions `pos` (n, 2).

        name: "gas" or "dust". species (n,): index of the population of each dust particle; None for gas. size (n,):
        grain radii; None: grains have the mean size of their population. pull (n,): `gravity` at the particles, if it
        is known.
        """
        scene = self.scene
        r = np.sqrt((pos**2).sum(axis=1))
        pull = self.gravity(r) if pull is None else pull
        # No rotation balances gravity that points outwards. `settle` raises an error if much mass is at such radii.
        keplerian = np.sqrt(np.maximum(pull * r, 1e-300))
        radial, lag = np.zeros(len(r)), np.zeros(len(r))
        if scene.model.given is not None:
            if self.drifts:
                radial, lag = self.effects["drag"].steady_drift(pos, species, size).T
        elif name == "dust" and not self.drifts and scene.radiation_pressure is not None:
            lag = radiation.circular_minus_keplerian(scene, species, r, keplerian)
        elif scene.gas is not None:
            disc = profile.radial(scene)
            pressure = self.pressure or disc.pressure_acceleration
            headwind = 0.5 * pressure(r) * r / keplerian  # eta v_K
            if self.has_small_dust:  # the pressure of the gas accelerates gas and small dust together
                headwind = headwind / (1.0 + growth.small_ratio_at(scene, r, disc.dust_share))
            headwind[keplerian <= 1e-100] = 0.0
            if name in self.drifting:
                radial, lag = self._drift(disc, species, r, keplerian / r, headwind, size)
            elif name == "gas":
                # Without drag the balance of gas is known exactly, not only to first order in the headwind.
                lag = np.sqrt(np.maximum(keplerian**2 - 2.0 * headwind * keplerian, 0.0)) - keplerian
            if name == "gas" and scene.table("alpha_viscosity") is not None:
                radial = radial + viscous_inflow(scene, disc, r)
        return radial, keplerian + lag

    @property
    def drifting(self) -> tuple[str, ...]:
        """Names of the species that start with the steady drift of gas and dust."""
        if not self.drifts:
            return ()
        return ("gas", "dust") if self.scene.drag.direction == "two-way" else ("dust",)

    def without_drag(self, pos: Array) -> tuple[Array, Array]:
        """Return radial and azimuthal velocity (n,) of gas at the positions `pos` (n, 2), without drag by dust."""
        drifts, self.drifts = self.drifts, False
        try:
            return self.velocities("gas", pos, None)
        finally:
            self.drifts = drifts

    def _drift(
        self, disc: profile.Radial, species: Array | None, r: Array, omega: Array, headwind: Array, size: Array | None
    ) -> tuple[Array, Array]:
        """Return the steady radial and azimuthal velocity (n,) of dust relative to Keplerian rotation.

        species (n,): index of the population of each dust particle; None: return the velocity of the gas instead. r,
        omega, headwind (n,): radius, Keplerian frequency and eta v_K. size (n,): grain radii, as in `velocities`.
        """
        # The equations are those of several kinds of grains. A few sizes with mass represent each population. The
        # grains whose drift is returned are one more kind, without mass.
        scene, drag = self.scene, self.effects["drag"]
        density = disc.surface_density(r)
        sound = profile.initial_thermal_speed(scene, r, density)
        typical, stokes, loads, pushed = np.empty((len(scene.dust), len(r))), [], [], []
        push = radiation.radiation_velocities(scene, r, omega * r)
        for k, population in enumerate(scene.dust):
            # Beyond an edge there is no gas and the stopping time is infinite; the bound avoids inf * 0.
            typical[k] = np.minimum(omega * drag.stopping_time(k, density, sound, omega, population.ratio), 1e100)
            ratio = population.ratio if disc.dust_share is None else population.ratio * disc.dust_share(r)
            inside = (r >= (population.inner or 0.0)) & (r <= (population.outer or np.inf))
            load = np.where(inside & (scene.drag.direction == "two-way"), ratio, 0.0)
            if self.has_small_dust:
                small = growth.small_ratio_at(scene, r, disc.dust_share)
                load = (load - small) / (1.0 + small)
            for over_typical, share in _representative_sizes(population):
                stokes.append(over_typical * typical[k])
                loads.append(share * load)
                pushed.append(None if push is None else push[k])
        if species is not None:
            at = species, np.arange(len(r))
            factor = 1.0 if size is None else size / np.array([typical_size(p) for p in scene.dust])[species]
            stokes.append(factor * typical[at])
            loads.append(np.zeros(len(r)))
            pushed.append(None if push is None else push[at])
        found = nsh.drift_about_circular_orbits(
            np.array(stokes), np.array(loads), headwind, omega * r, None if push is None else np.array(pushed)
        )
        if species is None:
            return found.gas_radial, found.gas_azimuthal
        return found.dust_radial[-1], found.dust_azimuthal[-1]


def _representative_sizes(population: Any) -> Iterator[tuple[float, float]]:
    """Return (relative stopping time, mass fraction) for each of the grain sizes that represent a population.

    The stopping time is divided by that of the mean size.
    """
    if not has_sizes(population):
        return iter([(1.0, 1.0)])
    size, weight = sampled_sizes(population, population.grain_size.bins or SIZE_SAMPLES)
    return zip(size / typical_size(population), weight / weight.sum(), strict=True)


def gas_only_scene(scene: Scene) -> Scene:
    """Return the scene with gas only, which only star, companions, pressure and viscosity accelerate."""
    gone = dict.fromkeys(("dust", "drag", "cooling", "self_gravity", "damping"))
    if scene.table("growth") is not None:
        gone.pop("drag")  # the direction of drag decides whether gas particles include the mass of small dust
    return scene.model_copy(update={**gone, "gas": scene.gas.model_copy(update={"conductivity": None})})


def settle(state: State, effects: dict[str, Any]) -> None:
    """Set the velocities of the gas and dust in `state` so that they balance the forces of `effects`.

    Raises ValueError if no rotation balances the forces on more than the mass fraction `support.MAX_FALLING` of a
    species.
    """
    equilibrium = Equilibrium(state, effects)
    if "gas" in effects:
        equilibrium.pressure = effects["gas"].pressure_push(state, equilibrium.gravity)
    set_velocities(equilibrium, state.species)
    if state.scene.model.given is None:
        for name in state.species:
            _check_orbits(equilibrium, state, name)


def set_velocities(equilibrium: Equilibrium, species: Mapping[str, Any]) -> None:
    """Set the velocities of the `Particles` of gas and dust by name to those of the equilibrium."""
    for name, particles in species.items():
        own: tuple[Array | None, ...] = getattr(particles, "species", None), getattr(particles, "size", None)
        if equilibrium.scene.table("companion") is not None:
            # `companions.mean_pull` tabulates over the radii of one call, which has to contain those of all particles.
            own = *own, equilibrium.gravity(np.sqrt((particles.pos**2).sum(axis=1)))
        for first in range(0, particles.count, CHUNK):
            rows = slice(first, first + CHUNK)
            pos = particles.pos[rows]
            of_grains = (None if array is None else array[rows] for array in own)
            radial, azimuthal = equilibrium.velocities(name, pos, *of_grains)
            direction = pos / np.sqrt((pos**2).sum(axis=1))[:, None]
            across = np.stack([-direction[:, 1], direction[:, 0]], axis=1)
            particles.vel[rows] = radial[:, None] * direction + azimuthal[:, None] * across


def _check_orbits(equilibrium: Equilibrium, state: State, name: str) -> None:
    """Raise ValueError if more than the mass fraction `support.MAX_FALLING` of a species has no circular orbit.

    name: name of the species.
    """
    particles = state.species[name]
    r = np.sqrt((particles.pos**2).sum(axis=1))
    pull = equilibrium.gravity(r)
    turning = (particles.pos[:, 0] * particles.vel[:, 1] - particles.pos[:, 1] * particles.vel[:, 0]) / r
    falling = turning <= 2.0 * nsh.SLOWEST * np.sqrt(np.abs(pull) * r)
    fraction = float(particles.mass[falling].sum() / particles.mass.sum())
    if fraction > support.MAX_FALLING:
        where = equilibrium.scene.units.show(float(np.median(r[falling])), "length")
        if np.median(pull[falling]) <= 0.0:
            cause, remedy = "self-gravity acts outwards", _remedy_of_self_gravity(state)
        else:
            cause = "pressure or radiation pressure exceeds gravity"
            remedy = "lower H/r or radiation_pressure.beta, or widen the taper there"
        without = f"{100.0 * fraction:.2g}% of the {name} mass has no circular orbit near r = {where}"
        raise ValueError(f"{without}, where {cause}; {remedy}")


def _remedy_of_self_gravity(state: State) -> str:
    """Return the remedy for self-gravity that acts outwards, as text: a softening of a grid cell, or less mass."""
    keys: Any = state.scene.self_gravity
    key, lighter = "thickness" if keys.kernel == "thin-disc" else "softening", "lower the mass of the disc"
    if state.grid is None or getattr(keys, key) >= state.grid.cell:
        return lighter
    shown = state.scene.units.show(state.grid.cell, "length")
    return f"raise self_gravity.{key} to {shown}, the side of a grid cell, or {lighter}"


def viscous_inflow(scene: Scene, disc: profile.Radial, r: Array) -> Array:
    """Return the radial velocity (n,) of gas that viscosity drives, at the radii r (n,) of the disc.

    Unless the disc sets this velocity itself, the velocity is limited to MAX_MACH c_s, as it would diverge at the
    edges.
    """
    if disc.inflow is not None:
        return disc.inflow(r)
    with np.errstate(divide="ignore", invalid="ignore"):
        flow = viscosity.radial_flow(scene, r, disc.surface_density)
    fastest = MAX_MACH * profile.sound_speed(scene, r, disc.surface_density(r))
    return np.clip(np.where(np.isfinite(flow), flow, 0.0), -fastest, fastest)


def velocity_profiles(state: State, effects: dict[str, Any], radius: Array) -> Array:
    """Return radial and azimuthal velocities (kinds, n, 2) at the radii `radius` (n,).

    The kinds are the gas, if the scene has gas, and then each dust population. With [background], or with a start that
    has radial profiles, the velocities are those of the equilibrium. Otherwise they are means over azimuth of particle
    velocities.
    """
    scene: Any = state.scene
    kinds = [("gas", 0)] if state.gas is not None else []
    kinds += [("dust", k) for k in range(len(scene.dust or ()))]
    known = scene.model.given is not None or (scene.initial is not None and start_of(scene).radial is not None)
    equilibrium = Equilibrium(state, effects) if known else None
    out = np.empty((len(kinds), len(radius), 2))
    for row, (name, k) in enumerate(kinds):
        if equilibrium is not None:
            pos = np.stack([radius, np.zeros_like(radius)], axis=1)
            species = np.full(len(radius), k) if name == "dust" else None
            out[row] = np.stack(equilibrium.velocities(name, pos, species), axis=1)
        else:
            out[row] = _mean_velocities(state.species[name], k, radius)
    return out


def _mean_velocities(particles: Any, population: int, radius: Array) -> Array:
    """Return mean radial and azimuthal velocities (n, 2) of `particles` at the radii `radius` (n,).

    Velocities are averaged over rings with equal numbers of particles, and interpolated between the rings.
    population: index of the dust population to average; 0 for gas.
    """
    chosen = np.flatnonzero(getattr(particles, "species", np.zeros(particles.count, int)) == population)
    pos, vel = particles.pos[chosen], particles.vel[chosen]
    r = np.sqrt((pos**2).sum(axis=1))
    order = np.argsort(r, kind="stable")
    turning = pos[:, 0] * vel[:, 1] - pos[:, 1] * vel[:, 0]
    rings = np.array_split(order, max(1, len(order) // max(MIN_RING_PARTICLES, math.isqrt(len(order)))))
    middle = [r[ring].mean() for ring in rings]
    means = [[(values[ring] / r[ring]).mean() for ring in rings] for values in ((pos * vel).sum(axis=1), turning)]
    return np.stack([np.interp(radius, middle, mean) for mean in means], axis=1)


def mean_gravity(state: State, effects: dict[str, Any]) -> Callable[[Array], Array]:
    """Return a function of radii (n,) that returns the inward acceleration (n,) by star, companions and self-gravity.

    The acceleration is averaged over azimuth. Self-gravity is computed here, at the particles of
    `state.limiting_species`: dust with one-way drag must not change the gas. `acc` of all particles in `state` is
    overwritten.
    """

    def pull(radius: Array) -> Array:
        if state.scene.star is None:
            return np.zeros(len(radius))
        by_star = star_pull(state.scene, radius)
        if state.scene.table("companion") is None:
            return by_star
        return by_star + companions.mean_pull(state.scene, radius)

    if "self_gravity" not in effects:
        return pull
    r = np.concatenate([np.sqrt((p.pos**2).sum(axis=1)) for p in state.limiting_species])
    for p in state.species.values():
        p.acc[:] = 0.0
    accelerate(effects["self_gravity"], state)
    inward = -np.concatenate([(p.acc * p.pos).sum(axis=1) for p in state.limiting_species]) / r
    edges = np.linspace(r.min(), r.max(), max(2, int(np.ptp(r) / state.grid.cell)) + 1)
    number, _ = np.histogram(r, edges)
    total, _ = np.histogram(r, edges, weights=inward)
    filled = number > 0
    centre, mean = 0.5 * (edges[1:] + edges[:-1])[filled], total[filled] / number[filled]
    return lambda radius: pull(radius) + np.interp(radius, centre, mean)
