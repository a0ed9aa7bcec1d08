"""Snapshots as objects of yt, pynbody and sarracen, which are imported on request.

These tools render the surface density of particles j, each with a mass, a density and a kernel of radius R_j, as

    Sigma(x, y) = sum_j (m_j / rho_j) rho_j W(|r - r_j|, R_j)

with W in two dimensions, or in three and integrated along the line of sight. rho_j cancels. sarracen works in two
dimensions, and its rho is the surface density. yt and pynbody work in three dimensions. Their rho is the density of
a layer one code length thick. In code units it equals the surface density, and so does its projection. The pressure
is converted in the same way.

R of SPH gas is the radius of the support of its kernel. For particles without h, R = r_32, the distance to the 32nd
neighbour. Their density is the mass within that distance, over pi R^2; for random positions its mean is unbiased.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.numerics.dataframe import dataframe_of
from discsim.output.fields.values import repeats
from discsim.output.layout import GROUPS, PLAIN_UNITS
from discsim.parts import command_of_extra

if TYPE_CHECKING:
    from discsim.output.snapshot import Snapshot, SnapshotParticles

Array = np.ndarray
NEIGHBOUR = 32
NEAREST = 1e-6  # smallest R over the box, for coincident particles
REACH = 2.0  # R / h of the kernels in pynbody and sarracen
LAYERS = ("density", "pressure")  # dimensions that are divided by a length in 3D
YT_NAMES = {"mass": "particle_mass", "ids": "particle_index", "h": "smoothing_length", "temperature": "temperature"}
YT_VECTORS = {"pos": ("particle_position_", "code_length"), "vel": ("particle_velocity_", "code_velocity")}
FAMILIES = {"gas": "gas", "dust": "dm", "bodies": "bh"}  # names of particle types in pynbody
PYNBODY_NAMES = {"ids": "iord", "h": "smooth", "density": "rho", "pressure": "p", "temperature": "temp"}


def to_yt(snap: Snapshot, species: str) -> Any:
    """Implement `Snapshot.to_yt`."""
    yt, smoothed = _tool(snap, "yt"), _of(snap, species)
    data = {}
    for kind, p in _kinds(snap).items():
        group, fields = GROUPS[kind]
        arrays = _arrays(p)
        if p is smoothed:  # yt smooths a single type, the one with h and density
            arrays |= _spread(snap, p)
        names = YT_NAMES | ({"density": "density"} if p is smoothed else {})
        for name, array in arrays.items():
            unit = "*".join(_powers(snap, p, name, ("code_mass", "code_length", "code_time", "K")))
            plain = fields[name].dataset if name in fields else name
            data[group, names.get(name, plain)] = array, unit
        for name, vectors in _vectors(p).items():
            begin, unit = YT_VECTORS[name]
            for axis, array in zip("xyz", vectors.T, strict=True):
                data[group, begin + axis] = np.ascontiguousarray(array), unit
    half = 0.5 * np.max(snap.upper - snap.lower)
    cgs = {f"{name}_unit": snap.units.cgs(name) for name in ("length", "mass", "time", "velocity")}
    return yt.load_particles(
        data,
        bbox=[*zip(snap.lower, snap.upper, strict=True), (-half, half)],
        sim_time=snap.time,
        periodicity=(repeats(snap), repeats(snap), False),
        **cgs,
    )


def to_pynbody(snap: Snapshot) -> Any:
    """Implement `Snapshot.to_pynbody`."""
    pynbody, kinds = _tool(snap, "pynbody"), _kinds(snap)
    counts = {FAMILIES[kind]: p.count for kind, p in kinds.items()}
    made = pynbody.new(order=",".join(counts), **counts)
    for kind, p in kinds.items():
        family = made[pynbody.family.get_family(FAMILIES[kind])]
        arrays = _arrays(p) | _vectors(p)
        if kind != "bodies":
            arrays |= _spread(snap, p)
            arrays["h"] = arrays["h"] / REACH
            family["sigma"] = arrays["density"]
            family["sigma"].units = f"{snap.units.cgs('surface_density')!r} g cm**-2"
        for name, array in arrays.items():
            powers = " ".join(_powers(snap, p, name, ("g", "cm", "s", "K")))
            kept = PYNBODY_NAMES.get(name, name)
            family[kept] = array
            family[kept].units = f"{_cgs(snap, p, name)!r} {powers}" if powers else "1"
    made.properties["time"] = pynbody.units.Unit(f"{snap.time * snap.units.cgs('time')!r} s")
    return made


def to_sarracen(snap: Snapshot, species: str) -> Any:
    """Implement `Snapshot.to_sarracen`."""
    sarracen, p = _tool(snap, "sarracen"), _of(snap, species)
    arrays = {"ids": np.arange(p.count)} | _arrays(p) | {name: v[:, :2] for name, v in _vectors(p).items()}
    arrays |= _spread(snap, p)
    arrays["h"] = arrays["h"] / REACH
    units = {name: snap.units.cgs(of) for name, of in (("umass", "mass"), ("udist", "length"), ("utime", "time"))}
    return sarracen.SarracenDataFrame(dataframe_of(arrays), params={"time": snap.time} | units)


def _tool(snap: Snapshot, name: str) -> Any:
    """Import and return a tool. Raises ImportError if it is missing, ValueError for a 1D snapshot."""
    if snap.dimensions != 2:
        raise ValueError(f"to_{name}() needs a snapshot in two dimensions, but this one has one; expected to_pandas()")
    try:
        return import_module(name)
    except ImportError as error:
        needed = f"to_{name}() needs {name}, which is not installed"
        raise ImportError(f"{needed}; expected {command_of_extra('tools')}") from error


def _kinds(snap: Snapshot) -> dict[str, SnapshotParticles]:
    """Return all kinds of particles of a snapshot by name, star and companions included."""
    return snap.species | ({} if snap.bodies is None else {"bodies": snap.bodies})


def _of(snap: Snapshot, species: str) -> SnapshotParticles:
    """Return the particles of a species. Raises KeyError if the snapshot has none."""
    if species not in snap.species:
        raise KeyError(f"the snapshot has no {species!r}; expected {' or '.join(map(repr, snap.species))}")
    return snap.species[species]


def _arrays(p: SnapshotParticles) -> dict[str, Array]:
    """Return the stored arrays (n,) of particles by name, without h."""
    held = {name: array for name, array in vars(p).items() if isinstance(array, np.ndarray) and array.ndim == 1}
    held.pop("h", None)
    return held | p.columns


def _vectors(p: SnapshotParticles) -> dict[str, Array]:
    """Return positions, and velocities if they were read, as (n, 3)."""
    held = {"pos": p.pos, "vel": p.vel}
    return {name: np.pad(array, ((0, 0), (0, 1))) for name, array in held.items() if array is not None}


def _powers(snap: Snapshot, p: SnapshotParticles, name: str, bases: tuple[str, ...]) -> list[str]:
    """Return the unit of an array as powers of base units of mass, length, time and temperature."""
    return [f"{base}**{power:g}" for base, power in zip(bases, _exponents(snap, p, name), strict=True) if power]


def _exponents(snap: Snapshot, p: SnapshotParticles, name: str) -> tuple[float, float, float, float]:
    dimension = _dimension(p, name)
    if dimension in PLAIN_UNITS:
        return 0.0, 0.0, 0.0, float(dimension == "temperature")
    mass, length, time = snap.units.exponents(dimension)
    return mass, length - (dimension in LAYERS), time, 0.0


def _cgs(snap: Snapshot, p: SnapshotParticles, name: str) -> float:
    """Return the code unit of an array in cgs."""
    dimension = _dimension(p, name)
    factor = 1.0 if dimension in PLAIN_UNITS else snap.units.cgs(dimension)
    return factor / snap.units.cgs("length") if dimension in LAYERS else factor


def _dimension(p: SnapshotParticles, name: str) -> str:
    return {"h": "length", "density": "density"}.get(name) or p.dimensions_of[name]


def _spread(snap: Snapshot, p: SnapshotParticles) -> dict[str, Array]:
    """Return h, the kernel radius R of each particle, and density, its surface density, both (n,)."""
    if p.h is not None and p.density is not None:
        return {"h": p.h * snap.support, "density": p.density}
    from scipy.spatial import cKDTree

    sides = snap.upper - snap.lower
    places, around = ((p.pos - snap.lower) % sides, sides) if repeats(snap) else (p.pos, None)
    # The nearest neighbour is the particle itself. Missing neighbours have infinite distance and no mass.
    distance, nearest = cKDTree(places, boxsize=around).query(places, NEIGHBOUR + 1)
    radius = np.clip(distance[:, -1], NEAREST * sides.max(), sides.max())
    mass = np.append(p.mass, 0.0)[nearest[:, 1:-1]].sum(axis=1)
    return {"h": radius, "density": mass / (np.pi * radius**2)}
