"""How the star and its companions move: each companion r_k from the star on its Kepler orbit, the rest in the kick.

    drift   r_k on the orbit about GM = mu_k, and x_0 + sum_k w_k r_k, x_0 the star's place, uniformly          (1)
    kick    r_k'' = A_k - A_0 + mu_k r_k / |r_k|^3,   x_0'' = A_0 - sum_k w_k mu_k r_k / |r_k|^3                (2)

A are all accelerations in an inertial frame, so that drift and kick together are the equations of motion whatever mu
and w. With mu_k = M + m_k and w_k = m_k / (M + sum m) the drift keeps the momentum, and the orbit of a single
companion is exact. mu_k = M where the star does not feel companions, and 0 for one that does not feel the star. A fixed
orbit has w_k = m_k / mu_k: the star then has the acceleration that it should.
In the frame of the star x_0 = 0, and particles get the opposite of its motion, in drift and kick alike, so that the run
is the same to rounding. The kicks of several live companions on each other are of second order and reversible.

A ramp f_k(t), from 0 to 1, is in what companion and disc do to each other; star and companions have their whole mass
for each other, and the orbits that it gives, from the start. Gas and dust feel

    companions   f_k m_k,      star   M + sum_c (1 - f_k) m_k                                                   (3)
    places       x_j + sum_c (1 - f_k) w_k r_k                                                                  (4)

with c the companions that the disc turns about (`formulas/centre.py`): about a barycentre the mass of a companion is at
first that of the star, which is then at the barycentre, and moves out to its orbit. The masses of (3) at the places of
(4) have the barycentre and the sum of all masses at any f, so that a ramp moves neither. Of other companions the star's
acceleration is part of what is ramped: gas and dust get f_k of it in the star's frame, and in an inertial frame are
carried along with the star by 1 - f_k of it, so that a disc about the star gets no push before it feels what balances
it. By the disc a companion gets f_k (A_k - A_0) from the star: the same forces, turned round.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from discsim.exact import kepler
from discsim.numerics.bodies import Bodies
from discsim.physics.centre import central
from discsim.physics.companions import ramped
from discsim.physics.radiation import pull_share

if TYPE_CHECKING:
    from discsim.scene import Scene

Array = np.ndarray
# Over 1/Omega, of what a leapfrog integrates: with the default Courant factor about a star 21 steps a turn.
IN_KICKS = 0.5


def feels(scene: Scene, companion: Any) -> frozenset[str]:
    """What a companion feels: star, companions, gas, dust."""
    if companion.orbit == "fixed":
        return frozenset()
    if companion.feels is not None:
        return frozenset(companion.feels)
    return frozenset({"star", "companions", *pulling(scene)})


def pulling(scene: Scene) -> list[str]:
    """The species that may pull bodies: one-way dust beside gas must not, as the gas would notice."""
    one_way = scene.drag is not None and scene.drag.direction == "one-way" and scene.gas is not None
    return [name for name in ("gas", "dust") if getattr(scene, name) is not None and not (name == "dust" and one_way)]


def felt_by_star(scene: Scene) -> frozenset[str]:
    """Whose pull on the star counts: companions, gas, dust."""
    star: Any = scene.star
    if star.indirect is not None:
        return frozenset(star.indirect)
    found = {"companions"} if scene.table("companion") else set()
    if scene.self_gravity is not None:
        found |= {name for name in pulling(scene) if name in scene.self_gravity.sources}
    return frozenset(found)


def orbital_mass(scene: Scene, star: float, companion: float) -> float:
    """GM of the orbit of a companion of that mass about a star of that mass: the star's alone where it feels none."""
    return star + companion if "companions" in felt_by_star(scene) else star


def at_rest(scene: Scene) -> bool:
    """Return True if the star has a constant mass and stays at the origin. Such a scene has no `Bodies`."""
    star = scene.star
    if star is None:
        return True
    return scene.table("companion") is None and star.frame == "star" and not star.grows and not felt_by_star(scene)


def in_drift(scene: Scene) -> bool:
    """Return True if gas and dust drift on Kepler orbits about the star. Then no kick contains the star's pull.

    The star has to be a point at rest: a moving star exchanges momentum with every particle, which only a kick
    conserves exactly. Radiation pressure with drag excludes it: the drag needs the push on dust in the kick, and the
    pull that nearly cancels this push has to be there too.
    """
    star = scene.star
    pointlike = star is not None and star.softening == 0.0 and at_rest(scene)
    pushed = scene.radiation_pressure is not None and scene.drag is not None
    return pointlike and not pushed and scene.model.given is None and scene.run.integrator == "kdk"


def masses_in_drift(scene: Scene, species: str) -> Array | None:
    """Central masses (populations,) of the orbits that gas or dust drifts on; None where it moves straight on."""
    if not in_drift(scene):
        return None
    assert scene.star is not None
    return scene.star.mass * (pull_share(scene) if species == "dust" else np.ones(1))


def velocities_turn(scene: Scene) -> bool:
    """Return True if the drift rotates velocities and positions on a circle by the same angle.

    Otherwise velocities are half a step ahead of positions, or behind them.
    """
    return scene.model.given is not None or in_drift(scene)


def step_of_circle(scene: Scene) -> float:
    """Step limit by circles about the star, over their 1/Omega."""
    return 1.0 if velocities_turn(scene) else IN_KICKS


class UnderWay(NamedTuple):
    """A body that is on its way at t = 0: place and velocity from the star (2,), mass gained, and when it began."""

    pos: Array
    vel: Array
    gained: float
    begun: float


class Orbits:
    """The motion of the bodies of a scene."""

    def __init__(self, scene: Scene) -> None:
        star: Any = scene.star
        self.companions: tuple[Any, ...] = scene.table("companion") or ()
        self.feels = [feels(scene, c) for c in self.companions]
        self.live = np.array([c.orbit == "live" for c in self.companions], bool)
        self.felt_by_star = felt_by_star(scene)
        self.back = float("companions" in self.felt_by_star)  # whether the star feels companions
        self.inertial = star.frame == "inertial"
        self.central = central(scene)[1:]  # companions that the disc turns about
        self.star = star
        self.orbits = [(c.semi_major_axis, c.eccentricity, math.radians(c.phase)) for c in self.companions]
        self.fixed_mu = [orbital_mass(scene, star.mass, c.mass) for c in self.companions]

    def at_start(self, under_way: Mapping[int, UnderWay] | None = None) -> Bodies:
        """The bodies at t = 0: the centre of the disc at rest at the origin; some may be under way, the star as 0."""
        under_way = under_way or {}
        bodies = Bodies.at_rest(np.zeros(1 + len(self.companions)))
        for number, body in under_way.items():
            bodies.gained[number], bodies.begun[number] = body.gained, body.begun
        bodies.mass = self._masses(bodies)
        mu, _ = self._weights(bodies.mass)
        for k, orbit in enumerate(self.orbits):
            if not self.live[k]:
                found = self._fixed(bodies, k, 0.0)
            elif k + 1 in under_way:
                found = kepler.Motion(*under_way[k + 1].pos.tolist(), *under_way[k + 1].vel.tolist())
            else:
                found = kepler.at_anomaly(mu[k] or self.fixed_mu[k], *orbit)
            bodies.pos[k + 1], bodies.vel[k + 1] = found[:2], found[2:]
        if self.star.centre == "barycentre":
            weight = self._of_centre(bodies)
            away = _sum(weight, bodies.pos[1:]), _sum(weight, bodies.vel[1:])
            bodies.pos -= away[0]
            bodies.vel -= away[1]
        self.place(bodies, 0.0)
        return bodies

    def offset(self, bodies: Bodies) -> tuple[Array, Array]:
        """Place and velocity (2,) of the centre of the disc at t = 0 in the frame of the run."""
        if not self.inertial or self.star.centre == "barycentre":
            return np.zeros(2), np.zeros(2)
        _, weight = self._weights(bodies.mass)
        r, v = bodies.pos[1:] - bodies.pos[0], bodies.vel[1:] - bodies.vel[0]
        return -_sum(weight, r), -_sum(weight, v)

    def drift(self, bodies: Bodies, time: float, dt: float) -> tuple[Array, Array]:
        """Eq. (1) from `time` over dt.

        Returns how far gas and dust move with the frame beyond a straight line, and the change of their velocity (2,),
        with the ramps at the middle of dt.
        """
        mu, weight = self._weights(bodies.mass)
        r, v = bodies.pos[1:] - bodies.pos[0], bodies.vel[1:] - bodies.vel[0]
        after, faster = np.empty_like(r), np.empty_like(v)
        for k in range(len(r)):
            motion = kepler.Motion(*r[k].tolist(), *v[k].tolist())
            found = kepler.drift(mu[k], motion, dt) if self.live[k] else self._fixed(bodies, k, time + dt)
            after[k], faster[k] = found[:2], found[2:]
        off, turned = after - r - dt * v, faster - v
        if self.inertial:
            bodies.pos[0] += dt * bodies.vel[0] - _sum(weight, off)
            bodies.vel[0] -= _sum(weight, turned)
        bodies.pos[1:], bodies.vel[1:] = bodies.pos[0] + after, bodies.vel[0] + faster
        carried = -weight * self._carried(self._ramps(bodies, time + 0.5 * dt))
        return _sum(carried, off), _sum(carried, turned)

    def place(self, bodies: Bodies, time: float) -> None:
        """Put companions on fixed orbits where they are at a time, and give all the masses that they have and that gas
        and dust feel, eqs. (3) and (4).
        """
        bodies.mass = self._masses(bodies)
        for k in np.flatnonzero(~self.live).tolist():
            found = self._fixed(bodies, k, time)
            bodies.pos[k + 1], bodies.vel[k + 1] = bodies.pos[0] + found[:2], bodies.vel[0] + found[2:]
        ramp, mass = self._ramps(bodies, time), bodies.mass[1:]
        inside = np.where(self.central, 1.0 - ramp, 0.0)  # what is still at the star
        bodies.felt = np.array([bodies.mass[0] + (inside * mass).sum(), *(ramp * mass)])
        bodies.shift = _sum(inside * self._of_centre(bodies), bodies.pos[1:] - bodies.pos[0])

    def frame_acceleration(self, bodies: Bodies, beyond_drift: bool) -> Array:
        """Acceleration (2,) that gas and dust get of the frame, `beyond_drift` without what the drift has."""
        carried = self._carried(bodies.felt[1:] / bodies.mass[1:])
        found = _sum(carried * self._on_star(bodies, beyond_drift), _directions(bodies.pos[1:] - bodies.pos[0]))
        return found if self.inertial else found - self._by_disc(bodies, 0, self.felt_by_star)

    def accelerate(self, bodies: Bodies) -> None:
        """Eq. (2) into `acc`, without differences of what cancels."""
        mass, back = bodies.mass[1:], self.back
        r = bodies.pos[1:] - bodies.pos[0]
        to = _directions(r)
        by_disc = self._by_disc(bodies, 0, self.felt_by_star)
        bodies.acc[:] = by_disc + _sum(self._on_star(bodies, beyond_drift=True), to) if self.inertial else 0.0
        ramp = bodies.felt[1:] / mass
        for k in np.flatnonzero(self.live).tolist():
            others = np.arange(len(r)) != k
            kick = ramp[k] * (self._by_disc(bodies, k + 1, self.feels[k]) - by_disc)
            kick -= _sum(back * mass[others], to[others])
            if "companions" in self.feels[k]:
                kick += _sum(mass[others], _directions(r[others] - r[k]))
            if "star" not in self.feels[k]:
                kick -= back * mass[k] * to[k]
            bodies.acc[k + 1] += kick

    def limit(self, bodies: Bodies) -> float:
        """1 / Omega of the companions about the star where they are, and of pairs of them about each other."""
        longest = math.inf
        for k in range(1, bodies.count):
            for j in range(k):
                if j == 0 or self.live[k - 1] or self.live[j - 1]:
                    distance, mass = math.dist(bodies.pos[k], bodies.pos[j]), bodies.mass[k] + bodies.mass[j]
                    longest = min(longest, math.sqrt(distance**3 / mass) if mass > 0.0 else math.inf)
        return longest

    def _by_disc(self, bodies: Bodies, number: int, felt: Iterable[str]) -> Array:
        return bodies.pulled[number][[name in felt for name in ("gas", "dust")]].sum(axis=0)

    def _fixed(self, bodies: Bodies, k: int, time: float) -> kepler.Motion:
        """Place and velocity from the star, in closed form of the time."""
        time -= float(bodies.begun[k + 1])
        size, e, phase = self.orbits[k]
        mu = self.fixed_mu[k]
        return kepler.at_mean_anomaly(mu, size, e, kepler.mean_anomaly(e, phase) + math.sqrt(mu / size**3) * time)

    def _masses(self, bodies: Bodies) -> Array:
        return np.array([self.star.mass, *(c.mass for c in self.companions)]) + bodies.gained

    def _ramps(self, bodies: Bodies, time: float) -> Array:
        """f_k (n,) of eqs. (3) and (4) at a time."""
        return np.array([ramped(c, time - begun) for c, begun in zip(self.companions, bodies.begun[1:], strict=True)])

    def _carried(self, ramp: Array) -> Array:
        """How much of the star's motion by each companion (n,) gas and dust have in the frame of the run."""
        return np.where(self.central, 0.0, float(self.inertial) - ramp)

    def _on_star(self, bodies: Bodies, beyond_drift: bool) -> Array:
        """GM (n,) of the pull of each companion on the star; `beyond_drift` without what the drift has."""
        pull = self.back * bodies.mass[1:]
        if not beyond_drift:
            return pull
        mu, weight = self._weights(bodies.mass)
        return pull - weight * mu

    def _of_centre(self, bodies: Bodies) -> Array:
        """w_k (n,) of the companions that the disc turns about, of these alone; 0 of others."""
        return np.where(self.central, self._weights(bodies.mass, self.central)[1], 0.0)

    def _weights(self, mass: Array, among: Array | bool = True) -> tuple[list[float], Array]:
        """mu_k and w_k of masses (n,), the star's first; w_k where there are the companions `among` (n,) alone."""
        mu = [
            (mass[0] + self.back * mass[k + 1]) * ("star" in self.feels[k]) if self.live[k] else self.fixed_mu[k]
            for k in range(len(self.companions))
        ]
        about = self.live & among & (np.array(mu) > 0.0)
        total = mass[0] + mass[1:][about].sum()
        weight = [
            self.back * m / (total if live else one) if one > 0.0 else 0.0
            for m, live, one in zip(mass[1:], self.live, mu, strict=True)
        ]
        return [float(one) for one in mu], np.array(weight)


def _sum(weight: Array, vectors: Array) -> Array:
    """sum_k w_k x_k (2,) of vectors (n, 2)."""
    return np.asarray((weight[:, None] * vectors).sum(axis=0))


def _directions(r: Array) -> Array:
    """r / |r|^3 (n, 2)."""
    with np.errstate(all="ignore"):  # of bodies at one place: what comes of it is no number, and told as such
        return r / np.sqrt((r * r).sum(axis=1))[:, None] ** 3
