"""Images of a disc on the sky from a snapshot.

The intensity of dust at the wavelength of frequency nu, with opacities kappa_j, masses m_j and temperatures T_j of its
grains, is that of a layer of optical depth tau along the line of sight,

    I = S [1 - exp(-tau)],    tau = sum_j m_j kappa_j G / A,    S = sum_j m_j kappa_j B(T_j) G / (tau A)        (1)

The sums are over grains of all sizes, spread by Gaussians G over pixels of the area A (`output/bins.py`). Positions
are projected on the sky, so that A is seen at an angle and tau is that of the face-on disc over cos i.

Velocity of the gas along the line of sight: the mean over mass. The residual is this velocity less that of circular
Kepler orbits about the disc's centre. Maps of velocity are averaged over the beam with the column density as weight.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from numbers import Integral
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.output.bins import square_pixels
from discsim.output.fields.base import PlotError
from discsim.output.fields.binned import Optics
from discsim.output.fields.display import checked_pixels, positive_quantity
from discsim.output.fields.frame import omega
from discsim.output.fields.values import full_radius, is_centred
from discsim.output.populations import grain_sizes, small_dust_size
from discsim.printable import printable
from discsim.scene.orbits import show_plain_time
from discsim.scene.summary import Rows, Summarised
from discsim.scene.units import clipped
from discsim.sky import beam as beams
from discsim.sky.opacity import Opacity, opacity_of
from discsim.sky.orientation import Orientation, orientation_of
from discsim.sky.temperature import law_of, temperatures

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes

    from discsim.output.snapshot import Snapshot, SnapshotParticles

Array = np.ndarray
PIXELS = 512
QUANTITIES = ("intensity", "velocity", "residual")


@dataclass(frozen=True, repr=False)
class SkyMap(Summarised):
    """A map on the sky. The first index increases to the north, the second to the west, as in FITS files.

    Attributes
    ----------
    values : ndarray, shape (ny, nx)
        Values in `unit`; NaN where a velocity or spectral index has no meaning.
    quantity : str
        "intensity", "velocity", "residual" or "spectral index".
    unit : str
        Unit as FITS writes it: "Jy/beam", "Jy/pixel", "km/s", or "" for a number.
    pixel : float
        Side of a pixel in arcsec.
    distance : float
        Distance in pc.
    centre : tuple of float
        Right ascension and declination of the disc's centre in degrees (ICRS); it lies in the middle of the map.
    orientation : Orientation
        Inclination, position angle and azimuth in radians.
    beam : radio_beam.Beam or None
        Beam of the map.
    wavelength : Quantity or None
        Wavelength of an intensity.
    title : str
        Title of the scene.
    time : str
        Time of the snapshot with its unit.
    description : tuple of str
        How the map was made, one line for each choice.
    scene_hash : str
        SHA-256 of the scene's text.
    noise : float
        Rms of the noise in Jy per beam, 0 without noise.
    """

    values: Array
    quantity: str
    unit: str
    pixel: float
    distance: float
    centre: tuple[float, float]
    orientation: Orientation
    beam: Any
    wavelength: Any
    title: str
    time: str
    description: tuple[str, ...]
    scene_hash: str
    noise: float = 0.0

    @property
    def data(self) -> Any:
        """The values as an astropy Quantity."""
        from discsim.scene.astropy_units import units as u

        return u.Quantity(self.values, self.unit)

    @property
    def flux(self) -> Any:
        """Flux density of the whole map, an astropy Quantity in Jy. Raises ValueError for a map of no intensity."""
        if self.quantity != "intensity":
            raise ValueError(f"a map of {self.quantity} has no flux")
        from discsim.scene.astropy_units import units as u

        return u.Quantity(self.values.sum() / self.pixels_per_beam, "Jy")

    @property
    def pixels_per_beam(self) -> float:
        """Solid angle of the beam in pixels; 1 without a beam."""
        return 1.0 if self.beam is None else float(self.beam.sr.to_value("arcsec2")) / self.pixel**2

    @property
    def to_brightness(self) -> float:
        """Factor from the values of an intensity, in Jy per beam or per pixel, to mJy/arcsec2."""
        return 1e3 / (self.pixels_per_beam * self.pixel**2)

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Offsets in arcsec of the edges: east, west, south, north; `extent` of matplotlib's imshow."""
        half_y, half_x = (0.5 * self.pixel * n for n in self.values.shape)
        return half_x, -half_x, -half_y, half_y

    @property
    def radius(self) -> Any:
        """Radius (ny, nx) in the plane of the disc of the middle of each pixel, an astropy Quantity in au."""
        from discsim.scene.astropy_units import units as u

        north, west = (self.pixel * (np.arange(n) - 0.5 * (n - 1)) for n in self.values.shape)
        return u.Quantity(self.distance * self.orientation.radius(-west, north[:, None]), "au")

    def summary(self) -> tuple[str, Rows]:
        """Return the title of the scene, and rows of names and values for display."""
        seen = self.values[np.isfinite(self.values)]
        span = f"{seen.min():.4g} to {seen.max():.4g} {self.unit}".rstrip() if seen.size else "none"
        ny, nx = self.values.shape
        tilt, angle = np.degrees([self.orientation.inclination, self.orientation.position_angle])
        rows = [
            ("quantity", self.quantity),
            ("wavelength", None if self.wavelength is None else f"{self.wavelength:g}"),
            ("time", self.time),
            ("values", span),
            ("pixels", f"{ny} x {nx} of {self.pixel:.4g} arcsec, [north, west]"),
            ("beam", None if self.beam is None else f"{_arcsec(self.beam.major)} x {_arcsec(self.beam.minor)} arcsec"),
            ("distance", f"{self.distance:g} pc"),
            ("inclination", f"{tilt:.4g} deg, position angle {angle:.4g} deg"),
        ]
        return self.title or "A map on the sky", [row for row in rows if row[1] is not None]

    def spectral_index(self, other: SkyMap, threshold: float | None = None) -> SkyMap:
        """Return the spectral index alpha, I ~ nu^alpha, from this map and a map at another wavelength.

        Parameters
        ----------
        other : SkyMap
            Intensity on the same pixels with the same beam.
        threshold : float, optional
            Lowest value in both maps, in their unit; below it the index is NaN. Default: 5 times the rms of the noise;
            without noise, 1e-3 of the largest value of each map.

        Returns
        -------
        SkyMap
            Map of the index.

        Raises
        ------
        PlotError
            If the maps differ in pixels, beam or quantity, or have the same wavelength.
        """
        same = self.values.shape == other.values.shape and self.pixel == other.pixel and self.beam == other.beam
        if not same or (self.quantity, other.quantity) != ("intensity", "intensity"):
            raise PlotError(
                "spectral index: the two maps differ in pixels, beam or quantity; use two intensities with "
                "equal pixels and beams"
            )
        ratio = float((other.wavelength / self.wavelength).to_value(""))
        if ratio == 1.0:
            raise PlotError("spectral index: the two maps have the same wavelength; use two wavelengths")
        least = [threshold if threshold is not None else 5.0 * m.noise or 1e-3 * m.values.max() for m in (self, other)]
        bright = (self.values > least[0]) & (other.values > least[1])
        index = np.full(self.values.shape, np.nan)
        index[bright] = np.log(self.values[bright] / other.values[bright]) / np.log(ratio)
        lines = (f"between {self.wavelength:g} and {other.wavelength:g}", *self.description)
        return replace(
            self, values=index, quantity="spectral index", unit="", description=lines, wavelength=None, noise=0.0
        )

    def write(self, path: str | Path) -> None:
        """Write a FITS file with world coordinates, unit and beam.

        Parameters
        ----------
        path : str or Path
            File, replaced if it is there.

        Raises
        ------
        OSError
            If the file cannot be written.
        """
        from discsim.sky.fits import write_fits

        write_fits(self, path)

    def draw(self, ax: Axes | None = None, **options: Any) -> Axes:
        """Draw the map with wavelength and time, beam, scale bar, colour bar, north and east.

        Parameters
        ----------
        ax : Axes, optional
            matplotlib axes; by default those of a new figure.
        **options
            `limits`, the lowest and highest value shown; `stretch`, "linear", "sqrt" or "log" for intensities; and
            `cmap`, a colour map of matplotlib.

        Returns
        -------
        Axes
            The axes drawn on.
        """
        from discsim.sky.draw import draw_map

        return draw_map(self, ax, **options)


@dataclass(frozen=True)
class _Sky:
    """Geometry of a map: a square of `pixels` pixels of `side` code lengths, with `margin` more on every side."""

    orientation: Orientation
    side: float
    pixels: int
    margin: int

    def plane(self, pos: Array) -> Any:
        """Return the pixels [west, north], with the margin, over which particles at `pos` (n, 2) are spread."""
        east, north = self.orientation.on_sky(pos)
        half = np.full(2, (0.5 * self.pixels + self.margin) * self.side)
        return square_pixels(np.stack([-east, north], axis=1), (-half, half), self.pixels + 2 * self.margin)

    def crop(self, values: Array) -> Array:
        """Return a map [north, west] without its margin."""
        inside = slice(self.margin, self.margin + self.pixels)
        return values[inside, inside]


@dataclass(frozen=True)
class ImageOptions:
    """Arguments of an image, as `Snapshot.image` documents them; `prefix` precedes their names in messages."""

    quantity: str = "intensity"
    distance: Any = None
    wavelength: Any = "1.3 mm"
    inclination: Any = "0 deg"
    position_angle: Any = "-90 deg"
    azimuth: Any = "0 deg"
    beam: Any = None
    noise: Any = None
    seed: int = 0
    opacity: Any = None
    temperature: Any = None
    fov: Any = None
    pixels: int = PIXELS
    position: Any = None
    prefix: str = ""


def image_of(snap: Snapshot, options: ImageOptions) -> SkyMap:
    """Return a map of a snapshot on the sky. Raises PlotError."""
    prefix = options.prefix
    if options.quantity not in QUANTITIES:
        raise PlotError(
            f'{prefix}quantity: "{clipped(str(options.quantity))}"; expected one of {", ".join(QUANTITIES)}'
        )
    check_snapshot(snap)
    snap = snap.about_centre()
    empty, sky, kernel = _empty_map(snap, options)
    rms = beams.noise_of(options.noise, prefix)
    if options.quantity != "intensity":
        if rms:
            raise PlotError(
                f"{prefix}noise: used only with {prefix}quantity intensity; set {prefix}quantity to "
                f"intensity, or remove {prefix}noise"
            )
        values = _velocity(snap, sky, kernel, residual=options.quantity == "residual")
        text = "line-of-sight velocity of the gas" + (" less Kepler's" if options.quantity == "residual" else "")
        return replace(empty, values=values, unit="km/s", description=(text,))
    if rms and kernel is None:
        raise PlotError(
            f"{prefix}noise: the noise needs a beam, which correlates the noise of pixels; add {prefix}beam"
        )
    seen = positive_quantity(options.wavelength, f"{prefix}wavelength", "mm")
    kappa, law = opacity_of(options.opacity, prefix), law_of(options.temperature, prefix)
    brightness = _intensity(snap, sky, Optics(seen), kappa, law)
    if kernel is not None:
        brightness = beams.convolved(brightness, kernel)
    found = replace(empty, unit="Jy/pixel" if kernel is None else "Jy/beam", wavelength=seen, noise=rms)
    values = sky.crop(brightness) / found.to_brightness
    lines = [f"opacity {kappa.text}", "temperature of the gas" if law is None else f"temperature {options.temperature}"]
    if kernel is not None and rms:
        values = values + beams.noise_map(rms, kernel, values.shape, (_checked_seed(options), _micrometres(seen)))
        lines.append(f"noise {1e6 * rms:.4g} uJy/beam, seed {options.seed}")
    return replace(found, values=values, description=tuple(printable(line) for line in lines))


def _empty_map(snap: Snapshot, options: ImageOptions) -> tuple[SkyMap, _Sky, Array | None]:
    """Return a map without values, its geometry, and the kernel of its beam (None without a beam). Raises PlotError."""
    prefix = options.prefix
    if options.distance is None:
        raise PlotError(f'{prefix}distance: missing; add the distance of the disc, like "140 pc"')
    away = float(positive_quantity(options.distance, f"{prefix}distance", "pc").to_value("pc"))
    pixels, au = checked_pixels(options.pixels, prefix), float(snap.units.quantity(1.0, "length").to_value("au"))
    if options.fov is None:
        fov = 2.2 * full_radius(snap) * au / away
    else:
        fov = float(positive_quantity(options.fov, f"{prefix}fov", "arcsec").to_value("arcsec"))
    pixel, beam = fov / pixels, beams.beam_of(options.beam, prefix)
    kernel = None if beam is None else beams.kernel_of(beam, pixel, prefix)
    seen = orientation_of(options.inclination, options.position_angle, options.azimuth, prefix)
    sky = _Sky(seen, pixel * away / au, pixels, 0 if kernel is None else len(kernel) // 2)
    found = SkyMap(
        values=np.zeros((0, 0)),
        quantity=options.quantity,
        unit="",
        pixel=pixel,
        distance=away,
        centre=centre_of_disc(options.position, prefix),
        orientation=seen,
        beam=beam,
        wavelength=None,
        title=snap.title,
        time=show_plain_time(snap.time, snap.units, snap.scene_text),
        description=(),
        scene_hash=hashlib.sha256(snap.scene_text.encode()).hexdigest(),
    )
    return found, sky, kernel


def _arcsec(angle: Any) -> str:
    """Return an angle in arcsec as text."""
    return f"{angle.to_value('arcsec'):.4g}"


def _micrometres(wavelength: Any) -> int:
    """Return a wavelength as a whole number of micrometres, so that images at two wavelengths have different noise."""
    return min(int(wavelength.to_value("um")), 1 << 62)


def _checked_seed(options: ImageOptions) -> int:
    """Return the seed of the noise. Raises PlotError unless it is a whole number of at least 0."""
    if isinstance(options.seed, bool) or not isinstance(options.seed, Integral) or options.seed < 0:
        raise PlotError(f"{options.prefix}seed: {clipped(str(options.seed))}; expected a whole number, 0 or more")
    return int(options.seed)


def check_snapshot(snap: Snapshot) -> None:
    """Raise PlotError for a snapshot that cannot be shown on the sky, and has no lengths in au or no centre."""
    if snap.dimensions != 2:
        raise PlotError("a run in one dimension has no image on the sky; use a run in two dimensions")
    if snap.units.system == "code":
        raise PlotError('the scene is in code units, without lengths in au; use a run with units.system = "physical"')
    if not is_centred(snap):
        raise PlotError("the scene has no disc about a centre; use a run with [star], or with a disc as initial.kind")


def centre_of_disc(position: Any, prefix: str) -> tuple[float, float]:
    """Return right ascension and declination in degrees of a text or SkyCoord; (0, 0) for None. Raises PlotError."""
    if position is None:
        return 0.0, 0.0
    from astropy.coordinates import SkyCoord
    from astropy.units import UnitsError

    try:
        found = SkyCoord(position).icrs
        return float(found.ra.deg), float(found.dec.deg)
    except (ValueError, TypeError, UnitsError):
        raise PlotError(
            f'{prefix}position: "{clipped(str(position))}"; expected right ascension and declination like '
            '"04h31m38.4s +18d13m57s" or "67.91 deg, 18.23 deg"'
        ) from None


def _intensity(snap: Snapshot, sky: _Sky, optics: Optics, opacity: Opacity, law: Any) -> Array:
    """Return the intensity [north, west] in mJy/arcsec2 of eq. (1), with the margin. Raises PlotError."""
    depth, emitted = 0.0, 0.0
    for grains in _grains_of(snap):
        kappa = opacity.absorption(optics.wavelength, grains.species, grains.size)
        plane = sky.plane(grains.pos)
        to_depth = snap.units.cgs("surface_density") / plane.measure
        weight = grains.mass * kappa * to_depth
        depth = depth + plane.sum(weight).T
        emitted = emitted + plane.sum(weight * optics.planck(temperatures(snap, grains.pos, law))).T
    if isinstance(depth, float):
        raise PlotError("the snapshot has no dust; use a run with [dust]")
    depth = np.maximum(depth, 0.0)  # against rounding of filters
    # S (1 - exp(-tau)) with S = emitted / tau; the second factor is 1 for tau -> 0.
    escape = np.divide(-np.expm1(-depth), depth, where=depth > 0.0, out=np.ones_like(depth))
    return np.maximum(emitted, 0.0) * escape


@dataclass(frozen=True)
class _Grains:
    """Grains of one population, or small dust in gas particles: positions (n, 2), masses, populations, radii in cm."""

    pos: Array
    mass: Array
    species: Array
    size: Array | None


def _grains_of(snap: Snapshot) -> list[_Grains]:
    """Return the grains of each dust population, and of small dust as an additional population."""
    found = []
    dust, gas = snap.dust, snap.gas
    if dust is not None and dust.count:
        species = np.zeros(dust.count, int) if dust.species is None else np.asarray(dust.species, dtype=int)
        size = grain_sizes(snap)
        for number in np.unique(species):
            chosen = species == number
            found.append(
                _Grains(dust.pos[chosen], dust.mass[chosen], species[chosen], None if size is None else size[chosen])
            )
    if gas is not None and gas.small is not None:
        number, size = np.zeros(gas.count, int), np.full(gas.count, small_dust_size(snap))
        found.append(_Grains(gas.pos, gas.small, number, size))
    return found


def _velocity(snap: Snapshot, sky: _Sky, kernel: Array | None, residual: bool) -> Array:
    """Return line-of-sight velocities [north, west] of the gas in km/s, NaN in empty pixels. Raises PlotError."""
    gas: SnapshotParticles | None = snap.gas
    if gas is None or not gas.count or gas.vel is None:
        raise PlotError("the snapshot has no gas particles with velocities; use a run with [gas]")
    vel = gas.vel
    if residual:
        if "star" not in snap.tables:
            raise PlotError("the scene has no star, and no Kepler orbits; choose another quantity than residual")
        x, y = gas.pos.T
        vel = vel - omega(snap, gas.radius)[:, None] * np.stack([-y, x], axis=1)
    plane = sky.plane(gas.pos)
    column = plane.sum(gas.mass).T
    flow = plane.sum(gas.mass * sky.orientation.line_of_sight(vel)).T
    enough = plane.has_enough_mass(column)
    if kernel is not None:
        column, flow = beams.convolved(column, kernel), beams.convolved(flow, kernel)
    found = np.divide(flow, column, where=enough, out=np.full(column.shape, np.nan))
    return sky.crop(found) * float(snap.units.quantity(1.0, "velocity").to_value("km/s"))
