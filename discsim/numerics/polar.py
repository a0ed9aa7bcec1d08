"""Gas in polar cells: geometry of the cells, pressure forces (`kernels/polar/forces.py`) and motion (`transport.py`).

Rings are even in ln r, and cells are nearly square. A cell takes the place of a particle: its position is the centroid,
its velocity that of the gas. Arrays of the gas have the cells of the innermost ring first.

Work arrays of kernels have all rings. With several processes they have the own rings of the process and ghost rings,
copies of the next rings of other processes (`ranks/polar.py`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from discsim.formulas.polar import centroid_azimuths, ring_centroids, ring_sides
from discsim.kernels.polar import forces, sampling, tracer, transport, viscosity
from discsim.kernels.polar.geometry import DENSITY, ENERGY, GHOSTS, Geometry, fill_force_ghosts, fill_ghosts
from discsim.kernels.polar.parabola import side_coefficients
from discsim.numerics import world
from discsim.numerics.sorting import counting_sort
from discsim.numerics.threads import parallel_for

if TYPE_CHECKING:
    from discsim.numerics.state import State

Array = np.ndarray
CHUNK = 4096  # smallest number of cells in a chunk of a parallel loop
NOTHING_PASSED = tracer.Passed(np.empty((0, 0)), np.empty((0, 0)), np.empty(0, np.int64))


def geometry_of(rings: int, angles: int, inner: float, outer: float, closed: bool) -> Geometry:
    """Return the geometry of `rings` rings of `angles` polar cells between two radii. closed: the edges are walls."""
    sides = ring_sides(rings, inner, outer, GHOSTS)
    radius, volume = ring_centroids(sides)
    own = slice(GHOSTS, GHOSTS + rings)
    azimuth = centroid_azimuths(angles)
    return Geometry(
        sides[GHOSTS : rings + GHOSTS + 1].copy(), radius[own].copy(), volume[own].copy(), 2.0 * math.pi / angles,
        side_coefficients(volume), np.cos(azimuth), np.sin(azimuth), closed, 0,
    )  # fmt: skip


def rings_of(geometry: Geometry, begin: int, end: int, first: int) -> Geometry:
    """Return the geometry of the rings `begin` to `end`; first: the first own ring among them."""
    some = slice(begin, end)
    return geometry._replace(
        sides=geometry.sides[begin : end + 1], radius=geometry.radius[some], volume=geometry.volume[some],
        weights=geometry.weights[begin : end + 2 * GHOSTS], first=first,
    )  # fmt: skip


def _on_rings(kernel: Callable[..., Any], begin: int, end: int, angles: int, *arguments: Any) -> list[Any]:
    """Run `kernel(first, last, *arguments)` on chunks of the rings `begin` to `end`; return the results in order."""

    def run(first: int, last: int, *given: Any) -> Any:
        return kernel(begin + first, begin + last, *given)

    return parallel_for(run, end - begin, *arguments, least=max(1, CHUNK // angles))


class PolarCells:
    """Polar cells between two radii, with the work arrays of their kernels.

    rings, angles: numbers of rings in work arrays and of cells in a ring. own: the own rings among them, a slice.
    geometry: for kernels. azimuth (angles,): of the centroids of a ring.
    """

    def __init__(self, rings: int, angles: int, inner: float, outer: float, closed: bool) -> None:
        self.angles, self.azimuth = angles, centroid_azimuths(angles)
        self.set_rings(geometry_of(rings, angles, inner, outer, closed), rings)

    def set_rings(self, geometry: Geometry, own: int) -> None:
        """Set the rings in work arrays, whose geometry is `geometry`; own: number of own rings."""
        self.geometry, self.rings = geometry, len(geometry.radius)
        self.own = slice(geometry.first, geometry.first + own)
        self._set_fields(ENERGY)
        self.mean, self.passed = np.empty(self.rings), NOTHING_PASSED

    def _set_fields(self, count: int) -> None:
        """Allocate the work arrays. count: number of fields that move.

        The arrays of the forces are parts of those of the drift, as each drift and each call of `find_velocities`
        write their arrays first.
        """
        self.fields = self.new = self.padded = np.empty((0, 0, 0))  # frees earlier arrays before the allocation
        self.fields, self.new = np.empty((2, count, self.rings + 2 * GHOSTS, self.angles))
        self.swept = np.empty((self.rings + 1, self.angles))
        self.padded, self.around = self.new[:2], self.swept[:-1]

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of own rings and of cells in a ring."""
        return self.own.stop - self.own.start, self.angles

    @property
    def area(self) -> Array:
        """Areas (n,) of the own cells."""
        return np.repeat(self._areas_of_rings, self.angles)

    @property
    def _areas_of_rings(self) -> Array:
        """Areas (own rings,) of the cells of each ring."""
        return self.geometry.volume[self.own] * self.geometry.angle

    def surface_density(self, mass: Array, out: Array) -> Array:
        """Write the surface density of cells with the masses `mass` (n,) to `out` (n,), and return `out`."""
        np.divide(mass.reshape(self.shape), self._areas_of_rings[:, None], out=out.reshape(self.shape))
        return out

    @property
    def pos(self) -> Array:
        """Centroids (n, 2) of the own cells."""
        radius, pos = self.geometry.radius[self.own], np.empty((*self.shape, 2))
        pos[..., 0] = np.outer(radius, self.geometry.cos)
        pos[..., 1] = np.outer(radius, self.geometry.sin)
        return pos.reshape(-1, 2)

    def for_rings(self, kernel: Callable[..., Any], *arguments: Any, more: int = 0) -> list[Any]:
        """Run `kernel(first, last, *arguments)` on chunks of the own rings; return the results, in the order of chunks.

        more: number of ghost rings on both sides on which the kernel runs too.
        """
        if self.own.start == self.own.stop:
            return []
        begin, end = max(self.own.start - more, 0), min(self.own.stop + more, self.rings)
        return _on_rings(kernel, begin, end, self.angles, *arguments)

    def with_empty_ghosts(self, array: Array, number: int) -> Array:
        """Return `array` (n,) of the own cells as (rings, angles), with uninitialised ghost rings.

        number: results that are in use at the same time have different numbers.
        """
        return array.reshape(self.shape)

    def update_ghosts(self, arrays: list[Array]) -> None:
        """Fetch the ghost rings of `arrays`, (rings, ...) each, from other processes, in place. Collective."""

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
        grid, fields = self.shape, [self.padded[k, GHOSTS:-GHOSTS] for k in range(2)]
        fields[0][self.own] = pressure.reshape(grid)
        rho, speed = self.with_empty_ghosts(density, 0), self.with_empty_ghosts(sound, 1)
        self.update_ghosts([*fields, self.mean, rho, speed])
        fill_force_ghosts(self.padded[0], self.padded[1], self.geometry.closed)
        heat = np.empty((0, 0)) if heating is None else heating.reshape(grid)
        arrays = self.padded[0], self.padded[1], self.around, self.mean, rho, speed
        rates = self.for_rings(forces.accelerate, *arrays, stiff, self.geometry, acc.reshape(*grid, 2), heat)
        fastest = float(np.max(rates, initial=0.0))
        return 1.0 / fastest if fastest != 0.0 else math.inf

    def add_viscosity(self, density: Array, nu: Array, acc: Array, heating: Array | None) -> None:
        """Add the viscous acceleration to `acc` (n, 2), and the viscous heat to `heating` (n,) if it is given.

        density, nu (n,): surface density and viscosity. Velocities are those of the last `find_velocities`, with the
        ghosts of the last `accelerate`.
        """
        grid, mu = self.shape, self.with_empty_ghosts(density * nu, 0)
        self.update_ghosts([self.around, mu])
        heat = np.empty((0, 0)) if heating is None else heating.reshape(grid)
        arrays = self.padded[1], self.around, mu, density.reshape(grid)
        self.for_rings(viscosity.accelerate, *arrays, self.geometry, acc.reshape(*grid, 2), heat)

    def move(
        self, mass: Array, vel: Array, pressure: Array, u: Array | None, gamma: float, dt: float, radial_first: bool,
        small: Array | None = None,
    ) -> Array:  # fmt: skip
        """Move the gas over dt; mass (n,), vel (n, 2), u (n,) and the mass of small dust `small` (n,) change in place.

        pressure (n,): at the beginning. gamma: adiabatic index. radial_first: whether the radial sweep comes first.
        Returns mass, momentum along x and y, angular momentum and small dust that left the inner and the outer edge
        (2, 5), as far as they are edges of own rings.
        """
        grid, g = self.shape, self.geometry
        count = ENERGY + (u is not None)
        if len(self.fields) != count:
            self._set_fields(count)
        energy = np.empty((0, 0)) if u is None else u.reshape(grid)
        polar = mass.reshape(grid), vel.reshape(*grid, 2)
        self.for_rings(transport.unpack, *polar, pressure.reshape(grid), energy, dt, g, self.fields)
        passed, lost = self._prepare_tracer(mass, small), np.zeros((2, 5))
        for radial in (radial_first, not radial_first):
            if radial:
                moving = [*self.fields, *([] if small is None else [self.share[0]])]
                self.update_ghosts([field[GHOSTS:-GHOSTS] for field in moving])
                fill_ghosts(self.fields, g.closed)
                # The flux through a side depends on what is swept through the next sides too.
                self.for_rings(transport.find_swept, self.fields, gamma, dt, g, self.swept, more=2)
                swept = self.for_rings(transport.sweep_radially, self.fields, self.swept, g, self.new, passed)
                lost[:, :4] = sum(swept)
            else:
                self.for_rings(transport.sweep_around, self.fields, gamma, dt, g, self.new, passed)
            if small is not None:
                lost[:, 4] += self._move_tracer(passed, radial)
            self.fields, self.new = self.new, self.fields
        self.for_rings(transport.pack, self.fields, dt, g, *polar, energy)
        if small is not None:
            np.multiply(self.share[0, GHOSTS:-GHOSTS][self.own].ravel(), mass, out=small)
        return lost

    def _prepare_tracer(self, mass: Array, small: Array | None) -> tracer.Passed:
        """Set the shares of small dust in the mass of the cells, and return arrays for the gas that passes sides."""
        if small is None:
            return NOTHING_PASSED
        if len(self.passed.shift) == 0:
            self.share = np.zeros((2, self.rings + 2 * GHOSTS, self.angles))
            sides = self.rings + 1, self.angles + 1
            self.passed = tracer.Passed(np.empty(sides), np.empty(sides), np.empty(self.rings, np.int64))
        self.share[0, GHOSTS:-GHOSTS][self.own] = (small / mass).reshape(self.shape)
        return self.passed

    def _move_tracer(self, passed: tracer.Passed, radial: bool) -> Array:
        """Move the small dust with the gas in a sweep, and return what left the inner and the outer edge (2,)."""
        share, new = self.share
        before, after = self.fields[DENSITY], self.new[DENSITY]
        lost = np.zeros(2)
        if radial:
            tracer.fill_share_ghosts(share)
            arrays = share, before, after, passed, self.swept, self.geometry, new
            lost = sum(self.for_rings(tracer.carry_radially, *arrays), lost)
        else:
            self.for_rings(tracer.carry_around, share, before, after, passed, new)
        self.share = self.share[::-1]
        return lost


class NearGrains(NamedTuple):
    """Grains that contribute to sums over grains in the own cells: the own grains, and then ghosts.

    members: combination of both. pos (n, 2): positions. places, sorted: for kernels.
    """

    members: world.ParticlesWithGhosts
    pos: Array
    places: sampling.PolarPlaces
    sorted: sampling.SortedGrains


class PolarGrains:
    """The dust of a state at the positions `pos` (n, 2) among polar cells, with sums over cells and over grains.

    With several processes the cells are those of consecutive rings: the own rings and the rings of own grains, with one
    more on both sides. Those of other processes among them are ghost rings. All but `for_rings` is collective.

    whole: geometry of all rings. first: first ring of this process among them. geometry: of the rings of this process.
    own: the own rings among these, a slice. places: of the own grains, for kernels.
    """

    def __init__(self, whole: Geometry, state: State, pos: Array) -> None:
        self.whole, self.gas, self.dust, self.pos = whole, state.gas, state.dust, pos
        self.angles = len(whole.cos)
        self.places = self._places_at(pos)
        self.first, self.geometry, self.own = 0, whole, slice(0, len(whole.radius))
        self._cells = world.ParticlesWithGhosts()
        if world.processes.is_parallel:
            self._fetch_rings()

    def _places_at(self, pos: Array) -> sampling.PolarPlaces:
        """Return the places of grains at `pos` (n, 2), with ring numbers of the whole grid."""
        g, count, rings = self.whole, len(pos), len(self.whole.radius)
        logarithm = math.log(g.sides[-1] / g.sides[0])
        arrays = np.empty(count, np.int32), np.empty(count, np.int32), np.empty((count, 2))
        places = sampling.PolarPlaces(*arrays, logarithm / rings)
        edges = g.sides[0], rings / logarithm
        parallel_for(sampling.find_places, count, pos, *edges, rings, g.angle, self.angles, places)
        return places

    def _fetch_rings(self) -> None:
        """Set the rings of this process, and combine its own cells with those of ghost rings."""
        rings, own = np.arange(len(self.whole.radius)), self.gas.global_index[:: self.angles] // self.angles
        around, end = np.concatenate([own.astype(np.int64), self.places.ring[~self.outside]]), 0
        if len(around) > 0:
            self.first, end = max(int(around.min()) - 1, 0), min(int(around.max()) + 2, len(rings))
        begin = int(own[0]) - self.first if len(own) > 0 else 0
        self.own, self.geometry = slice(begin, begin + len(own)), rings_of(self.whole, self.first, end, begin)
        self.places.ring[~self.outside] -= self.first
        key = np.repeat(own.astype(np.uint32), self.angles)
        needed = world.NeededCells((rings >= self.first) & (rings < end), rings, rings + 1)
        self._cells = world.processes.fetch_ghosts(self.gas, key, lambda: needed)

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of rings and of cells in a ring."""
        return len(self.geometry.radius), self.angles

    @property
    def area(self) -> Array:
        """Areas (own cells,)."""
        return np.repeat(self.geometry.volume[self.own] * self.geometry.angle, self.angles)

    @property
    def outside(self) -> Array:
        """Mask (n,) of own grains beyond the edges of the grid."""
        return self.places.ring < 0

    @cached_property
    def near(self) -> NearGrains:
        """The grains that contribute to sums in the own cells: those in the own rings and in the next rings."""
        beyond, count = len(self.whole.radius), self.own.stop - self.own.start
        rings, low = np.arange(beyond + 1), self.first + self.own.start - 1
        needed = (rings >= low) & (rings < min(low + count + 2, beyond)) & (count > 0)
        key = np.where(self.outside, beyond, self.places.ring + self.first).astype(np.uint32)
        members = world.processes.fetch_ghosts(self.dust, key, lambda: world.NeededCells(needed, rings, rings + 1))
        (pos, ids), places = members.all_with_ghosts([self.pos, self.dust.ids]), self.places
        if len(pos) > len(self.pos):
            places = self._places_at(pos)
            places.ring[places.ring >= 0] -= self.first
        cells, ring = math.prod(self.shape), places.ring.astype(np.int64)
        cell = np.where(ring < 0, cells, ring * self.angles + places.column)
        return NearGrains(members, pos, places, sampling.SortedGrains(*counting_sort(cell, cells + 1, ids)))

    def for_rings(self, kernel: Callable[..., Any], *arguments: Any) -> list[Any]:
        """Run `kernel(first, last, *arguments)` on chunks of the own rings; return the results in order."""
        return _on_rings(kernel, self.own.start, self.own.stop, self.angles, *arguments)

    def with_ghost_rings(self, arrays: list[Array]) -> list[Array]:
        """Return arrays (n, ...) of the own cells as (rings, angles, ...), with the ghost rings."""
        own, below = (self.own.stop - self.own.start) * self.angles, self.own.start * self.angles
        found = self._cells.all_with_ghosts(arrays)
        if below > 0:  # ghosts come after the own cells
            found = [np.concatenate([a[own : own + below], a[:own], a[own + below :]]) for a in found]
        return [array.reshape(*self.shape, *array.shape[1:]) for array in found]

    def sum_weights(self, values: Array) -> Array:
        """Return the sum (n,) of weights times `values` (own cells,) at each own grain; 0 beyond the edges."""
        out, (values,) = np.empty(len(self.pos)), self.with_ghost_rings([values])
        parallel_for(sampling.sum_weights, len(out), self.places, values, out)
        return out

    def spread(self, values: Array) -> Array:
        """Return the sum (own cells,) of weights times `values` (n,), of own grains, over the grains near each cell."""
        near, out = self.near, np.empty(self.shape)
        values = near.members.with_ghosts(values)
        self.for_rings(sampling.spread, near.places, near.sorted, values, out)
        return out[self.own].ravel()
