"""Companions of the star (planets, a second star, a flyby): gravity -G m d / (d^2 + eps^2)^(3/2) on gas and dust.

d is the vector from the companion, and eps its softening.

    orbit = "fixed"   a Kepler orbit about GM = M + m, in closed form
    orbit = "live"    feels star, companions, gas and dust, or the sources in the key `feels`; exact if only the star
                      pulls (`physics/orbits.py`); companion and particle exert opposite forces on each other

During a ramp, the forces between companion and disc grow as sin^2(pi t / 2 ramp) (`physics/orbits.py`). The orbit has
the full mass from the start.

Particles within accretion_radius are accreted: all at once or, with accretion_rate, each with the probability
1 - exp(-rate dt / P) in a step, with P = 2 pi / Omega of the companion at its present distance. The companion gains
their mass; a live one gains their momentum too.

The step limit is half of the smallest of

    ((d^2 + eps^2)^(3/2) / G m)^(1/2)   of the nearest particle
    (d^2 + eps^2)^(1/2) / |v|           of each particle, at its relative velocity
    1/Omega                             about the star, and of each pair of companions of which one is live
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from discsim.effects import base
from discsim.effects.accretion import accrete, accreted_masses
from discsim.initial import start_of
from discsim.numerics import world
from discsim.numerics.bodies import SPECIES
from discsim.numerics.state import State
from discsim.numerics.threads import parallel_for
from discsim.numerics.totals import rounded
from discsim.parts import Lazy
from discsim.physics import companions as formulas
from discsim.physics.companions import softening
from discsim.physics.local import PHASES, resolution
from discsim.physics.orbits import IN_KICKS, Orbits
from discsim.scene.keys import Companion as Keys
from discsim.scene.rules import Draft, Problem, missing_tables

if TYPE_CHECKING:
    from discsim.numerics.bodies import Bodies
    from discsim.scene import Scene
    from discsim.scene.units import Units

kernels = Lazy("discsim.kernels.gravity.point_masses")

CLOSE = 0.2  # largest distance, in inner radii of the disc, at which star and companion count as one central mass
REMEDY = "a longer companion.softening"  # for step limits
PULL = 12.0  # CPU nanoseconds in a step, per particle and companion


def _orbit_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of companions without a star, of orbits that do not exist, and of ramps on unbound orbits."""
    yield from missing_tables(draft, ("companion",), {"star": "a companion needs a star to orbit"})
    for k, companion in enumerate(draft.companion or ()):
        e, phase = companion.eccentricity, companion.phase
        if e == 1.0:
            wrong = "e = 1 is a parabola, which has no semi-major axis"
            yield ("companion", k, "eccentricity"), f"{wrong}; expected any value except 1"
        elif e > 1.0 and abs(phase) >= (most := math.degrees(math.acos(-1.0 / e))):
            wrong = f"{phase:g} degrees is beyond the asymptote of a hyperbola with e = {e:g}"
            yield ("companion", k, "phase"), f"{wrong}; expected between -{most:.4g} and {most:.4g}"
        if e > 1.0 and companion.ramp > 0.0 and draft.star is not None and draft.star.centre == "barycentre":
            wrong = 'an unbound companion with a ramp is not possible with star.centre = "barycentre"'
            yield ("companion", k, "ramp"), f'{wrong}; remove ramp, or set star.centre = "star"'


def _feels_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of the key `feels`, the list of sources that accelerate a live companion."""
    for k, companion in enumerate(draft.companion or ()):
        where = ("companion", k, "feels")
        if companion.feels is not None:
            if companion.orbit == "fixed":
                yield where, 'no force acts on a fixed orbit; set orbit = "live", or remove "feels"'
            yield from base.source_problems(draft, where, companion.feels, "a companion that it moves")


def _softening_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of the keys for softening and accretion."""
    gas = draft.gas or draft.background
    for k, companion in enumerate(draft.companion or ()):
        where, wanted = ("companion", k, "softening"), 'expected a length in quotes, like "0.03"'
        if companion.softening.in_heights and gas is None:
            yield where, f"a number means scale heights H, but there is no gas; {wanted}"
        elif companion.softening.in_heights and draft.gas and not _has_height(draft.gas.eos):
            yield where, f"a number means scale heights H, and H depends on density or heat here; {wanted}"
        is_cleared = companion.accretion_radius > 0.0 and companion.accretion_rate is None
        if companion.softening.value == 0.0 and not is_cleared:
            yield (
                where,
                "0 gives infinite forces near the companion; choose a value above 0, or add an accretion_radius",
            )
        if companion.accretion_rate is not None and companion.accretion_radius == 0.0:
            wrong = "an accretion rate needs an accretion radius"
            yield ("companion", k, "accretion_rate"), f"{wrong}; add the key accretion_radius"


def _has_height(eos: Any) -> bool:
    """Return whether the equation of state defines a scale height that depends on radius alone."""
    return getattr(eos, "sound_speed", None) is not None or getattr(eos, "aspect_ratio", None) is not None


class _LocalLengths(NamedTuple):
    """Length scales at the semi-major axis of a companion.

    units: units of the scene. softening: softening of the companion. height: scale height H of the gas. resolution:
    smoothing length h of the gas, as in `GasSamples.resolution`, or the side of a cell of a polar grid. `height` and
    `resolution` are None if the scene does not define them. unit: name of `resolution` as a unit, "h" or "cells".
    """

    units: Units
    softening: float
    height: float | None
    resolution: float | None
    unit: str = "h"

    def as_text(self, length: float) -> str:
        """Return a length with its unit and in multiples of H and `resolution`, for a table of derived numbers."""
        scales = ((self.height, "H"), (self.resolution, self.unit))
        others = ", ".join(f"{length / scale:.3g} {name}" for scale, name in scales if scale is not None)
        return self.units.show(length, "length") + (f" ({others})" if others else "")


def _local_lengths(scene: Scene, at: base.GasSamples, companion: Any) -> _LocalLengths:
    """Return the length scales at the semi-major axis of a companion."""
    r = companion.semi_major_axis
    gas: Any = scene.gas
    is_known = scene.background is not None or (gas is not None and _has_height(gas.eos))
    height = float(formulas.scale_height(scene, r)) if is_known else None
    h = None
    if scene.model.disc_cells is not None:
        side = float(scene.model.disc_cells(scene).side(np.array(r)))
        return _LocalLengths(scene.units, softening(scene, companion, r), height, side, "cells")
    if gas is not None and at.particle_mass is not None and (density := _initial_gas(scene, r, "density")) > 0.0:
        mass = at.particle_mass * _initial_gas(scene, r, "relative_mass")
        h = float(resolution(scene, np.array(gas.smoothing_length or gas.eta * math.sqrt(mass / density))))
    return _LocalLengths(scene.units, softening(scene, companion, r), height, h)


def _initial_gas(scene: Scene, r: float, name: str) -> float:
    """Return a property of the initial gas at radius `r`; 0 beyond the gas.

    name: "density" for the surface density, or "relative_mass" for the mass of gas particles over their mean mass.
    """
    places = start_of(scene).sample_all_gas(scene)[0]
    values = getattr(places, name)
    if values is None:  # all particles have the same mass
        return 1.0
    return 0.0 if places.radius is None else float(np.interp(r, places.radius, values, left=0.0, right=0.0))


def quadrupole_of_pair(scene: Scene, companion: Any) -> float | None:
    """Return the relative difference between the pulls of a close pair and of a single star with their total mass.

    Both pulls are at the inner edge of the disc. Returns None unless the companion is on a bound fixed orbit far
    within this edge.
    """
    star, edges = scene.star, start_of(scene).edges
    if edges is None or companion.orbit != "fixed" or companion.eccentricity >= 1.0:
        return None
    inner, total, wide = edges(scene)[0], star.mass + companion.mass, companion.semi_major_axis
    if wide * (1.0 + companion.eccentricity) > CLOSE * inner:
        return None
    return float(0.75 * star.mass * companion.mass / total**2 * (wide / inner) ** 2)


class Effect(base.Effect):
    """Gravity between companions and particles, and accretion. The effect of [star] moves the companions."""

    keys = Keys
    role = base.Role(several=True)
    rules = (_orbit_problems, _feels_problems, _softening_problems)

    def __init__(self, scene: Scene, state: State) -> None:
        self.scene = scene
        self.companions = scene.table("companion")
        self.orbits = Orbits(scene)
        # By species: smallest values (companions, 2) of d^2 and of (d^2 + eps^2) / v^2 over the particles.
        self._near: dict[str, np.ndarray] = {}
        self._lengths = np.zeros(len(self.companions))  # softenings
        self._dt = 0.0

    @classmethod
    def nanoseconds(cls, scene: Scene, counts: base.Counts) -> float:
        return PULL * len(scene.table("companion")) * (counts.gas + counts.dust)

    @classmethod
    def expected_limit(cls, scene: Scene, outlook: base.ForecastState) -> base.Expected:
        found = []
        encounters = formulas.encounter_limits(scene, outlook)
        for k, (companion, encounter) in enumerate(zip(scene.table("companion"), encounters, strict=True), 1):
            orbit = formulas.step_of_orbit(scene, companion, outlook.time)
            found.append(base.Expected(orbit, f"by the orbit of companion {k}"))
            found.append(base.Expected(encounter, f"near companion {k}"))
        steps = np.array([np.broadcast_to(one.step, PHASES) for one in found])
        return base.Expected(IN_KICKS * steps.min(axis=0), found[int(np.argmin(steps.min(axis=1)))].where)

    @classmethod
    def report(cls, scene: Scene, at: base.GasSamples) -> base.Report:
        return base.Report(_companion_rows(scene, at), _companion_warnings(scene, at))

    def operators(self, state: State) -> list[base.Operator]:
        reads, of = base.arrays(state.species, "pos vel mass") | {"bodies"}, base.Slot
        return [
            base.Operator("companion.pull", of.FORCE, self.accelerate, reads, base.arrays(state.species, "acc")),
            base.Operator("companion.limit", of.LIMIT, self.limit, reads),
            base.Operator("companion.step", of.MOVE, self.move),
            base.Operator("companion.accretion", of.EVENT, self.event),
        ]

    def accelerate(self, view: base.View) -> None:
        """Add the gravity of the companions to `acc` of gas and dust, and set the accelerations of the bodies."""
        bodies, positions = view.bodies, view.bodies.felt_pos
        away = view.from_centre(positions[1:]) if view.centre is not None else positions[1:] - positions[0]
        distances = np.sqrt((away**2).sum(axis=1))
        for k, companion in enumerate(self.companions):
            self._lengths[k] = softening(self.scene, companion, float(distances[k]), view.central_mass)
        for name, p in view.species.items():
            self._near[name] = np.full((len(self.companions), 2), np.inf)
            for k in range(len(self.companions)):
                body = bodies.felt[k + 1], self._lengths[k], *positions[k + 1].tolist(), *bodies.vel[k + 1].tolist()
                found = parallel_for(kernels.attract_moving, p.count, p.pos, p.vel, p.acc, p.mass, *body)
                bodies.pulled[k + 1, SPECIES.index(name)] = rounded(sum(limbs for limbs, _ in found))
                self._near[name][k] = np.min([near for _, near in found], axis=0)
        self.orbits.accelerate(bodies)

    def limit(self, view: base.View) -> dict[str, base.Limit]:
        felt, positions = view.bodies.felt[1:], view.bodies.felt_pos[1:]
        acting = felt > 0.0  # a ramp begins with 0, which sets no limit
        found = {base.ALL: self._limit(self.orbits.limit(view.bodies))}
        for name, p in view.species.items():
            near, crossing = self._near[name][acting].T
            squared = (near + self._lengths[acting] ** 2) ** 1.5 / felt[acting]
            shortest = float(np.sqrt(min(squared.min(initial=np.inf), crossing.min(initial=np.inf))))
            found[name] = self._limit(shortest, partial(self._nearest_row, p.pos, positions))
        return found

    def _limit(self, shortest: float, row: Callable[[], int] | None = None) -> base.Limit:
        """Return the time-step limit by orbits of companions, or by encounters of particles with companions.

        shortest: smallest 1 / frequency. row: `Limit.row`, which returns the particle that sets the limit.
        """
        step = IN_KICKS * shortest
        return base.Limit(step, base.GROWS / IN_KICKS * step, row, REMEDY)

    def _nearest_row(self, pos: np.ndarray, companions: np.ndarray) -> int:
        """Return the index of the particle at `pos` (n, 2) nearest to any of the positions `companions` (k, 2)."""
        away = ((pos[:, None] - companions) ** 2).sum(axis=2) + self._lengths**2
        return int(away.min(axis=1).argmin())

    def move(self, state: State, dt: float) -> None:
        """Store the length of the step, for the accretion at its end."""
        self._dt = dt

    def event(self, state: State) -> None:
        """Accrete particles within the accretion radii at the end of a step."""
        bodies = state.bodies
        for k, companion in enumerate(self.companions):
            if companion.accretion_radius > 0.0:
                position = bodies.felt_pos[k + 1].tolist()
                for name in state.species:
                    self._accrete(state, k, name, position)
        self.orbits.set_bodies(bodies, state.time)

    def _accrete(self, state: State, k: int, name: str, position: list[float]) -> None:
        """Let companion `k`, at `position`, accrete particles of species `name` after a step.

        The accreted particles are removed from the state.
        """
        companion, p = self.companions[k], state.species[name]
        found = parallel_for(kernels.split_by_radius, p.count, p.pos, companion.accretion_radius**2, *position)
        gone = np.concatenate([inside for _, inside in found])
        if companion.accretion_rate is not None:
            numbers = _random_numbers(self.scene.run.seed, state.step + state.earlier, k, p.ids[gone])
            gone = gone[~(numbers >= self._accretion_probability(state, k))]
        if world.processes.max(len(gone)) > 0:
            masses = accreted_masses(state, name, gone)
            accrete(state, k + 1, name, gone, masses, grows=True, moves=bool(self.orbits.live[k]))
            p.remove(gone)

    def _accretion_probability(self, state: State, k: int) -> float:
        """Return the probability that companion `k` accretes a particle within its radius after a step."""
        return -math.expm1(-self.companions[k].accretion_rate * self._dt / self.period(state.bodies, k))

    def period(self, bodies: Bodies, k: int) -> float:
        """Return the period of a circular orbit at the present distance of companion `k`."""
        r = math.dist(bodies.pos[k + 1], bodies.pos[0])
        return 2.0 * math.pi * math.sqrt(r**3 / (bodies.mass[0] + bodies.mass[k + 1]))

    def potential_energy(self, state: State) -> float:
        """Return the total potential energy of gas and dust in the field of the companions."""
        bodies, energy = state.bodies, 0.0
        for p in state.species.values():
            for k in range(len(self.companions)):
                energy += base.point_mass_energy(p, bodies.felt_pos[k + 1], bodies.felt[k + 1], self._lengths[k])
        return energy


def _companion_rows(scene: Scene, at: base.GasSamples) -> Iterator[tuple[str, str]]:
    """Yield (name, text) of the derived numbers of each companion."""
    viscous = scene.table("alpha_viscosity") is not None
    for k, companion in enumerate(scene.table("companion"), 1):
        name, lengths = f"companion {k}", _local_lengths(scene, at, companion)
        if companion.eccentricity < 1.0:
            yield f"{name}: period", scene.units.show(formulas.period(scene, companion), "time")
        if not formulas.is_second_star(scene, companion):
            yield f"{name}: Hill radius", lengths.as_text(formulas.hill_radius(scene, companion))
        yield f"{name}: softening", lengths.as_text(lengths.softening)
        if viscous and lengths.height is not None and not formulas.is_second_star(scene, companion):
            gap = formulas.gap_number(scene, companion)
            depth = 1.0 / (1.0 + 0.04 * gap)
            yield f"{name}: gap", f"K = {gap:.3g}: Sigma in the gap falls to a fraction of {depth:.2g}"


def _companion_warnings(scene: Scene, at: base.GasSamples) -> Iterator[str]:
    """Yield warnings of a Hill radius or softening below the smoothing length of the gas, or below 1.5 polar cells."""
    least, unit = (1.5, "side of a cell") if scene.model.polar else (1.0, "smoothing length h")
    for k, companion in enumerate(scene.table("companion"), 1):
        near = _local_lengths(scene, at, companion)
        if near.resolution is None:
            continue
        hill = formulas.hill_radius(scene, companion)
        # A Hill radius within the softening has no effect on the gas, so it needs no resolution.
        acts = not formulas.is_second_star(scene, companion) and hill > near.softening
        lengths = [("the Hill radius", hill, "")] if acts else []
        if companion.accretion_radius < near.resolution:
            lengths.append(("companion.softening", near.softening, "a longer companion.softening, or "))
        for name, length, other in lengths:
            if 0.0 < length < least * near.resolution:
                needed = scene.gas.particles * (least * near.resolution / length) ** 2
                yield (
                    f"{name} of companion {k} is {length / near.resolution:.2g} times the {unit} "
                    f"of the gas there, below {least:g}: choose {other}about {needed:.2g} gas.particles"
                )


def _random_numbers(seed: int, step: int, companion: int, ids: np.ndarray) -> np.ndarray:
    """Return pseudo-random numbers (n,) in [0, 1) for the particles `ids` (n,).

    A counter-based hash (splitmix64; Steele et al. 2014) of seed, step, companion and id computes them.
    """
    golden = np.uint64(0x9E3779B97F4A7C15)
    z = ids.astype(np.uint64)
    for word in (seed, step, companion):
        z = (z + np.uint64(word % 2**64)) * golden
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        z ^= z >> np.uint64(31)
    return (z >> np.uint64(11)) * 2.0**-53
