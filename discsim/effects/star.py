"""Star: gravity a = -G M d / (d^2 + s^2)^(3/2) and optional accretion; d is the vector from the star, s its softening.

Particles within the accretion radius are removed at the end of the step. The ledger records their mass, momentum and
angular momentum. With grows = true the star gains their mass; a moving star gains their momentum too. The star also
accretes the gas that leaves a polar grid through an open inner edge (`effects/polar.py`).

An unsoftened star at rest acts in the drift: gas and dust move on Kepler orbits, exact at any step
(`kernels/gravity/kepler.py`). Otherwise the star acts in the kick, where a moving star gains the momentum that
particles lose, to rounding. The step limit is 1/Omega = sqrt((d^2 + s^2)^(3/2) / (G M)) of the particle nearest to the
star, or half of this if the star acts in the kick.

A_0 is the sum of the accelerations of the star by the sources in the key `indirect`:

    frame = "star"       the star is the origin, and gas, dust and companions have the additional acceleration -A_0
    frame = "inertial"   the star accelerates with A_0; the barycentre of star and companions starts at rest at the
                         origin
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from discsim.effects import base
from discsim.effects.accretion import accrete, accreted_masses
from discsim.numerics import world
from discsim.numerics.bodies import SPECIES
from discsim.numerics.state import Particles, State
from discsim.numerics.threads import parallel_for, parallel_for_ranges
from discsim.numerics.totals import rounded, totals
from discsim.parts import Lazy
from discsim.physics.orbits import Orbits, circular_step_limit, pulling_species, star_acts_in_drift
from discsim.scene.keys import Star as Keys
from discsim.scene.rules import Draft, Problem

if TYPE_CHECKING:
    from discsim.scene import Scene

kernels = Lazy("discsim.kernels.gravity.point_masses")
polar = Lazy("discsim.effects.polar")

REMEDY = "a larger star.accretion_radius or star.softening"  # for step limits
PULL = 5.0  # CPU nanoseconds in a step, per particle; twice as long for particles that pull the star


def _space_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of a space that has no centre for a star."""
    if draft.dimensions == 1:
        yield ("star",), "a star is possible only in two dimensions; set space.dimensions = 2"
    elif draft.space and draft.space.boundary == "periodic" and not (draft.start and draft.start.edges):
        yield ("star",), 'a star is not possible in a periodic space; set space.boundary = "open"'


def _indirect_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of the key `indirect`, the list of sources that accelerate the star."""
    return base.source_problems(draft, ("star", "indirect"), draft.star.indirect or (), "the motion of the star")


def _frame_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of the keys `frame`, `centre` and `grows`."""
    star = draft.star
    if star.frame == "inertial" and draft.has("background"):
        yield ("star", "frame"), 'a [background] needs the star at the origin; set star.frame = "star"'
    if star.centre == "barycentre":
        if not draft.has("companion"):
            yield ("star", "centre"), 'centre = "barycentre" needs a companion; add a table [[companion]]'
        if star.frame == "star":
            wrong = 'centre = "barycentre" needs the inertial frame'
            yield ("star", "centre"), f'{wrong}; set star.frame = "inertial"'
        if star.indirect is not None and "companions" not in star.indirect:
            wrong = 'centre = "barycentre" needs companions that accelerate the star'
            yield ("star", "indirect"), f'{wrong}; add "companions" to star.indirect, or set star.centre = "star"'
        bound = [c for c in draft.companion or () if c.eccentricity < 1.0]
        if len(bound) > 1 and any(c.orbit == "fixed" for c in bound):
            wrong = f'with {len(bound)} bound companions and orbit = "fixed" the barycentre is not at rest'
            yield ("star", "centre"), f'{wrong}; set orbit = "live" in each [[companion]], or star.centre = "star"'
    if star.grows and star.accretion_radius == 0.0 and not polar.leaves_inwards(draft):
        yield ("star", "grows"), "the star accretes nothing; add star.accretion_radius, or remove grows"


def orbit_limit(
    pos: np.ndarray, star: tuple[float, float], distance2: float, mass: float, factor: float, unstable: float
) -> base.Limit:
    """Return the limit factor * (d^3 / mass)^(1/2) by the particle that is nearest to the star.

    pos (n, 2): positions of the particles. star: position of the star. distance2: smallest softened d^2. mass: GM of
    the force. factor: limit in units of 1/Omega. unstable: ratio of the shortest unstable step to the limit.
    """
    step = float(factor * (distance2**1.5 / mass) ** 0.5)
    return base.Limit(step, unstable * step, lambda: int(((pos - star) ** 2).sum(axis=1).argmin()), REMEDY)


def expected_orbit_limit(scene: Scene, outlook: base.ForecastState, mass: float, factor: float) -> base.Expected:
    """Estimate the limit of `orbit_limit` for the forecast, with the same `mass` and `factor`."""
    if outlook.nearest == np.inf or mass == 0.0 or factor == np.inf:
        return base.Expected()
    softened = float(np.hypot(outlook.nearest, scene.star.softening))
    return base.Expected(factor * (softened**3 / mass) ** 0.5, f"at {scene.units.show(outlook.nearest, 'length')}")


class Effect(base.Effect):
    """Gravity of the star, accretion by it, and its motion.

    counted: species whose pull on the star is summed. all_in_kick: whether the kick includes the whole acceleration by
    the moving frame. in_drift: whether gas and dust drift on Kepler orbits. step: step limit in units of 1/Omega.
    """

    keys = Keys
    role = base.Role(centre=True)
    rules = (_space_problems, _indirect_problems, _frame_problems)

    def __init__(self, scene: Scene, state: State) -> None:
        self.star = scene.star
        self.orbits = Orbits(scene)
        self.counted = [name for name in pulling_species(scene) if name in self.orbits.felt_by_star]
        # Drag by a prescribed disc and cells at rest need the whole acceleration in the kick. Otherwise a drift of all
        # particles cancels the drift of the star.
        self.all_in_kick = scene.model.star_in_kick
        self.in_drift, self.step = star_acts_in_drift(scene), circular_step_limit(scene)
        # Displacement and velocity change of gas and dust in the last drift, caused by the motion of the frame.
        self._frame_motion = np.zeros(2), np.zeros(2)

    @classmethod
    def nanoseconds(cls, scene: Scene, counts: base.Counts) -> float:
        felt = Orbits(scene).felt_by_star
        return PULL * (counts.gas * (1 + ("gas" in felt)) + counts.dust * (1 + ("dust" in felt)))

    @classmethod
    def expected_limit(cls, scene: Scene, outlook: base.ForecastState) -> base.Expected:
        return expected_orbit_limit(scene, outlook, scene.star.mass, circular_step_limit(scene))

    def operators(self, state: State) -> list[base.Operator]:
        reads, slots = base.arrays(state.species, "pos mass") | {"bodies"}, base.Slot
        force = slots.DRIFT_FORCE if self.in_drift else slots.FORCE
        return [
            base.Operator("star.pull", force, self.accelerate, reads, base.arrays(state.species, "acc"), starts=True),
            base.Operator("star.limit", slots.LIMIT, self.limit, reads | {"star.nearest"}),
            base.Operator("star.drift", slots.DRIFT, self.drift),
            base.Operator("star.frame", slots.MOVE, self.move),
            base.Operator("star.nearest", slots.EVENT, self.event),
        ]

    def accelerate(self, view: base.View) -> None:
        """Add the gravity of the star, and the acceleration by the motion of the frame, to `acc` of gas and dust.

        A moving star without companions gets its own acceleration here too.
        """
        bodies, star = view.bodies, (view.star_pull, self.star.softening, *view.star_place)
        both, counted = view.species, self.counted if view.bodies is not None else []
        first = {name for name in both if view.is_unset(f"{name}.acc")}
        for name, p in both.items():
            if name not in counted:
                parallel_for(kernels.attract, p.count, p.pos, p.acc, name in first, *star, light=True)
        if bodies is None:
            return
        mutual = {name: p for name, p in both.items() if name in counted}
        pulling = [(p.count, p.pos, p.acc, name in first, p.mass, *star) for name, p in mutual.items()]
        for name, limbs in zip(mutual, parallel_for_ranges(kernels.attract_mutually, pulling), strict=True):
            bodies.pulled[0, SPECIES.index(name)] = rounded(sum(limbs))
        of_frame = self.orbits.frame_acceleration(bodies, beyond_drift=not self.all_in_kick).tolist()
        if not self.orbits.inertial or any(of_frame):
            parallel_for_ranges(kernels.add_to_each, [(p.count, p.acc, *of_frame) for p in both.values()], light=True)
        if bodies.count == 1:
            self.orbits.accelerate(bodies)

    def limit(self, view: base.View) -> dict[str, base.Limit]:
        nearest, found = view.pop("star.nearest", {}), {}
        for name, p in view.species.items():
            distance2 = nearest.get(name) or min(
                parallel_for(kernels.nearest_squared, p.count, p.pos, *view.star_place, light=True)
            )
            softened2, growing = distance2 + self.star.softening**2, base.GROWS / self.step
            limit = orbit_limit(p.pos, view.star_place, softened2, view.star_pull, self.step, growing)
            found[name] = limit._replace(unstable=math.inf) if self.in_drift else limit
        return found

    def drift(self, state: State, dt: float) -> None:
        """Drift the star and its companions over dt."""
        if state.bodies is not None:
            self._frame_motion = self.orbits.drift(state.bodies, state.time, dt)

    def move(self, state: State, dt: float) -> None:
        """Move gas and dust by the motion of the frame during the last drift."""
        if state.bodies is None or self.all_in_kick or not np.any(self._frame_motion):
            return
        for p in state.species.values():
            for vectors, moved in zip((p.pos, p.vel), self._frame_motion, strict=True):
                if p.immobile is None:
                    parallel_for(kernels.add_to_each, p.count, vectors, *moved.tolist(), light=True)
                else:
                    vectors[~p.immobile] += moved

    def event(self, state: State) -> dict[str, float]:
        """Accrete particles, and return by species the smallest squared distance of a remaining particle from the star.

        The result has no entry for a species whose distances may have changed or were not computed.
        """
        nearest: dict[str, float] = {}
        if state.bodies is not None:
            self.orbits.set_bodies(state.bodies, state.time)
        if self.star.accretion_radius > 0.0:
            region = self.star.accretion_radius**2, *state.star_place
            ranges = [(p.count, p.pos, *region) for p in state.species.values()]
            found = parallel_for_ranges(kernels.split_by_radius, ranges, light=True)
            for (name, particles), near in zip(state.species.items(), found, strict=True):
                nearest[name] = min(least for least, _ in near)
                self._accrete(state, name, particles, np.concatenate([inside for _, inside in near]))
            if state.bodies is not None and self.star.grows:
                if self.orbits.inertial:
                    nearest = {}  # the star may have moved
                self.orbits.set_bodies(state.bodies, state.time)
        return nearest

    def _accrete(self, state: State, name: str, particles: Particles, gone: np.ndarray) -> None:
        """Remove the accreted particles with the indices `gone` (k,) from `particles`, the species `name`.

        The ledger records their mass and momentum, and a growing star gains their mass.
        """
        if world.processes.max(len(gone)) == 0:
            return
        mass, pos, vel = particles.mass[gone], particles.pos[gone], particles.vel[gone]
        ledger, masses = state.ledger, accreted_masses(state, name, gone)
        setattr(ledger, f"accreted_{name}", getattr(ledger, f"accreted_{name}") + masses.own)
        ledger.accreted_small += masses.small
        specific = pos[:, 0] * vel[:, 1] - pos[:, 1] * vel[:, 0]  # angular momentum per mass
        *momentum, angular_momentum = totals(mass[:, None] * np.column_stack([vel, specific]))
        ledger.accreted_momentum += momentum
        ledger.accreted_angular_momentum += float(angular_momentum)
        if state.bodies is not None:
            accrete(state, 0, name, gone, masses, grows=self.star.grows, moves=self.orbits.inertial)
        particles.remove(gone)

    def potential_energy(self, state: State) -> float:
        star, softening = np.array(state.star_place), self.star.softening
        return sum(base.point_mass_energy(p, star, state.star_pull, softening) for p in state.species.values())
