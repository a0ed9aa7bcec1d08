"""Snapshots in the HDF5 layout of SWIFT (Schaller et al. 2024, arXiv:2305.13380), which yt and other tools read.

Gas is PartType0 and dust is PartType3. The star and its companions, if they move in the run, are PartType5 (black
holes in SWIFT); the id is 0 for the star and k for companion k. Coordinates have three columns and lie in [0,
BoxSize], as other tools require. The group "discsim" has the shift from these coordinates to the scene's frame, and
the other data that `read_snapshot` needs.
"""

from __future__ import annotations

import os
import tomllib
from collections.abc import Collection
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.numerics.dataframe import dataframe_of
from discsim.numerics.entries import EntryError, check_finite, check_ranges
from discsim.output import hdf5, open_step
from discsim.output.bins import square_pixels
from discsim.output.layout import GROUPS, PLAIN_UNITS
from discsim.output.snapshot_entries import (
    FINITE,
    is_requested,
    read_columns,
    scene_text_of,
    table_count,
    tables_of,
    time_of,
    units_of,
)
from discsim.parts import Lazy
from discsim.printable import UserError, printable
from discsim.scene.orbits import show_time
from discsim.scene.summary import Rows, Summarised
from discsim.scene.units import Units

if TYPE_CHECKING:
    from discsim.output.open_step import OpenStep
    from discsim.sky.image import SkyMap

Array = np.ndarray
display = Lazy("discsim.output.fields.display")
frame = Lazy("discsim.output.fields.frame")
sky = Lazy("discsim.sky.image")
tools = Lazy("discsim.output.tools")


class SnapshotError(UserError):
    """A snapshot that is missing or damaged, or another file in its place; the message has the reason."""


@dataclass(frozen=True, repr=False)
class SnapshotParticles(Summarised):
    """Particles of one kind in a snapshot, sorted by ids.

    Arrays are in code units and in the scene's frame. An array is None if the file does not have it, or if the
    argument `columns` of `read_snapshot` leaves it out.

    Attributes
    ----------
    units : Units
        Code units of the snapshot.
    dimensions_of : dict
        Physical dimension of each array by the array's name, for example {"density": "density"}.
    pos, vel : ndarray, shape (n, dimensions)
        Positions and velocities.
    across : ndarray, shape (n,)
        Azimuthal velocity in a shearing box.
    mass, ids : ndarray, shape (n,)
        Masses, and identity numbers that stay the same through a run.
    immobile : ndarray, shape (n,)
        True for boundary particles.
    density : ndarray, shape (n,)
        Density, in 2D a surface density; for gas the SPH density.
    h, u, pressure, sound_speed : ndarray, shape (n,)
        Smoothing length, internal energy per mass, pressure and sound speed of gas.
    temperature : ndarray, shape (n,)
        Temperature in K.
    small : ndarray, shape (n,)
        Mass of the small dust in each gas particle.
    species, size, stopping_time, stokes : ndarray, shape (n,)
        Number of the dust population, grain radius, stopping time and Stokes number.
    columns : dict of ndarray
        Columns of effects from other packages, by name.
    """

    units: Units
    dimensions_of: dict[str, str]
    pos: Array
    vel: Array
    mass: Array
    ids: Array
    immobile: Array | None = None
    across: Array | None = None
    density: Array | None = None
    h: Array | None = None
    u: Array | None = None
    pressure: Array | None = None
    sound_speed: Array | None = None
    temperature: Array | None = None
    small: Array | None = None
    species: Array | None = None
    size: Array | None = None
    stopping_time: Array | None = None
    stokes: Array | None = None
    columns: dict[str, Array] = field(default_factory=dict)

    @property
    def count(self) -> int:
        """Number of particles."""
        return len(self.mass)

    @cached_property
    def radius(self) -> Array:
        """Distance from the origin, (n,)."""
        return np.sqrt(np.einsum("ij,ij->i", self.pos, self.pos))

    def quantity(self, name: str) -> Any:
        """Return an array as an astropy Quantity.

        Parameters
        ----------
        name : str
            Name of the array, for example "density".

        Returns
        -------
        Quantity
            Array with the units of the snapshot; dimensionless in the code system.

        Raises
        ------
        KeyError
            If the snapshot does not hold the array.
        """
        from discsim.scene.astropy_units import units as u

        array = self.columns[name] if name in self.columns else getattr(self, name, None)
        if array is None or name not in self.dimensions_of:
            raise KeyError(f"the snapshot has no {name!r}")
        dimension = self.dimensions_of[name]
        if dimension in PLAIN_UNITS:
            return u.Quantity(array, PLAIN_UNITS[dimension])
        return self.units.quantity(array, dimension)

    def arrays(self) -> dict[str, Array]:
        """Return by name all arrays that are not None, and those in `columns`."""
        held = {f.name: getattr(self, f.name) for f in fields(self)}
        return {name: array for name, array in held.items() if isinstance(array, np.ndarray)} | self.columns

    def summary(self) -> tuple[str, Rows]:
        """Return a title with the particle number, and a row with shape and dimension for each array."""
        rows = []
        for name, array in self.arrays().items():
            rows.append((name, f"{array.shape}  {self.dimensions_of.get(name, '').replace('_', ' ')}"))
        return f"{self.count:,} particles", rows

    def to_pandas(self) -> Any:
        """Return the arrays as a pandas DataFrame in code units, with ids as its index.

        Raises ImportError without pandas.
        """
        return dataframe_of(self.arrays())

    def radial_profile(self, edges: Any) -> Array:
        """Return the azimuthally averaged surface density in rings. Raises PlotError if `edges` is invalid.

        Parameters
        ----------
        edges : Quantity or array_like, shape (rings + 1,)
            Rising radii; an array is in code units.

        Returns
        -------
        ndarray, shape (rings,)
            Mass in each ring over its area, in code units.
        """
        edges = display.edges_in_code_units(edges, self.units, dimensions=2)
        mass, _ = np.histogram(self.radius, edges, weights=self.mass)
        return mass / (np.pi * np.diff(np.square(edges)))

    def surface_density_map(self, lower: Array, upper: Array, pixels: int, periodic: bool = False) -> Array:
        """Return the surface density on square pixels (2D only).

        Parameters
        ----------
        lower, upper : ndarray, shape (2,)
            Corners of the window in code units.
        pixels : int
            Number of pixels on the longer side of the window.
        periodic : bool
            If True, the window is the whole periodic box.

        Returns
        -------
        ndarray, shape (nx, ny)
            Surface density [ix, iy] in code units.

        Notes
        -----
        Each particle is a Gaussian as wide as the distance to its 12th neighbour; all particles in a pixel have the
        same width. For random positions the shot noise is 1/sqrt(48).
        """
        plane = square_pixels(self.pos, (lower, upper), pixels, periodic)
        return plane.sum(self.mass) / plane.measure


@dataclass(frozen=True, repr=False)
class Snapshot(Summarised):
    """The state of a run at one time, from `read_snapshot`. `quantity` returns its numbers with units.

    Attributes
    ----------
    time : float
        Time in code units, as all numbers here.
    gas, dust : SnapshotParticles or None
        Particles; None if the run has none.
    units : Units
        Code units.
    scene_text : str
        Scene of the run as TOML.
    dimensions : int
        Dimensions of space.
    lower, upper : ndarray, shape (dimensions,)
        Corners of the box, in the scene's frame.
    bodies : SnapshotParticles or None
        Star, then companions; None without a star, or if the star is fixed at the origin.
    open_step : OpenStep or None
        Additional data with which a new run can continue this run to rounding.
    reference_density : float or None
        Surface density to which drag laws refer; None if the start has none.
    version, command : str
        Version of discsim and command line that wrote the file; "" for a command that an earlier version did not
        record.
    support : float
        Radius of the support of the gas kernel in units of h.
    """

    time: float
    gas: SnapshotParticles | None
    dust: SnapshotParticles | None
    units: Units
    scene_text: str
    dimensions: int
    lower: Array
    upper: Array
    bodies: SnapshotParticles | None = None
    open_step: OpenStep | None = None
    reference_density: float | None = None
    version: str = ""
    command: str = ""
    support: float = 1.0

    @cached_property
    def tables(self) -> dict[str, Any]:
        """The scene of the run as nested dicts, with the values as written."""
        return tomllib.loads(self.scene_text)

    @property
    def title(self) -> str:
        """The title of the scene, printable; "" without one."""
        return printable(self.tables.get("title", ""))

    @property
    def time_text(self) -> str:
        """The time as text, with the number of orbits if the scene counts orbits: "474.3 yr (40 orbits at 5.2 au)"."""
        return show_time(self.time, self.units, self.scene_text)

    @property
    def species(self) -> dict[str, SnapshotParticles]:
        """Particles by the name of their species, "gas" or "dust", for the species that the run has."""
        both = {"gas": self.gas, "dust": self.dust}
        return {name: particles for name, particles in both.items() if particles is not None}

    def summary(self) -> tuple[str, Rows]:
        """Return the title of the scene, and rows of names and values for display."""
        held = [(name, f"{p.count:,} particles: {', '.join(p.arrays())}") for name, p in self.species.items()]
        rows = [("time", self.time_text), ("dimensions", self.dimensions), *held]
        return self.title or "A snapshot", rows

    def about_centre(self) -> Snapshot:
        """Return the snapshot with positions and velocities relative to the disc's centre, a star or barycentre.

        The corners of the box stay the same. If the centre does not move, the snapshot itself is returned.
        """
        if self.bodies is None or self.tables.get("star", {}).get("frame") != "inertial":
            return self
        centre, velocity = frame.centre_of(self)

        def shifted(p: SnapshotParticles | None) -> SnapshotParticles | None:
            return p and replace(p, pos=p.pos - centre, vel=None if p.vel is None else p.vel - velocity)

        return replace(self, gas=shifted(self.gas), dust=shifted(self.dust), bodies=shifted(self.bodies))

    def quantity(self, name: str) -> Any:
        """Return the time or an array as an astropy Quantity.

        Parameters
        ----------
        name : str
            "time", or an array like "gas.density".

        Returns
        -------
        Quantity
            Value with the units of the snapshot; dimensionless in the code system.

        Raises
        ------
        KeyError
            If the snapshot does not hold the array.
        """
        if name == "time":
            return self.units.quantity(self.time, "time")
        kind, _, array = name.partition(".")
        if kind not in self.species:
            raise KeyError(f"the snapshot has no {kind!r}")
        return self.species[kind].quantity(array)

    def field(
        self, name: str, window: Any = None, pixels: int = 480, edges: Any = None, *,
        distance: Any = None, wavelength: Any = None, opacity: Any = None,
    ) -> Any:  # fmt: skip
        """Return a field as an astropy Quantity; `discsim.plot` draws fields with the same arguments.

        Parameters
        ----------
        name : str
            Name of the field, like "gas.toomre_q"; `discsim plot --fields` lists all names.
        window : str, Quantity or array_like, optional
            Region of a map. A text is "50 au" (half the side of a square about the centre) or "30 au,0 au,5 au" (x
            and y of the middle, and half the side). A Quantity, or an array in code units, has the same numbers, or
            the corners (lower, upper). With `distance`, texts and Quantities may be in arcsec.
        pixels : int
            Number of pixels on the longer side of a map.
        edges : Quantity or array_like, optional
            Rising radii (in 1D positions) of the rings for averages; an array is in code units.
        distance : str or Quantity, optional
            Distance of the disc, like "140 pc".
        wavelength, opacity : str or Quantity, optional
            Parameters of "emission" and "optical_depth", like "1.3 mm" and "2 cm2/g" (per gram of dust).

        Returns
        -------
        Quantity
            With `edges`: values in rings, shape (rings,). With `window`: a map [ix, iy]. With neither: values of the
            particles, (n,), in the order of their ids; fields without values per particle, such as densities, give
            a map of the region that figures show.

        Raises
        ------
        FieldError
            If the snapshot has no such field.
        PlotError
            If another argument is invalid.
        """
        options = {"distance": distance, "wavelength": wavelength, "opacity": opacity}
        return display.field_of(self, name, edges, window=window, pixels=pixels, **options)

    def image(
        self,
        wavelength: Any = "1.3 mm",
        *,
        distance: Any,
        inclination: Any = "0 deg",
        position_angle: Any = "-90 deg",
        azimuth: Any = "0 deg",
        beam: Any = None,
        noise: Any = None,
        seed: int = 0,
        opacity: Any = None,
        temperature: Any = None,
        fov: Any = None,
        pixels: int = 512,
        position: Any = None,
        quantity: str = "intensity",
    ) -> SkyMap:
        """Return an image of the disc on the sky: the continuum of its dust, or velocities of its gas.

        Parameters
        ----------
        wavelength : str or Quantity
            Wavelength, like "1.3 mm".
        distance : str or Quantity
            Distance, like "140 pc".
        inclination, position_angle, azimuth : str or Quantity
            Angles like "40 deg". The inclination is 0 to 85 deg if the sky shows the disc as it rotates in the scene,
            95 to 180 deg if the sky shows the opposite rotation. The position angle, from north to east, is the
            direction of the +x axis of the disc, after the disc is turned by `azimuth` (counter-clockwise). The half
            of a counter-clockwise disc around this axis recedes. By default a face-on image has x to the right and y
            up.
        beam : str, Quantity, sequence or radio_beam.Beam, optional
            Full width at half maximum, like "0.05 arcsec", or major and minor width and position angle,
            "0.06 arcsec,0.04 arcsec,30 deg".
        noise : str or Quantity, optional
            Rms of noise in a beam, like "20 uJy/beam"; `seed` is the seed of its random numbers.
        opacity : str, Quantity, sequence or Path, optional
            Absorption opacity per gram of dust: "2 cm2/g", one such value for each population, or a file with a table
            by wavelength and grain size (see the page on images). Default: 10 cm2/g (nu / 1 THz).
        temperature : str, Quantity or callable, optional
            Temperature of the dust in place of that of the gas: "20 K"; a power law "150 K,1 au,0.5" (value, radius,
            index); "1 Lsun,0.05", a passive disc (luminosity, grazing angle); a function of radii in au.
        fov : str or Quantity, optional
            Side of the image, like "2 arcsec"; by default 2.2 times the radius of the disc.
        pixels : int
            Number of pixels along each side.
        position : str or SkyCoord, optional
            Right ascension and declination of the centre, like "04h31m38.4s +18d13m57s".
        quantity : str
            "intensity"; "velocity", that of the gas away from the observer; or "residual", the velocity less that of
            circular Kepler orbits.

        Returns
        -------
        SkyMap
            Values with unit, `flux`, `spectral_index`, and `write` for a FITS file.

        Raises
        ------
        PlotError
            If an argument is invalid, or the run has no such image.
        """
        given = locals()
        options = {field.name: given[field.name] for field in fields(sky.ImageOptions) if field.name in given}
        return sky.image_of(self, sky.ImageOptions(**options))

    def to_yt(self, species: str = "gas") -> Any:
        """Return the snapshot as a yt dataset in the scene's frame.

        Parameters
        ----------
        species : str
            "gas" or "dust": the species that yt smooths, with fields ("gas", ...). A dataset has only one.

        Returns
        -------
        yt.data_objects.static_output.Dataset
            Particle types and fields as in the file. `density` is the surface density over one code length;
            `ProjectionPlot(ds, "z", ("gas", "density"))` shows the surface density.

        Raises
        ------
        ImportError
            Without yt.
        KeyError
            If the snapshot lacks the species.
        ValueError
            In 1D.
        """
        return tools.to_yt(self, species)

    def to_pynbody(self) -> Any:
        """Return the snapshot as a pynbody SimSnap in the scene's frame.

        Returns
        -------
        pynbody.snapshot.SimSnap
            Dust is `dm`, star and companions are `bh`. `rho` is the surface density over one code length.
            `plot.sph.image(s.gas, units="g cm^-2")` shows the surface density of gas, and with `s.dm` of dust.

        Raises
        ------
        ImportError
            Without pynbody.
        ValueError
            In 1D.
        """
        return tools.to_pynbody(self)

    def to_sarracen(self, species: str = "gas") -> Any:
        """Return gas or dust as a two-dimensional SarracenDataFrame in code units, with ids as its index.

        Parameters
        ----------
        species : str
            "gas" or "dust".

        Returns
        -------
        sarracen.SarracenDataFrame
            `density` is the surface density, for `render("density")`. `params` has the time, and the code units in
            cgs.

        Raises
        ------
        ImportError
            Without sarracen.
        KeyError
            If the snapshot lacks the species.
        ValueError
            In 1D.
        """
        return tools.to_sarracen(self, species)


def snapshot_files(source: str | os.PathLike[str]) -> list[Path]:
    """Return the paths of the snapshots of a run in the order of time. Raises SnapshotError if there are none.

    `source` is the directory of the run or its folder "snapshots". If it is a file, only this file is returned.
    """
    path = Path(source)
    if not path.is_dir():
        if not path.exists():
            raise SnapshotError(f"{path}: file not found; give the directory of a run, or a snapshot")
        return [path]
    files = sorted((path / "snapshots").glob("*.h5")) or sorted(path.glob("[0-9]*.h5"))
    if not files:
        raise SnapshotError(f"{path}: no snapshots found; give the directory of a run, or a snapshot")
    return files


def read_snapshot(path: str | os.PathLike[str], columns: Collection[str] | None = None) -> Snapshot:
    """Read a snapshot.

    Parameters
    ----------
    path : str or path-like
        File of a snapshot, or directory of a run (its last snapshot).
    columns : collection of str, optional
        Arrays of gas and dust to read in addition to positions and masses, like ["gas.density"]; all others are
        None. By default all arrays are read.

    Returns
    -------
    Snapshot
        Arrays in code units.

    Raises
    ------
    SnapshotError
        If the file is missing, damaged or not a snapshot of discsim.
    """
    path = snapshot_files(path)[-1] if Path(path).is_dir() else path
    with hdf5.open_file_of_kind(path, SnapshotError, "snapshot") as file:
        own, units = file.group("discsim"), units_of(file)
        dimensions = own.whole("dimensions")
        origin, size = (own.numbers(name, (dimensions,)) for name in ("origin", "size"))
        support = own.number("support")
        if not (support > 0.0 and (size > 0.0).all()):
            sides = " x ".join(f"{side:g}" for side in size)
            wrong = f"the kernel support is {support:g}, and the box has the sides {sides}"
            raise EntryError(f"{wrong}; expected positive numbers")
        text = scene_text_of(file)
        tables = tables_of(text, units)
        populations = table_count(tables, "dust")
        there = [kind for kind, (group, _) in GROUPS.items() if group in file]
        kinds = {kind: _particles_of(file, kind, populations, columns) for kind in there}
        counts = {kind: particles.count for kind, particles in kinds.items()}
        bodies = table_count(tables, "star") + table_count(tables, "companion")
        if counts.get("bodies", bodies) != bodies:
            wrong = f"the file contains {counts['bodies']} bodies, but its scene has {bodies} bodies"
            raise EntryError(f"{wrong}; expected equal numbers")
        reference, time = "reference_density", time_of(file)
        return Snapshot(
            time=time,
            gas=kinds.get("gas"),
            dust=kinds.get("dust"),
            bodies=kinds.get("bodies"),
            units=units,
            scene_text=text,
            dimensions=dimensions,
            lower=origin,
            upper=origin + size,
            open_step=open_step.read(own, counts, dimensions, time) if columns is None else None,
            reference_density=own.number(reference) if reference in own.attributes else None,
            version=file.text("version"),
            command=file.attribute("command").decode(errors="replace") if "command" in file.attributes else "",
            support=support,
        )


def _particles_of(
    file: hdf5.CheckedGroup, kind: str, populations: int, columns: Collection[str] | None
) -> SnapshotParticles:
    """Return the particles of one kind ("gas", "dust", "bodies") in the open snapshot `file`, in the scene's frame.

    `populations` is the number of dust populations, `columns` the argument of `read_snapshot`. Raises EntryError.
    """
    own, units, (group, fields) = file.group("discsim"), units_of(file), GROUPS[kind]
    wanted = partial(is_requested, columns, kind)
    arrays, others, known = read_columns(file.group(group), fields, wanted)
    arrays["pos"] = arrays["pos"][:, : units.dimensions] + own.numbers("origin", (units.dimensions,))
    if "vel" in arrays:
        arrays["vel"] = arrays["vel"][:, : units.dimensions]
    check_finite(kind, {name: array for name, array in arrays.items() if name in FINITE})
    if populations > 1 and kind == "dust" and "species" not in arrays and wanted("species"):
        raise EntryError("the dust has no dataset Species, which contains the population number of each particle")
    check_ranges(kind, arrays, populations)
    if "h" in arrays:
        arrays["h"] = arrays["h"] / own.number("support")
    if not own.attribute("energy_equation"):
        arrays.pop("u", None)
    known = {name: dimension for name, dimension in known.items() if name in arrays or name in others}
    return SnapshotParticles(units, known, columns=others, **(dict.fromkeys(("vel", "ids")) | arrays))
