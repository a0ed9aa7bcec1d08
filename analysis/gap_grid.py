"""The gap that a planet opens in the disc of a scene, on a polar grid: another method beside the runs of the scene.

    python analysis/gap_grid.py SCENE [--set key=value ...] [--rings N] [--orbits N] [--last N] [--deep D]
                                 [--accretes] [--table FILE]

The scene's disc, locally isothermal gas with [alpha_viscosity], is solved as by ZEUS (Stone & Norman 1992, ApJS 80,
753) and FARGO (Masset 2000, A&AS 141, 165): radial velocities on the inner sides of cells and azimuthal ones on their
right sides,

    dv/dt = -grad P / Sigma - grad Phi + div T / Sigma,  T the shear viscosity nu,                   (1)
    Phi = -G M / r - G m / sqrt(d^2 + s^2) + G m r.r_p / r_p^3,                                      (2)

with von Neumann's viscosity in shocks, then mass, radial and angular momentum move with van Leer's slopes, turned with
the mean of each ring. Rings are even in ln r, cells square. In the zones of [damping] density and velocities are held
near those of the start. The planet, on a circle, has its mass from the beginning on; with --accretes it takes what the
scene says. With --deep there is a gap already, D deep, of the shape of Kanagawa et al. (2017, PASJ 69, 97), which saves
a hundred orbits. Prints every --last orbits what `gap.py` does of a run: depth and inside, of the mean of these orbits
without the angles within two Hill radii, and the torque on the gas beyond the orbit and within it, without that of half
a Hill radius about the planet, over q^2 (H/r)^-3 Sigma_min; what was taken, over 3 pi nu Sigma_0. Sigma_0 is that of
the scene. Cost: rings^3; with 64 two seconds of CPU time an orbit. --table writes the last mean for a run of particles
that starts with it (`kind = "table"`), with the resolution sqrt(Sigma_0) / Sigma: light gas in the gap.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np

from discsim import SceneError, load_scene
from discsim.initial import balance
from discsim.output.gaps import HILLS, OUTSIDE, excluded_angles
from discsim.physics import companions, profile, viscosity
from discsim.physics.centre import kepler_omega
from discsim.shipped import ShippedError, scene_file

Array = np.ndarray
COURANT, SHOCKS = 0.5, 1.41  # share of the longest step; cells over which a shock is spread


class InputError(Exception):
    """Something the user can put right; the message says what."""


def slopes(values: Array, axis: int) -> Array:
    """Van Leer's slopes of cell means (rings, angles), per cell: harmonic means of differences of one sign."""
    if axis == 1:
        ahead = np.roll(values, -1, 1) - values
        behind = np.roll(ahead, 1, 1)
    else:
        ahead = np.diff(values, axis=0, append=values[-1:])
        behind = np.diff(values, axis=0, prepend=values[:1])
    both = ahead * behind
    return np.where(both > 0.0, 2.0 * both / np.where(both > 0.0, ahead + behind, 1.0), 0.0)


class Grid:
    """Gas on a polar grid; arrays (rings, angles), of radial velocities (rings + 1, angles); code units."""

    def __init__(self, scene: Any, rings: int, accretes: bool = False, deep: float = 1.0) -> None:
        disc, star = profile.radial(scene), scene.star
        self.scene, self.planet = scene, scene.table("companion")[0]
        self.rate = (self.planet.accretion_rate or 0.0) if accretes else 0.0
        r = np.linspace(disc.inner, disc.outer, 4001)
        dense = r[disc.surface_density(r) > OUTSIDE * disc.surface_density(r).max()]
        self.side = np.geomspace(dense[0], dense[-1], rings + 1)
        count = round(2.0 * np.pi / np.log(self.side[1] / self.side[0]))
        self.step_angle = 2.0 * np.pi / count
        self.angle = (np.arange(count) + 0.5) * self.step_angle
        self.r = 2.0 / 3.0 * np.diff(self.side**3) / np.diff(self.side**2)
        self.area = 0.5 * np.diff(self.side**2) * self.step_angle
        self.sound2 = profile.sound_speed(scene, self.r, np.ones(rings))[:, None] ** 2
        self.nu = viscosity.diffusivity(scene, self.r)[:, None]
        self.start = disc.surface_density(self.r)[:, None]
        pull = disc.pressure_acceleration(self.r)
        self.circle = np.sqrt(star.mass / self.r - pull * self.r)[:, None]
        # At the very edges of a table, where Sigma ends, the flow has no limit: that of the next side is taken.
        within = np.clip(self.side, self.side[1], self.side[-2])
        self.inflow = balance.viscous_inflow(scene, disc, within)[:, None]
        left = self._gap(deep)
        slope = self.sound2 * np.gradient(np.log(left), np.log(self.r), axis=0)
        turning = np.sqrt(np.maximum(self.circle**2 + slope, 0.0))
        self.mass = np.repeat(self.start * left, count, 1)  # Sigma
        self.v_r, self.v_phi = np.repeat(self.inflow, count, 1), np.repeat(turning, count, 1)
        self.held, self.held_sides = self._damping(self.r), self._damping(self.side)
        self.time, self.taken = 0.0, 0.0
        a = self.planet.semi_major_axis
        self.omega = np.sqrt((star.mass + self.planet.mass) / a**3)
        self.hill = companions.hill_radius(scene, self.planet)
        self.softening = companions.softening(scene, self.planet, a)

    def _gap(self, deep: float) -> Array:
        """Share (rings, 1) of the start's Sigma that a gap leaves: `deep`, and beyond that it rises evenly to 1."""
        if deep == 1.0:
            return np.ones((len(self.r), 1))
        a = self.planet.semi_major_axis
        height = companions.scale_height(self.scene, a) / a
        wide = (companions.gap_number(self.scene, self.planet) * height**2) ** 0.25 * a  # (q^2 (H/r)^-3 / alpha)^1/4
        near, far = (0.25 * deep + 0.08) * wide, 0.33 * wide
        return (deep + (1.0 - deep) * np.clip((np.abs(self.r - a) - near) / (far - near), 0.0, 1.0))[:, None]

    def _damping(self, r: Array) -> Array:
        """Rates (n, 1) of [damping]."""
        zones = self.scene.table("damping")
        x = np.zeros_like(r)
        for near, far in ((zones.inner[::-1], zones.inner), (zones.outer, zones.outer[::-1])):
            x = np.maximum(x, np.clip((r - near[0]) / (far[0] - near[0]), 0.0, 1.0))
        return (x**2 * kepler_omega(self.scene, r) / (2.0 * np.pi * zones.time))[:, None]

    def distances2(self) -> Array:
        """From the planet, squared."""
        a = self.planet.semi_major_axis
        return self.r[:, None] ** 2 + a * a - 2.0 * a * self.r[:, None] * np.cos(self.angle - self.omega * self.time)

    def pull(self) -> Array:
        """The planet's potential, eq. (2)."""
        return -self.planet.mass / np.sqrt(self.distances2() + self.softening**2)

    def potential(self) -> Array:
        turned = np.cos(self.angle - self.omega * self.time)
        recoil = self.planet.mass * self.r[:, None] * turned / self.planet.semi_major_axis**2
        return self.pull() - self.scene.star.mass / self.r[:, None] + recoil

    def longest(self) -> float:
        """Of sound, flow past the mean of each ring, viscosity and squeezed gas in shocks."""
        cell = np.diff(self.side)[:, None]
        own = np.abs(self.v_phi - self.v_phi.mean(axis=1, keepdims=True))
        squeezed = np.maximum(np.abs(np.diff(self.v_r, axis=0)), np.abs(np.roll(self.v_phi, -1, 1) - self.v_phi))
        speeds = np.sqrt(self.sound2), np.maximum(np.abs(self.v_r[1:]), np.abs(self.v_r[:-1])), own
        rates = [speed / cell for speed in (*speeds, 4.0 * SHOCKS**2 * squeezed)] + [4.0 * self.nu / cell**2]
        return float(1.0 / np.sqrt(sum(rate**2 for rate in rates).max()))

    def step(self, dt: float) -> None:
        self._source(dt)
        self._shear(dt)
        hold, hold_sides = np.exp(-dt * self.held), np.exp(-dt * self.held_sides)
        self.v_phi = self.circle + (self.v_phi - self.circle) * hold
        self.v_r = self.inflow + (self.v_r - self.inflow) * hold_sides
        self._transport(dt)
        self.mass = self.start + (self.mass - self.start) * hold
        self.time += dt
        if self.rate > 0.0:
            near = self.distances2() < self.planet.accretion_radius**2
            lost = self.mass * near * (1.0 - np.exp(-self.rate * self.omega * dt / (2.0 * np.pi)))
            self.mass -= lost
            self.taken += float((lost * self.area[:, None]).sum())

    def _source(self, dt: float) -> None:
        """Eq. (1) without T."""
        s, phi = self.mass, self.potential()
        pressure, apart, along = s * self.sound2, np.diff(self.r)[:, None], self.r[:, None] * self.step_angle
        turning = 0.5 * (self.v_phi + np.roll(self.v_phi, -1, 1))
        curved = (0.5 * (turning[1:] + turning[:-1])) ** 2 / self.side[1:-1, None]
        v_r, v_phi = self.v_r.copy(), self.v_phi.copy()
        v_r[1:-1] += dt * (curved - (np.diff(phi, axis=0) + 2.0 * np.diff(pressure, axis=0) / (s[1:] + s[:-1])) / apart)
        before, left = s + np.roll(s, 1, 1), phi - np.roll(phi, 1, 1)
        v_phi -= dt / along * (left + 2.0 * (pressure - np.roll(pressure, 1, 1)) / before)
        shock_r = SHOCKS**2 * s * np.minimum(np.diff(v_r, axis=0), 0.0) ** 2
        shock_phi = SHOCKS**2 * s * np.minimum(np.roll(v_phi, -1, 1) - v_phi, 0.0) ** 2
        v_r[1:-1] -= 2.0 * dt * np.diff(shock_r, axis=0) / apart / (s[1:] + s[:-1])
        v_phi -= 2.0 * dt * (shock_phi - np.roll(shock_phi, 1, 1)) / along / before
        self.v_r, self.v_phi = v_r, v_phi

    def _shear(self, dt: float) -> None:
        """div T / Sigma; T_r,phi at the corners of cells."""
        s, r, side, wide = self.mass, self.r[:, None], self.side[:, None], self.step_angle
        v_r, v_phi = self.v_r, self.v_phi
        apart, cell = np.diff(r, axis=0), np.diff(side, axis=0)
        along_r = np.diff(v_r, axis=0) / cell
        along_phi = (np.roll(v_phi, -1, 1) - v_phi) / (r * wide) + 0.5 * (v_r[1:] + v_r[:-1]) / r
        third = (along_r + along_phi) / 3.0
        t_rr, t_pp = (2.0 * s * self.nu * (part - third) for part in (along_r, along_phi))
        corner = 0.25 * (s[1:] + s[:-1]) * 0.5 * (self.nu[1:] + self.nu[:-1])
        corner = corner + np.roll(corner, 1, 1)
        twist = side[1:-1] * np.diff(v_phi / r, axis=0) / apart + (v_r - np.roll(v_r, 1, 1))[1:-1] / (side[1:-1] * wide)
        t_rp = corner * twist
        t_rp = np.concatenate([t_rp[:1], t_rp, t_rp[-1:]])
        push = np.diff(r * t_rr, axis=0) / apart - 0.5 * (t_pp[1:] + t_pp[:-1])
        push += (np.roll(t_rp, -1, 1) - t_rp)[1:-1] / wide
        v_r[1:-1] += 2.0 * dt * push / side[1:-1] / (s[1:] + s[:-1])
        turn = np.diff(side**2 * t_rp, axis=0) / (cell * r**2) + (t_pp - np.roll(t_pp, 1, 1)) / (r * wide)
        v_phi += 2.0 * dt * turn / (s + np.roll(s, 1, 1))

    def _transport(self, dt: float) -> None:
        """Mass, and with it momenta per mass of the sides of each cell; then velocities are means of cells beside."""
        r, side = self.r[:, None], self.side[:, None]
        carried = [self.v_r[:-1], self.v_r[1:], r * self.v_phi, r * np.roll(self.v_phi, -1, 1)]
        cell = np.diff(side, axis=0)
        self._move(carried, self.v_r[1:-1] * dt, cell, side[1:-1], 0)
        mean = self.v_phi.mean(axis=1, keepdims=True)
        along = r * self.step_angle
        self._move(carried, (self.v_phi - mean) * dt, along, np.ones_like(r), 1)
        cells = mean * dt / along
        whole = np.round(cells)
        self._move(carried, np.broadcast_to((cells - whole) * along, self.mass.shape), along, np.ones_like(r), 1)
        column = (np.arange(len(self.angle)) - whole.astype(int)) % len(self.angle)
        self.mass, *carried = (np.take_along_axis(values, column, 1) for values in (self.mass, *carried))
        inner, outer, right, left = (self.mass * values for values in carried)
        self.v_r[1:-1] = (outer[:-1] + inner[1:]) / (self.mass[:-1] + self.mass[1:])
        self.v_phi = (np.roll(left, 1, 1) + right) / (np.roll(self.mass, 1, 1) + self.mass) / r

    def _move(self, carried: list[Array], moved: Array, cell: Array, length: Array, axis: int) -> None:
        """Move mass, and what it carries, over sides of relative `length` that gas crosses by `moved`; none leaves."""
        forward = moved > 0.0

        def beside(values: Array) -> Array:
            """Upwind values where the gas that crosses is, for each side."""
            change = 0.5 * slopes(values, axis)
            if axis == 1:
                before, behind = np.roll(values, 1, 1), np.roll(change, 1, 1)
                widths = cell, cell
            else:
                values, before, change, behind = values[1:], values[:-1], change[1:], change[:-1]
                widths = cell[:-1], cell[1:]
            return np.where(
                forward, before + behind * (1.0 - moved / widths[0]), values - change * (1.0 + moved / widths[1])
            )

        def difference(flux: Array) -> Array:
            return np.roll(flux, -1, 1) - flux if axis == 1 else np.diff(np.pad(flux, ((1, 1), (0, 0))), axis=0)

        volume = cell if axis == 1 else cell * 0.5 * (self.side[1:] + self.side[:-1])[:, None]
        flux = moved * length * beside(self.mass)
        new = self.mass - difference(flux) / volume
        for k, values in enumerate(carried):
            carried[k] = (values * self.mass - difference(flux * beside(values)) / volume) / new
        self.mass = new


class Means:
    """Means over time of what a gap is told by: Sigma (rings,) away from the planet, and the torque (rings,) on it."""

    def __init__(self, grid: Grid) -> None:
        self.grid, self.time, self.taken = grid, 0.0, grid.taken
        a = grid.planet.semi_major_axis
        self.inner = grid.r < a
        self.near = np.abs(grid.r - a) < max(float(companions.scale_height(grid.scene, a)), HILLS * grid.hill)
        self.out = excluded_angles(grid.r, a, grid.hill)[:, None]
        self.density, self.torque = np.zeros_like(grid.r), np.zeros_like(grid.r)

    def add(self, dt: float) -> None:
        grid = self.grid
        away = np.abs((grid.angle - grid.omega * grid.time + np.pi) % (2.0 * np.pi) - np.pi) > self.out
        self.density += dt * (grid.mass * away).sum(axis=1) / away.sum(axis=1)
        pull = grid.pull()
        turned = (np.roll(pull, 1, 1) - np.roll(pull, -1, 1)) / (2.0 * grid.step_angle)
        far = grid.distances2() > (0.5 * grid.hill) ** 2
        self.torque += dt * (turned * grid.mass * far).sum(axis=1) * grid.area
        self.time += dt

    def write(self, path: Path) -> None:
        """A table that discs can start from, in the scene's code units."""
        density, start = self.density / self.time, self.grid.start[:, 0]
        rows = zip(self.grid.r, density, np.sqrt(start) / density, strict=True)
        body = "".join(f"{r:.9g} {sigma:.9g} {resolution:.9g}\n" for r, sigma, resolution in rows)
        path.write_text(f"# r  Sigma  resolution\n{body}")

    def __str__(self) -> str:
        grid, near = self.grid, self.near
        a, start = grid.planet.semi_major_axis, grid.start[:, 0]
        left = self.density / self.time / start
        depth, inside = left[near].min(), np.average(left[near], weights=(start * grid.area)[near])
        there = float(np.interp(a, grid.r, start))
        ratio = grid.planet.mass / grid.scene.star.mass
        unit = ratio**2 * (companions.scale_height(grid.scene, a) / a) ** -3 * depth * there * a**4 * grid.omega**2
        torques = [self.torque[part].sum() / self.time / unit for part in (~self.inner, self.inner)]
        feed = 3.0 * np.pi * float(np.interp(a, grid.r, grid.nu[:, 0])) * there
        taken = (grid.taken - self.taken) / self.time / feed
        parts = [f"depth {depth:.4f}", f"inside {inside:.4f}", f"torque {torques[0]:.3f} {torques[1]:.3f}"]
        return "  ".join([*parts, *([f"taken {taken:.2f}"] if grid.rate > 0.0 else [])])


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", help="path of a scene, or name of a setup")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="as of discsim run")
    parser.add_argument("--rings", type=int, default=64, metavar="N")
    parser.add_argument("--orbits", type=float, default=100.0, metavar="N", help="of the planet (default 100)")
    parser.add_argument("--last", type=float, default=10.0, metavar="N", help="orbits of a mean (default 10)")
    parser.add_argument("--deep", type=float, default=1.0, metavar="D", help="depth of a gap to begin with")
    parser.add_argument("--accretes", action="store_true", help="by the planet's accretion_radius and accretion_rate")
    parser.add_argument("--table", type=Path, metavar="FILE", help="for a start of the last mean, in code units")
    given = parser.parse_args(arguments)
    try:
        scene = load_scene(scene_file(Path(given.scene)), given.set)
        for name in ("gas", "star", "companion", "alpha_viscosity", "damping"):
            if scene.table(name) is None:
                raise InputError(f"{given.scene}: no [{name}]; expected a viscous disc with a planet and calm edges")
        if not 0.0 < given.deep <= 1.0:
            raise InputError(f"--deep {given.deep:g} is out of range; expected more than 0, and 1 at most")
        if given.table is not None and scene.units.system != "code":
            raise InputError(f"{given.scene}: --table has no units; expected a scene in code units")
        if None in (scene.table("damping").inner, scene.table("damping").outer):
            raise InputError(f"{given.scene}: [damping] has one zone; expected inner and outer")
    except (InputError, SceneError, ShippedError, OSError) as error:
        print(f"gap_grid: {error}", file=sys.stderr)
        return 2
    grid = Grid(scene, given.rings, given.accretes, given.deep)
    period = 2.0 * np.pi / grid.omega
    for k in range(round(given.orbits / given.last)):
        means, until = Means(grid), (k + 1) * given.last * period
        while grid.time < until:
            dt = min(COURANT * grid.longest(), until - grid.time)
            grid.step(dt)
            means.add(dt)
        print(f"to orbit {(k + 1) * given.last:g}: {means}", flush=True)
    if given.table is not None:
        means.write(given.table)
    return 0


if __name__ == "__main__":
    sys.exit(main())
