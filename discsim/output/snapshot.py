"""Snapshots in the HDF5 layout of SWIFT (Schaller et al. 2024, arXiv:2305.13380), which yt and others read.

Gas is PartType0, dust is PartType3; the star and its companions, where they are bodies of the run, are PartType5 (black
holes there), with their numbers as ids, the star's 0. Coordinates have three columns and lie in [0, BoxSize], as
readers want; the shift back to the scene's own frame, and what else `read_snapshot` needs, is in the group "discsim".
"""

from __future__ import annotations

import os
import tomllib
from collections.abc import Callable, Collection
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.numerics.dataframe import dataframe_of
from discsim.numerics.entries import EntryError, check_finite, check_ranges
from discsim.output import hdf5, open_step
from discsim.output.bins import square_window
from discsim.output.contents import (
    Extent,
    derived_arrays,
    extent_of,
    into_box,
    present_kinds,
    support_radius,
    unit_texts,
)
from discsim.output.layout import GROUPS, PLAIN_UNITS, write_layout, write_particles
from discsim.output.snapshot_entries import columns_of, is_wanted, listed, tables_of, time_of, units_of
from discsim.parts import STARTS, Lazy
from discsim.physics.profile import reference_density
from discsim.printable import UserError, printable
from discsim.scene import SceneError
from discsim.scene.summary import Rows, Summarised
from discsim.scene.units import Units

if TYPE_CHECKING:
    import h5py

    from discsim.effects.base import Column
    from discsim.numerics.bodies import Bodies
    from discsim.numerics.state import Dust, Gas
    from discsim.output.open_step import OpenStep
    from discsim.scene import Scene

Array = np.ndarray
frame = Lazy("discsim.output.fields.frame")
growth = Lazy("discsim.physics.growth")
FINITE = ("pos", "vel", "mass", "density", "h", "u", "pressure", "sound_speed", "temperature", "small", "size")


class SnapshotError(UserError):
    """The file is absent, damaged, or no snapshot of ours; the message says which."""


@dataclass(frozen=True, repr=False)
class SnapshotParticles(Summarised):
    """Particles of one kind, sorted by ids: arrays in code units and in the scene's own frame.

    pos and vel have shape (n, dimensions), the others (n,); None is what the snapshot does not hold.
    """

    units: Units
    dimensions_of: dict[str, str]
    pos: Array
    vel: Array
    mass: Array
    ids: Array
    immobile: Array | None = None
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
    columns: dict[str, Array] = field(default_factory=dict)  # those of effects that other packages bring, by name

    @property
    def count(self) -> int:
        return len(self.mass)

    @cached_property
    def radius(self) -> Array:
        """Distance from the origin, (n,)."""
        return np.sqrt(np.einsum("ij,ij->i", self.pos, self.pos))

    def quantity(self, name: str) -> Any:
        """The array `name` as an astropy Quantity. Raises KeyError where it is not stored."""
        from discsim.scene.astropy_units import units as u

        array = self.columns[name] if name in self.columns else getattr(self, name, None)
        if array is None or name not in self.dimensions_of:
            raise KeyError(f"the snapshot holds no {name!r}")
        dimension = self.dimensions_of[name]
        if dimension in PLAIN_UNITS:
            return u.Quantity(array, PLAIN_UNITS[dimension])
        return self.units.quantity(array, dimension)

    def arrays(self) -> dict[str, Array]:
        """The arrays by name, those of other packages too, without those that the snapshot does not hold."""
        held = {f.name: getattr(self, f.name) for f in fields(self)}
        return {name: array for name, array in held.items() if isinstance(array, np.ndarray)} | self.columns

    def summary(self) -> tuple[str, Rows]:
        of = {name: self.dimensions_of.get(name, "").replace("_", " ") for name in self.arrays()}
        return f"{self.count:,} particles", [(name, f"{a.shape}  {of[name]}") for name, a in self.arrays().items()]

    def to_pandas(self) -> Any:
        """The arrays as a pandas DataFrame in code units, with ids as its index. Raises ImportError without pandas."""
        return dataframe_of(self.arrays())

    def radial_profile(self, edges: Array) -> Array:
        """Surface density, averaged over angle, in the rings between the radii `edges` (rings + 1,)."""
        mass, _ = np.histogram(self.radius, edges, weights=self.mass)
        return mass / (np.pi * np.diff(np.square(edges)))

    def surface_density_map(self, lower: Array, upper: Array, pixels: int, periodic: bool = False) -> Array:
        """Surface density on square pixels [ix, iy], `pixels` on the longer side of the window (2D).

        Each particle is a Gaussian as wide as the distance to its 12th neighbour, of one particle for all in its
        pixel: a shot noise of 1/sqrt(48) where particles lie at random. `periodic`: the window is the box, and repeats.
        """
        plane = square_window(self.pos, (lower, upper), pixels, periodic)
        return plane.sum(self.mass) / plane.measure


@dataclass(frozen=True, repr=False)
class Snapshot(Summarised):
    """One instant of a run, as `read_snapshot` gives it; `gas` or `dust` is None where the run has none."""

    time: float
    gas: SnapshotParticles | None
    dust: SnapshotParticles | None
    units: Units
    scene_text: str
    dimensions: int
    lower: Array  # corners of the box, in the scene's own frame, (dimensions,)
    upper: Array
    bodies: SnapshotParticles | None = None  # star, then companions; None where there is only a star at the origin
    open_step: OpenStep | None = None  # what a start from it needs beside
    reference_density: float | None = None  # Sigma that laws of drag refer to, of a start that has one
    version: str = ""  # of discsim, that wrote it
    command: str = ""  # line that made it; "" where an earlier version did
    support: float = 1.0  # radius of the support of the gas's kernel, in h

    @cached_property
    def tables(self) -> dict[str, Any]:
        """The scene as run, as plain tables."""
        return tomllib.loads(self.scene_text)

    @property
    def title(self) -> str:
        """The title of the scene, printable; "" where it has none."""
        return printable(self.tables.get("title", ""))

    @property
    def species(self) -> dict[str, SnapshotParticles]:
        """The kinds of particles present, by name."""
        both = {"gas": self.gas, "dust": self.dust}
        return {name: particles for name, particles in both.items() if particles is not None}

    def summary(self) -> tuple[str, Rows]:
        held = [(name, f"{p.count:,} particles: {', '.join(p.arrays())}") for name, p in self.species.items()]
        rows = [("time", self.units.show_time(self.time)), ("dimensions", self.dimensions), *held]
        return self.title or "A snapshot", rows

    def about_centre(self) -> Snapshot:
        """The snapshot about the centre of its disc, star or barycentre, where that moves; the box stays."""
        if self.bodies is None or self.tables.get("star", {}).get("frame") != "inertial":
            return self
        place, speed = frame.centre_of(self)

        def shifted(p: SnapshotParticles | None) -> SnapshotParticles | None:
            return p and replace(p, pos=p.pos - place, vel=None if p.vel is None else p.vel - speed)

        return replace(self, gas=shifted(self.gas), dust=shifted(self.dust), bodies=shifted(self.bodies))

    def quantity(self, name: str) -> Any:
        """ "time", or an array like "gas.density", as an astropy Quantity. Raises KeyError for any other."""
        if name == "time":
            return self.units.quantity(self.time, "time")
        kind, _, array = name.partition(".")
        if kind not in self.species:
            raise KeyError(f"the snapshot holds no {kind!r}")
        return self.species[kind].quantity(array)

    def field(
        self, name: str, window: Any = None, pixels: int = 480, edges: Any = None, *,
        distance: Any = None, wavelength: Any = None, opacity: Any = None,
    ) -> Any:  # fmt: skip
        """Give a field as an astropy Quantity; the same arguments make a figure of it with `discsim.plot`.

        Parameters
        ----------
        name
            Name of the field, like "gas.toomre_q"; `discsim plot --fields` lists them.
        window
            Part of the plane to map: a text like "50 au" (about the centre) or "30 au,0 au,5 au" (x, y and half the
            side), the same as a Quantity or as numbers in code units, or corners (lower, upper) as one of these two.
            With `distance` a text or a Quantity may be in arcsec.
        pixels
            Number of pixels on the longer side of a map.
        edges
            Rising radii between which to average over rings, in 1D places: numbers in code units, or a Quantity.
        distance
            Distance of the disc, like "140 pc".
        wavelength, opacity
            Of "emission" and "optical_depth", like "1.3 mm" and "2 cm2/g", per gram of dust. Texts or Quantities.

        Returns
        -------
        Quantity
            With `edges` values in the rings. With `window`, and for densities and ratios of gas and dust always, a map
            [ix, iy], by default of the part of the plane that figures show. Else the values of the particles, (n,), in
            the order of their ids.

        Raises
        ------
        FieldError
            Where the snapshot has no such field.
        PlotError
            Where another argument is wrong.
        """
        from discsim.output.fields.look import field_of

        look = {"distance": distance, "wavelength": wavelength, "opacity": opacity}
        return field_of(self, name, edges, window=window, pixels=pixels, **look)

    def to_yt(self, species: str = "gas") -> Any:
        """The snapshot as a dataset of yt, in the scene's own frame, with the particle types and fields of its file.

        species: "gas" or "dust", the one whose projections are smooth, `("gas", ...)` to yt; it has one alone. Its
        `density` is that of a layer one code length thick; `ProjectionPlot(ds, "z", ("gas", "density"))` shows the
        surface density. Raises ImportError without yt, KeyError without the species, ValueError in 1D.
        """
        from discsim.output import tools

        return tools.to_yt(self, species)

    def to_pynbody(self) -> Any:
        """The snapshot as a SimSnap of pynbody, in the scene's own frame: dust as `dm`, star and companions as `bh`.

        `rho` is that of a layer one code length thick, and `plot.sph.image(s.gas, units="g cm^-2")` shows the surface
        density, of `s.dm` that of the dust. Raises ImportError without pynbody, ValueError in 1D.
        """
        from discsim.output import tools

        return tools.to_pynbody(self)

    def to_sarracen(self, species: str = "gas") -> Any:
        """Gas or dust as a SarracenDataFrame of two dimensions, in code units, with ids as its index.

        `density` is the surface density, as `render("density")` shows it; `params` has the time, and the code units in
        cgs. Raises ImportError without sarracen, KeyError without the species, ValueError in 1D.
        """
        from discsim.output import tools

        return tools.to_sarracen(self, species)


def write_snapshot(
    path: str | os.PathLike[str], scene: Scene, time: float, gas: Gas | None, dust: Dust | None,
    extra: dict[str, dict[str, Array | Column]] | None = None, bodies: Bodies | None = None,
    step: OpenStep | None = None, extent: Extent | None = None,
    into: Callable[[Any], AbstractContextManager[h5py.File]] = hdf5.create,
) -> None:  # fmt: skip
    """Write the particles at `time` to `path`, which appears only when it is complete.

    `extra` holds more arrays by kind and name, such as {"dust": {"stokes": ...}}, in the order of the
    particles; `step` what a run goes on from beside them. Of a run whose particles are not all here `extent` is that
    of all. into: what makes the file. Raises OSError where it cannot be written.
    """
    extra, present = extra or {}, present_kinds(gas, dust, bodies)
    lower, upper, counts = extent or extent_of(scene, gas, dust, bodies)
    support = support_radius(scene)
    with into(path) as file:
        hdf5.mark(file, "snapshot")
        write_layout(file, scene, time, upper - lower, counts)
        own = file.create_group("discsim")
        own.attrs["origin"] = lower
        own.attrs["size"] = upper - lower
        own.attrs["dimensions"] = scene.space.dimensions
        own.attrs["support"] = support
        own.attrs["energy_equation"] = gas is not None and gas.u is not None
        own.attrs["units"] = [np.bytes_(text.encode()) for text in unit_texts(scene.units)]
        hdf5.put(own, "Scene", np.frombuffer(scene.text.encode(), np.uint8))
        if step is not None:
            open_step.write(own, step)
        with suppress(SceneError):  # of a start whose own start is gone
            if scene.initial is not None and STARTS[scene.initial.kind].reference_density is not None:
                own.attrs["reference_density"] = reference_density(scene)
        for name, particles in present.items():
            arrays: dict[str, Any] = particles.arrays() | derived_arrays(scene, name, particles) | extra.get(name, {})
            arrays.setdefault("ids", np.arange(particles.count))
            arrays = arrays | {"pos": into_box(particles.pos, lower, upper)}
            if name == "gas":
                arrays["h"] = arrays["h"] * support
            write_particles(file, name, arrays, scene.units)


def files_of(source: str | os.PathLike[str]) -> list[Path]:
    """The snapshots of a run's directory in the order of time, or the one file. Raises SnapshotError."""
    path = Path(source)
    if not path.is_dir():
        if not path.exists():
            raise SnapshotError(f"{path}: there is no such file; expected the directory of a run, or a snapshot")
        return [path]
    files = sorted((path / "snapshots").glob("*.h5")) or sorted(path.glob("[0-9]*.h5"))
    if not files:
        raise SnapshotError(f"{path}: no snapshots here; expected the directory of a run, or a snapshot")
    return files


def read_snapshot(path: str | os.PathLike[str], columns: Collection[str] | None = None) -> Snapshot:
    """Read a snapshot.

    Parameters
    ----------
    path
        File of the snapshot, or directory of a run, of which the last snapshot is read.
    columns
        Arrays of gas and dust to read beside places and masses, like ["gas.density"]; others are None. By default all.

    Returns
    -------
    Snapshot
        Its arrays in code units.

    Raises
    ------
    SnapshotError
        Where the file is absent, damaged, or not one of discsim's.
    """
    path = files_of(path)[-1] if Path(path).is_dir() else path
    with hdf5.reading(path, SnapshotError, "snapshot") as file:
        own, units = file.group("discsim"), units_of(file)
        dimensions = own.whole("dimensions")
        origin, size = (own.numbers(name, (dimensions,)) for name in ("origin", "size"))
        support = own.number("support")
        if not (support > 0.0 and (size > 0.0).all()):
            raise EntryError("the box or the support of the kernel has no size; expected positive numbers")
        text = hdf5.decoded(own.dataset("Scene", "u", ()).read().tobytes(), "/discsim/Scene")
        tables = tables_of(text, units)
        populations, bodies = listed(tables, "dust"), listed(tables, "star") + listed(tables, "companion")
        there = [kind for kind, (group, _) in GROUPS.items() if group in file]
        kinds = {kind: _particles_of(file, kind, populations, columns) for kind in there}
        counts = {kind: particles.count for kind, particles in kinds.items()}
        if counts.get("bodies", bodies) != bodies:
            raise EntryError(f"it holds {counts['bodies']} bodies, and its scene {bodies}; expected as many")
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


def _particles_of(file: hdf5.Held, kind: str, populations: int, columns: Collection[str] | None) -> SnapshotParticles:
    """The particles of one kind, in the scene's own frame. Raises EntryError."""
    own, units, (group, fields) = file.group("discsim"), units_of(file), GROUPS[kind]
    wanted = partial(is_wanted, columns, kind)
    arrays, others, known = columns_of(file.group(group), fields, wanted)
    arrays["pos"] = arrays["pos"][:, : units.dimensions] + own.numbers("origin", (units.dimensions,))
    if "vel" in arrays:
        arrays["vel"] = arrays["vel"][:, : units.dimensions]
    check_finite(kind, {name: array for name, array in arrays.items() if name in FINITE})
    if populations > 1 and kind == "dust" and "species" not in arrays and wanted("species"):
        raise EntryError("its dust has no Species; expected the number of each particle's population")
    check_ranges(kind, arrays, populations)
    if "h" in arrays:
        arrays["h"] = arrays["h"] / own.number("support")
    if not own.attribute("energy_equation"):
        arrays.pop("u", None)
    known = {name: dimension for name, dimension in known.items() if name in arrays or name in others}
    needed = dict.fromkeys(("vel", "ids")) | arrays
    return SnapshotParticles(units, known, columns=others, **needed)
