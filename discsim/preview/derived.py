"""Numbers derived from a scene at sample points: the edges and the middle of a disc, or a few points of another start.

    H = c_T / Omega,    Q = c_s Omega / (pi G Sigma),    h = eta (m / Sigma)^(1/d),    St = t_stop Omega

c_s: speed of sound waves. c_T = sqrt(P / Sigma): thermal speed. Omega: frequency of circular orbits about the softened
star. m: mass of a gas particle. d: number of dimensions. t_stop: stopping time of the dust. Q: Toomre Q. St: Stokes
number.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.effects import effect_classes
from discsim.initial import lattice, start_of, start_time
from discsim.initial.base import SamplePoints
from discsim.numerics.layout import MAX_CELL_GROWTH, grid_cells, leaf_side_and_counts, side_of_blocks
from discsim.parts import EOS, LAWS, SCHEMES, Lazy
from discsim.physics import laws, profile, viscosity
from discsim.physics.centre import kepler_omega
from discsim.physics.eos import eos_of
from discsim.physics.grains import has_sizes, typical_size
from discsim.physics.local import GasSamples, longest_step, resolution
from discsim.scene import Scene
from discsim.scene.units import Units

if TYPE_CHECKING:
    from discsim.drag.base import CellSizes
    from discsim.drag.width import CellWidth

drag_width = Lazy("discsim.drag.width")
Array = np.ndarray


def gas_at_start(scene: Scene) -> GasSamples:
    """Return the properties of the initial gas at the few sample points of the scene's start."""
    return gas_at_points(scene, start_of(scene).sample_points(scene))


def gas_at_points(scene: Scene, points: SamplePoints) -> GasSamples:
    """Return the properties of the gas at the sample points `points` of a start.

    With [background], the densities of `points` are replaced by those of the prescribed disc.
    """
    if scene.model.given is not None and points.radius is not None:
        points = replace(points, density=scene.model.given(scene).surface_density(points.radius))
    radius, density = points.radius, points.density
    omega = kepler_omega(scene, radius) if scene.star and radius is not None else None
    sound = _sound_speed(scene, points)
    thermal = None if sound is None else sound / np.sqrt(_adiabatic_index(scene, density))
    h = _smoothing_lengths(scene, points)
    usual_h = None if h is None else resolution(scene, h)
    step = None if h is None or sound is None else longest_step(scene, h, sound)
    nu = None if h is None else viscosity.diffusivity_at(scene, radius, thermal, h)
    if nu is not None and step is not None:
        step = np.minimum(step, viscosity.longest_step(scene, nu, h))
    particle_mass = gas_mass(scene) / particle_count(scene, scene.gas) if scene.gas else None
    relative = np.ones_like(density) if points.relative_mass is None else points.relative_mass
    of_grid = grid(scene)
    at = GasSamples(
        points.names, radius, density, sound, thermal, omega, h, usual_h, step, partial(_resolution_by_mass, scene),
        lambda: _drag_cells(scene, at), relative, particle_mass, of_grid[0] if of_grid else None, points.jump,
    )  # fmt: skip
    return at


def _drag_cells(scene: Scene, at: GasSamples) -> tuple[Array, Array, Array] | None:
    """Return side, gas particles and dust particles (n,) of drag cells at the points `at`; None without drag cells."""
    side = drag_cell_sides(scene, at)
    return None if side is None else (side, *drag_cell_counts(scene, at, side))


def _resolution_by_mass(scene: Scene) -> tuple[Array, Array]:
    """Return values of h/H (m,) in rising order, and the mass fraction (m,) of the gas with h/H up to each value."""
    points, weight = start_of(scene).sample_all_gas(scene)
    at = gas_at_points(scene, points)
    assert at.resolution is not None and at.scale_height is not None
    ratio = at.resolution / at.scale_height
    order = np.argsort(ratio, kind="stable")
    return ratio[order], np.cumsum(weight[order]) / weight.sum()


def gas_mass(scene: Scene) -> float:
    """Return the mass of all gas; in a scene without [gas] the mass to which `dust.ratio` refers."""
    return start_of(scene).gas_mass(scene)


def dust_masses(scene: Scene) -> list[float]:
    """Return the total mass of each dust population."""
    return [dust.ratio * start_of(scene).gas_mass(scene, dust) for dust in scene.dust or ()]


def stopping_times(scene: Scene, at: GasSamples) -> list[Array]:
    """Return the stopping times (n,) at the sample points `at`, one array for each dust population.

    The list is empty if the scene has no drag law.
    """
    return laws.stopping_times(scene, at.density, at.thermal_speed, at.omega)


def derived_rows(scene: Scene) -> list[tuple[str, str]]:
    """Return a row (name, values at the sample points as text) for each derived number, in units of the scene."""
    if scene.initial is None:
        return []
    at = gas_at_start(scene)
    rows = [*_mass_rows(scene), ("at", ", ".join(at.places))]
    density = "surface density" if scene.space.dimensions == 2 else "density"
    rows.append((f"{density} of the gas", _quantity_texts(scene.units, at.density, "density")))
    if at.sound_speed is not None:
        rows.append(("sound speed", _quantity_texts(scene.units, at.sound_speed, "velocity")))
    if scene.model.cells and scene.gas:
        cell = scene.space.size[0] / scene.gas.particles
        rows.append(("fixed grid", f"{scene.gas.particles} cells of {scene.units.show(cell, 'length')}"))
    if at.h is not None and scene.model.is_sph:
        rows.append(("smoothing length h", _quantity_texts(scene.units, at.h, "length")))
    rows += [*_orbit_rows(scene, at), *_drag_rows(scene, at), *_grid_rows(scene)]
    return rows + effect_rows(scene)


def effect_rows(scene: Scene) -> list[tuple[str, str]]:
    """Return a row (name, values as text) for each derived number that an effect reports."""
    if scene.initial is None:
        return []
    at = gas_at_start(scene)
    with np.errstate(all="ignore"):  # infinities are shown as they are
        return [row for effect in effect_classes(scene).values() for row in effect.report(scene, at).rows]


def _mass_rows(scene: Scene) -> Iterator[tuple[str, str]]:
    # In 1D masses are masses per area.
    dimension = "mass" if scene.space.dimensions == 2 else "surface_density"
    if scene.gas:
        mass = gas_mass(scene)
        yield "mass of gas", scene.units.show(mass, dimension)
        if scene.model.is_sph:
            mean, relative = (
                mass / particle_count(scene, scene.gas),
                start_of(scene).sample_all_gas(scene)[0].relative_mass,
            )
            ends = [mean] if relative is None else [mean * relative.min(), mean * relative.max()]
            yield "particle mass of gas", " to ".join(scene.units.show(end, dimension) for end in ends)
    for dust, mass, phrase in zip(scene.dust or (), dust_masses(scene), scene.dust_phrases, strict=True):
        yield f"mass of {phrase}", scene.units.show(mass, dimension)
        if not scene.model.cells:
            yield f"particle mass of {phrase}", scene.units.show(mass / particle_count(scene, dust), dimension)


def _orbit_rows(scene: Scene, at: GasSamples) -> Iterator[tuple[str, str]]:
    if at.omega is None:
        return
    period = 2 * math.pi / at.omega
    yield "orbital period", _quantity_texts(scene.units, period, "time")
    yield "number of orbits", _number_texts((scene.run.until - start_time(scene)) / period)
    if at.scale_height is not None and at.sound_speed is not None:
        yield "H/r", _number_texts(at.scale_height / at.radius)
        if at.resolution is not None:
            if scene.model.is_sph:
                yield "h/H", _number_texts(at.resolution / at.scale_height)
            yield "Toomre Q", _number_texts(at.toomre_q)
        slopes = profile.pressure_slopes(scene, at.radius)
        names = "headwind eta v_K", "headwind from midplane pressure"
        for name, slope in zip(names, slopes or (), strict=False):
            headwind = 0.5 * slope * at.thermal_speed**2 / (at.radius * at.omega)
            yield name, _quantity_texts(scene.units, headwind, "velocity")


def _drag_rows(scene: Scene, at: GasSamples) -> Iterator[tuple[str, str]]:
    times = stopping_times(scene, at)
    for i, time in enumerate(times):
        which, dust = f" of {scene.dust_phrases[i]}" if len(times) > 1 else "", scene.dust[i]
        if has_sizes(dust):
            yield f"mass-weighted mean grain size{which}", scene.units.show(typical_size(dust), "length")
            which = f" of the mean size{which}"
        if i == 0 and (formula := LAWS[scene.drag.law].formula) is not None:
            yield "formula of the stopping time", formula(scene)
        yield f"stopping time{which}", _quantity_texts(scene.units, time, "time")
        if at.omega is not None:
            yield f"Stokes number{which}", _number_texts(time * at.omega)
    side = drag_cell_sides(scene, at)
    if side is not None:
        counts = drag_cell_counts(scene, at, side)
        yield "side of a drag cell", _quantity_texts(scene.units, side, "length")
        yield f"gas {scene.model.elements} in a drag cell", _number_texts(counts[0])
        yield "dust particles in a drag cell", _number_texts(counts[1])


def _grid_rows(scene: Scene) -> Iterator[tuple[str, str]]:
    found = grid(scene)
    if found is None:
        return
    cell, shape = found
    size = grid_bytes(scene, shape)
    if scene.space.dimensions == 1 and not size:  # drag cells in 1D are independent of the grid
        return
    yield "grid", " x ".join(map(str, shape)) + " cells of " + scene.units.show(cell, "length")
    if size:
        yield "memory of the grid, estimated", f"{size / 2**20:.3g} MiB"


def grid(scene: Scene) -> tuple[float, tuple[int, ...]] | None:
    """Return the side of a grid cell, and the number of cells along each axis; None if the run has no grid."""
    if not any(effect.role.grid for effect in effect_classes(scene).values()):
        return None
    tables = (scene.gas,) if scene.gas else scene.dust or ()
    cell, shape = grid_cells(scene, sum(particle_count(scene, species) for species in tables))
    return cell, tuple(max(1, number) for number in shape)


def grid_bytes(scene: Scene, shape: tuple[int, ...]) -> int:
    """Return the memory in bytes that all effects together need for a grid with `shape` cells along each axis."""
    return sum(effect.grid_bytes(scene, shape) for effect in effect_classes(scene).values())


def particle_count(scene: Scene, species: Any) -> int:
    """Return the number of particles that the start makes for `species`, the table of the gas or of a dust population.

    The number can differ from `particles` of this table, because a lattice in 2D has whole rows and columns. Immobile
    particles beyond the ends of a tube or a layer are not counted.
    """
    if scene.model.disc_cells is not None and species is scene.gas:
        return scene.model.disc_cells(scene).cells
    on_lattice = species.placement == "even" if hasattr(species, "placement") else True
    if scene.space.dimensions == 1 or not on_lattice or scene.initial is None or not start_of(scene).on_lattice:
        return species.particles
    return math.prod(lattice.lattice_shape(scene.space.size, species.particles))


def drag_cell_sides(scene: Scene, at: GasSamples) -> Array | None:
    """Return the sides (n,) of drag cells at the sample points `at`, at the start; None if drag has no cells.

    The side of a cell with too few particles is doubled once, if the upper limit of sides allows it. In a run such a
    cell can grow further.
    """
    of_grid, drag = grid(scene), scene.drag
    cells: CellSizes | None = SCHEMES[drag.scheme].cells if drag else None
    if drag is None or cells is None or not scene.gas or at.h is None or of_grid is None:
        return None
    cell, shape = of_grid
    least_leaf, width = drag.cell_length, drag_width.CellWidth(scene)
    if least_leaf is None:
        mean, least = _mean_and_min_length(scene, width)
        least_leaf = cells.leaf(scene, width.number, lambda: mean, least)
    periodic = scene.space.boundary == "periodic"
    leaf, _ = leaf_side_and_counts(width.rounded * least_leaf, cell, shape, periodic, particle_count(scene, scene.gas))
    side = limit = np.full_like(at.h, leaf)
    if width.number:
        limit = width.number * _limit_lengths(width, at.radius, at.h)
        side = side_of_blocks(leaf, cells.least_side * limit)
    if cells.minimum is not None:
        counts = drag_cell_counts(scene, at, side)
        few = np.any([count < fewest for count, fewest in zip(counts, cells.minimum(scene), strict=True)], axis=0)
        side = np.where(few & (2 * side <= MAX_CELL_GROWTH * limit), 2 * side, side)
    return side


def drag_cell_counts(scene: Scene, at: GasSamples, side: Array) -> tuple[Array, Array]:
    """Return the mean numbers (n,) of gas and of dust particles in a drag cell at each of the sample points `at`.

    side (n,): sides of the cells.
    """
    assert scene.gas is not None
    mass = at.density * side**scene.space.dimensions
    gas = mass * particle_count(scene, scene.gas) / (gas_mass(scene) * at.relative_mass)
    dust = np.zeros_like(gas)
    for population, total in zip(scene.dust or (), dust_masses(scene), strict=True):
        if total > 0:
            dust += _is_within(population, at) * population.ratio * mass * particle_count(scene, population) / total
    return gas, dust


def _is_within(population: Any, at: GasSamples) -> Array | bool:
    """Return whether each of the sample points `at` is between the edges of the dust population; True without radii."""
    return at.radius is None or (at.radius >= (population.inner or 0.0)) & (at.radius <= (population.outer or math.inf))


def _limit_lengths(width: CellWidth, radius: Array | None, h: Array) -> Array:
    """Return the smoothing lengths (n,) that set the size of drag cells: `h` (n,), limited by H at each radius (n,).

    If `radius` is None, `h` is returned unchanged.
    """
    return h if radius is None else width.limited_lengths_at(radius, h)


def _mean_and_min_length(scene: Scene, width: CellWidth) -> tuple[float, float]:
    """Return geometric mean and minimum, over all gas, of the smoothing lengths that set the size of drag cells."""
    points, weight = start_of(scene).sample_all_gas(scene)
    h = _smoothing_lengths(scene, points)
    assert h is not None
    h = _limit_lengths(width, points.radius, h)
    return float(np.exp(np.average(np.log(h), weights=weight))), float(h.min())


def _sound_speed(scene: Scene, points: SamplePoints) -> Array | None:
    """Return the speed of sound waves (n,) at the sample points; None with neither [gas] nor [background]."""
    radius, density = points.radius, points.density
    if scene.model.given is not None and radius is not None:
        return scene.model.given(scene).sound_speed(radius)
    if scene.gas is None:
        return None
    if points.pressure is not None and eos_of(scene).holds_heat:
        return np.sqrt(_adiabatic_index(scene, density) * points.pressure / density)
    return eos_of(scene).start_speed(scene, radius, density)


def _adiabatic_index(scene: Scene, density: Array) -> Array | float:
    eos: Any = scene.table(scene.model.table).eos
    return EOS[eos.kind].adiabatic_index(eos, density)


def _smoothing_lengths(scene: Scene, points: SamplePoints) -> Array | None:
    """Return the smoothing length h (n,) at the sample points; None without gas particles."""
    if scene.gas is None or scene.model.cells:
        return None
    if scene.gas.smoothing_length is not None:
        return np.full_like(points.density, scene.gas.smoothing_length)
    if scene.model.disc_cells is not None and points.radius is not None:
        return scene.gas.eta * scene.model.disc_cells(scene).side(points.radius)
    mass: float | Array = gas_mass(scene) / particle_count(scene, scene.gas)
    if points.relative_mass is not None:
        mass = mass * points.relative_mass
    return scene.gas.eta * (mass / points.density) ** (1 / scene.space.dimensions)


def _quantity_texts(units: Units, values: Array, dimension: str) -> str:
    """Return values (n,) of a dimension, like "length", as text with units, separated by commas."""
    return ", ".join(units.show(float(value), dimension) for value in values)


def _number_texts(values: Array | None) -> str:
    return ", ".join(f"{value:.3g}" for value in values) if values is not None else ""
