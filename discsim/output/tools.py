"""Conversion of snapshots to objects of yt, pynbody and sarracen. These packages are imported when needed.

These tools render the surface density of particles j, each with a mass, a density and a kernel of radius R_j, as

    Sigma(x, y) = sum_j (m_j / rho_j) rho_j W(|r - r_j|, R_j)

where the kernel W is two-dimensional, or three-dimensional and integrated along the line of sight; rho_j cancels.
sarracen works in two dimensions, and its rho is the surface density. yt and pynbody work in three dimensions. Their rho
is the surface density over one code length, as for a layer of this thickness; its projection is then the surface
density. Pressure is converted in the same way.

For SPH gas, R is the radius of the support of its kernel. For particles without h, R = r_32, the distance to the
32nd neighbour, and the density is the mass of the 31 nearer neighbours over pi R^2; for random positions its mean is
unbiased.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.numerics.dataframe import dataframe_of
from discsim.output.fields.values import is_periodic
from discsim.output.layout import GROUPS, unit_of
from discsim.parts import install_command

if TYPE_CHECKING:
    from discsim.output.snapshot import Snapshot, SnapshotParticles

Array = np.ndarray
NEIGHBOUR_AT_R = 32  # neighbour whose distance is R for particles without h
MIN_RADIUS = 1e-6  # smallest R in units of the box; R is 0 for coincident particles
R_OVER_H = 2.0  # R / h of the kernels in pynbody and sarracen
PER_LENGTH_IN_3D = ("density", "pressure")  # dimensions that are divided by one code length for tools in 3D
YT_NAMES = {"mass": "particle_mass", "ids": "particle_index", "h": "smoothing_length", "temperature": "temperature"}
YT_VECTORS = {"pos": ("particle_position_", "code_length"), "vel": ("particle_velocity_", "code_velocity")}
FAMILIES = {"gas": "gas", "dust": "dm", "bodies": "bh"}  # names of particle types in pynbody
PYNBODY_NAMES = {"ids": "iord", "h": "smooth", "density": "rho", "pressure": "p", "temperature": "temp"}


def to_yt(snap: Snapshot, species: str) -> Any:
    """Return a snapshot as a yt dataset; see `Snapshot.to_yt`."""
    yt, smoothed = _import_tool(snap, "yt"), _particles_of(snap, species)
    data = {}
    for kind, p in _particles_by_kind(snap).items():
        group, fields = GROUPS[kind]
        arrays = _scalar_arrays(p)
        if p is smoothed:  # yt smooths a single type, the one with h and density
            arrays |= _radius_and_density(snap, p)
        names = YT_NAMES | ({"density": "density"} if p is smoothed else {})
        for name, array in arrays.items():
            unit = "*".join(_unit_for_tool(snap, p, name, ("code_mass", "code_length", "code_time", "K"))[1])
            plain = fields[name].dataset if name in fields else name
            data[group, names.get(name, plain)] = array, unit
        for name, vectors in _vector_arrays(p).items():
            begin, unit = YT_VECTORS[name]
            for axis, array in zip("xyz", vectors.T, strict=True):
                data[group, begin + axis] = np.ascontiguousarray(array), unit
    half = 0.5 * np.max(snap.upper - snap.lower)
    cgs = {f"{name}_unit": snap.units.cgs(name) for name in ("length", "mass", "time", "velocity")}
    return yt.load_particles(
        data,
        bbox=[*zip(snap.lower, snap.upper, strict=True), (-half, half)],
        sim_time=snap.time,
        periodicity=(is_periodic(snap), is_periodic(snap), False),
        **cgs,
    )


def to_pynbody(snap: Snapshot) -> Any:
    """Return a snapshot as a pynbody SimSnap; see `Snapshot.to_pynbody`."""
    pynbody, kinds = _import_tool(snap, "pynbody"), _particles_by_kind(snap)
    counts = {FAMILIES[kind]: p.count for kind, p in kinds.items()}
    made = pynbody.new(order=",".join(counts), **counts)
    for kind, p in kinds.items():
        family = made[pynbody.family.get_family(FAMILIES[kind])]
        arrays = _scalar_arrays(p) | _vector_arrays(p)
        if kind != "bodies":
            arrays |= _radius_and_density(snap, p)
            arrays["h"] = arrays["h"] / R_OVER_H
            family["sigma"] = arrays["density"]
            family["sigma"].units = f"{snap.units.cgs('surface_density')!r} g cm**-2"
        for name, array in arrays.items():
            factor, powers = _unit_for_tool(snap, p, name, ("g", "cm", "s", "K"))
            kept = PYNBODY_NAMES.get(name, name)
            family[kept] = array
            family[kept].units = " ".join([f"{factor!r}", *powers]) if powers else "1"
    made.properties["time"] = pynbody.units.Unit(f"{snap.time * snap.units.cgs('time')!r} s")
    return made


def to_sarracen(snap: Snapshot, species: str) -> Any:
    """Return a species as a SarracenDataFrame; see `Snapshot.to_sarracen`."""
    sarracen, p = _import_tool(snap, "sarracen"), _particles_of(snap, species)
    arrays = {"ids": np.arange(p.count)} | _scalar_arrays(p) | {name: v[:, :2] for name, v in _vector_arrays(p).items()}
    arrays |= _radius_and_density(snap, p)
    arrays["h"] = arrays["h"] / R_OVER_H
    units = {name: snap.units.cgs(of) for name, of in (("umass", "mass"), ("udist", "length"), ("utime", "time"))}
    return sarracen.SarracenDataFrame(dataframe_of(arrays), params={"time": snap.time} | units)


def _import_tool(snap: Snapshot, name: str) -> Any:
    """Import and return the package `name`. Raises ImportError if it is missing, ValueError for a 1D snapshot."""
    if snap.dimensions != 2:
        raise ValueError(
            f"to_{name}() needs a snapshot in two dimensions, but this snapshot is in one dimension; use to_pandas()"
        )
    try:
        return import_module(name)
    except ImportError as error:
        needed = f"to_{name}() needs {name}, which is not installed"
        raise ImportError(f"{needed}; run: {install_command('tools')}") from error


def _particles_by_kind(snap: Snapshot) -> dict[str, SnapshotParticles]:
    """Return the particles of a snapshot by kind: "gas", "dust", and "bodies" for star and companions."""
    return snap.species | ({} if snap.bodies is None else {"bodies": snap.bodies})


def _particles_of(snap: Snapshot, species: str) -> SnapshotParticles:
    """Return the particles of a species. Raises KeyError if the snapshot has none."""
    if species not in snap.species:
        raise KeyError(f"the snapshot has no {species!r}; expected {' or '.join(map(repr, snap.species))}")
    return snap.species[species]


def _scalar_arrays(p: SnapshotParticles) -> dict[str, Array]:
    """Return the arrays (n,) of particles by name, without h, which `_radius_and_density` returns."""
    held = {name: array for name, array in vars(p).items() if isinstance(array, np.ndarray) and array.ndim == 1}
    held.pop("h", None)
    return held | p.columns


def _vector_arrays(p: SnapshotParticles) -> dict[str, Array]:
    """Return the arrays "pos" and "vel" with shape (n, 3), z = 0; "vel" is left out if it was not read."""
    held = {"pos": p.pos, "vel": p.vel}
    return {name: np.pad(array, ((0, 0), (0, 1))) for name, array in held.items() if array is not None}


def _unit_for_tool(snap: Snapshot, p: SnapshotParticles, name: str, bases: tuple[str, ...]) -> tuple[float, list[str]]:
    """Return the unit of the array `name` for tools in 3D: its factor to cgs, and its powers of `bases` like "g**1".

    `bases` are the names of units of mass, length, time and temperature.
    """
    dimension = {"h": "length", "density": "density"}.get(name) or p.dimensions_of[name]
    factor, (mass, length, time, temperature) = unit_of(snap.units, dimension)
    if dimension in PER_LENGTH_IN_3D:
        factor, length = factor / snap.units.cgs("length"), length - 1
    exponents = zip(bases, (mass, length, time, temperature), strict=True)
    return factor, [f"{base}**{power:g}" for base, power in exponents if power]


def _radius_and_density(snap: Snapshot, p: SnapshotParticles) -> dict[str, Array]:
    """Return two arrays (n,): "h", the radius R of each particle's kernel, and "density", its surface density."""
    if p.h is not None and p.density is not None:
        return {"h": p.h * snap.support, "density": p.density}
    from scipy.spatial import cKDTree

    sides = snap.upper - snap.lower
    pos, period = ((p.pos - snap.lower) % sides, sides) if is_periodic(snap) else (p.pos, None)
    # The nearest neighbour is the particle itself. Missing neighbours have infinite distance and no mass.
    distance, nearest = cKDTree(pos, boxsize=period).query(pos, NEIGHBOUR_AT_R + 1)
    radius = np.clip(distance[:, -1], MIN_RADIUS * sides.max(), sides.max())
    mass = np.append(p.mass, 0.0)[nearest[:, 1:-1]].sum(axis=1)
    return {"h": radius, "density": mass / (np.pi * radius**2)}
