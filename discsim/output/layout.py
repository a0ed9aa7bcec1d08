"""The HDF5 layout of SWIFT snapshots: names and dimensions of datasets, and the attributes that other tools read."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from discsim.effects.base import Column
from discsim.output import hdf5
from discsim.physics.eos import eos_of
from discsim.scene.units import Units

if TYPE_CHECKING:
    import h5py

    from discsim.scene import Scene

Array = np.ndarray


class Field(NamedTuple):
    """A dataset of the layout: its name, its physical dimension and a description.

    The dimension is one of `discsim.scene.units`, "temperature", or "" for a plain number.
    """

    dataset: str
    dimension: str
    about: str


COMMON = {
    "pos": Field("Coordinates", "length", "positions, shifted into the box"),
    "vel": Field("Velocities", "velocity", "velocities"),
    "across": Field("AzimuthalVelocities", "velocity", "azimuthal velocity in a shearing box, without the shear flow"),
    "mass": Field("Masses", "mass", "masses"),
    "ids": Field("ParticleIDs", "", "identities, constant during a run"),
    "immobile": Field("Immobile", "", "1 for boundary particles that never move"),
}
GAS = COMMON | {
    "density": Field("Densities", "density", "SPH density; a surface density in 2D"),
    "h": Field("SmoothingLengths", "length", "radius of the support of the kernel"),
    "u": Field(
        "InternalEnergies",
        "specific_energy",
        "specific internal energy; P/rho / (gamma - 1) or 3/2 P/rho without an energy equation",
    ),
    "pressure": Field("Pressures", "pressure", "pressure; vertically integrated in 2D"),
    "sound_speed": Field("SoundSpeeds", "velocity", "sound speed"),
    "temperature": Field("Temperatures", "temperature", "P/rho mu m_H/k_B"),
    "small": Field("SmallDustMasses", "mass", "mass of small dust carried by the particle"),
}
DUST = COMMON | {
    "density": Field("DustDensities", "density", "density of the dust; a surface density in 2D"),
    "species": Field("Species", "", "number of the population"),
    "size": Field("GrainSizes", "length", "radius of the grains"),
    "stopping_time": Field("StoppingTimes", "time", "stopping time"),
    "stokes": Field("StokesNumbers", "", "stopping time times the Keplerian frequency"),
}
BODIES = {name: COMMON[name] for name in ("pos", "vel", "mass", "ids")}
# For each kind of particles, its group in the file and its datasets by the name of the array.
GROUPS = {"gas": ("PartType0", GAS), "dust": ("PartType3", DUST), "bodies": ("PartType5", BODIES)}
TYPES = 7  # number of particle types in the header
PLAIN_UNITS = {"": "", "temperature": "K"}  # units of the dimensions that do not depend on the code units


def unit_of(units: Units, dimension: str) -> tuple[float, tuple[float, float, float, float]]:
    """Return the code unit of a dimension in cgs, and its exponents of mass, length, time and temperature."""
    if dimension in PLAIN_UNITS:
        return 1.0, (0.0, 0.0, 0.0, float(dimension == "temperature"))
    mass, length, time = units.exponents(dimension)
    return units.cgs(dimension), (mass, length, time, 0.0)


def write_particles(file: h5py.File, kind: str, arrays: dict[str, Array], units: Units) -> None:
    """Write the arrays of one kind of particles to `file`, sorted by ids, with units and descriptions.

    `kind` is a key of GROUPS. `arrays` has arrays by name, among them "ids", and may have a Column of another package.
    """
    part, fields = GROUPS[kind]
    group = file.create_group(part)
    order = np.argsort(arrays["ids"], kind="stable")
    for name, array, (dataset, dimension, about) in _stored_datasets(arrays, fields):
        array = array[order]
        if dataset == "Velocities":
            array = np.pad(array, ((0, 0), (0, 3 - array.shape[1])))
        if dataset == "Immobile":
            array = array.astype(np.uint8)
        stored = hdf5.write_array(group, dataset, array)
        if name not in fields:
            stored.attrs["Name"], stored.attrs["Dimension of discsim"] = np.bytes_(name), np.bytes_(dimension)
        factor, exponents = unit_of(units, dimension)
        stored.attrs["Description"] = np.bytes_(about)
        stored.attrs["Conversion factor to CGS (not including cosmological corrections)"] = [factor]
        stored.attrs["Conversion factor to physical CGS (including cosmological corrections)"] = [factor]
        stored.attrs["a-scale exponent"] = [0.0]
        stored.attrs["h-scale exponent"] = [0.0]
        for base, power in zip(("U_M", "U_L", "U_t", "U_T", "U_I"), (*exponents, 0.0), strict=True):
            stored.attrs[f"{base} exponent"] = [float(power)]


def _stored_datasets(arrays: dict[str, Any], fields: dict[str, Field]) -> Iterator[tuple[str, Array, Field]]:
    """Yield name, values and dataset of the arrays in the layout, then of the columns of effects in other packages."""
    yield from ((name, arrays[name], field) for name, field in fields.items() if name in arrays)
    for name, column in arrays.items():
        if isinstance(column, Column):
            yield name, column.values, Field(*column[1:])


def columns_of_packages(group: hdf5.CheckedGroup) -> dict[str, tuple[str, str]]:
    """Return the columns of effects in other packages as {name: (name of the dataset, physical dimension)}."""
    others = {dataset: group.dataset(dataset) for dataset in group.names_with("Dimension of discsim")}
    return {each.text("Name"): (dataset, each.text("Dimension of discsim")) for dataset, each in others.items()}


def write_layout(file: h5py.File, scene: Scene, time: float, side: Array, numbers: dict[str, int]) -> None:
    """Write to `file` all groups of the layout except those of particles, with the attributes that other tools need.

    `side` (dimensions,) are the sides of the box. `numbers` has the number of particles of each kind, by name.
    """
    units, counts = scene.units, np.zeros(TYPES, np.int64)
    for kind, count in numbers.items():
        counts[int(GROUPS[kind][0][-1])] = count
    box = np.full(3, side.max())
    box[: len(side)] = side
    gas = scene.gas
    groups: dict[str, dict[str, Any]] = {
        "Header": {
            "Code": np.bytes_("SWIFT"),  # readers identify the layout by this name
            "RunName": np.bytes_((scene.title or "discsim").encode()),
            "BoxSize": box,
            "Dimension": [3],
            "NumPart_ThisFile": counts,
            "NumPart_Total": counts.astype(np.uint32),
            "NumPart_Total_HighWord": (counts >> 32).astype(np.uint32),
            "NumFilesPerSnapshot": [1],
            "NumPartTypes": [TYPES],
            "MassTable": np.zeros(TYPES),
            "Flag_Entropy_ICs": [0],
            "Time": [float(time)],
            "Redshift": [0.0],
            "Scale-factor": [1.0],
            "ThisFile": [0],
            "OutputType": np.bytes_("FullVolume"),
        },
        "Policy": {"cosmological integration": [0]},
        "Parameters": {"InitialConditions:periodic": np.bytes_(str(int(scene.space.boundary == "periodic")))},
        "Cosmology": {"Cosmological run": [0], "Redshift": [0.0], "Scale-factor": [1.0], "h": [0.0]},
        "HydroScheme": {
            "Scheme": np.bytes_("SPH"),
            "Kernel function": np.bytes_(gas.kernel if gas else "none"),
            "Adiabatic index": [float((eos_of(scene).index(gas.eos) if gas else None) or 5 / 3)],
            "Dimension": [float(scene.space.dimensions)],
        },
        "SubgridScheme": {"Chemistry Model": np.bytes_("None"), "Cooling Model": np.bytes_("None")},
    }
    unit_values: dict[str, Any] = {
        "Unit mass in cgs (U_M)": [units.cgs("mass")],
        "Unit length in cgs (U_L)": [units.cgs("length")],
        "Unit time in cgs (U_t)": [units.cgs("time")],
        "Unit current in cgs (U_I)": [1.0],
        "Unit temperature in cgs (U_T)": [1.0],
    }
    for name, attributes in (groups | {"Units": unit_values, "InternalCodeUnits": unit_values}).items():
        group = file.create_group(name)
        for key, value in attributes.items():
            group.attrs[key] = value
