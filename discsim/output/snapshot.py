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
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from discsim.numerics.dataframe import dataframe_of
from discsim.output import hdf5, open_step
from discsim.output.bins import square_window
from discsim.output.layout import GROUPS, PLAIN_UNITS, other_columns, write_layout, write_particles
from discsim.parts import STARTS, Lazy
from discsim.physics.eos import eos_of
from discsim.physics.profile import reference_density
from discsim.printable import UserError, printable
from discsim.scene import SceneError, html
from discsim.scene.units import Units

if TYPE_CHECKING:
    import h5py

    from discsim.effects.base import Column
    from discsim.numerics.bodies import Bodies
    from discsim.numerics.state import Dust, Gas, Particles
    from discsim.output.open_step import OpenStep
    from discsim.scene import Scene

Array = np.ndarray
growth = Lazy("discsim.physics.growth")


class SnapshotError(UserError):
    """The file is absent, damaged, or no snapshot of ours; the message says which."""


@dataclass(frozen=True)
class SnapshotParticles:
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

    def to_pandas(self) -> Any:
        """The arrays as a pandas DataFrame in code units, with ids as its index. Raises ImportError without pandas."""
        held = {name: array for name, array in vars(self).items() if isinstance(array, np.ndarray)}
        return dataframe_of(held | self.columns)

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


@dataclass(frozen=True)
class Snapshot:
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

    def _repr_html_(self) -> str:
        rows = [("time", self.units.show_time(self.time)), ("dimensions", self.dimensions)]
        for name, particles in self.species.items():
            held = [key for key, array in vars(particles).items() if isinstance(array, np.ndarray)]
            rows.append((name, f"{particles.count:,} particles: {', '.join([*held, *particles.columns])}"))
        return html.table(self.title or "A snapshot", rows)

    def about_centre(self) -> Snapshot:
        """The snapshot about its moving star, where that is the centre of the disc; the box stays where it is."""
        star = self.tables.get("star", {})
        if self.bodies is None or star.get("frame") != "inertial" or star.get("centre") == "barycentre":
            return self
        place, speed = self.bodies.pos[0], self.bodies.vel[0]

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

    def field(self, name: str, window: tuple[Array, Array] | None = None, pixels: int = 480, edges: Any = None) -> Any:
        """A field like "gas.toomre_q" as an astropy Quantity; `discsim plot --fields` lists them.

        Of a field of particles their values (n,), in the order of the ids; of a density, or what gas and dust make
        together, a map [ix, iy] of `pixels` on the longer side of the window, (lower, upper) corners in code units, by
        default the part of the plane that figures show. With window or edges any field is a map, or the mean in the
        rings between the radii `edges` (in 1D between places). Raises FieldError where the snapshot has no such field.
        """
        from discsim.output.fields import values

        return values.quantity(self, name, window, pixels, edges)

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


class Extent(NamedTuple):
    """Corners (dimensions,) of the box that holds all particles of a run, and how many there are of each kind."""

    lower: Array
    upper: Array
    counts: dict[str, int]


def extent_of(scene: Scene, gas: Gas | None, dust: Dust | None, bodies: Bodies | None) -> Extent:
    """The scene's box, widened to hold what has left it through an open boundary."""
    size = np.asarray(scene.space.size, dtype=float)
    lower = -size / 2 if scene.centred else np.zeros_like(size)
    upper = lower + size
    present = _present(gas, dust, bodies)
    for particles in present.values():
        if particles.count:
            lower = np.minimum(lower, particles.pos.min(axis=0))
            upper = np.maximum(upper, particles.pos.max(axis=0))
    return Extent(lower, upper, {name: particles.count for name, particles in present.items()})


def write_snapshot(
    path: str | os.PathLike[str],
    scene: Scene,
    time: float,
    gas: Gas | None,
    dust: Dust | None,
    extra: dict[str, dict[str, Array | Column]] | None = None,
    bodies: Bodies | None = None,
    step: OpenStep | None = None,
    extent: Extent | None = None,
    into: Callable[[Any], AbstractContextManager[h5py.File]] = hdf5.create,
) -> None:
    """Write the particles at `time` to `path`, which appears only when it is complete.

    `extra` holds more arrays by kind and name, such as {"dust": {"stokes": ...}}, in the order of the
    particles; `step` what a run goes on from beside them. Of a run whose particles are not all here `extent` is that
    of all. into: what makes the file. Raises OSError where it cannot be written.
    """
    extra, present = extra or {}, _present(gas, dust, bodies)
    lower, upper, counts = extent or extent_of(scene, gas, dust, bodies)
    support = _support(scene)
    with into(path) as file:
        hdf5.mark(file, "snapshot")
        write_layout(file, scene, time, upper - lower, counts)
        own = file.create_group("discsim")
        own.attrs["origin"] = lower
        own.attrs["size"] = upper - lower
        own.attrs["dimensions"] = scene.space.dimensions
        own.attrs["support"] = support
        own.attrs["energy_equation"] = gas is not None and gas.u is not None
        own.attrs["units"] = [np.bytes_(text.encode()) for text in _unit_texts(scene.units)]
        hdf5.put(own, "Scene", np.frombuffer(scene.text.encode(), np.uint8))
        if step is not None:
            open_step.write(own, step)
        with suppress(SceneError):  # of a start whose own start is gone
            if scene.initial is not None and STARTS[scene.initial.kind].reference_density is not None:
                own.attrs["reference_density"] = reference_density(scene)
        for name, particles in present.items():
            arrays: dict[str, Any] = particles.arrays() | _derived(scene, name, particles) | extra.get(name, {})
            arrays.setdefault("ids", np.arange(particles.count))
            arrays = arrays | {"pos": _into_box(particles.pos, lower, upper)}
            if name == "gas":
                arrays["h"] = arrays["h"] * support
            write_particles(file, name, arrays, scene.units)


def read_snapshot(path: str | os.PathLike[str], columns: Collection[str] | None = None) -> Snapshot:
    """Read what `write_snapshot` wrote. Raises SnapshotError where it is absent, damaged or not ours.

    columns: of gas and dust only places, masses and these, like "gas.density"; others are None. By default all.
    """
    with hdf5.reading(path, SnapshotError, "snapshot") as file:
        own = file["discsim"]
        dimensions = int(own.attrs["dimensions"])
        origin = own.attrs["origin"]
        units = units_of(file)
        kinds = {}
        for kind, (group, fields) in GROUPS.items():
            if group not in file:
                continue
            wanted = partial(_wanted, columns, kind)
            arrays = {
                name: hdf5.read(file[group][f.dataset])
                for name, f in fields.items()
                if f.dataset in file[group] and wanted(name)
            }
            arrays["pos"] = arrays["pos"][:, :dimensions] + origin
            if "vel" in arrays:
                arrays["vel"] = arrays["vel"][:, :dimensions]
            if "h" in arrays:
                arrays["h"] = arrays["h"] / own.attrs["support"]
            if not own.attrs["energy_equation"]:
                arrays.pop("u", None)
            if "immobile" in arrays:
                arrays["immobile"] = arrays["immobile"].astype(bool)
            known = {name: fields[name].dimension for name in arrays}
            others = {name: column for name, column in other_columns(file[group]).items() if wanted(name)}
            known |= {name: dimension for name, (_, dimension) in others.items()}
            own_columns = {name: array for name, (array, _) in others.items()}
            needed = dict.fromkeys(("vel", "ids")) | arrays
            kinds[kind] = SnapshotParticles(units, known, columns=own_columns, **needed)
        return Snapshot(
            time=float(file["Header"].attrs["Time"][0]),
            gas=kinds.get("gas"),
            dust=kinds.get("dust"),
            bodies=kinds.get("bodies"),
            units=units,
            scene_text=own["Scene"][()].tobytes().decode(),
            dimensions=dimensions,
            lower=origin,
            upper=origin + own.attrs["size"],
            open_step=open_step.read(own) if columns is None else None,
            reference_density=own.attrs.get("reference_density"),
            version=file.attrs["version"].decode(),
            command=file.attrs.get("command", b"").decode(errors="replace"),
            support=float(own.attrs["support"]),
        )


def units_of(file: h5py.File) -> Units:
    """The units of a snapshot that is open."""
    own = file["discsim"]
    system, length, mass = (text.decode() for text in own.attrs["units"])
    return Units(system, int(own.attrs["dimensions"]), length, mass)


def _wanted(columns: Collection[str] | None, kind: str, name: str) -> bool:
    """Whether `read_snapshot` is to read a column."""
    return columns is None or kind == "bodies" or name in ("pos", "mass") or f"{kind}.{name}" in columns


def _unit_texts(units: Units) -> tuple[str, str, str]:
    return units.system, units.length_text, units.mass_text


def _support(scene: Scene) -> float:
    """Radius of the kernel's support in units of h."""
    if scene.gas is None:
        return 1.0
    from discsim.kernels.smoothing import KERNELS, SUPPORT

    return SUPPORT[KERNELS[scene.gas.kernel]]


def _present(gas: Gas | None, dust: Dust | None, bodies: Bodies | None) -> dict[str, Particles | Bodies]:
    kinds: dict[str, Any] = {"gas": gas, "dust": dust, "bodies": bodies}
    return {name: particles for name, particles in kinds.items() if particles is not None}


def _into_box(pos: Array, lower: Array, upper: Array) -> Array:
    """Three columns in [0, BoxSize]; dimensions that the run does not have are in the middle."""
    side = upper - lower
    shifted = np.full((len(pos), 3), side.max() / 2)
    shifted[:, : pos.shape[1]] = np.clip(pos - lower, 0, side)  # else rounding may put one just outside
    return shifted


def _derived(scene: Scene, kind: str, particles: Any) -> dict[str, Array]:
    """What the layout holds beside the state."""
    if kind != "gas" or scene.gas is None:
        return {}
    per_mass = particles.pressure / particles.density
    derived, gamma = {}, eos_of(scene).index(scene.gas.eos)
    if particles.u is None:
        # What readers make the pressure of, (gamma - 1) rho u, with the index that the file tells them.
        derived["u"] = 1.5 * per_mass if gamma is None else per_mass / (gamma - 1.0)
    if scene.units.system == "physical":
        from discsim.scene.astropy_units import constants

        # P/rho is c_s^2 of isothermal gas and c_s^2/gamma of adiabatic: one formula for both.
        molecule = scene.gas.eos.mean_molecular_weight * (constants.m_p + constants.m_e).cgs.value
        specific = scene.units.cgs("specific_energy") * per_mass
        if particles.small is not None:
            specific = specific / growth.gas_share(scene, particles)
        derived["temperature"] = specific * molecule / constants.k_B.cgs.value
    return derived
