"""Quiet gas: SPH of isothermal discs without the pressure noise of disordered particles in shear (`gas.quiet`).

    d ln rho / dt = -div v + (ln rho_sum - ln rho) (1 / tau + 10 s c_s / h),   P = c_s^2 rho                (1)
    B    = c_s^2 Sigma(r) min(share, 1 - guard sigma) n^2 / (n^2 + 30^2)                                    (2)
    forces of pairs use P - B, and each particle has the acceleration -grad B / rho in addition             (3)

rho_sum is the usual SPH density sum; share, guard and time are keys of gas.quiet; the other symbols are explained
below.

Shear changes the arrangement of particles. The conservative pressure force resists this change and moves particles,
and viscosity turns the motion into heat. This acts like a viscosity with alpha of about 0.004 at h/H = 0.5. There are
two causes: the noise of the summed density, and the term 2 P sum V grad W of the force. In a disordered arrangement
this term does not vanish, even if P is uniform.

Eq. (1) removes the first cause. The density rho follows the flow, with div v of eq. (7) of `kernels/sph/forces.py`. It
relaxes to the summed density within tau = time / Omega, and stays within a factor of 3 of it. Eqs. (2) and (3) remove
the second cause: the mean pressure B of a ring acts on the ring as a whole. Noise stays unless both are removed.

Rings are 0.4 H wide. The surface density Sigma(r), the number n of particles and the scatter sigma of ln(r P / c_s^2)
are sums over the particles of a ring. Each particle contributes to three rings (TSC weights), and the sums are smoothed
twice over neighbouring rings with the weights 1/4, 1/2, 1/4. B is a cubic spline between rings. Pairs with P < B are
under tension and clump, so `guard` keeps B below the pressure of nearly all particles. s is 1 in shocks, where no
velocity gradient exists (`kernels/sph/quiet.py`), and decreases behind them.

Densities of eq. (1) settle a few per cent below Sigma of their ring, while summed densities of disordered particles are
up to 25% above it. In rings with little scatter, drag and snapshots use a density rho' whose mean agrees with Sigma:

    rho' = rho (r Sigma(r) / exp<ln r rho>)^max(0, 1 - 4 sigma)                                             (4)

In a disc with self-gravity the density of a ring also takes the m = 1 pattern of its mass. In each step it is
multiplied by

    exp(share n^2 / (n^2 + 300^2) Re [2 <(1 - l) exp(i phi)> exp(-i phi)]),   l = ln r rho - <ln r rho>     (6)

with means over the mass of the ring, whose sums are smoothed eight times. An eccentric pattern in a disc about a star
stays in place for many orbits, and errors of eq. (1) add up in it: without eq. (6) the pattern of the density has half
of the amplitude of that of the mass, and a phase that differs by 40 to 60 degrees. Eccentric modes of discs with
self-gravity then grow. Without self-gravity they decay, and the noise in the pattern of the mass would only double the
random motion of the gas.

The mean pressure of a periodic plane has no gradient. The density of the plane is the summed one, and

    forces of pairs use P - c_s^2 <Sigma> min(share, 1 - guard sigma)                                       (5)

with the mean surface density and the scatter of all gas. A lattice of SPH particles resists shear like a crystal, by
the term 2 P sum V grad W, and eq. (5) reduces this stiffness by the fraction `share`. Sound waves with kh = 0.56 are
2.6% slow with eq. (5), and 3.7% fast without it.

Forces of pairs conserve momentum and angular momentum, and the acceleration -grad B / rho is radial and has no torque
about the centre. If the star or companions can move, the small net force of this acceleration is subtracted from all
gas, like a force on a rigid body, so that momentum is conserved too.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from discsim.kernels.common import move as moves
from discsim.kernels.sph import quiet as kernels
from discsim.kernels.sph.quiet import FIRST, LOG_X, LOG_Y, MASS, MASS_X, MASS_Y, NUMBER, SECOND
from discsim.numerics import world
from discsim.numerics.operators import View
from discsim.numerics.threads import copied, parallel_for
from discsim.numerics.totals import totals
from discsim.physics.centre import kepler_omega
from discsim.physics.eos import eos_of

if TYPE_CHECKING:
    from discsim.numerics.sph import Sph
    from discsim.numerics.state import Gas
    from discsim.scene import Scene

Array = np.ndarray
WIDTH = 0.4  # width of a ring in H
SPARSE = 30.0  # number of particles in a ring at which B is half of its largest value, eq. (2)
UNEVEN = 4.0  # factor of the scatter in eq. (4): rho' = rho if the scatter is at least 1 / UNEVEN
SMOOTHED = 2  # times that sums over rings are smoothed
MORE = 6  # the same for patterns, in addition: alpha of the noise is 2e-4, and 3e-4 without
CROWDED = 300.0  # number of particles in a ring at which half of its pattern is that of the mass, eq. (6)
MAX_RINGS = 1 << 14
TINY, MAX_LOG_RADIUS = 1e-300, 200.0  # MAX_LOG_RADIUS: largest |ln(r / reference)|, so that areas of rings are finite
BITS = 61  # bits of integer sums, which do not depend on the order of particles


class Rings(NamedTuple):
    """Properties of rings of gas, arrays (count,).

    radius: radius of the middle. mass. density: surface density Sigma, from the mass of the ring. number: particles.
    mean, scatter: mean and standard deviation sigma of ln(r P / c_s^2). excess: ln(radius density) minus this mean; 0
    in rings with few particles.
    """

    radius: Array
    mass: Array
    density: Array
    number: Array
    mean: Array
    scatter: Array
    excess: Array


class QuietPlane:
    """Pressure for the forces between particles of quiet gas in a periodic plane, reduced by eq. (5)."""

    def __init__(self, scene: Scene) -> None:
        self.keys, self.area = scene.gas.quiet, float(np.prod(scene.space.size))

    @contextmanager
    def split_pressure(self, state: View, sph: Sph) -> Iterator[Array]:
        """Return a context manager that yields the pressure (n,) for the SPH forces of pairs, eq. (5)."""
        gas = state.gas
        logs = np.log(gas.density)
        mean, first, second = totals(np.column_stack([gas.mass, logs, logs * logs])) / np.array([self.area, 1.0, 1.0])
        number = gas.global_count
        scatter = np.sqrt(max(second / number - (first / number) ** 2, 0.0))
        fraction = min(max(1.0 - self.keys.guard * scatter, 0.0), self.keys.share)
        yield gas.pressure - fraction * mean * gas.sound_speed**2


class QuietDisc:
    """Densities and mean pressures of rings for quiet gas in a disc, eqs. (1) to (4) and (6).

    reference: radius with the ring coordinate 0. width: width of a ring at the radius `reference`, divided by
    `reference`. flaring: exponent in H / r ~ r^flaring.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene, self.keys = scene, scene.gas.quiet
        eos: Any = scene.gas.eos
        self.reference = float(getattr(eos, "reference_radius", 1.0))
        # H ~ r^(1 + flaring) is exact for power laws. In other discs rings are somewhat narrower or wider than WIDTH.
        self.flaring = 0.5 * (1.0 - eos_of(scene).temperature_slope(eos))
        at = np.array([self.reference])
        speed = eos_of(scene).thermal_speed(scene, at)
        self.width = WIDTH * float((speed / kepler_omega(scene, at) / at)[0])

    @contextmanager
    def split_pressure(self, state: View, sph: Sph) -> Iterator[Array]:
        """Return a context manager that yields the pressure P - B (n,) for the SPH forces of pairs, eq. (3).

        At its beginning the context manager advances the followed density. At its end it adds -grad B / rho to
        `gas.acc_unshared`, and sets density and pressure of the gas by eqs. (1) and (4). sph: SPH sums with the
        velocity gradients of the gas.
        """
        gas = state.gas
        self._advance_density(state, sph)
        pressure, acceleration, correction = self.pair_pressure(state)
        yield pressure
        parallel_for(moves.add_scaled, gas.count, gas.acc_unshared, acceleration, 1.0, light=True)
        gas.density[:] = gas.followed * correction
        gas.pressure *= correction

    def _advance_density(self, state: View, sph: Sph) -> None:
        """Advance `gas.followed`, the density of eq. (1), to the time of the state.

        `gas.pressure` is rescaled in proportion to this density.
        """
        gas = state.gas
        away = np.sqrt((state.from_centre(gas.pos) ** 2).sum(axis=1))
        parallel_for(
            kernels.follow_density, gas.count, state.time, self.keys.time, state.kepler_omega(away), sph.slopes,
            gas.density, gas.pressure, gas.sound_speed, sph.squeezed / gas.h,
            gas.followed, gas.divergence, gas.shocked, gas.followed_at,
        )  # fmt: skip

    def pair_pressure(self, state: View) -> tuple[Array, Array, Array]:
        """Return P - B (n,), the acceleration -grad B / rho (n, 2) of eq. (3), and rho' / rho (n,) of eq. (4).

        With self-gravity the followed density first takes the pattern of eq. (6), and `gas.pressure` is rescaled in
        proportion.
        """
        gas, pos = state.gas, state.from_centre(state.gas.pos)
        r = np.maximum(np.sqrt((pos**2).sum(axis=1)), TINY)
        coordinate = self._ring_coordinates(r)
        first, count = _ring_range(coordinate)
        at = np.clip(coordinate - first, 2.0, count - 3.0)
        rings = self._rings(state, at, r, first, count)
        if self.scene.self_gravity is not None:
            self._take_pattern(gas, pos / r[:, None], r, at, rings)
        pressure, acc = copied(gas.pressure), np.zeros_like(pos)
        stretch = (r / self.reference) ** -self.flaring / (self.width * r * r)  # d(at)/dr over r
        parallel_for(
            kernels.replace_ring_pressure, gas.count, pos, at, stretch, gas.followed, self._pressure_spline(rings),
            pressure, acc,
        )  # fmt: skip
        if state.bodies is not None:
            acc -= _rigid_acceleration(gas.mass, pos, acc)
        weight = np.clip(1.0 - UNEVEN * rings.scatter, 0.0, 1.0)
        return pressure, acc, np.exp(np.interp(at, np.arange(count), weight * rings.excess))

    def _ring_coordinates(self, r: Array) -> Array:
        """Return the coordinates (n,) of radii `r` (n,) in units of the ring width; 0 at the reference radius."""
        log = np.log(r / self.reference)
        return (log if self.flaring == 0.0 else -np.expm1(-self.flaring * log) / self.flaring) / self.width

    def _ring_radii(self, coordinate: Array) -> Array:
        """Return the radii (n,) of ring coordinates (n,), the inverse of `_ring_coordinates`."""
        log = self.width * coordinate
        if self.flaring != 0.0:
            log = -np.log(np.maximum(1.0 - self.flaring * log, TINY)) / self.flaring
        return self.reference * np.exp(np.clip(log, -MAX_LOG_RADIUS, MAX_LOG_RADIUS))

    def _rings(self, state: View, at: Array, r: Array, first: float, count: int) -> Rings:
        """Return the properties of `count` rings, the first of which has the ring coordinate `first`.

        at (n,): ring coordinates of the particles, relative to `first`. r (n,): radii of the particles.
        """
        gas = state.gas
        density = gas.pressure / gas.sound_speed**2  # P / c_s^2
        mass = gas.mass * density / gas.followed
        log = float(np.abs(np.log(density * r)).max(initial=0.0))
        units = _integer_units(gas, [mass.max(initial=0.0), 1.0, log, log * log])
        found = parallel_for(kernels.ring_sums, gas.count, count, at, mass, density, r, units, light=True)
        sums = _smoothed(world.processes.sum(sum(found)) / units[:, None], SMOOTHED)
        number, radius = np.maximum(sums[NUMBER], TINY), self._ring_radii(first + np.arange(count))
        area = 2.0 * np.pi * self.width * radius**2 * (radius / self.reference) ** self.flaring
        mean, sigma = sums[FIRST] / number, sums[MASS] / area
        scatter = np.sqrt(np.maximum(sums[SECOND] / number - mean**2, 0.0))
        excess = np.log(np.maximum(radius * sigma, TINY)) - mean
        excess = np.where(sums[NUMBER] > SPARSE, excess, 0.0)
        return Rings(radius, sums[MASS], sigma, sums[NUMBER], mean, scatter, excess)

    def _take_pattern(self, gas: Gas, direction: Array, r: Array, at: Array, rings: Rings) -> None:
        """Give the followed density of each ring the m = 1 pattern of its mass, eq. (6).

        `gas.pressure` is rescaled in proportion. direction (n, 2): unit vectors from the centre. r, at: as in `_rings`.
        """
        indices = np.arange(len(rings.radius))
        density = gas.pressure / gas.sound_speed**2
        mass, deviation = gas.mass * density / gas.followed, np.log(density * r) - np.interp(at, indices, rings.mean)
        most = [mass.max(initial=0.0), np.abs(mass * deviation).max(initial=0.0)]
        units = _integer_units(gas, np.repeat(most, 2))
        found = parallel_for(
            kernels.pattern_sums, gas.count, len(indices), at, mass, direction, deviation, units, light=True
        )
        sums = _smoothed(world.processes.sum(sum(found)) / units[:, None], SMOOTHED + MORE)
        mass_of_rings, number = _smoothed(np.stack([rings.mass, rings.number]), MORE)
        weight = 2.0 * self.keys.share * number**2 / (number**2 + CROWDED**2) / np.maximum(mass_of_rings, TINY)
        x, y = weight * (sums[MASS_X] - sums[LOG_X]), weight * (sums[MASS_Y] - sums[LOG_Y])
        factor = np.exp(np.interp(at, indices, x) * direction[:, 0] + np.interp(at, indices, y) * direction[:, 1])
        gas.followed *= factor
        gas.pressure *= factor

    def _pressure_spline(self, rings: Rings) -> Array:
        """Return the coefficients (4, count - 1) of the cubic spline of B, eq. (2), highest power first."""
        from scipy.interpolate import CubicSpline

        number2 = rings.number**2
        bound = np.clip(1.0 - self.keys.guard * rings.scatter, 0.0, self.keys.share)
        fraction = bound * number2 / (number2 + SPARSE**2)
        speed = eos_of(self.scene).thermal_speed(self.scene, rings.radius)
        return CubicSpline(np.arange(len(number2)), fraction * rings.density * speed**2).c


def _integer_units(gas: Gas, most: Any) -> Array:
    """Return the factors of terms that are summed as integers; most: largest absolute term of each sum, here."""
    largest = world.processes.max(np.array(most))
    return 2.0 ** (BITS - np.ceil(np.log2(gas.global_count + 1.0)) - np.frexp(largest)[1])


def _smoothed(sums: Array, times: int) -> Array:
    """Return sums over rings (k, count), smoothed `times` times over neighbouring rings."""
    sums = sums.copy()
    for _ in range(times):
        sums[:, 1:-1] = 0.25 * (sums[:, :-2] + 2.0 * sums[:, 1:-1] + sums[:, 2:])
    return sums


def _ring_range(coordinate: Array) -> tuple[float, int]:
    """Return the ring coordinate of the first ring and the number of rings, for the gas of all processes.

    coordinate (n,): ring coordinates of local particles. The range of rings has a margin at both ends.
    """
    least = world.processes.min(coordinate.min(initial=np.inf))
    most = world.processes.max(coordinate.max(initial=-np.inf))
    first = np.floor(max(least, most - MAX_RINGS)) - 3.0
    return float(first), int(most - first) + 5


def _rigid_acceleration(mass: Array, pos: Array, acc: Array) -> Array:
    """Return accelerations (n, 2) of a rigid body with the net force of `acc` (n, 2) and no torque about the origin."""
    x, y = pos.T
    columns = np.column_stack([np.ones_like(x), x, y, acc, x * x + y * y])
    whole, mx, my, fx, fy, inertia = totals(mass[:, None] * columns).tolist()
    x0, y0 = mx / whole, my / whole
    inertia -= whole * (x0 * x0 + y0 * y0)
    angular = (y0 * fx - x0 * fy) / inertia if inertia > 0.0 else 0.0
    return np.column_stack([fx / whole - angular * (y - y0), fy / whole + angular * (x - x0)])
