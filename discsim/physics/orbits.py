"""Motion of the star and its companions, split into drift and kick.

The drift moves companion k, at r_k from the star, on a Kepler orbit; the kick has all other accelerations. With the
position x_0 of the star,

    drift   r_k moves on a Kepler orbit about GM = mu_k, and x_0 + sum_k w_k r_k moves uniformly                (1)
    kick    r_k'' = A_k - A_0 + mu_k r_k / |r_k|^3,   x_0'' = A_0 - sum_k w_k mu_k r_k / |r_k|^3                (2)

A_k and A_0 are the total accelerations of companion and star in an inertial frame, so that drift and kick together are
the equations of motion for any mu and w. With mu_k = M + m_k and w_k = m_k / (M + sum m) the drift conserves momentum,
and the orbit of a single companion is exact. If the star does not feel companions, mu_k = M; for a companion that does
not feel the star, mu_k = 0. A fixed orbit has w_k = m_k / mu_k, which gives the star the right acceleration.

In the frame of the star x_0 = 0, and in both drift and kick particles move opposite to the star's motion in an inertial
frame. Runs in both frames agree to rounding. The kicks of several live companions on each other are of second order
and reversible.

A ramp f_k(t), from 0 to 1, scales the forces between companion and disc. Star and companions feel each other's full
masses from the start, and have the corresponding orbits. Gas and dust feel

    masses       companions: f_k m_k,      star: M + sum_c (1 - f_k) m_k                                        (3)
    positions    x_j + sum_c (1 - f_k) w_k r_k, for the star and each companion j                               (4)

where the sums are over the companions c that are part of the disc's central mass (`formulas/centre.py`). If the disc is
about a barycentre, the mass of a companion is at first added to that of the star, which is placed at the barycentre;
as f_k grows, the mass moves out to the orbit. The masses (3) at the positions (4) have the same barycentre and total
mass at any f.

Other companions also accelerate the star. In the frame of the star, gas and dust feel the fraction f_k of the
corresponding frame acceleration; in an inertial frame they move with the star by the fraction 1 - f_k of it. A disc
about the star thus feels this acceleration only together with the companion's pull that balances it. The disc
accelerates a companion relative to the star by f_k (A_k - A_0), by the opposite forces.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from discsim.exact import kepler
from discsim.formulas import centre as formulas
from discsim.numerics.bodies import Bodies
from discsim.physics.centre import central_mask
from discsim.physics.companions import ramp_fraction
from discsim.physics.radiation import gravity_factor

if TYPE_CHECKING:
    from discsim.scene import Scene

Array = np.ndarray
# Step limit of orbits that a leapfrog integrates, over 1/Omega: with the default Courant factor 21 steps per orbit.
IN_KICKS = 0.5


def feels(scene: Scene, companion: Any) -> frozenset[str]:
    """Return the names of the sources that accelerate a companion; no names if its orbit is fixed.

    The names are "star", "companions", "gas" and "dust".
    """
    if companion.orbit == "fixed":
        return frozenset()
    if companion.feels is not None:
        return frozenset(companion.feels)
    return frozenset({"star", "companions", *pulling_species(scene)})


def pulling_species(scene: Scene) -> list[str]:
    """Return the names of the species that may accelerate the star and the companions.

    With one-way drag by [gas], dust is excluded, as the accelerated bodies would change the motion of the gas.
    """
    one_way = scene.drag is not None and scene.drag.direction == "one-way" and scene.gas is not None
    return [name for name in ("gas", "dust") if getattr(scene, name) is not None and not (name == "dust" and one_way)]


def felt_by_star(scene: Scene) -> frozenset[str]:
    """Return the names of the sources that accelerate the star: "companions", "gas" and "dust", or some of them."""
    if scene.star.indirect is not None:
        return frozenset(scene.star.indirect)
    found = {"companions"} if scene.table("companion") else set()
    if scene.self_gravity is not None:
        found |= {name for name in pulling_species(scene) if name in scene.self_gravity.sources}
    return frozenset(found)


def orbital_mass(scene: Scene, star: float, companion: float) -> float:
    """Return GM of an orbit: the sum of two masses, or `star` if companions do not accelerate the star."""
    return formulas.orbital_mass(star, companion, scene.star.indirect)


def is_star_at_rest(scene: Scene) -> bool:
    """Return whether the star has a constant mass and stays at the origin. The state then has no `bodies`."""
    star = scene.star
    if star is None:
        return True
    return scene.table("companion") is None and star.frame == "star" and not star.grows and not felt_by_star(scene)


def star_acts_in_drift(scene: Scene) -> bool:
    """Return whether gas and dust drift on Kepler orbits about the star; kicks then exclude the star's pull.

    The star has to be a point at rest, as the momentum that particles exchange with a moving star is conserved only in
    kicks. Radiation pressure with drag excludes Kepler drifts: drag needs the radiation force on dust in the kick, and
    the stellar pull that nearly cancels this force has to be in the kick too.
    """
    star = scene.star
    pointlike = star is not None and star.softening == 0.0 and is_star_at_rest(scene)
    pushed = scene.radiation_pressure is not None and scene.drag is not None
    return pointlike and not pushed and not scene.model.star_in_kick and scene.run.integrator == "kdk"


def drift_masses(scene: Scene, species: str) -> Array | None:
    """Return the central masses (populations,) of the Kepler drifts of a species; None for drifts on straight lines."""
    if not star_acts_in_drift(scene):
        return None
    return scene.star.mass * (gravity_factor(scene) if species == "dust" else np.ones(1))


def drift_rotates_velocities(scene: Scene) -> bool:
    """Return whether the drift of a circular orbit rotates velocity and position by the same angle.

    Otherwise the angle of the velocity is half a step ahead of the angle of the position, or behind it.
    """
    return scene.model.given is not None or star_acts_in_drift(scene)


def circular_step_limit(scene: Scene) -> float:
    """Return the step limit of circular orbits about the star, in units of 1/Omega."""
    return 1.0 if drift_rotates_velocities(scene) else IN_KICKS


class ContinuedBody(NamedTuple):
    """Star or companion of a snapshot from which a new run continues.

    pos, vel (2,): position and velocity relative to the star. gained: accreted mass. begun: time of the new run at
    which the body was added; below 0 if this was before its start.
    """

    pos: Array
    vel: Array
    gained: float
    begun: float


class Orbits:
    """Equations of motion of the star and companions of a scene, eqs. (1) to (4).

    Arrays and lists have an entry for each companion. feels: names of the sources that accelerate the companion.
    live: whether the orbit is live. felt_by_star: names of the sources that accelerate the star. recoil: 1.0 if
    companions accelerate the star, else 0.0. inertial: whether the frame is inertial. central: whether the companion
    is part of the central mass. orbits: semi-major axis, eccentricity and phase. fixed_mu: GM of the orbit.
    """

    def __init__(self, scene: Scene) -> None:
        star = scene.star
        self.companions: tuple[Any, ...] = scene.table("companion") or ()
        self.feels = [feels(scene, c) for c in self.companions]
        self.live = np.array([c.orbit == "live" for c in self.companions], bool)
        self.felt_by_star = felt_by_star(scene)
        self.recoil = float("companions" in self.felt_by_star)
        self.inertial = star.frame == "inertial"
        self.central = central_mask(scene)[1:]
        self.star = star
        self.orbits = [(c.semi_major_axis, c.eccentricity, math.radians(c.phase)) for c in self.companions]
        self.fixed_mu = [orbital_mass(scene, star.mass, c.mass) for c in self.companions]

    def initial_bodies(self, under_way: Mapping[int, ContinuedBody] | None = None) -> Bodies:
        """Return the bodies at t = 0, with the centre of the disc at rest at the origin.

        under_way: bodies that a run continues from a snapshot, by number; the star is 0.
        """
        under_way = under_way or {}
        bodies = Bodies.at_rest(np.zeros(1 + len(self.companions)))
        for number, body in under_way.items():
            bodies.gained[number], bodies.begun[number] = body.gained, body.begun
        bodies.mass = self._masses(bodies)
        mu, _ = self._weights(bodies.mass)
        for k, orbit in enumerate(self.orbits):
            if not self.live[k]:
                found = self._fixed_orbit(bodies, k, 0.0)
            elif k + 1 in under_way:
                found = kepler.Motion(*under_way[k + 1].pos.tolist(), *under_way[k + 1].vel.tolist())
            else:
                found = kepler.motion_at_anomaly(mu[k] or self.fixed_mu[k], *orbit)
            bodies.pos[k + 1], bodies.vel[k + 1] = found[:2], found[2:]
        if self.star.centre == "barycentre":
            weight = self._central_weights(bodies)
            away = _weighted_sum(weight, bodies.pos[1:]), _weighted_sum(weight, bodies.vel[1:])
            bodies.pos -= away[0]
            bodies.vel -= away[1]
        self.set_bodies(bodies, 0.0)
        return bodies

    def centre_of_disc(self, bodies: Bodies) -> tuple[Array, Array]:
        """Return the initial position (2,) and velocity (2,) of the disc's centre in the frame of the run.

        bodies: result of `initial_bodies`.
        """
        if not self.inertial or self.star.centre == "barycentre":
            return np.zeros(2), np.zeros(2)
        _, weight = self._weights(bodies.mass)
        r, v = bodies.pos[1:] - bodies.pos[0], bodies.vel[1:] - bodies.vel[0]
        return -_weighted_sum(weight, r), -_weighted_sum(weight, v)

    def drift(self, bodies: Bodies, time: float, dt: float) -> tuple[Array, Array]:
        """Drift `bodies` in place over dt, eq. (1); return what the acceleration of the frame adds to gas and dust.

        The result is a displacement (2,), in addition to motion on straight lines, and a velocity change (2,). Ramps
        are evaluated at the middle of dt.
        """
        mu, weight = self._weights(bodies.mass)
        r, v = bodies.pos[1:] - bodies.pos[0], bodies.vel[1:] - bodies.vel[0]
        new_r, new_v = np.empty_like(r), np.empty_like(v)
        for k in range(len(r)):
            motion = kepler.Motion(*r[k].tolist(), *v[k].tolist())
            found = kepler.drift(mu[k], motion, dt) if self.live[k] else self._fixed_orbit(bodies, k, time + dt)
            new_r[k], new_v[k] = found[:2], found[2:]
        shift, change = new_r - r - dt * v, new_v - v
        if self.inertial:
            bodies.pos[0] += dt * bodies.vel[0] - _weighted_sum(weight, shift)
            bodies.vel[0] -= _weighted_sum(weight, change)
        bodies.pos[1:], bodies.vel[1:] = bodies.pos[0] + new_r, bodies.vel[0] + new_v
        factors = -weight * self._frame_factors(self._ramps(bodies, time + 0.5 * dt))
        return _weighted_sum(factors, shift), _weighted_sum(factors, change)

    def set_bodies(self, bodies: Bodies, time: float) -> None:
        """Set `bodies` at `time`: masses, companions on fixed orbits, and the gravity on gas and dust, eqs. (3), (4).

        In `bodies.felt` and `bodies.shift` are the masses and positions that act on gas and dust.
        """
        bodies.mass = self._masses(bodies)
        for k in np.flatnonzero(~self.live).tolist():
            found = self._fixed_orbit(bodies, k, time)
            bodies.pos[k + 1], bodies.vel[k + 1] = bodies.pos[0] + found[:2], bodies.vel[0] + found[2:]
        ramp, mass = self._ramps(bodies, time), bodies.mass[1:]
        inside = np.where(self.central, 1.0 - ramp, 0.0)  # share of the mass that is still at the star
        bodies.felt = np.array([bodies.mass[0] + (inside * mass).sum(), *(ramp * mass)])
        bodies.shift = _weighted_sum(inside * self._central_weights(bodies), bodies.pos[1:] - bodies.pos[0])

    def frame_acceleration(self, bodies: Bodies, beyond_drift: bool) -> Array:
        """Return the acceleration (2,) of gas and dust by the motion of the frame.

        beyond_drift: whether to exclude the part of the acceleration that the drift contains.
        """
        pulls = self._frame_factors(bodies.felt[1:] / bodies.mass[1:]) * self._pulls_on_star(bodies, beyond_drift)
        found = _weighted_sum(pulls, _inverse_squares(bodies.pos[1:] - bodies.pos[0]))
        return found if self.inertial else found - self._pull_of_disc(bodies, 0, self.felt_by_star)

    def accelerate(self, bodies: Bodies) -> None:
        """Set `bodies.acc` by eq. (2), without the terms that cancel."""
        mass, recoil = bodies.mass[1:], self.recoil
        r = bodies.pos[1:] - bodies.pos[0]
        to = _inverse_squares(r)  # from the star to the companions
        by_disc = self._pull_of_disc(bodies, 0, self.felt_by_star)
        bodies.acc[:] = (
            by_disc + _weighted_sum(self._pulls_on_star(bodies, beyond_drift=True), to) if self.inertial else 0.0
        )
        ramp = bodies.felt[1:] / mass
        for k in np.flatnonzero(self.live).tolist():
            others = np.arange(len(r)) != k
            kick = ramp[k] * (self._pull_of_disc(bodies, k + 1, self.feels[k]) - by_disc)
            kick -= _weighted_sum(recoil * mass[others], to[others])
            if "companions" in self.feels[k]:
                kick += _weighted_sum(mass[others], _inverse_squares(r[others] - r[k]))
            if "star" not in self.feels[k]:
                kick -= recoil * mass[k] * to[k]
            bodies.acc[k + 1] += kick

    def limit(self, bodies: Bodies) -> float:
        """Return the smallest 1 / Omega = (r^3 / GM)^(1/2) of pairs of bodies at their present distances r.

        Pairs of companions on fixed orbits are excluded.
        """
        longest = math.inf
        for k in range(1, bodies.count):
            for j in range(k):
                if j == 0 or self.live[k - 1] or self.live[j - 1]:
                    distance, mass = math.dist(bodies.pos[k], bodies.pos[j]), bodies.mass[k] + bodies.mass[j]
                    longest = min(longest, math.sqrt(distance**3 / mass) if mass > 0.0 else math.inf)
        return longest

    def _pull_of_disc(self, bodies: Bodies, number: int, felt: Iterable[str]) -> Array:
        """Return the acceleration (2,) of the body `number` by gas and dust.

        A species counts only if `felt` contains its name.
        """
        return bodies.pulled[number][[name in felt for name in ("gas", "dust")]].sum(axis=0)

    def _fixed_orbit(self, bodies: Bodies, k: int, time: float) -> kepler.Motion:
        """Return position and velocity of companion `k` on its fixed orbit, relative to the star."""
        time -= float(bodies.begun[k + 1])
        size, e, phase = self.orbits[k]
        mu = self.fixed_mu[k]
        mean = kepler.mean_anomaly(e, phase) + math.sqrt(mu / size**3) * time
        return kepler.motion_at_mean_anomaly(mu, size, e, mean)

    def _masses(self, bodies: Bodies) -> Array:
        """Return the present masses (n + 1,) of star and companions."""
        return np.array([self.star.mass, *(c.mass for c in self.companions)]) + bodies.gained

    def _ramps(self, bodies: Bodies, time: float) -> Array:
        """Return f_k (n,) of eqs. (3) and (4) at a time."""
        return np.array(
            [ramp_fraction(c, time - begun) for c, begun in zip(self.companions, bodies.begun[1:], strict=True)]
        )

    def _frame_factors(self, ramp: Array) -> Array:
        """Return the motion of gas and dust in the frame of the run as a fraction of the star's motion.

        The result (n,) has a fraction for the motion due to each companion. ramp: f_k (n,).
        """
        return np.where(self.central, 0.0, float(self.inertial) - ramp)

    def _pulls_on_star(self, bodies: Bodies, beyond_drift: bool) -> Array:
        """Return the pull of each companion on the star as GM (n,).

        beyond_drift: whether to exclude the part of the pull that the drift contains.
        """
        pull = self.recoil * bodies.mass[1:]
        if not beyond_drift:
            return pull
        mu, weight = self._weights(bodies.mass)
        return pull - weight * mu

    def _central_weights(self, bodies: Bodies) -> Array:
        """Return w_k (n,) of eq. (1) for companions in the central mass; 0 for other companions.

        The sum in w_k is over companions in the central mass only.
        """
        return np.where(self.central, self._weights(bodies.mass, self.central)[1], 0.0)

    def _weights(self, mass: Array, among: Array | bool = True) -> tuple[list[float], Array]:
        """Return mu_k and w_k of eq. (1) from the masses (n + 1,) of star and companions.

        among (n,): mask of the companions whose masses count in the sum of w_k.
        """
        pairs = (mass[0] + self.recoil * mass[1:]) * np.array(["star" in feels for feels in self.feels], bool)
        mu = np.where(self.live, pairs, self.fixed_mu)
        counted = self.live & among & (mu > 0.0)
        total = mass[0] + mass[1:][counted].sum()
        weight = self.recoil * mass[1:] / np.where(self.live, total, np.where(mu > 0.0, mu, 1.0))
        return mu.tolist(), np.where(mu > 0.0, weight, 0.0)


def _weighted_sum(weight: Array, vectors: Array) -> Array:
    """Return sum_k w_k x_k (2,) of vectors (n, 2)."""
    return np.asarray((weight[:, None] * vectors).sum(axis=0))


def _inverse_squares(r: Array) -> Array:
    """Return r / |r|^3 (n, 2) of the vectors `r` (n, 2)."""
    with np.errstate(all="ignore"):  # bodies at one position give NaN, which is reported elsewhere
        return r / np.sqrt((r * r).sum(axis=1))[:, None] ** 3
