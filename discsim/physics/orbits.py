"""How the star and its companions move: each companion r_k from the star on its Kepler orbit, the rest in the kick.

    drift   r_k on the orbit about GM = mu_k, and x_0 + sum_k w_k r_k, x_0 the star's place, uniformly          (1)
    kick    r_k'' = A_k - A_0 + mu_k r_k / |r_k|^3,   x_0'' = A_0 - sum_k w_k mu_k r_k / |r_k|^3                (2)

A are all accelerations in an inertial frame, so that drift and kick together are the equations of motion whatever mu
and w. With mu_k = M + m_k and w_k = m_k / (M + sum m) the drift keeps the momentum, and the orbit of a single
companion is exact. mu_k = M where the star does not feel companions, and 0 for one that does not feel the star. A fixed
orbit has the mu of its full mass for good, and w_k = m_k / mu_k: the star then has the acceleration that it should.
In the frame of the star x_0 = 0, and particles get the opposite of its motion, in drift and kick alike, so that the run
is the same to rounding. The kicks of several live companions on each other are of second order and reversible.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from discsim.exact import kepler
from discsim.numerics.bodies import Bodies
from discsim.physics.companions import mass_at

if TYPE_CHECKING:
    from discsim.scene import Scene

Array = np.ndarray


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
        self.star = star
        self.orbits = [(c.semi_major_axis, c.eccentricity, math.radians(c.phase)) for c in self.companions]
        self.fixed_mu = [star.mass + self.back * c.mass for c in self.companions]

    def at_start(self, under_way: Mapping[int, UnderWay] | None = None) -> Bodies:
        """The bodies at t = 0: the centre of the disc at rest at the origin; some may be under way, the star as 0."""
        under_way = under_way or {}
        bodies = Bodies.at_rest(np.zeros(1 + len(self.companions)))
        for number, body in under_way.items():
            bodies.gained[number], bodies.begun[number] = body.gained, body.begun
        bodies.mass = self._masses(bodies, 0.0)
        mu, weight = self._weights(bodies.mass)
        for k, orbit in enumerate(self.orbits):
            if not self.live[k]:
                found = self._fixed(bodies, k, 0.0)
            elif k + 1 in under_way:
                found = kepler.Motion(*under_way[k + 1].pos.tolist(), *under_way[k + 1].vel.tolist())
            else:
                found = kepler.at_anomaly(mu[k] or self.fixed_mu[k], *orbit)
            bodies.pos[k + 1], bodies.vel[k + 1] = found[:2], found[2:]
        if self.star.centre == "barycentre":
            away = _sum(weight, bodies.pos[1:]), _sum(weight, bodies.vel[1:])
            bodies.pos -= away[0]
            bodies.vel -= away[1]
        return bodies

    def offset(self, bodies: Bodies) -> tuple[Array, Array]:
        """Place and velocity (2,) of the centre of the disc at t = 0 in the frame of the run."""
        if not self.inertial or self.star.centre == "barycentre":
            return np.zeros(2), np.zeros(2)
        _, weight = self._weights(bodies.mass)
        r, v = bodies.pos[1:] - bodies.pos[0], bodies.vel[1:] - bodies.vel[0]
        return -_sum(weight, r), -_sum(weight, v)

    def drift(self, bodies: Bodies, time: float, dt: float) -> tuple[Array, Array]:
        """Eq. (1) from `time` over dt, with the masses at its middle.

        Returns how far the star has left its straight line, and the change of its velocity (2,).
        """
        mass = self._masses(bodies, time + 0.5 * dt)
        mu, weight = self._weights(mass)
        r, v = bodies.pos[1:] - bodies.pos[0], bodies.vel[1:] - bodies.vel[0]
        after, faster = np.empty_like(r), np.empty_like(v)
        for k in range(len(r)):
            motion = kepler.Motion(*r[k].tolist(), *v[k].tolist())
            found = kepler.drift(mu[k], motion, dt) if self.live[k] else self._fixed(bodies, k, time + dt)
            after[k], faster[k] = found[:2], found[2:]
        off, turned = -_sum(weight, after - r - dt * v), -_sum(weight, faster - v)
        if self.inertial:
            bodies.pos[0] += dt * bodies.vel[0] + off
            bodies.vel[0] += turned
        bodies.pos[1:], bodies.vel[1:] = bodies.pos[0] + after, bodies.vel[0] + faster
        return off, turned

    def place(self, bodies: Bodies, time: float) -> None:
        """Put companions on fixed orbits where they are at a time, and give all the masses that they have."""
        bodies.mass = self._masses(bodies, time)
        for k in np.flatnonzero(~self.live).tolist():
            found = self._fixed(bodies, k, time)
            bodies.pos[k + 1], bodies.vel[k + 1] = bodies.pos[0] + found[:2], bodies.vel[0] + found[2:]

    def pull_on_star(self, bodies: Bodies, beyond_drift: bool) -> Array:
        """A_0 (2,), of gas and dust as `bodies.pulled` has it; or x_0'' of eq. (2), without what the drift has."""
        weight = self.back * bodies.mass[1:]
        if beyond_drift:
            mu, of_drift = self._weights(bodies.mass)
            weight = weight - of_drift * mu
        return self._by_disc(bodies, 0, self.felt_by_star) + _sum(weight, _directions(bodies.pos[1:] - bodies.pos[0]))

    def accelerate(self, bodies: Bodies) -> None:
        """Eq. (2) into `acc`, without differences of what cancels."""
        mass, back = bodies.mass[1:], self.back
        r = bodies.pos[1:] - bodies.pos[0]
        to = _directions(r)
        by_disc = self._by_disc(bodies, 0, self.felt_by_star)
        bodies.acc[:] = self.pull_on_star(bodies, beyond_drift=True) if self.inertial else 0.0
        for k in np.flatnonzero(self.live).tolist():
            others = np.arange(len(r)) != k
            kick = self._by_disc(bodies, k + 1, self.feels[k]) - by_disc - _sum(back * mass[others], to[others])
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

    def _masses(self, bodies: Bodies, time: float) -> Array:
        grown = (mass_at(c, time - begun) for c, begun in zip(self.companions, bodies.begun[1:], strict=True))
        return np.array([self.star.mass, *grown]) + bodies.gained

    def _weights(self, mass: Array) -> tuple[list[float], Array]:
        """mu_k and w_k of masses (n,), the star's first."""
        mu = [
            (mass[0] + self.back * mass[k + 1]) * ("star" in self.feels[k]) if self.live[k] else self.fixed_mu[k]
            for k in range(len(self.companions))
        ]
        about = self.live & (np.array(mu) > 0.0)
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
