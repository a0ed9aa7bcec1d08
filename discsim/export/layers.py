"""A razor-thin disc as layers with a height, on rings and azimuths that all codes share.

Surface densities are on cells of equal width in ln r and phi, over which particles are spread by Gaussians
(`output/bins.py`); the mass of each group of grains is then scaled to be exact. In height a layer is a Gaussian,

    rho = Sigma exp(-z^2 / 2 H^2) / (sqrt(2 pi) H)                                                                 (1)
    H   = sqrt(P / Sigma) / Omega                              of the gas                                          (2)
    H_d = H sqrt(alpha / (alpha + St))                         of dust with the Stokes number St                   (3)

(Dubrulle, Morfill & Sterzik 1995, Icarus 114, 237; Youdin & Lithwick 2007, Icarus 192, 588). P / Sigma and St are means
over the mass in each ring. alpha is the one given, or that of [dust_diffusion] or else of [alpha_viscosity]; a constant
D or nu is alpha = D Omega / c_s^2 with c_s^2 = P / Sigma. Small dust of [growth] has the height of the gas. Cells take
their exact part of (1), by differences of the error function.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.output.bins import Bins, PixelBins, Rings
from discsim.output.cells import CellPixels, polar_grid
from discsim.output.fields.base import PlotError
from discsim.output.fields.frame import central_mass, omega
from discsim.sky.temperature import temperatures

if TYPE_CHECKING:
    from discsim.export.grains import Grains
    from discsim.output.snapshot import Snapshot

Array = np.ndarray
MARGIN = 4  # rings beyond the first and the last particle, into which Gaussians reach
DEPTH = 1e-4  # smallest radius of the cells over the largest; particles further in belong to the innermost cells
MAX_VALUES = 200_000_000  # most densities in a file: 1.6 GB
REACH = 5.0  # height of the grids in heights of the gas; beyond lies 6e-7 of the mass


@dataclass(frozen=True)
class Disc:
    """The cells of a snapshot in ln r and phi, and its layers. Lengths are in code units.

    `snap` is relative to the disc's centre. `edges` (rings + 1,) are radii, and `azimuths` is the number of cells in
    phi, from 0 to 2 pi. `given_alpha` is the alpha of eq. (3), None for that of the scene.
    """

    snap: Snapshot
    edges: Array
    azimuths: int
    given_alpha: float | None
    prefix: str = ""

    @cached_property
    def radius(self) -> Array:
        """Middle of each ring in ln r, (rings,)."""
        middle: Array = np.sqrt(self.edges[1:] * self.edges[:-1])
        return middle

    @cached_property
    def frequency(self) -> Array:
        """Omega (rings,) in code units."""
        return omega(self.snap, self.radius)

    @cached_property
    def speed2(self) -> Array:
        """P / Sigma (rings,) in code units: of the gas particles, or of the prescribed disc."""
        gas = self.snap.gas
        if gas is None:
            from discsim.physics.profile import initial_thermal_speed
            from discsim.scene import load_scene

            found: Array = initial_thermal_speed(load_scene(self.snap.tables, own_particles=True), self.radius) ** 2
            return found
        assert gas.pressure is not None and gas.density is not None
        return self.in_rings(gas.pos, gas.mass, gas.pressure / gas.density)

    @cached_property
    def gas_height(self) -> Array:
        """H (rings,) of the gas, eq. (2)."""
        height: Array = np.sqrt(self.speed2) / self.frequency
        return height

    @cached_property
    def alpha(self) -> Array:
        """Strength (rings,) of the turbulence. Raises PlotError if neither an option nor the scene has one."""
        if self.given_alpha is not None:
            return np.full(len(self.radius), self.given_alpha)
        from discsim.physics import diffusion, viscosity
        from discsim.scene import load_scene

        scene = load_scene(self.snap.tables, own_particles=True)
        if scene.table("dust_diffusion") is not None:
            constant = diffusion.uniform_diffusivity(scene)
            return diffusion.alpha(scene, self.radius) if constant is None else self._of_constant(constant)
        if scene.table("alpha_viscosity") is not None:
            nu = scene.table("alpha_viscosity").nu
            return viscosity.alpha(scene, self.radius) if nu is None else self._of_constant(nu)
        raise PlotError(
            f"{self.prefix}alpha: missing, and the scene has no [dust_diffusion] or [alpha_viscosity]; expected the "
            "strength of the turbulence that lifts the dust, like 1e-3"
        )

    def _of_constant(self, diffusivity: float) -> Array:
        found: Array = diffusivity * self.frequency / self.speed2
        return found

    def height(self, grains: Grains) -> Array:
        """Return the height H_d (rings,) of grains, eq. (3). Raises PlotError."""
        if grains.stokes is None:
            return self.gas_height
        stokes = self.in_rings(grains.pos, grains.mass, grains.stokes)
        found: Array = self.gas_height * np.sqrt(self.alpha / (self.alpha + stokes))
        return found

    def in_rings(self, pos: Array, mass: Array, values: Array) -> Array:
        """Return means over mass (rings,) of values (n,), between the rings that have particles by interpolation."""
        rings = Rings(np.clip(np.hypot(*pos.T), self.edges[0], self.edges[-1]), self.edges)
        total = rings.sum(mass)
        full = np.flatnonzero(total > 0.0)
        found: Array = np.interp(np.arange(len(total)), full, (rings.sum(mass * values)[full] / total[full]))
        return found

    def cells(self, pos: Array) -> Bins:
        """Return the cells [ring, azimuth] over which particles at `pos` (n, 2), or cells of a grid, are spread."""
        if (grid := polar_grid(pos)) is not None:
            azimuth = 2.0 * np.pi * (np.arange(self.azimuths) + 0.5) / self.azimuths
            area = np.pi * np.diff(self.edges**2) / self.azimuths
            r, azimuth = np.broadcast_arrays(self.radius[:, None], azimuth)
            return CellPixels(grid, r, azimuth, area[:, None])

        def at(part: slice) -> Array:
            x, y = pos[part].T
            log = np.log(np.clip(np.hypot(x, y), self.edges[0], self.edges[-1]))
            return np.stack([np.minimum(log, np.nextafter(ends[1], -np.inf)), np.arctan2(y, x)], axis=1)

        ends = np.log(self.edges[[0, -1]])
        window = np.array([ends[0], 0.0]), np.array([ends[1], 2.0 * np.pi])
        return PixelBins(len(pos), at, window, (len(self.radius), self.azimuths), (False, True))

    def masses(self, pos: Array, mass: Array) -> Array:
        """Return the mass in each cell [ring, azimuth]; the sum is that of `mass` (n,) to rounding."""
        found = np.maximum(self.cells(pos).sum(mass), 0.0)
        return found * (mass.sum() / found.sum())

    def check_size(self, heights: int, species: int) -> None:
        """Raise PlotError if there are too many densities, for cells in height and species."""
        count = len(self.radius) * self.azimuths * heights * species
        if count > MAX_VALUES:
            raise PlotError(
                f"{self.prefix}cells: {self.azimuths} in azimuth are {count:.2g} densities of {species} species; "
                f"expected at most {MAX_VALUES:.2g}, by fewer {self.prefix}cells or {self.prefix}sizes"
            )

    def velocities(self) -> Array:
        """Return the velocity of the gas [2, ring, azimuth], along r and phi; circular orbits where gas is missing."""
        gas = self.snap.gas
        assert gas is not None and gas.vel is not None
        x, y = gas.pos.T
        along = np.stack([x, y]) / np.maximum(gas.radius, 1e-300)
        turned = np.stack([-along[1], along[0]])
        cells = self.cells(gas.pos)
        total = cells.sum(gas.mass)
        found = np.zeros((2, *total.shape))
        found[1] = (self.frequency * self.radius)[:, None]
        full = total > 1e-9 * total.max()
        for number, direction in enumerate((along, turned)):
            flow = cells.sum(gas.mass * (gas.vel * direction.T).sum(axis=1))
            found[number][full] = flow[full] / total[full]
        return found

    def temperature(self, law: Any) -> Array:
        """Return temperatures [ring, azimuth] in K, of a law or, for None, of the gas. Raises PlotError."""
        phi = 2.0 * np.pi * (np.arange(self.azimuths) + 0.5) / self.azimuths
        direction = np.stack([np.cos(phi), np.sin(phi)], axis=1)
        pos = (self.radius[:, None, None] * direction).reshape(-1, 2)
        return temperatures(self.snap, pos, law).reshape(len(self.radius), self.azimuths)


def disc_of(snap: Snapshot, azimuths: int, alpha: float | None = None, prefix: str = "") -> Disc:
    """Return the cells of a snapshot about its centre, about square, around all of its particles. Raises PlotError."""
    if "star" not in snap.tables or not central_mass(snap) > 0.0:
        raise PlotError("the scene has no star to heat the disc; expected a run with [star]")
    snap = snap.about_centre()
    radii = np.concatenate([p.radius for p in snap.species.values()])
    outer = float(radii.max(initial=0.0)) * (1.0 + 1e-9)
    if not outer > 0.0:
        raise PlotError("the snapshot has no particles away from the star; expected a disc")
    inner = max(float(radii.min()) * (1.0 - 1e-9), DEPTH * outer)
    side = 2.0 * np.pi / azimuths
    rings = max(int(np.ceil(np.log(outer / inner) / side)), 2)
    edges = np.geomspace(inner * np.exp(-MARGIN * side), outer * np.exp(MARGIN * side), rings + 2 * MARGIN + 1)
    return Disc(snap, edges, azimuths, alpha, prefix)


def gaussian_parts(edges: Array) -> Array:
    """Return the parts (..., n) of a Gaussian between edges (..., n + 1), in standard deviations; their sum is 1."""
    from scipy.special import erf

    found = np.diff(erf(edges / np.sqrt(2.0)), axis=-1)
    parts: Array = found / found.sum(axis=-1, keepdims=True)
    return parts


def graded(thinnest: float, reach: float) -> Array:
    """Return heights (n + 1,) from 0 to `reach`.

    The first step is at most a quarter of the height `thinnest`, and each step is 10% wider than the one before.
    """
    first, ratio = 0.25 * thinnest, 1.1
    number = max(int(np.ceil(np.log1p((ratio - 1.0) * reach / first) / np.log(ratio))), 4)
    steps = (ratio ** np.arange(number + 1) - 1.0) / (ratio**number - 1.0)
    return reach * steps
