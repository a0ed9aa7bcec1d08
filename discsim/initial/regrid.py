"""Gas of a snapshot in another representation: SPH particles to polar cells and back, and one polar grid to another.

- Particles to cells: each particle is spread over its smoothing kernel, with its velocity gradient.
- Cells to cells: the mass within a radius and an azimuth is interpolated by monotone cubics (Fritsch & Carlson 1980).
- Cells to particles: particles of equal mass are placed on rings. The spacing of the rings, and that of the particles
  along a ring, follow the mass of the cells.

Mass, angular momentum about the origin, heat and small dust of the gas within the new grid are conserved to rounding.
Velocities between centroids of cells are interpolated as v_r and l / r^1/2, which is uniform on circular orbits; l is
the angular momentum per mass.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from discsim.formulas.polar import FLOOR, Interpolation, PolarShape, ring_sides
from discsim.initial.refine import gradients
from discsim.initial.rings import place_on_rings

Array = np.ndarray
Arrays = dict[str, Array]
MIN_POINTS, MAX_POINTS, PER_CELL = 64, 4096, 64  # points that represent a particle: limits, and mean number in a cell
CHUNK = 1 << 20  # points at a time
NODES = 16384  # nodes of the mass within a radius


# Cells


class _Cells(NamedTuple):
    """Gas in cells: mass, v_r, l / r^1/2, and the quantities `others` per mass, each (rings, angles)."""

    mass: Array
    radial: Array
    spin: Array
    others: Arrays

    def quantities(self) -> Arrays:
        """Return all quantities but the mass by name."""
        return {"radial": self.radial, "spin": self.spin, **self.others}


def _cells_of(shape: PolarShape, gas: Arrays) -> _Cells:
    """Return the gas with the arrays `gas` in cells of `shape`."""
    r, grid = np.sqrt((gas["pos"] ** 2).sum(axis=1)), (shape.rings, shape.angles)
    radial = (gas["pos"] * gas["vel"]).sum(axis=1) / r
    others = {name: values.reshape(grid) for name, values in _per_mass(gas).items()}
    return _Cells(gas["mass"].reshape(grid), radial.reshape(grid), (_spin(gas) / np.sqrt(r)).reshape(grid), others)


def _arrays_of(shape: PolarShape, cells: _Cells) -> Arrays:
    """Return the arrays of the gas in cells of `shape`, with at least the surface density FLOOR."""
    radius, azimuth, area = shape.centroids()
    density = cells.mass / area[:, None]
    density = np.maximum(density, FLOOR * density.max())
    out = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)[None]
    across = np.stack([-out[..., 1], out[..., 0]], axis=-1)
    around = (cells.spin / np.sqrt(radius)[:, None])[..., None]
    vel = cells.radial[..., None] * out + around * across
    pos = np.broadcast_to(radius[:, None, None] * out, vel.shape)
    mass = (density * area[:, None]).ravel()
    arrays = {"pos": pos.reshape(-1, 2), "vel": vel.reshape(-1, 2), "mass": mass, "density": density.ravel()}
    return arrays | _of_gas({name: values.ravel() for name, values in cells.others.items()}, mass)


def _without_gaps(cells: _Cells) -> _Cells:
    """Return cells whose empty cells have the mean quantities of their ring, or else of rings that contain gas."""
    empty, of_ring = ~(cells.mass > 0.0), cells.mass.sum(axis=1)
    if not empty.any():
        return cells
    held = np.flatnonzero(of_ring)
    filled = {}
    for name, values in cells.quantities().items():
        mean = np.where(empty, 0.0, cells.mass * values).sum(axis=1)[held] / of_ring[held]
        filled[name] = np.where(empty, np.interp(np.arange(len(of_ring)), held, mean)[:, None], values)
    return _Cells(cells.mass, filled.pop("radial"), filled.pop("spin"), filled)


def _spin(gas: Arrays) -> Array:
    """Return the angular momentum per mass (n,) of particles or cells."""
    result: Array = gas["pos"][:, 0] * gas["vel"][:, 1] - gas["pos"][:, 1] * gas["vel"][:, 0]
    return result


def _per_mass(gas: Arrays) -> Arrays:
    """Return the energy and the small dust per mass (n,) of the gas, as far as it has them."""
    found = {"u": gas["u"]} if "u" in gas else {}
    return found | ({"small": gas["small"] / gas["mass"]} if "small" in gas else {})


def _of_gas(per_mass: Arrays, mass: Array) -> Arrays:
    """Return the arrays u and small of gas from the quantities `per_mass`."""
    return {name: values * mass if name == "small" else values for name, values in per_mass.items()}


def _totals(gas: Arrays) -> Arrays:
    """Return the total of mass, angular momentum and all quantities per mass of the gas."""
    sums = {name: (gas["mass"] * values).sum() for name, values in _per_mass(gas).items()}
    return {"mass": gas["mass"].sum(), "spin": (gas["mass"] * _spin(gas)).sum(), **sums}


def _with_totals(gas: Arrays, wanted: Arrays) -> Arrays:
    """Return the gas with the totals `wanted`: masses and quantities are scaled, and a rigid rotation is added."""
    scaled = gas | {name: gas[name] * (wanted["mass"] / gas["mass"].sum()) for name in ("mass", "density")}
    per_mass = {
        name: values * (wanted[name] / (scaled["mass"] * values).sum()) for name, values in _per_mass(gas).items()
    }
    now = _totals(scaled)
    rate = (wanted["spin"] - now["spin"]) / (scaled["mass"] * (gas["pos"] ** 2).sum(axis=1)).sum()
    vel = gas["vel"] + rate * np.stack([-gas["pos"][:, 1], gas["pos"][:, 0]], axis=1)
    return scaled | {"vel": vel} | _of_gas(per_mass, scaled["mass"])


# Conversions


def particles_to_cells(shape: PolarShape, gas: Arrays, reach: Array) -> Arrays:
    """Return the arrays of gas in cells of `shape`, from SPH particles whose kernels have the radii `reach` (n,).

    gas: arrays pos, vel (n, 2), mass (n,) and, optionally, u and small (n,). Gas outside the grid is left out.
    """
    pos, mass = gas["pos"], gas["mass"]
    number = int(np.clip(PER_CELL * shape.cells // len(pos), MIN_POINTS, MAX_POINTS))
    away, slopes, own_spin, per_mass = _kernel_points(number), gradients(pos, gas["vel"]), _spin(gas), _per_mass(gas)
    sums = np.zeros((3 + len(per_mass), shape.cells))  # of mass, radial momentum, angular momentum and others
    for first in range(0, len(pos), max(1, CHUNK // number)):
        part = slice(first, first + max(1, CHUNK // number))
        shift = reach[part, None, None] * away
        at, vel = pos[part, None] + shift, gas["vel"][part, None] + np.einsum("nki,nif->nkf", shift, slopes[part])
        r = np.sqrt((at**2).sum(axis=-1))
        radial, spin = (at * vel).sum(axis=-1) / r, at[..., 0] * vel[..., 1] - at[..., 1] * vel[..., 0]
        spin += (own_spin[part] - spin.mean(axis=1))[:, None]  # the gradient changes the mean of the points
        cell = _cell_at(shape, r, np.arctan2(at[..., 1], at[..., 0]))
        inside = cell >= 0
        weight = np.broadcast_to(mass[part, None] / number, cell.shape)
        constant = [np.broadcast_to(values[part, None], cell.shape) for values in per_mass.values()]
        for row, values in enumerate([np.ones_like(r), radial, spin, *constant]):
            sums[row] += np.bincount(cell[inside], (weight * values)[inside], shape.cells)
    if not sums[0].any():
        raise ValueError("the snapshot has no gas in the polar grid; change gas.grid.inner and gas.grid.outer")
    with np.errstate(divide="ignore", invalid="ignore"):
        radial, spin, *others = (row.reshape(shape.rings, shape.angles) for row in sums[1:] / sums[0])
    spin = spin / np.sqrt(shape.centroids()[0])[:, None]
    cells = _Cells(sums[0].reshape(spin.shape), radial, spin, dict(zip(per_mass, others, strict=True)))
    return _arrays_of(shape, _without_gaps(cells))


def _kernel_points(number: int) -> Array:
    """Return points (number, 2) that represent a Wendland C2 kernel of radius 1 with equal weights, and have mean 0."""
    x = np.linspace(0.0, 1.0, 1025)
    density = (1.0 - x) ** 4 * (1.0 + 4.0 * x) * x
    within = np.concatenate([[0.0], np.cumsum(density[1:] + density[:-1])])
    index = np.arange(number) + 0.5
    r = np.interp(index / number, within / within[-1], x)
    angle = np.pi * (3.0 - np.sqrt(5.0)) * index  # golden angle: evenly spaced in all directions
    points = r[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return points - points.mean(axis=0)


def _cell_at(shape: PolarShape, r: Array, azimuth: Array) -> Array:
    """Return the indices of the cells that contain points at r and azimuth, -1 outside the grid."""
    with np.errstate(divide="ignore"):
        ring = np.floor(np.log(r / shape.inner) * (shape.rings / np.log(shape.outer / shape.inner))).astype(np.int64)
    along = np.floor(azimuth * (shape.angles / (2.0 * np.pi))).astype(np.int64) % shape.angles
    return np.where((ring >= 0) & (ring < shape.rings), ring * shape.angles + along, -1)


def cells_to_cells(before: PolarShape, shape: PolarShape, gas: Arrays) -> Arrays:
    """Return the arrays of gas in cells of `shape`, from those in cells of another grid.

    Gas outside the new grid is left out. On the same grid the arrays keep their values.
    """
    if before[:2] == shape[:2] and np.allclose(before[2:4], shape[2:4], rtol=1e-12, atol=0.0):
        return gas
    old, (radius, azimuth, _) = _cells_of(before, gas), shape.centroids()
    spin = gas["mass"] * _spin(gas)
    totals = {"mass": gas["mass"], "spin": spin} | {n: gas["mass"] * v for n, v in _per_mass(gas).items()}
    moved = {name: _remapped(before, shape, values.reshape(old.mass.shape)) for name, values in totals.items()}
    if not moved["mass"].any():
        raise ValueError("the snapshot has no gas in the polar grid; change gas.grid.inner and gas.grid.outer")
    at = _between(before, old, *np.meshgrid(radius, azimuth, indexing="ij"))
    made = _arrays_of(shape, _Cells(moved["mass"], at.pop("radial"), at.pop("spin"), at))
    return _with_totals(made, {name: values.sum() for name, values in moved.items()})


def _remapped(before: PolarShape, shape: PolarShape, amounts: Array) -> Array:
    """Return the amounts (rings, angles) of a quantity in cells of `shape`, from those in cells of another grid."""
    from scipy.interpolate import PchipInterpolator  # slow to import

    old, new = (ring_sides(grid.rings, grid.inner, grid.outer) ** 2 for grid in (before, shape))
    within = PchipInterpolator(old, np.pad(np.cumsum(amounts, axis=0), ((1, 0), (0, 0))))
    in_rings = np.diff(within(np.clip(new, old[0], old[-1])), axis=0)
    wide = min(4, before.angles)  # cells that are repeated beyond the full circle
    around = np.concatenate([in_rings[:, -wide:], in_rings, in_rings[:, :wide]], axis=1)
    sides = np.arange(-wide, before.angles + wide + 1) / before.angles
    within = PchipInterpolator(sides, np.pad(np.cumsum(around, axis=1), ((0, 0), (1, 0))), axis=1)
    return np.asarray(np.diff(within(np.arange(shape.angles + 1) / shape.angles), axis=1))


def cells_to_particles(before: PolarShape, gas: Arrays, count: int, stream: np.random.Generator) -> Arrays:
    """Return the arrays of `count` SPH particles of equal mass, from the gas in cells of a polar grid.

    stream: generator of the angles of the first particles of rings.
    """
    from scipy.interpolate import PchipInterpolator  # slow to import

    cells, sides = _cells_of(before, gas), ring_sides(before.rings, before.inner, before.outer)
    r = np.linspace(before.inner, before.outer, NODES)
    within = PchipInterpolator(sides**2, np.concatenate([[0.0], np.cumsum(cells.mass.sum(axis=1))]))(r**2)
    radius, angle = place_on_rings(r, within * (count / within[-1]), stream)
    angle = _angles_by_mass(before, cells.mass, radius, angle)
    density = gas["density"].reshape(cells.mass.shape)
    at = _between(before, cells._replace(others=cells.others | {"density": density}), radius, angle)
    out = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    across = np.stack([-out[:, 1], out[:, 0]], axis=1)
    vel = at.pop("radial")[:, None] * out + (at.pop("spin") / np.sqrt(radius))[:, None] * across
    mass = np.full(count, gas["mass"].sum() / count)
    made = {"pos": radius[:, None] * out, "vel": vel, "mass": mass, "density": at.pop("density")}
    density = made["density"]
    return _with_totals(made | _of_gas(at, mass), _totals(gas)) | {"density": density}


def _angles_by_mass(shape: PolarShape, mass: Array, radius: Array, angle: Array) -> Array:
    """Return the angles (n,) of particles that are even along rings, displaced to follow the `mass` of the cells.

    radius, angle (n,): of the particles, ring by ring.
    """
    share = np.pad(np.cumsum(mass, axis=1) / mass.sum(axis=1)[:, None], ((0, 0), (1, 0)))
    sides = np.linspace(0.0, 2.0 * np.pi, shape.angles + 1)
    at = Interpolation(shape, radius, angle)
    moved = np.empty_like(angle)
    first = np.append(np.flatnonzero(np.diff(radius, prepend=-1.0)), len(radius))
    for start, end in pairwise(first):
        low, weight = at.ring[start], at.outwards[start]
        within = (1.0 - weight) * share[low] + weight * share[low + 1]
        moved[start:end] = np.interp(angle[start:end] / (2.0 * np.pi) % 1.0, within, sides)
    return moved


def _between(shape: PolarShape, cells: _Cells, r: Array, azimuth: Array) -> Arrays:
    """Return the quantities of the cells at points r and azimuth, interpolated linearly in ln r and azimuth."""
    at = Interpolation(shape, r, azimuth)
    return {name: at.of(values) for name, values in cells.quantities().items()}
