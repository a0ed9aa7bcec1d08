"""Input files of RADMC-3D 2.0 (Dullemond et al. 2012; the manual of the version of December 2024).

The grid is spherical: cells of equal width in ln r and phi, and cells in theta on both sides of the mid-plane, finest
there. In the shell at r a layer of height H has in a cell the part

    erf(r mu_2 / sqrt(2) H) - erf(r mu_1 / sqrt(2) H),    mu = cos theta,                                          (1)

of its mass, which is eq. (1) of `layers.py` at the constant spherical radius r. Arrays are in binary files (`.binp`),
so that they are exact. The number density of H2 is rho / (2.8 u), for hydrogen with a part of 5/7 of the mass.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.export.grains import grains_of, groups_of, wavelength_range
from discsim.export.layers import REACH, disc_of, gaussian_parts, graded
from discsim.export.options import MAX_CELLS, MAX_SIZES
from discsim.sky.opacity import opacity_of
from discsim.sky.temperature import law_of

if TYPE_CHECKING:
    from discsim.export.grains import Grains
    from discsim.export.layers import Disc
    from discsim.export.options import ExportOptions
    from discsim.output.snapshot import Snapshot
    from discsim.sky.opacity import Opacity

Array = np.ndarray
H2_MASS = 2.8  # mass of gas for each H2 molecule in u
WAVELENGTHS = 120  # number
STEEPEST = 1.4  # largest latitude of the grid in radians
VERSION = "RADMC-3D 2.0"
SETTINGS = """nphot = 1000000
scattering_mode_max = 0
modified_random_walk = 1
istar_sphere = 1
"""


def write_folder(snap: Snapshot, folder: Path, options: ExportOptions) -> list[str]:
    """Write the input files of RADMC-3D into a folder that exists; return a description. Raises PlotError."""
    disc = disc_of(snap, options.checked_number("cells", 8, MAX_CELLS), options.checked_alpha(), options.prefix)
    snap = disc.snap
    groups = groups_of(grains_of(snap), options.checked_number("sizes", 1, MAX_SIZES))
    opacity = opacity_of(options.opacity, options.prefix)
    heights = [disc.height(group) for group in groups]
    thetas = _thetas(disc, heights)
    disc.check_size(len(thetas) - 1, len(groups))
    volume = _volumes(disc, thetas) * snap.units.cgs("length") ** 3
    wavelengths = np.geomspace(*wavelength_range(opacity), WAVELENGTHS)
    _write_grid(folder, disc, thetas)
    _write_lines(folder / "wavelength_micron.inp", [len(wavelengths)], wavelengths)
    _write_star(folder, snap, options, wavelengths)
    densities = []
    for number, (group, height) in enumerate(zip(groups, heights, strict=True)):
        parts = _parts(disc, thetas, height)
        mass = disc.masses(group.pos, group.mass) * snap.units.cgs("mass")
        densities.append(_flat(mass.T[:, None, :] * parts / volume))
        _write_opacity(folder, number, group, opacity, wavelengths)
    _write_binary(folder / "dust_density.binp", np.concatenate(densities), len(groups), densities[0].size)
    _write_species(folder, len(groups))
    (folder / "radmc3d.inp").write_text(SETTINGS)
    law: Any = law_of(None if options.temperature == "gas" else options.temperature, options.prefix)
    if options.temperature is not None:
        found = _flat(np.broadcast_to(disc.temperature(law).T[:, None, :], (disc.azimuths, *volume.shape[1:])))
        _write_binary(folder / "dust_temperature.bdat", np.tile(found, len(groups)), len(groups), found.size)
    if snap.gas is not None and snap.gas.count:
        _write_gas(folder, disc, thetas, volume)
    return [
        f"Written for {VERSION}: `radmc3d mctherm`, then `radmc3d image lambda 1300 incl 45`.",
        f"Grid: {len(disc.radius)} x {len(thetas) - 1} x {disc.azimuths} cells in r, theta and phi.",
        f"Opacity: {opacity.text}; without scattering.",
        *(_line(number, group, disc) for number, group in enumerate(groups)),
    ]


def _line(number: int, group: Grains, disc: Disc) -> str:
    """Return a line about one group of grains."""
    size = "" if group.mean_size is None else f", radius {group.mean_size:.4g} cm"
    mass = group.mass.sum() * disc.snap.units.cgs("mass")
    return f"Species {number + 1} (dustkappa_dust{number}.inp): {group.text}{size}, mass {mass:.15e} g."


def _thetas(disc: Disc, heights: list[Array]) -> Array:
    """Return the edges in theta: symmetric about pi/2, which is an edge, and fine enough for the thinnest layer."""
    aspects = [float((height / disc.radius).min()) for height in heights]
    thick = float((disc.gas_height / disc.radius).max())
    latitudes = graded(min([*aspects, thick]), min(REACH * thick, STEEPEST))
    return np.concatenate([0.5 * np.pi - latitudes[:0:-1], [0.5 * np.pi], 0.5 * np.pi + latitudes[1:]])


def _volumes(disc: Disc, thetas: Array) -> Array:
    """Return the volumes [1, theta, r] of cells, in code units."""
    shells = np.diff(disc.edges**3) / 3.0
    volume: Array = shells * -np.diff(np.cos(thetas))[:, None] * (2.0 * np.pi / disc.azimuths)
    return volume[None]


def _parts(disc: Disc, thetas: Array, height: Array) -> Array:
    """Return the parts [theta, r] of the mass of a layer with heights (rings,), eq. (1)."""
    return gaussian_parts(-np.cos(thetas) * (disc.radius / height)[:, None]).T


def _flat(values: Array) -> Array:
    """Return values [phi, theta, r] in the order of RADMC-3D's cells, in which r changes fastest."""
    return np.ascontiguousarray(values).ravel()


def _write_lines(path: Path, first: list[Any], rows: Any) -> None:
    """Write a text file: lines with the values `first`, then a line for each of `rows`."""
    lines = [str(value) for value in first]
    lines += [" ".join(f"{value:.17g}" for value in np.atleast_1d(row)) for row in rows]
    path.write_text("\n".join(lines) + "\n")


def _write_binary(path: Path, values: Array, *counts: int) -> None:
    """Write a binary file: format 1, 8 bytes a number, the number of cells and perhaps of species, and the values."""
    header = np.array([1, 8, *counts[::-1]], dtype="<i8")
    with path.open("wb") as file:
        file.write(header.tobytes())
        file.write(np.ascontiguousarray(values, dtype="<f8").tobytes())


def _write_grid(folder: Path, disc: Disc, thetas: Array) -> None:
    """Write amr_grid.inp: a regular spherical grid, with lengths in cm."""
    cm = disc.edges * disc.snap.units.cgs("length")
    phis = np.linspace(0.0, 2.0 * np.pi, disc.azimuths + 1)
    shape = f"{len(disc.radius)} {len(thetas) - 1} {disc.azimuths}"
    _write_lines(folder / "amr_grid.inp", [1, 0, 100, 0, "1 1 1", shape], np.concatenate([cm, thetas, phis]))


def _write_star(folder: Path, snap: Snapshot, options: ExportOptions, wavelengths: Array) -> None:
    """Write stars.inp: the star as a black body, at its position relative to the disc's centre."""
    from discsim.output.fields.frame import central_mass

    radius, temperature = options.star("cm")
    moves = snap.bodies is not None and snap.bodies.count > 0
    mass = float(snap.bodies.mass[0]) if snap.bodies is not None and moves else central_mass(snap)
    x, y = snap.bodies.pos[0] * snap.units.cgs("length") if snap.bodies is not None and moves else (0.0, 0.0)
    star = f"{radius:.17g} {mass * snap.units.cgs('mass'):.17g} {x:.17g} {y:.17g} 0"
    _write_lines(folder / "stars.inp", [2, f"1 {len(wavelengths)}", star], [*wavelengths, -temperature])


def _write_species(folder: Path, count: int) -> None:
    """Write dustopac.inp: a dustkappa file for each species, thermal grains."""
    rule = "-" * 40
    each = [line for number in range(count) for line in (rule, 1, 0, f"dust{number}")]
    _write_lines(folder / "dustopac.inp", [2, count, *each, rule], [])


def _write_opacity(folder: Path, number: int, group: Grains, opacity: Opacity, wavelengths: Array) -> None:
    """Write the absorption opacity of a group, the mean over the mass of its grains. Raises PlotError."""
    rows = list(zip(wavelengths, group.absorption(opacity, wavelengths), strict=True))
    _write_lines(folder / f"dustkappa_dust{number}.inp", [f"# {opacity.text}", 1, len(rows)], rows)


def _write_gas(folder: Path, disc: Disc, thetas: Array, volume: Array) -> None:
    """Write the number density of H2, and velocity and temperature of the gas."""
    from discsim.scene.astropy_units import constants

    gas, units = disc.snap.gas, disc.snap.units
    assert gas is not None
    cells = (disc.azimuths, *volume.shape[1:])
    mass = disc.masses(gas.pos, gas.mass) * units.cgs("mass")
    density = mass.T[:, None, :] * _parts(disc, thetas, disc.gas_height) / volume
    number = _flat(density / (H2_MASS * constants.u.cgs.value))
    _write_binary(folder / "numberdens_h2.binp", number, number.size)
    along, turned = disc.velocities() * units.cgs("velocity")
    flow = np.zeros((*cells, 3))  # along r, theta and phi: each shell moves as a whole
    flow[..., 0], flow[..., 2] = along.T[:, None, :], turned.T[:, None, :]
    _write_binary(folder / "gas_velocity.binp", flow.ravel(), number.size)
    if gas.temperature is not None:
        kelvin = np.broadcast_to(disc.temperature(None).T[:, None, :], cells)
        _write_binary(folder / "gas_temperature.binp", _flat(kelvin), number.size)
