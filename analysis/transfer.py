"""Compare discsim with RADMC-3D and MCFOST: fluxes at 1.3 mm, and temperatures of the mid-plane.

    python analysis/transfer.py flux RUN -o OUT [--cells N,...] [--inclination I,...]
    python analysis/transfer.py temperature RUN -o OUT [--cells N] [--packages N] [--radii R,...] [--mcfost PROGRAM]

RUN is the directory of a run, or one of these, which the script runs in OUT/RUN unless it is there: "thin", the gas
and 3 mm grains of the README at 20 yr, optically thin at 1.3 mm; "thick", the setup twin_twoway. The script exports the
last snapshot into folders of OUT, runs RADMC-3D (and MCFOST) in them, reads their results, and prints a table, which it
also writes into OUT. Results that OUT has already are not computed again. Fluxes are at 140 pc, without the star.

flux          of `discsim image` and of RADMC-3D with the same temperatures, those of the gas, and that of the exported
              cells as a disc without height; by cells in azimuth and by inclination in degrees
temperature   of the mid-plane, a mean over azimuth, and the flux, from
              RADMC-3D and MCFOST    temperatures that the code computes from the star's light, by packages of photons
              gas                    the temperature of the gas in the scene
              passive disc           the law of a passive disc with the luminosity of the star
              discsim, RADMC-3D's T  the flux of `discsim image` with the mean over mass of RADMC-3D's temperatures

The opacity is the default, 10 cm2/g (nu / 1 THz), without scattering. The star is a black body of 2 Rsun and 4000 K.
RADMC-3D 2.0: https://github.com/dullemond/radmc3d-2.0. MCFOST 4.1: https://github.com/cpinte/mcfost.
"""

from __future__ import annotations

import argparse
import math
import re
import shutil
import subprocess
import sys
from argparse import ArgumentTypeError
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from astropy import constants, units
from astropy.io import fits
from astropy.modeling.models import BlackBody
from astropy.table import QTable
from script_helpers import whole_numbers

import discsim.export
from discsim import shipped
from discsim.output.results import print_fault, print_table, script_parser, write_table
from discsim.output.run import Run
from discsim.output.snapshot import Snapshot
from discsim.printable import UserError
from discsim.run.runner import DONE, run_scene
from discsim.sky.temperature import law_of

Array = np.ndarray
MICRONS, DISTANCE = 1300, "140 pc"
STAR_RADIUS, STAR_TEMPERATURE = 2.0 * units.Rsun, 4000.0 * units.K
PIXELS = 500  # on a side of RADMC-3D's images
MCFOST_PIXELS = 200
THIN = """
title = "Gas and 3 mm grains about a star"
run = {until = "20 yr", snapshots = 1}
space = {size = "160 au"}
initial = {kind = "disc", mass = "0.001 Msun", inner = "15 au", outer = "60 au"}
star = {mass = "1 Msun", accretion_radius = "12 au"}
drag = {law = "epstein", direction = "two-way"}
[gas]
particles = 35_000
eos = {kind = "locally-isothermal", aspect_ratio = 0.07, reference_radius = "20 au"}
viscosity = {alpha = 1.0}
[dust]
particles = 15_000
ratio = 0.01
grain_size = "3 mm"
grain_density = "2 g/cm3"
"""
RUNS = ("thin", "thick")


class InputError(UserError):
    """A run, an option or a program that does not suit the comparison; the message has the reason."""


class Grid(NamedTuple):
    """Cells of an export for RADMC-3D: edges in r (cm), and in theta and phi (radians)."""

    r: Array
    theta: Array
    phi: Array

    @property
    def radius(self) -> Array:
        """Middles of the shells in au, in ln r."""
        return np.sqrt(self.r[1:] * self.r[:-1]) / units.au.to("cm")


def program(name: str, option: str) -> str:
    """Return the path of a program. Raises InputError."""
    found = shutil.which(name)
    if found is None:
        raise InputError(f"{option} {name}: program not found; give its path, or add its directory to PATH")
    return str(Path(found).absolute())


def call(folder: Path, log: str, *words: object) -> None:
    """Run a program in a folder, with its output in the file `log`. Raises InputError if it fails."""
    with (folder / log).open("w") as output:
        done = subprocess.run(list(map(str, words)), cwd=folder, stdin=subprocess.DEVNULL, stdout=output, stderr=output)
    if done.returncode:
        raise InputError(f"{words[0]}: ended with status {done.returncode}; {folder / log} has its messages")


def run_named(given: str, out: Path) -> Run:
    """Return the run in a directory, or one of RUNS, which is made in `out` unless it is there. Raises UserError."""
    if given not in RUNS:
        return discsim.open_run(given)
    directory = out / given
    if not directory.exists():
        source = out / f"{given}.toml"
        source.write_text(THIN if given == "thin" else shipped.setup("twin_twoway").text, encoding="utf-8")
        if run_scene(discsim.load_scene(source), directory) != DONE:
            raise InputError(f"{directory}: the run did not end; see its message above, and remove the directory")
    return discsim.open_run(directory)


def exported(snap: Snapshot, to: str, folder: Path, **options: Any) -> Path:
    """Return a folder with an export of a snapshot, which is written unless it is there. Raises UserError."""
    star = {"star_radius": STAR_RADIUS, "star_temperature": STAR_TEMPERATURE}
    if not folder.exists():
        discsim.export.write(snap, to, folder, **star, **options)
    if (folder / "dustkappa_dust1.inp").exists():
        raise InputError(f"{folder}: several species of dust; expected a run with one grain size")
    return folder


def grid_of(folder: Path) -> Grid:
    """Return the grid of an export for RADMC-3D."""
    words = (folder / "amr_grid.inp").read_text().split()
    counts = np.array(words[7:10], dtype=int)
    return Grid(*np.split(np.array(words[10:], dtype=float), np.cumsum(counts + 1)[:-1]))


def jansky(specific: Array, pixel: Any) -> float:
    """Return the flux in Jy of an image in erg/s/cm2/Hz/sr, with the length `pixel` of a side of its pixels."""
    angle = (pixel / units.Quantity(DISTANCE)).to_value("", units.dimensionless_angles())
    return float((specific.sum() * angle**2 * units.Unit("erg/(s cm2 Hz)")).to_value("Jy"))


def planck(temperature: Any) -> Any:
    """Return the intensity of a black body at MICRONS in Jy/sr, for temperatures in K."""
    return (BlackBody(temperature * units.K)(MICRONS * units.um) * units.sr).to_value("Jy")


def cell_values(folder: Path, name: str) -> Array:
    """Return the values [phi, theta, r] in a binary file of RADMC-3D with one species of dust."""
    return np.fromfile(folder / name, dtype="<f8")[4:].reshape([len(edges) - 1 for edges in grid_of(folder)[::-1]])


def flux_of_cells(folder: Path, inclination: float) -> float:
    """Return the flux in Jy of an export with temperatures, if the dust in its cells had no height."""
    grid, cosine = grid_of(folder), np.cos(np.radians(inclination))
    density, heat = (cell_values(folder, name) for name in ("dust_density.binp", "dust_temperature.bdat"))
    height = np.diff(grid.r**3) / 3.0 * -np.diff(np.cos(grid.theta))[:, None]  # volume by angle in phi
    area = 0.5 * np.diff(grid.r**2)
    wavelength, kappa = np.loadtxt(folder / "dustkappa_dust0.inp", skiprows=3).T
    opacity = np.exp(np.interp(np.log(MICRONS), np.log(wavelength), np.log(kappa)))
    depth = opacity * (density * height).sum(axis=1) / (area * cosine)
    flux = -np.expm1(-depth) * planck(heat[:, 0]) * area * np.diff(grid.phi)[:, None] * cosine
    return float(flux.sum() / units.Quantity(DISTANCE).to_value("cm") ** 2)


def radmc3d_flux(radmc3d: str, folder: Path, inclination: float, side: float) -> float:
    """Return the flux in Jy of an image by RADMC-3D, with a side in au, from the temperatures in the folder."""
    view = f"lambda {MICRONS} incl {inclination:g} npix {PIXELS} sizeau {side:.9g} nostar".split()
    call(folder, "image.log", radmc3d, "image", *view)
    words = (folder / "image.out").read_text().split()
    count = int(words[1]) * int(words[2])
    return jansky(np.array(words[7 : 7 + count], dtype=float), float(words[4]) * units.cm)


def radmc3d_temperature(radmc3d: str, folder: Path, packages: int) -> Array:
    """Return the temperature [phi, theta, r] that RADMC-3D computes for one species of dust."""
    if not (folder / "dust_temperature.dat").exists():
        call(folder, "mctherm.log", radmc3d, "mctherm", "nphot_therm", packages)
    shape = tuple(len(edges) - 1 for edges in grid_of(folder)[::-1])
    return np.loadtxt(folder / "dust_temperature.dat", skiprows=3).reshape(shape)


def mcfost_results(mcfost: str, folder: Path, packages: int) -> tuple[Array, float]:
    """Return the temperature [phi, z, r] and the flux in Jy that MCFOST computes for an export."""
    text = (folder / "discsim.para").read_text()
    (folder / "discsim.para").write_text(re.sub(r"\S+( +nbr_photons_eq_th)", rf"{packages:d}\1", text))
    words = (mcfost, "discsim.para", "-3D", "-density_file", "density.fits.gz", "-star_bb")
    if not (folder / "data_th").exists():
        call(folder, "temperature.log", *words)
    if not (folder / f"data_{MICRONS}").exists():
        call(folder, "image.log", *words, "-img", MICRONS, "-Jy", "-resol", MCFOST_PIXELS, MCFOST_PIXELS)
    image = fits.getdata(folder / f"data_{MICRONS}" / "RT.fits.gz")
    solid_angle = np.pi * (STAR_RADIUS / units.Quantity(DISTANCE)).to_value("") ** 2
    star = solid_angle * planck(STAR_TEMPERATURE.value)
    return fits.getdata(folder / "data_th" / "Temperature.fits.gz"), float(image[0, 0, 0].sum() - star)


def mid_plane(temperature: Array) -> Array:
    """Return the mean (rings,) over azimuth of the two cells at the mid-plane, of temperatures [phi, height, r]."""
    middle = temperature.shape[1] // 2
    return temperature[:, middle - 1 : middle + 1].mean(axis=(0, 1))


def mass_mean(temperature: Array, folder: Path, grid: Grid) -> Array:
    """Return the mean (rings,) over mass of temperatures [phi, theta, r] of one species of dust."""
    mass = cell_values(folder, "dust_density.binp") * -np.diff(np.cos(grid.theta))[:, None]
    return (mass * temperature).sum(axis=(0, 1)) / np.maximum(mass.sum(axis=(0, 1)), 1e-300)


def compare_fluxes(given: Any, snap: Snapshot) -> tuple[str, list[str], list[list[object]]]:
    """Return title, head and rows of the table of fluxes."""
    radmc3d, rows = program(given.radmc3d, "--radmc3d"), []
    for cells in given.cells:
        folder = given.output / f"{given.name}-gas-{cells}-{given.alpha:g}"
        exported(snap, "radmc3d", folder, alpha=given.alpha, cells=cells, temperature="gas")
        for inclination in given.inclination:
            ours, side = our_flux(snap, inclination=f"{inclination} deg")
            theirs = radmc3d_flux(radmc3d, folder, inclination, side)
            fluxes = [ours, flux_of_cells(folder, inclination), theirs]
            rows.append([cells, inclination, *(f"{x:.5g}" for x in fluxes), f"{100.0 * (theirs / ours - 1.0):.2f}"])
    head = ["cells", "inclination [deg]", "discsim [Jy]", "cells [Jy]", "RADMC-3D [Jy]", "difference [%]"]
    return f"{snap.title}: flux at {MICRONS / 1000} mm and {DISTANCE}, temperature of the gas", head, rows


def compare_temperatures(given: Any, snap: Snapshot) -> tuple[str, list[str], list[list[object]]]:
    """Return title, head and rows of the table of temperatures."""
    radmc3d = program(given.radmc3d, "--radmc3d")
    mcfost = None if given.mcfost is None else program(given.mcfost, "--mcfost")
    options, name = (
        {"alpha": given.alpha, "cells": given.cells[0]},
        f"{given.name}-{{}}-{given.cells[0]}-{given.alpha:g}",
    )
    folder = exported(snap, "radmc3d", given.output / name.format("radmc3d"), **options)
    grid = grid_of(folder)
    found = radmc3d_temperature(radmc3d, folder, given.packages)
    by_mass = mass_mean(found, folder, grid)
    of_gas, side = our_flux(snap)
    codes = [("RADMC-3D", mid_plane(found), radmc3d_flux(radmc3d, folder, 0.0, side))]
    if mcfost is not None:
        table = given.output / "opacity.ecsv"
        wavelength = np.array([0.1, 1e4]) * units.um
        kappa = 10.0 * units.cm**2 / units.g * (constants.c / wavelength).to_value("THz")
        QTable({"wavelength": wavelength, "absorption": kappa}).write(table, format="ascii.ecsv", overwrite=True)
        other = exported(snap, "mcfost", given.output / name.format("mcfost"), opacity=table, **options)
        heat, flux = mcfost_results(mcfost, other, given.packages)
        codes.append(("MCFOST", mid_plane(heat), flux))
    luminosity = (4.0 * np.pi * STAR_RADIUS**2 * constants.sigma_sb * STAR_TEMPERATURE**4).to("Lsun")
    passive = f"{luminosity.value:.6g} Lsun"
    edges = grid.r / snap.units.cgs("length")
    gas = snap.field("gas.temperature", edges=edges).to_value("K")
    there = np.isfinite(gas)
    codes += [
        ("gas", np.interp(grid.radius, grid.radius[there], gas[there]), of_gas),
        ("passive disc", law_of(passive)(grid.radius), our_flux(snap, temperature=passive)[0]),
        ("discsim, RADMC-3D's T", by_mass, our_flux(snap, temperature=lambda r: np.interp(r, grid.radius, by_mass))[0]),
    ]
    logs = np.log(given.radii), np.log(grid.radius)
    rows = [[label, *(f"{t:.1f}" for t in np.interp(*logs, heat)), f"{flux:.4g}"] for label, heat, flux in codes]
    head = ["temperature of", *(f"{radius:g} au [K]" for radius in given.radii), f"flux at {MICRONS / 1000} mm [Jy]"]
    return f"{snap.title}: mid-plane, {given.packages:.2g} packages, L = {passive}", head, rows


def our_flux(snap: Snapshot, **options: Any) -> tuple[float, float]:
    """Return the flux in Jy of discsim's image with options of `Snapshot.image`, and its side in au."""
    sky = snap.image(f"{MICRONS} um", distance=DISTANCE, **options)
    return float(sky.flux.to_value("Jy")), len(sky.values) * sky.pixel * sky.distance


def numbers(text: str) -> list[float]:
    """Return numbers from 0, separated by commas, from the command line."""
    try:
        found = [float(part) for part in text.split(",")]
    except ValueError:
        found = []
    if not found or not all(0.0 <= each < np.inf for each in found):
        raise ArgumentTypeError(f"{text!r}: expected numbers from 0, separated by commas")
    return found


def positive_number(text: str) -> float:
    """Return the positive number in a text, as a type of argparse. Raises ArgumentTypeError."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r}: expected a number above 0")
    return value


def main(arguments: list[str] | None = None, prog: str | None = None) -> int:
    """Run the command line, and return the exit status."""
    parser = script_parser(__doc__, prog, __file__)
    parser.add_argument("table", choices=("flux", "temperature"), help="flux or temperature")
    parser.add_argument("run", metavar="RUN", help="directory of a run, thin or thick")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="OUT", help="directory of all results")
    parser.add_argument(
        "--alpha",
        type=positive_number,
        metavar="A",
        help="turbulence that lifts dust (default: flux 1e-3, temperature 1)",
    )
    parser.add_argument(
        "--cells", type=whole_numbers(8), default=[128], metavar="N,...", help="in azimuth (default 128)"
    )
    parser.add_argument("--inclination", type=numbers, default=[0.0, 45.0], metavar="I,...", help="default 0,45 deg")
    parser.add_argument("--packages", type=whole_numbers(1), default=[10**7], metavar="N", help="default 1e7")
    parser.add_argument("--radii", type=numbers, default=[20, 25, 30, 40, 50], metavar="R,...", help="in au")
    parser.add_argument("--radmc3d", default="radmc3d", metavar="PROGRAM", help="path of RADMC-3D (default: in PATH)")
    parser.add_argument("--mcfost", metavar="PROGRAM", help="path of MCFOST (default: it is left out)")
    given = parser.parse_args(arguments)
    given.name, given.packages = Path(given.run).resolve().name, given.packages[0]
    given.alpha = given.alpha or (1e-3 if given.table == "flux" else 1.0)
    try:
        program(given.radmc3d, "--radmc3d")  # before a run is made
        given.output.mkdir(parents=True, exist_ok=True)
        snap = run_named(given.run, given.output)[-1]
        title, head, rows = (compare_fluxes if given.table == "flux" else compare_temperatures)(given, snap)
        path = given.output / f"{given.name}-{given.table}.csv"
        write_table(path, head, rows)
    except (UserError, OSError) as error:
        return print_fault("transfer", error)
    print_table(title, head, rows)
    print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
