"""Companions of the star: planets, a second star, a flyby; G m d / (d^2 + eps^2)^(3/2) on gas and dust.

    orbit = "fixed"   Kepler's orbit about GM = M + m in closed form of the time
    orbit = "live"    responds to star, companions, gas and dust, each optional; exact while only the star pulls
                      (`physics/orbits.py`), and companion and particle exert opposite forces on each other

The pull on gas and dust grows as m sin^2(pi t / 2 ramp), and so does the pull of the disc on the companion
(`physics/orbits.py`). The orbit has the whole mass from the start.

Particles within accretion_radius are accreted: all at once, or each with the probability 1 - exp(-rate dt / P) in a
step, P = 2 pi / Omega of the companion at its present distance. A live companion gains their mass and momentum, a
companion on a fixed orbit their mass.

Step limit, half of the least of

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
from discsim.effects.accretion import accrete, accreted_from
from discsim.initial import start_of
from discsim.numerics import world
from discsim.numerics.bodies import SPECIES, Bodies
from discsim.numerics.state import State
from discsim.numerics.threads import parallel_for
from discsim.numerics.totals import rounded, total
from discsim.parts import Lazy
from discsim.physics import companions as formulas
from discsim.physics.companions import softening
from discsim.physics.local import PHASES, Expected, resolution
from discsim.physics.orbits import IN_KICKS, Orbits
from discsim.scene.keys.companion import Keys
from discsim.scene.rules import Draft, Problem

if TYPE_CHECKING:
    from discsim.physics.local import Local, Outlook
    from discsim.scene import Scene
    from discsim.scene.units import Units

kernels = Lazy("discsim.kernels.gravity.point_masses")

CLOSE = 0.2  # in inner radii of the disc: for the disc a closer companion and the star are one central mass
SOFTER = "a longer companion.softening"
PULL = 12.0  # CPU nanoseconds in a step, per particle and companion


def _about_a_star(draft: Draft) -> Iterator[Problem]:
    """Yield problems of companions without a star, and of orbits that do not exist."""
    if not draft.has("star"):
        yield ("companion",), "a companion needs a star to orbit; expected a table [star] too"
    for k, companion in enumerate(draft.companion or ()):
        e, phase = companion.eccentricity, companion.phase
        if e == 1.0:
            yield (
                ("companion", k, "eccentricity"),
                "e = 1 is a parabola, which has no semi-major axis; expected less or more than 1",
            )
        elif e > 1.0 and abs(phase) >= (most := math.degrees(math.acos(-1.0 / e))):
            wrong = f"{phase:g} degrees is beyond the asymptote of a hyperbola with e = {e:g}"
            yield ("companion", k, "phase"), f"{wrong}; expected between -{most:.4g} and {most:.4g}"


def _its_ramp(draft: Draft) -> Iterator[Problem]:
    """Yield a problem of a ramp on an unbound companion if the disc turns about the barycentre."""
    if draft.star is None or draft.star.centre == "star":
        return
    for k, companion in enumerate(draft.companion or ()):
        if companion.ramp > 0.0 and companion.eccentricity > 1.0:
            wrong = 'an unbound companion with a ramp is not possible with star.centre = "barycentre"'
            yield ("companion", k, "ramp"), f'{wrong}; expected no ramp, or star.centre = "star"'


def _what_it_feels(draft: Draft) -> Iterator[Problem]:
    """Yield problems of `feels`, the list of what pulls a live companion."""
    for k, companion in enumerate(draft.companion or ()):
        where, names = ("companion", k, "feels"), companion.feels
        if names is None:
            continue
        if companion.orbit == "fixed":
            yield where, 'no force acts on a fixed orbit; expected orbit = "live", or no feels'
        if len(set(names)) < len(names):
            yield where, "a name occurs twice; expected each name once"
        for name in dict.fromkeys(names):
            if name in SPECIES and not draft.has(name):
                yield where, f'"{name}" is listed, but there is no table [{name}]; expected that table, or no "{name}"'
        if "dust" in names and draft.one_way_beside_gas:
            wrong = "with one-way drag, dust must not act on the gas, not even through a companion that it moves"
            yield where, f'{wrong}; expected no "dust", or drag.direction = "two-way"'


def _its_softening(draft: Draft) -> Iterator[Problem]:
    """Yield problems of softening and accretion, like a softening in H in gas without a fixed H."""
    gas = draft.gas or draft.background
    for k, companion in enumerate(draft.companion or ()):
        where, wanted = ("companion", k, "softening"), 'expected a length in quotes, like "0.03"'
        if companion.softening.in_heights and gas is None:
            yield where, f"a number means scale heights H, but there is no gas; {wanted}"
        elif companion.softening.in_heights and draft.gas and not _has_height(draft.gas.eos):
            yield where, f"a number means scale heights H, and H depends on density or heat here; {wanted}"
        taken = companion.accretion_radius > 0.0 and companion.accretion_rate is None
        if companion.softening.value == 0.0 and not taken:
            yield where, "0 gives infinite forces near the companion; expected more than 0, or an accretion_radius"
        if companion.accretion_rate is not None and companion.accretion_radius == 0.0:
            yield (
                ("companion", k, "accretion_rate"),
                "an accretion rate needs an accretion radius; expected accretion_radius too",
            )


def _has_height(eos: Any) -> bool:
    """Return whether an equation of state gives a scale height that is a function of the radius alone."""
    return getattr(eos, "sound_speed", None) is not None or getattr(eos, "aspect_ratio", None) is not None


class _Near(NamedTuple):
    """Length scales at a companion's semi-major axis: its softening, H, and h in the convention of
    `Local.resolution`.

    A length is None where the scene has none.
    """

    units: Units
    softening: float
    height: float | None
    resolution: float | None

    def told(self, length: float) -> str:
        of = ((self.height, "H"), (self.resolution, "h"))
        others = ", ".join(f"{length / unit:.3g} {name}" for unit, name in of if unit is not None)
        return self.units.show(length, "length") + (f" ({others})" if others else "")


def _near(scene: Scene, at: Local, companion: Any) -> _Near:
    """Return the length scales at the semi-major axis of a companion."""
    r = companion.semi_major_axis
    gas: Any = scene.gas
    known = scene.background is not None or (gas is not None and _has_height(gas.eos))
    height = float(formulas.scale_height(scene, r)) if known else None
    h = None
    if gas is not None and at.particle_mass is not None and (density := _density(scene, r)) > 0.0:
        mass = at.particle_mass * _relative_mass(scene, r)
        h = float(resolution(scene, np.array(gas.smoothing_length or gas.eta * math.sqrt(mass / density))))
    return _Near(scene.units, softening(scene, companion, r), height, h)


def _density(scene: Scene, r: float) -> float:
    """Return Sigma of the starting gas at a radius; 0 where there is none."""
    places = start_of(scene).all_over(scene)[0]
    if places.radius is None:
        return 0.0
    return float(np.interp(r, places.radius, places.density, left=0.0, right=0.0))


def _relative_mass(scene: Scene, r: float) -> float:
    """Return the mass of the starting gas particles at a radius over their mean."""
    places = start_of(scene).all_over(scene)[0]
    return 1.0 if places.relative_mass is None else float(np.interp(r, places.radius, places.relative_mass))


def quadrupole_of_pair(scene: Scene, companion: Any) -> float | None:
    """Return how much the pull of a close pair differs from one star's at the inner edge of the disc, as a fraction.

    Returns None unless the companion is on a bound fixed orbit far within the disc.
    """
    star, edges = scene.star, start_of(scene).edges
    if edges is None or companion.orbit != "fixed" or companion.eccentricity >= 1.0:
        return None
    inner, total, wide = edges(scene)[0], star.mass + companion.mass, companion.semi_major_axis
    if wide * (1.0 + companion.eccentricity) > CLOSE * inner:
        return None
    return float(0.75 * star.mass * companion.mass / total**2 * (wide / inner) ** 2)


def _named(k: int, what: str) -> str:
    return f"companion {k}: {what}"


class Effect(base.Effect):
    """Pull between companions and particles, and accretion by companions; the effect of the star moves the
    companions.
    """

    keys = Keys
    role = base.Role(several=True)
    rules = (_about_a_star, _its_ramp, _what_it_feels, _its_softening)

    def __init__(self, scene: Scene, state: State) -> None:
        self.scene = scene
        self.companions = scene.table("companion")
        self.orbits = Orbits(scene)
        self._near: dict[str, np.ndarray] = {}  # (companions, 2), least values of `kernels.attract_moving`
        self._lengths = np.zeros(len(self.companions))  # softenings
        self._dt = 0.0

    @classmethod
    def nanoseconds(cls, scene: Scene, counts: base.Counts) -> float:
        return PULL * len(scene.table("companion")) * (counts.gas + counts.dust)

    @classmethod
    def expected_limit(cls, scene: Scene, outlook: Outlook) -> Expected:
        found = []
        for k, (companion, nearby) in enumerate(
            zip(scene.table("companion"), formulas.encounter_limits(scene, outlook), strict=True), 1
        ):
            orbit = formulas.step_of_orbit(scene, companion, outlook.time)
            found += [Expected(orbit, f"by the orbit of companion {k}"), Expected(nearby, f"near companion {k}")]
        steps = np.array([np.broadcast_to(one.step, PHASES) for one in found])
        return Expected(IN_KICKS * steps.min(axis=0), found[int(np.argmin(steps.min(axis=1)))].where)

    @classmethod
    def report(cls, scene: Scene, at: Local) -> base.Report:
        return base.Report(cls._rows(scene, at), cls._warnings(scene, at))

    @classmethod
    def _rows(cls, scene: Scene, at: Local) -> Iterator[tuple[str, str]]:
        star, viscous = scene.star, scene.table("alpha_viscosity") is not None
        assert star is not None
        for k, companion in enumerate(scene.table("companion"), 1):
            near = _near(scene, at, companion)
            if companion.eccentricity < 1.0:
                yield _named(k, "period"), scene.units.show(formulas.period(scene, companion), "time")
            if not formulas.is_star(scene, companion):
                yield _named(k, "Hill radius"), near.told(formulas.hill_radius(scene, companion))
            yield _named(k, "softening"), near.told(near.softening)
            if viscous and near.height is not None and not formulas.is_star(scene, companion):
                gap = formulas.gap_number(scene, companion)
                yield (
                    _named(k, "gap"),
                    f"K = {gap:.3g}: Sigma in the gap falls to a fraction of {1.0 / (1.0 + 0.04 * gap):.2g}",
                )

    @classmethod
    def _warnings(cls, scene: Scene, at: Local) -> Iterator[str]:
        star = scene.star
        assert star is not None
        for k, companion in enumerate(scene.table("companion"), 1):
            near = _near(scene, at, companion)
            if near.resolution is None:
                continue
            hill = formulas.hill_radius(scene, companion)
            # A Hill radius within the softening has no effect on the gas, so it needs no resolution.
            seen = not formulas.is_star(scene, companion) and hill > near.softening
            lengths = [("the Hill radius", hill, "")] if seen else []
            if companion.accretion_radius < near.resolution:
                lengths.append(("companion.softening", near.softening, "a longer companion.softening, or "))
            for name, length, other in lengths:
                if 0.0 < length < near.resolution:
                    needed = scene.gas.particles * (near.resolution / length) ** 2
                    yield (
                        f"{name} of companion {k} is {length / near.resolution:.2g} times the smoothing length h "
                        f"of the gas there, below 1: choose {other}gas.particles of about {needed:.2g}"
                    )

    def operators(self, state: State) -> list[base.Operator]:
        reads, of = base.arrays(state.species, "pos vel mass") | {"bodies"}, base.Slot
        return [
            base.Operator("companion.pull", of.FORCE, self.accelerate, reads, base.arrays(state.species, "acc")),
            base.Operator("companion.limit", of.LIMIT, self.limit, reads),
            base.Operator("companion.step", of.MOVE, self.move),
            base.Operator("companion.accretion", of.EVENT, self.event),
        ]

    def accelerate(self, view: base.View) -> None:
        bodies, places = view.bodies, view.bodies.felt_pos
        away = view.from_centre(places[1:]) if view.centre is not None else places[1:] - places[0]
        distances = np.sqrt((away**2).sum(axis=1))
        for k, companion in enumerate(self.companions):
            self._lengths[k] = softening(self.scene, companion, float(distances[k]), view.central_mass)
        for name, p in view.species.items():
            self._near[name] = np.full((len(self.companions), 2), np.inf)
            for k in range(len(self.companions)):
                given = bodies.felt[k + 1], self._lengths[k], *places[k + 1].tolist(), *bodies.vel[k + 1].tolist()
                found = parallel_for(kernels.attract_moving, p.count, p.pos, p.vel, p.acc, p.mass, *given)
                bodies.pulled[k + 1, SPECIES.index(name)] = rounded(sum(limbs for limbs, _ in found))
                self._near[name][k] = np.min([near for _, near in found], axis=0)
        self.orbits.accelerate(bodies)

    def limit(self, view: base.View) -> dict[str, base.Limit]:
        felt, places = view.bodies.felt[1:], view.bodies.felt_pos[1:]
        there = felt > 0.0  # a ramp begins with 0, which sets no limit
        found = {base.ALL: self._limit(self.orbits.limit(view.bodies))}
        for name, p in view.species.items():
            near, crossing = self._near[name][there].T
            squared = (near + self._lengths[there] ** 2) ** 1.5 / felt[there]
            shortest = float(np.sqrt(min(squared.min(initial=np.inf), crossing.min(initial=np.inf))))
            found[name] = self._limit(shortest, partial(self._nearest_row, p.pos, places))
        return found

    def _limit(self, shortest: float, row: Callable[[], int] | None = None) -> base.Limit:
        """Return the limit by an orbit or an encounter with 1 / frequency `shortest`."""
        step = IN_KICKS * shortest
        return base.Limit(step, base.GROWS / IN_KICKS * step, row, SOFTER)

    def _nearest_row(self, pos: np.ndarray, places: np.ndarray) -> int:
        away = ((pos[:, None] - places) ** 2).sum(axis=2) + self._lengths**2
        return int(away.min(axis=1).argmin())

    def move(self, state: State, dt: float) -> None:
        self._dt = dt

    def event(self, state: State) -> None:
        bodies = _bodies(state)
        for k, companion in enumerate(self.companions):
            if companion.accretion_radius > 0.0:
                place = bodies.felt_pos[k + 1].tolist()
                for name in state.species:
                    self._accrete(state, k, name, place)
        self.orbits.place(bodies, state.time)

    def _accrete(self, state: State, k: int, name: str, place: list[float]) -> None:
        """Remove the particles of species `name` that companion `k`, at `place`, accretes in the step just made."""
        companion, p = self.companions[k], state.species[name]
        found = parallel_for(kernels.split_by_radius, p.count, p.pos, companion.accretion_radius**2, *place)
        gone = np.concatenate([inside for _, inside in found])
        if companion.accretion_rate is not None:
            kept = _chances(self.scene.run.seed, state.step + state.earlier, k, p.ids[gone]) >= self._share(state, k)
            gone = gone[~kept]
        if world.processes.most(len(gone)) > 0:
            taken = accreted_from(state, name, gone)
            accrete(state, k + 1, name, gone, taken, grows=True, moves=bool(self.orbits.live[k]))
            p.remove(gone)

    def _share(self, state: State, k: int) -> float:
        """Return the share of the particles within the radius that is accreted in the step just made."""
        bodies = _bodies(state)
        r = math.dist(bodies.pos[k + 1], bodies.pos[0])
        period = 2.0 * math.pi * math.sqrt(r**3 / (bodies.mass[0] + bodies.mass[k + 1]))
        return -math.expm1(-self.companions[k].accretion_rate * self._dt / period)

    def potential_energy(self, state: State) -> float:
        """Return the energy of gas and dust in the field of the companions."""
        bodies, energy = _bodies(state), 0.0
        for p in state.species.values():
            for k in range(len(self.companions)):
                distance = np.sqrt(((p.pos - bodies.felt_pos[k + 1]) ** 2).sum(axis=1) + self._lengths[k] ** 2)
                energy -= total(p.mass * bodies.felt[k + 1] / distance)
        return energy


def _bodies(state: State) -> Bodies:
    assert state.bodies is not None
    return state.bodies


def _chances(seed: int, step: int, companion: int, ids: np.ndarray) -> np.ndarray:
    """Return numbers in [0, 1) (n,) that depend on seed, step, companion and particle ids alone.

    A counter-based hash makes them (splitmix64; Steele et al. 2014).
    """
    golden = np.uint64(0x9E3779B97F4A7C15)
    z = ids.astype(np.uint64)
    for word in (seed, step, companion):
        z = (z + np.uint64(word % 2**64)) * golden
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        z ^= z >> np.uint64(31)
    return (z >> np.uint64(11)) * 2.0**-53
