"""Snapshots as objects of yt, pynbody and sarracen, which are imported only where somebody asks for one.

These tools render a surface density of particles j, each with a mass, a density and a kernel of radius R_j, as

    Sigma(x, y) = sum_j (m_j / rho_j) rho_j W(|r - r_j|, R_j)

with W in two dimensions, or in three and summed along the line of sight; rho_j falls out of it. sarracen knows two
dimensions, and its rho is the surface density. yt and pynbody know three: their rho is that of a layer one code length
thick, which in code units has the number of the surface density, and whose projection is that density. So is pressure.

R of SPH gas is the radius of its kernel's support. Particles without h have R = r_32, the distance to the 32nd
neighbour, and as density the mass that is nearer, over pi R^2, right in the mean where particles lie at random.
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
NEAREST = 1e-6  # of the box: the least R, where particles lie on each other
REACH = 2.0  # R / h of the kernels of pynbody and sarracen
LAYERS = ("density", "pressure")  # dimensions with a length less in a volume
YT_NAMES = {"mass": "particle_mass", "ids": "particle_index", "h": "smoothing_length", "temperature": "temperature"}
YT_VECTORS = {"pos": ("particle_position_", "code_length"), "vel": ("particle_velocity_", "code_velocity")}
FAMILIES = {"gas": "gas", "dust": "dm", "bodies": "bh"}  # as pynbody calls those of a file
PYNBODY_NAMES = {"ids": "iord", "h": "smooth", "density": "rho", "pressure": "p", "temperature": "temp"}


def to_yt(snap: Snapshot, species: str) -> Any:
    """See `Snapshot.to_yt`."""
    yt, smoothed = _tool(snap, "yt"), _of(snap, species)
    data = {}
    for kind, p in _kinds(snap).items():
        group, fields = GROUPS[kind]
        arrays = _arrays(p)
        if p is smoothed:  # no other may have both of these
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
    """See `Snapshot.to_pynbody`."""
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
    """See `Snapshot.to_sarracen`."""
    sarracen, p = _tool(snap, "sarracen"), _of(snap, species)
    arrays = {"ids": np.arange(p.count)} | _arrays(p) | {name: v[:, :2] for name, v in _vectors(p).items()}
    arrays |= _spread(snap, p)
    arrays["h"] = arrays["h"] / REACH
    units = {name: snap.units.cgs(of) for name, of in (("umass", "mass"), ("udist", "length"), ("utime", "time"))}
    return sarracen.SarracenDataFrame(dataframe_of(arrays), params={"time": snap.time} | units)


def _tool(snap: Snapshot, name: str) -> Any:
    """The module of a tool. Raises ImportError where it is not there, ValueError for a snapshot of one dimension."""
    if snap.dimensions != 2:
        raise ValueError(f"to_{name}() is for snapshots of two dimensions, this one has one; expected to_pandas()")
    try:
        return import_module(name)
    except ImportError as error:
        needed = f"to_{name}() needs {name}, which is not installed"
        raise ImportError(f"{needed}; expected {command_of_extra('tools')}") from error


def _kinds(snap: Snapshot) -> dict[str, SnapshotParticles]:
    """All kinds of particles that are there, by name."""
    return snap.species | ({} if snap.bodies is None else {"bodies": snap.bodies})


def _of(snap: Snapshot, species: str) -> SnapshotParticles:
    """Raises KeyError where the snapshot has none of that name."""
    if species not in snap.species:
        raise KeyError(f"the snapshot holds no {species!r}; expected {' or '.join(map(repr, snap.species))}")
    return snap.species[species]


def _arrays(p: SnapshotParticles) -> dict[str, Array]:
    """All that are stored of particles, (n,), but h."""
    held = {name: array for name, array in vars(p).items() if isinstance(array, np.ndarray) and array.ndim == 1}
    held.pop("h", None)
    return held | p.columns


def _vectors(p: SnapshotParticles) -> dict[str, Array]:
    """Places, and velocities where they were read, (n, 3)."""
    held = {"pos": p.pos, "vel": p.vel}
    return {name: np.pad(array, ((0, 0), (0, 1))) for name, array in held.items() if array is not None}


def _powers(snap: Snapshot, p: SnapshotParticles, name: str, bases: tuple[str, ...]) -> list[str]:
    """The unit of an array as powers of bases of mass, length, time and temperature."""
    return [f"{base}**{power:g}" for base, power in zip(bases, _exponents(snap, p, name), strict=True) if power]


def _exponents(snap: Snapshot, p: SnapshotParticles, name: str) -> tuple[float, float, float, float]:
    dimension = _dimension(p, name)
    if dimension in PLAIN_UNITS:
        return 0.0, 0.0, 0.0, float(dimension == "temperature")
    mass, length, time = snap.units.exponents(dimension)
    return mass, length - (dimension in LAYERS), time, 0.0


def _cgs(snap: Snapshot, p: SnapshotParticles, name: str) -> float:
    """The code unit of an array in cgs."""
    dimension = _dimension(p, name)
    factor = 1.0 if dimension in PLAIN_UNITS else snap.units.cgs(dimension)
    return factor / snap.units.cgs("length") if dimension in LAYERS else factor


def _dimension(p: SnapshotParticles, name: str) -> str:
    return {"h": "length", "density": "density"}.get(name) or p.dimensions_of[name]


def _spread(snap: Snapshot, p: SnapshotParticles) -> dict[str, Array]:
    """h: the radius R of the kernel of each particle, and density: its surface density, (n,)."""
    if p.h is not None and p.density is not None:
        return {"h": p.h * snap.support, "density": p.density}
    from scipy.spatial import cKDTree

    sides = snap.upper - snap.lower
    places, around = ((p.pos - snap.lower) % sides, sides) if repeats(snap) else (p.pos, None)
    # Each is its own nearest; where there are fewer in all, what is missing is infinitely far and has no mass.
    distance, nearest = cKDTree(places, boxsize=around).query(places, NEIGHBOUR + 1)
    radius = np.clip(distance[:, -1], NEAREST * sides.max(), sides.max())
    mass = np.append(p.mass, 0.0)[nearest[:, 1:-1]].sum(axis=1)
    return {"h": radius, "density": mass / (np.pi * radius**2)}
