"""Density file and parameter file of MCFOST 4.1 (Pinte et al. 2006, A&A 459, 797; 2009, A&A 498, 967).

MCFOST makes its cylindrical grid from the parameter file, and the density file must hold densities on this grid: cells
of equal width in ln r (n_rad_in = 1) and phi, and n_z equal cells up to z = 7 h (r / r_0)^beta at the mean of the two
edges of a ring. Here h and beta are a fit of 5/7 of the height of the gas, so that the grid reaches up to 5 heights or
more. Cells have their exact part of the Gaussian in z (`layers.py`). The file holds z > 0; MCFOST mirrors it.

MCFOST interpolates between grain sizes, and makes its own in equal ratios. The sizes of the file are at these ratios,
so that nothing is interpolated. It scales the number of grains from the array dn/da, and all of it to the dust mass of
the parameter file: dn/da = M / a^4 for the mass M of each size.

Given opacities kappa go into a file of efficiencies Q = 4/3 rho a kappa, in the layout that MCFOST expects from a file
with a name that begins with "Misselt". MCFOST takes the mean over the points of the file inside each of its bins of
wavelength, and interpolates between points for an image. The points are in the middle of equal parts of these bins; one
more lies on each side, as does one more size.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.export.grains import WAVELENGTHS, Grains, grains_of, groups_at_equal_ratios, wavelength_range
from discsim.export.layers import REACH, disc_of, gaussian_parts
from discsim.export.options import MAX_CELLS, MAX_SIZES
from discsim.output.fields.base import PlotError
from discsim.output.fields.frame import central_mass
from discsim.sky.opacity import opacity_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from discsim.export.layers import Disc
    from discsim.export.options import ExportOptions
    from discsim.output.snapshot import Snapshot
    from discsim.sky.opacity import Opacity

Array = np.ndarray
CUTOFF = 7.0  # height of MCFOST's grid in scale heights of the parameter file
MAX_HEIGHTS = 150  # most cells in z > 0
EMPTY = 1e-30  # mass of a size without grains over the mass of all; MCFOST takes its logarithm
VERSION = "MCFOST 4.1 (parameter file 4.1)"
DENSITY, PARAMETERS, OPACITIES = "density.fits.gz", "discsim.para", "Misselt_discsim.dat"
SILICATE = "Draine_Si_sUV.dat"  # optical constants of MCFOST, where no opacities are given
BINS, PARTS = 50, 5  # bins of wavelength; points of the file of opacities in each
GRAIN_DENSITY = 2.0  # g/cm3, with which efficiencies are written; opacities do not depend on it


def write_folder(snap: Snapshot, folder: Path, options: ExportOptions) -> list[str]:
    """Write the files of MCFOST into a folder that exists; return lines that describe them. Raises PlotError."""
    from astropy.io import fits

    if options.temperature is not None:
        raise PlotError(f"{options.prefix}temperature: used only by radmc3d, MCFOST computes its own; leave it out")
    opacity = None if options.opacity is None else opacity_of(options.opacity, options.prefix)
    disc = disc_of(snap, options.checked_number("cells", 8, MAX_CELLS), options.checked_alpha(), options.prefix)
    snap = disc.snap
    groups = groups_at_equal_ratios(grains_of(snap), options.checked_number("sizes", 1, MAX_SIZES))
    heights = [disc.gas_height if grains is None else disc.height(grains) for _, grains in groups]
    scale, flaring = _scale_height(disc)
    tops = _tops(disc, scale, flaring)
    thinnest = min(float((height / tops).min()) for height in heights)
    number = int(np.clip(np.ceil(2.0 / thinnest), 10, MAX_HEIGHTS))
    disc.check_size(number, len(groups))
    levels = np.linspace(0.0, 1.0, number + 1)
    masses = [0.0 if grains is None else float(grains.mass.sum()) for _, grains in groups]
    densities = [
        _density(disc, tops, levels, height, None if grains is None else (grains.pos, grains.mass))
        for height, (_, grains) in zip(heights, groups, strict=True)
    ]
    radii = np.array([radius for radius, _ in groups])
    primary = fits.PrimaryHDU(np.array(densities) if len(groups) > 1 else densities[0])
    hdus = [primary]
    if len(groups) > 1:
        primary.header["read_n_a"] = (1, "HDU 2: sizes in um, HDU 3: dn/da")
        share = np.maximum(np.array(masses) / sum(masses), EMPTY)
        hdus += [fits.ImageHDU(1e4 * radii), fits.ImageHDU(share / (radii / radii[0]) ** 4)]
    gas = snap.gas if snap.gas is not None and snap.gas.count else None
    if gas is not None:
        primary.header["HIERARCH read_gas_density"] = 1
        primary.header["HIERARCH read_gas_velocity"] = 2
        hdus.append(fits.ImageHDU(_density(disc, tops, levels, disc.gas_height, (gas.pos, gas.mass))))
        metres = 0.01 * snap.units.cgs("velocity")
        flow = np.zeros((3, disc.azimuths, number, len(disc.radius)))
        flow[:2] = metres * disc.velocities().transpose(0, 2, 1)[:, :, None, :]
        hdus.append(fits.ImageHDU(flow))
    fits.HDUList(hdus).writeto(folder / DENSITY)
    shape = (len(disc.radius), number, disc.azimuths)
    optics = (SILICATE, *WAVELENGTHS)
    if opacity is not None:
        optics = (OPACITIES, *_write_opacities(folder / OPACITIES, opacity, groups))
    text = _parameters(disc, options, shape, radii, (sum(masses), scale, flaring), optics)
    (folder / PARAMETERS).write_text(text)
    unit = snap.units.cgs("mass")
    return [
        f"Written for {VERSION}: `mcfost {PARAMETERS} -3D -density_file {DENSITY} -star_bb`.",
        f"Grid: {shape[0]} x {shape[1]} x {shape[2]} cells in r, z > 0 and phi.",
        f"The thinnest layer is {number * thinnest:.2g} cells high.",
        "Opacities are those of MCFOST for the optical constants that the parameter file names; set them there."
        if opacity is None
        else f"Opacity: {opacity.text}; without scattering.",
        *(
            f"Size {1e4 * radius:.6g} um: mass {mass * unit:.15e} g."
            for radius, mass in zip(radii, masses, strict=True)
        ),
    ]


def _scale_height(disc: Disc) -> tuple[float, float]:
    """Return h at 1 in code units and beta of the parameter file; CUTOFF h r^beta is REACH heights or more."""
    log = np.log(disc.radius)
    slope = float(np.polyfit(log, np.log(disc.gas_height), 1)[0])
    beta = float(f"{max(slope, 0.0):.6f}")  # as the parameter file has it
    lift = float(np.max(np.log(disc.gas_height) - beta * log))
    return REACH / CUTOFF * float(np.exp(lift)), beta


def _tops(disc: Disc, scale: float, flaring: float) -> Array:
    """Return the height (rings,) of MCFOST's grid in code units."""
    middle = 0.5 * (disc.edges[1:] + disc.edges[:-1])
    top: Array = CUTOFF * scale * middle**flaring
    return top


def _density(
    disc: Disc, tops: Array, levels: Array, height: Array, particles: tuple[Array, Array] | None
) -> Array:  # fmt: skip
    """Return the density [phi, z, r] in g/cm3 for z > 0 of particles (positions, masses); 0 for None."""
    shape = (disc.azimuths, len(levels) - 1, len(disc.radius))
    if particles is None:
        return np.zeros(shape)
    units = disc.snap.units
    base = np.diff(disc.edges**2) * np.pi / disc.azimuths
    volume = base * tops * (levels[1] - levels[0])
    parts = gaussian_parts(levels * (tops / height)[:, None]).T
    mass = 0.5 * disc.masses(*particles) * units.cgs("mass")
    return mass.T[:, None, :] * parts / (volume * units.cgs("length") ** 3)


def _write_opacities(
    path: Path, opacity: Opacity, groups: Sequence[tuple[float, Grains | None]]
) -> tuple[float, float]:  # fmt: skip
    """Write the absorption of groups (radius in cm, grains) by wavelength.

    Return the shortest and the longest wavelength of MCFOST's bins in um. Raises PlotError.
    """
    wavelengths = np.geomspace(*wavelength_range(opacity), BINS * PARTS + 2)
    sizes = [(radius, _absorption(opacity, wavelengths, radius, grains)) for radius, grains in groups]
    (first, of_first), (last, of_last) = sizes[0], sizes[-1]
    lines = ["none", *["#"] * 7, f"sizes {len(sizes) + 2}", f"wavelengths {len(wavelengths)}", f"1 {GRAIN_DENSITY}"]
    lines += ["#", "# number, wavelength in um, 0, Q_sca, Q_ext, g for each radius in um"]
    for radius, kappa in [(0.5 * first, 2.0 * of_first), *sizes, (2.0 * last, 0.5 * of_last)]:  # Q of the end sizes
        lines += [f"{1e4 * radius:.9e}", "#"]
        efficiency = 4.0 / 3.0 * GRAIN_DENSITY * radius * kappa
        lines += [f"{k} {w:.9e} 0 0 {q:.9e} 0" for k, (w, q) in enumerate(zip(wavelengths, efficiency, strict=True))]
        lines.append("")
    path.write_text("\n".join(lines))
    half = np.sqrt(wavelengths[1] / wavelengths[0])
    return float(wavelengths[0] * half), float(wavelengths[-1] / half)


def _absorption(opacity: Opacity, wavelengths: Array, radius: float, grains: Grains | None) -> Array:
    """Return the opacity (m,) in cm2/g of grains, or of the first population where a size has no grains."""
    if grains is None:
        nowhere, one = np.zeros((1, 2)), np.ones(1)
        grains = Grains("", nowhere, one, np.full(1, radius), None, np.zeros(1, int))
    return grains.absorption(opacity, wavelengths)


def _parameters(
    disc: Disc,
    options: ExportOptions,
    shape: tuple[int, int, int],
    radii: Array,
    dust: tuple[float, float, float],
    optics: tuple[str, float, float],
) -> str:
    """Return the text of the parameter file.

    dust: its mass, and h and beta of the grid, in code units. optics: file of optical constants or opacities, and the
    shortest and the longest wavelength in um.
    """
    snap, (mass, scale, flaring) = disc.snap, dust
    au = snap.units.cgs("length") / 1.495978707e13
    to_solar = float(snap.units.quantity(1.0, "mass").to_value("Msun"))
    ratio = 100.0 if snap.gas is None or not snap.gas.count else float(snap.gas.mass.sum()) / mass
    reach = 0.5 * np.log(radii[-1] / radii[0]) / max(len(radii) - 1, 1)
    smallest, largest = 1e4 * radii[0] * np.exp(-reach), 1e4 * radii[-1] * np.exp(reach)
    moves = snap.bodies is not None and snap.bodies.count > 0
    star = float(snap.bodies.mass[0]) if snap.bodies is not None and moves else central_mass(snap)
    x, y = au * snap.bodies.pos[0] if snap.bodies is not None and moves else (0.0, 0.0)
    radius, temperature = options.star("Rsun")
    values: dict[str, Any] = {
        "n_rad": shape[0], "n_z": shape[1], "n_az": shape[2], "map": 2.2 * au * disc.edges[-1],
        "mass": mass * to_solar, "ratio": ratio, "scale": scale * au ** (1.0 - flaring),
        "flaring": flaring, "inner": au * disc.edges[0], "outer": au * disc.edges[-1], "smallest": smallest,
        "largest": largest, "sizes": len(radii), "temperature": temperature, "radius": radius,
        "star": star * to_solar, "x": x, "y": y, "bins": BINS,
        "file": optics[0], "shortest": optics[1], "longest": optics[2],
    }  # fmt: skip
    return TEMPLATE.format(**values)


TEMPLATE = """4.1                      mcfost version

#Number of photon packages
  1.28e6                  nbr_photons_eq_th  : T computation
  1.28e3                  nbr_photons_lambda : SED computation
  1.28e6                  nbr_photons_image  : images computation

#Wavelength
  {bins} {shortest:.9g} {longest:.9g}   n_lambda, lambda_min, lambda_max [mum]
  T F T                   compute temperature?, compute sed?, use default wavelength grid for output ?
  none.lambda             wavelength file (if previous parameter is F)
  F F                     separation of different contributions?, stokes parameters?

#Grid geometry and size
  1                       1 = cylindrical, 2 = spherical
  {n_rad} {n_z} {n_az} 1   n_rad (log distribution), nz, n_az, n_rad_in

#Maps
  501 501 {map:.9g}        grid (nx,ny), size [AU]
  0.  0.  1  F            RT: imin, imax, n_incl, centered ?
  0    0.   1             RT: az_min, az_max, n_az angles
  140.0                   distance (pc)
  -90.                    disk PA

#Scattering method
  1                       1=exact phase function, 2=hg function

#Symmetries
  F                       image symmetry
  F                       central symmetry
  F                       axial symmetry

#Disk physics
  0  0.50  1.0            dust_settling, exp_strat, a_strat
  F                       dust radial migration
  F                       sublimate dust
  F                       hydrostatic equilibrium
  F  1e-5                 viscous heating, alpha_viscosity

#Number of zones
  1

#Density structure
  1                       zone type : 1 = disk
  {mass:.15e} {ratio:.15e}   dust mass, gas-to-dust mass ratio
  {scale:.16e} 1.0 2       scale height, reference radius (AU), vertical profile exponent
  {inner:.16e} 0.0 {outer:.16e} 100.   Rin, edge, Rout, Rc (AU)
  {flaring:.9g}            flaring exponent
  -1.0 0.0                surface density exponent

#Grain properties
  1  Number of species
  Mie  1 2  0.0  1.0  0.9 Grain type (Mie or DHS), N_components, mixing rule, porosity, mass fraction, Vmax (for DHS)
  {file}  1.0   Optical indices file, volume fraction
  1                       Heating method : 1 = RE + LTE, 2 = RE + NLTE, 3 = NRE
  {smallest:.16e} {largest:.16e} 3.5 {sizes}   amin, amax [mum], aexp, n_grains (log distribution)

#Molecular RT settings
  T T T                   lpop, laccurate_pop, LTE
  0.2 km/s                turbulence
  1                       nmol
  co@xpol.dat 6           molecular data filename, level_max
  T 1.e-6 abundance.fits.gz   cst molecule abundance ?, abundance, abundance file
  T  2                    ray tracing ?,  number of lines in ray-tracing
  2 3                     transition numbers
  -10.0 10.0 41           vmin, vmax (km.s^-1), n_speed

#Atoms settings
  1                       number of atoms
  H_6.atom
  F                       non-LTE ?
  0                       initial solution
  1000 101                vmax (km/s), n_points
  T 1                     images (T) or total flux (F) ? Number of lines for images
  3 2                     upper level -> lower level

#Star properties
  1 Number of stars
  {temperature:.9g} {radius:.9g} {star:.9g} {x:.12g} {y:.12g} 0.0  T  T, R, M (solar), x, y, z (AU), automatic spectrum?
  lte4000-3.5.NextGen.fits.gz
  0.0 2.2                 fUV, slope_fUV
"""
