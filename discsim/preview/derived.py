"""Numbers derived from a scene at sample points: the edges and the middle of a disc, or a few points of another start.

    H = c_T / Omega,    Q = c_s Omega / (pi G Sigma),    h = eta (m / Sigma)^(1/d),    St = t_stop Omega

c_s: speed of sound waves. c_T = sqrt(P / Sigma): thermal speed. Omega: frequency of circular orbits about the softened
star. m: mass of a gas particle. d: dimensions of space. t_stop: stopping time of the dust.
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
from discsim.initial.base import Places
from discsim.numerics.layout import MAX_CELL_GROWTH, grid_cells, leaves, side_of_blocks
from discsim.parts import EOS, LAWS, SCHEMES, Lazy
from discsim.physics import laws, profile, viscosity
from discsim.physics.centre import kepler_omega
from discsim.physics.eos import eos_of
from discsim.physics.grains import has_sizes, typical_size
from discsim.physics.local import GasSamples, longest_step, resolution
from discsim.scene import Scene
from discsim.scene.units import Units

if TYPE_CHECKING:
    from discsim.drag.base import Cells
    from discsim.drag.width import Width

drag_width = Lazy("discsim.drag.width")
Array = np.ndarray


def local(scene: Scene) -> GasSamples:
    """Return the properties of the gas at the sample points of the scene's start."""
    return local_at(scene, start_of(scene).places(scene))


def local_at(scene: Scene, places: Places) -> GasSamples:
    """Return the properties of the gas at the sample points `places`.

    With [background], densities are those of the prescribed disc.
    """
    if scene.model.given is not None and places.radius is not None:
        places = replace(places, density=scene.model.given(scene).surface_density(places.radius))
    radius, density = places.radius, places.density
    omega = kepler_omega(scene, radius) if scene.star and radius is not None else None
    sound = _sound_speed(scene, places)
    thermal = None if sound is None else sound / np.sqrt(_adiabatic_index(scene, density))
    h = _smoothing_lengths(scene, places)
    fine = None if h is None else resolution(scene, h)
    step = None if h is None or sound is None else longest_step(scene, h, sound)
    nu = None if h is None else viscosity.diffusivity_at(scene, radius, thermal, h)
    if nu is not None and step is not None:
        step = np.minimum(step, viscosity.longest_step(scene, nu, h))
    particle_mass = gas_mass(scene) / particle_count(scene, scene.gas) if scene.gas else None
    relative = np.ones_like(density) if places.relative_mass is None else places.relative_mass
    found = grid(scene)
    at = GasSamples(
        places.names, radius, density, sound, thermal, omega, h, fine, step, partial(_resolution_by_mass, scene),
        lambda: _drag_cells(scene, at), relative, particle_mass, found[0] if found else None, places.jump,
    )  # fmt: skip
    return at


def _drag_cells(scene: Scene, at: GasSamples) -> tuple[Array, Array, Array] | None:
    side = drag_cell_sides(scene, at)
    return None if side is None else (side, *drag_cell_counts(scene, at, side))


def _resolution_by_mass(scene: Scene) -> tuple[Array, Array]:
    places, weight = start_of(scene).all_over(scene)
    at = local_at(scene, places)
    assert at.resolution is not None and at.scale_height is not None
    ratio = at.resolution / at.scale_height
    order = np.argsort(ratio, kind="stable")
    return ratio[order], np.cumsum(weight[order]) / weight.sum()


def gas_mass(scene: Scene) -> float:
    """Return the total mass of the gas. Without gas: the mass of the virtual gas to which `dust.ratio` refers."""
    return start_of(scene).mass(scene)


def dust_masses(scene: Scene) -> list[float]:
    """Return the total mass of each dust population."""
    return [dust.ratio * start_of(scene).mass(scene, dust) for dust in scene.dust or ()]


def stopping_times(scene: Scene, at: GasSamples) -> list[Array]:
    """Return the stopping times (n,) of each dust population at the sample points `at`.

    The list is empty if the scene defines no stopping times.
    """
    return laws.stopping_times(scene, at.density, at.thermal_speed, at.omega)


def derived(scene: Scene) -> list[tuple[str, str]]:
    """Return a row (name, values as text) for each derived number, in units of the scene."""
    if scene.initial is None:
        return []
    at = local(scene)
    rows = [*_mass_rows(scene), ("at", ", ".join(at.places))]
    density = "surface density" if scene.space.dimensions == 2 else "density"
    rows.append((f"{density} of the gas", _quantities_text(scene.units, at.density, "density")))
    if at.sound_speed is not None:
        rows.append(("sound speed", _quantities_text(scene.units, at.sound_speed, "velocity")))
    if scene.model.cells and scene.gas:
        cell = scene.space.size[0] / scene.gas.particles
        rows.append(("fixed grid", f"{scene.gas.particles} cells of {scene.units.show(cell, 'length')}"))
    if at.h is not None:
        rows.append(("smoothing length h", _quantities_text(scene.units, at.h, "length")))
    rows += [*_orbit_rows(scene, at), *_drag_rows(scene, at), *_grid_rows(scene)]
    return rows + effect_rows(scene)


def effect_rows(scene: Scene) -> list[tuple[str, str]]:
    """Return a row (name, values as text) for each derived number of an effect; run.log has them too."""
    if scene.initial is None:
        return []
    at = local(scene)
    with np.errstate(all="ignore"):  # infinities are shown as they are
        return [row for effect in effect_classes(scene).values() for row in effect.report(scene, at).rows]


def _mass_rows(scene: Scene) -> Iterator[tuple[str, str]]:
    # In 1D "mass" is a column: mass over area.
    name = "mass" if scene.space.dimensions == 2 else "surface_density"
    if scene.gas:
        mass = gas_mass(scene)
        yield "mass of the gas", scene.units.show(mass, name)
        if not scene.model.cells:
            mean = mass / particle_count(scene, scene.gas)
            yield "mass of a gas particle", _particle_mass_text(scene, mean, name)
    for i, (dust, mass) in enumerate(zip(scene.dust or (), dust_masses(scene), strict=True)):
        which = f" {i}" if len(scene.dust or ()) > 1 else ""
        yield f"mass of the dust{which}", scene.units.show(mass, name)
        if not scene.model.cells:
            yield f"mass of a dust particle{which}", scene.units.show(mass / particle_count(scene, dust), name)


def _orbit_rows(scene: Scene, at: GasSamples) -> Iterator[tuple[str, str]]:
    if at.omega is None:
        return
    period = 2 * math.pi / at.omega
    yield "orbital period", _quantities_text(scene.units, period, "time")
    yield "number of orbits", _numbers_text((scene.run.until - start_time(scene)) / period)
    if at.scale_height is not None and at.sound_speed is not None:
        yield "H/r", _numbers_text(at.scale_height / at.radius)
        if at.resolution is not None:
            yield "h/H", _numbers_text(at.resolution / at.scale_height)
            yield "Toomre Q", _numbers_text(at.toomre_q)
        slopes = profile.pressure_slopes(scene, at.radius)
        names = "headwind eta v_K", "headwind from midplane pressure"
        for name, slope in zip(names, slopes or (), strict=False):
            yield (
                name,
                _quantities_text(scene.units, 0.5 * slope * at.thermal_speed**2 / (at.radius * at.omega), "velocity"),
            )


def _drag_rows(scene: Scene, at: GasSamples) -> Iterator[tuple[str, str]]:
    times = stopping_times(scene, at)
    for i, time in enumerate(times):
        which, dust = f" {i}" if len(times) > 1 else "", scene.dust[i]
        if has_sizes(dust):
            yield f"mass-weighted mean grain size{which}", scene.units.show(typical_size(dust), "length")
            which += " of the mean size"
        if i == 0 and (formula := LAWS[scene.drag.law].formula) is not None:
            yield "formula of the stopping time", formula(scene)
        yield f"stopping time{which}", _quantities_text(scene.units, time, "time")
        if at.omega is not None:
            yield f"Stokes number{which}", _numbers_text(time * at.omega)
    side = drag_cell_sides(scene, at)
    if side is not None:
        counts = drag_cell_counts(scene, at, side)
        yield "side of a drag cell", _quantities_text(scene.units, side, "length")
        yield "gas particles in a drag cell", _numbers_text(counts[0])
        yield "dust particles in a drag cell", _numbers_text(counts[1])


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
        yield "memory of the grid, about", f"{size / 2**20:.3g} MiB"


def grid(scene: Scene) -> tuple[float, tuple[int, ...]] | None:
    """Return the side of a cell of the grid, and the number of cells along each axis. None: the run has no grid."""
    if not any(effect.role.grid for effect in effect_classes(scene).values()):
        return None
    first = (scene.gas,) if scene.gas else scene.dust or ()
    cell, shape = grid_cells(scene, sum(particle_count(scene, species) for species in first))
    return cell, tuple(max(1, number) for number in shape)


def grid_bytes(scene: Scene, shape: tuple[int, ...]) -> int:
    """Return the memory in bytes that all effects together need for a grid of `shape` cells."""
    return sum(effect.grid_bytes(scene, shape) for effect in effect_classes(scene).values())


def particle_count(scene: Scene, species: Any) -> int:
    """Return the number of particles that the start makes for `species`, the table of the gas or of a dust population.

    A lattice in 2D has whole rows and columns. Immobile particles beyond the ends of a tube or a layer are not counted.
    """
    on_lattice = species.placement == "even" if hasattr(species, "placement") else True
    if scene.space.dimensions == 1 or not on_lattice or scene.initial is None or not start_of(scene).on_lattice:
        return species.particles
    return math.prod(lattice.shape(scene.space.size, species.particles))


def drag_cell_sides(scene: Scene, at: GasSamples) -> Array | None:
    """Return the sides (n,) of drag cells at the sample points `at` at the start; None if drag has no cells.

    The side of a cell with too few particles is doubled once, if the upper limit of sides allows it. In a run such a
    cell can grow further.
    """
    found, drag = grid(scene), scene.drag
    cells: Cells | None = SCHEMES[drag.scheme].cells if drag else None
    if drag is None or cells is None or not scene.gas or at.h is None or found is None:
        return None
    cell, shape = found
    wanted, width = drag.cell_length, drag_width.Width(scene)
    if wanted is None:
        mean, least = _mean_and_min_length(scene, width)
        wanted = cells.leaf(scene, width.number, lambda: mean, least)
    periodic = scene.space.boundary == "periodic"
    leaf, _ = leaves(width.rounded * wanted, cell, shape, periodic, particle_count(scene, scene.gas))
    side = limit = np.full_like(at.h, leaf)
    if width.number:
        limit = width.number * _limited_lengths(width, at.radius, at.h)
        side = side_of_blocks(leaf, cells.share * limit)
    if cells.least is not None:
        counts = drag_cell_counts(scene, at, side)
        few = np.any([count < fewest for count, fewest in zip(counts, cells.least(scene), strict=True)], axis=0)
        side = np.where(few & (2 * side <= MAX_CELL_GROWTH * limit), 2 * side, side)
    return side


def drag_cell_counts(scene: Scene, at: GasSamples, side: Array) -> tuple[Array, Array]:
    """Return the mean numbers (n,) of gas and of dust particles in drag cells at the sample points `at`.

    side (n,): side of the cell at each point.
    """
    assert scene.gas is not None
    mass = at.density * side**scene.space.dimensions
    gas = mass * particle_count(scene, scene.gas) / (gas_mass(scene) * at.relative_mass)
    dust = np.zeros_like(gas)
    for population, total in zip(scene.dust or (), dust_masses(scene), strict=True):
        if total > 0:
            dust += _is_within(population, at) * population.ratio * mass * particle_count(scene, population) / total
    return gas, dust


def _is_within(population: Any, at: GasSamples) -> Array | float:
    """Return 1 at sample points between the inner and outer radius of a population, else 0; 1 without radii."""
    if at.radius is None:
        return 1.0
    return 1.0 * ((at.radius >= (population.inner or 0.0)) & (at.radius <= (population.outer or math.inf)))


def _limited_lengths(width: Width, radius: Array | None, h: Array) -> Array:
    """Return the smoothing lengths (n,) from which the size of drag cells follows: `h` (n,), limited at each radius.

    Without radii they are not limited.
    """
    return h if radius is None else width.counted_at(radius, h)


def _mean_and_min_length(scene: Scene, width: Width) -> tuple[float, float]:
    """Return the geometric mean and the minimum of the lengths from `_limited_lengths`, over all gas particles."""
    places, weight = start_of(scene).all_over(scene)
    h = _smoothing_lengths(scene, places)
    assert h is not None
    h = _limited_lengths(width, places.radius, h)
    return float(np.exp(np.average(np.log(h), weights=weight))), float(h.min())


def _sound_speed(scene: Scene, places: Places) -> Array | None:
    radius, density = places.radius, places.density
    if scene.model.given is not None and radius is not None:
        return scene.model.given(scene).sound_speed(radius)
    if scene.gas is None:
        return None
    if places.pressure is not None and eos_of(scene).holds_heat:
        return np.sqrt(_adiabatic_index(scene, density) * places.pressure / density)
    return eos_of(scene).start_speed(scene, radius, density)


def _adiabatic_index(scene: Scene, density: Array) -> Array | float:
    eos: Any = scene.table(scene.model.table).eos
    return EOS[eos.kind].adiabatic_index(eos, density)


def _smoothing_lengths(scene: Scene, places: Places) -> Array | None:
    if scene.gas is None or scene.model.cells:
        return None
    if scene.gas.smoothing_length is not None:
        return np.full_like(places.density, scene.gas.smoothing_length)
    mass: float | Array = gas_mass(scene) / particle_count(scene, scene.gas)
    if places.relative_mass is not None:
        mass = mass * places.relative_mass
    return scene.gas.eta * (mass / places.density) ** (1 / scene.space.dimensions)


def _particle_mass_text(scene: Scene, mean: float, name: str) -> str:
    """Return the mass of a gas particle as text; if masses differ, the smallest and the largest mass.

    mean: mean mass. name: its dimension.
    """
    relative = start_of(scene).all_over(scene)[0].relative_mass
    ends = [mean] if relative is None else [mean * relative.min(), mean * relative.max()]
    return " to ".join(scene.units.show(mass, name) for mass in ends)


def _quantities_text(units: Units, values: Array, name: str) -> str:
    return ", ".join(units.show(float(value), name) for value in values)


def _numbers_text(values: Array | None) -> str:
    return ", ".join(f"{value:.3g}" for value in values) if values is not None else ""
