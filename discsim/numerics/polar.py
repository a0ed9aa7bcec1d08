"""Gas in polar cells: geometry of the cells, pressure forces (`kernels/polar/forces.py`) and motion (`transport.py`).

Rings are even in ln r, and cells are nearly square. A cell takes the place of a particle: its position is the centroid,
its velocity that of the gas. Arrays of the gas have the cells of the innermost ring first.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from discsim.formulas.polar import ring_sides
from discsim.kernels.polar import forces, transport, viscosity
from discsim.kernels.polar.geometry import ENERGY, GHOSTS, Geometry, fill_force_ghosts, fill_ghosts
from discsim.kernels.polar.parabola import side_coefficients
from discsim.numerics.threads import parallel_for

Array = np.ndarray
CHUNK = 4096  # smallest number of cells in a chunk of a parallel loop


class PolarCells:
    """Polar cells between two radii, with the work arrays of their kernels.

    rings, angles: numbers of rings and of cells in a ring. geometry: for kernels. pos (n, 2), area (n,): centroids and
    areas of the cells. azimuth (angles,): of the centroids of a ring.
    """

    def __init__(self, rings: int, angles: int, inner: float, outer: float, closed: bool) -> None:
        self.rings, self.angles = rings, angles
        sides = ring_sides(rings, inner, outer, GHOSTS)
        volume = 0.5 * (sides[1:] - sides[:-1]) * (sides[1:] + sides[:-1])
        angle = 2.0 * math.pi / angles
        self.azimuth = (np.arange(angles) + 0.5) * angle
        own = slice(GHOSTS, GHOSTS + rings)
        # Centroid (r_o^3 - r_i^3) / (3 volume), without a difference of cubes.
        low, high = sides[:-1], sides[1:]
        radius = (high - low) * (high * high + high * low + low * low) / (3.0 * volume)
        self.geometry = Geometry(
            sides[GHOSTS : rings + GHOSTS + 1].copy(), radius[own].copy(), volume[own].copy(), angle,
            side_coefficients(volume), np.cos(self.azimuth), np.sin(self.azimuth), closed,
        )  # fmt: skip
        self.area = np.repeat(self.geometry.volume * angle, angles)
        self.pos = np.empty((rings * angles, 2))
        self.pos[:, 0] = np.outer(self.geometry.radius, self.geometry.cos).ravel()
        self.pos[:, 1] = np.outer(self.geometry.radius, self.geometry.sin).ravel()
        self.fields, self.new = np.empty((2, 0, 0, 0))
        self.padded = np.empty((2, rings + 2 * GHOSTS, angles))
        self.swept = np.empty((rings + 1, angles))
        self.around, self.mean = np.empty((rings, angles)), np.empty(rings)

    @property
    def shape(self) -> tuple[int, int]:
        return self.rings, self.angles

    def for_rings(self, kernel: Callable[..., Any], *arguments: Any) -> list[Any]:
        """Run `kernel(first, last, *arguments)` on chunks of the rings; return the results, in the order of chunks."""
        return parallel_for(kernel, self.rings, *arguments, least=max(1, CHUNK // self.angles))

    def find_velocities(self, vel: Array, kick_acc: Array, lag: float) -> None:
        """Store the polar velocities of the cells after `lag`: vel, kick_acc (n, 2)."""
        grid = (*self.shape, 2)
        arrays = vel.reshape(grid), kick_acc.reshape(grid), lag
        self.for_rings(forces.to_polar, *arrays, self.geometry, self.padded[1], self.around, self.mean)

    def accelerate(
        self, density: Array, pressure: Array, sound: Array, stiff: float, acc: Array, heating: Array | None
    ) -> float:
        """Add the acceleration by pressure to `acc` (n, 2), and return the step limit of the cells.

        density, pressure, sound (n,). stiff: s of eq. (1) of the forces. heating (n,): set to the heating rate, if
        given. Velocities are those of the last `find_velocities`.
        """
        own, grid = slice(GHOSTS, GHOSTS + self.rings), self.shape
        self.padded[0, own] = pressure.reshape(grid)
        fill_force_ghosts(self.padded[0], self.padded[1], self.geometry.closed)
        heat = np.empty((0, 0)) if heating is None else heating.reshape(grid)
        arrays = self.padded[0], self.padded[1], self.around, self.mean, density.reshape(grid), sound.reshape(grid)
        rates = self.for_rings(forces.accelerate, *arrays, stiff, self.geometry, acc.reshape(*grid, 2), heat)
        fastest = float(np.max(rates))
        return 1.0 / fastest if fastest != 0.0 else math.inf

    def add_viscosity(self, density: Array, nu: Array, acc: Array, heating: Array | None) -> None:
        """Add the viscous acceleration to `acc` (n, 2), and the viscous heat to `heating` (n,) if it is given.

        density, nu (n,): surface density and viscosity. Velocities are those of the last `find_velocities`, with the
        ghosts of the last `accelerate`.
        """
        grid = self.shape
        heat = np.empty((0, 0)) if heating is None else heating.reshape(grid)
        arrays = self.padded[1], self.around, (density * nu).reshape(grid), density.reshape(grid)
        self.for_rings(viscosity.accelerate, *arrays, self.geometry, acc.reshape(*grid, 2), heat)

    def move(
        self, mass: Array, vel: Array, pressure: Array, u: Array | None, gamma: float, dt: float, radial_first: bool
    ) -> Array:
        """Move the gas over dt; mass (n,), vel (n, 2) and u (n,) change in place.

        pressure (n,): at the beginning. gamma: adiabatic index. radial_first: whether the radial sweep comes first.
        Returns mass, momentum along x and y, and angular momentum that left the inner and the outer edge (2, 4).
        """
        grid, g = self.shape, self.geometry
        count = ENERGY + (u is not None)
        if len(self.fields) != count:
            self.fields, self.new = np.empty((2, count, self.rings + 2 * GHOSTS, self.angles))
        energy = np.empty((0, 0)) if u is None else u.reshape(grid)
        polar = mass.reshape(grid), vel.reshape(*grid, 2)
        self.for_rings(transport.unpack, *polar, pressure.reshape(grid), energy, dt, g, self.fields)
        lost = np.empty(0)
        for radial in (radial_first, not radial_first):
            if radial:
                fill_ghosts(self.fields, g.closed)
                self.for_rings(transport.find_swept, self.fields, gamma, dt, g, self.swept)
                lost = sum(self.for_rings(transport.sweep_radially, self.fields, self.swept, g, self.new))
            else:
                self.for_rings(transport.sweep_around, self.fields, gamma, dt, g, self.new)
            self.fields, self.new = self.new, self.fields
        self.for_rings(transport.pack, self.fields, dt, g, *polar, energy)
        return lost
