"""Checked reading of entries of a snapshot: columns, units, time and the tables of the scene.

The functions that read raise EntryError if an entry is missing or has a wrong type, shape or value.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Collection
from typing import Any

import numpy as np

from discsim.numerics.entries import TYPES, VECTORS, EntryError
from discsim.output import hdf5
from discsim.output.fields.frame import in_code
from discsim.output.layout import Field, columns_of_packages
from discsim.scene.units import UnitError, Units, clipped

Array = np.ndarray
REQUIRED = ("pos", "vel", "mass", "ids")  # columns that every species must have
# Columns whose entries must be finite.
FINITE = (
    "pos", "vel", "across", "mass", "density", "h", "u", "pressure", "sound_speed", "temperature", "small", "size",
)  # fmt: skip
# Keys of a scene that functions on snapshots read, and whose values are texts.
TEXT_KEYS = (("space", "boundary"), ("initial", "kind"), ("star", "frame"), ("star", "centre"), ("drag", "direction"))


def time_of(file: hdf5.CheckedGroup) -> float:
    """Return the time of an open snapshot, in its code units."""
    return float(file.group("Header").numbers("Time", (1,))[0])


def scene_text_of(file: hdf5.CheckedGroup) -> str:
    """Return the scene in an open snapshot as TOML, unchecked."""
    content = file.group("discsim").dataset("Scene", "u", ()).read().tobytes()
    return hdf5.decode_text(content, "/discsim/Scene")


def units_of(file: hdf5.CheckedGroup) -> Units:
    """Return the code units of an open snapshot."""
    own = file.group("discsim")
    texts, dimensions = own.texts("units"), own.whole("dimensions")
    if len(texts) != 3 or dimensions not in (1, 2):
        wrong = f"the file has {len(texts)} units and {dimensions} dimensions"
        raise EntryError(f"{wrong}; expected 3 units (system, length and mass), and 1 or 2 dimensions")
    system, length, mass = texts
    try:
        return Units(system, dimensions, length, mass)
    except UnitError as fault:
        raise EntryError(f"the units in the file are wrong: {fault}") from None


def read_columns(
    group: hdf5.CheckedGroup, fields: dict[str, Field], wanted: Callable[[str], bool]
) -> tuple[dict[str, Array], dict[str, Array], dict[str, str]]:
    """Return the columns of particles in a group, as three dicts with the column's name as key.

    The dicts have the arrays that the layout defines, the arrays of effects in other packages, and the physical
    dimensions of all these arrays. `fields` are the datasets of the layout. Only columns for which `wanted(name)` is
    True are read.
    """
    count = len(group.dataset("Masses", "f", ()))
    arrays: dict[str, Array] = {}
    known: dict[str, str] = {}
    for name, (dataset, dimension, _) in fields.items():
        if wanted(name) and (name in REQUIRED or dataset in group):
            kinds = {"ids": "iu", "species": "iu", "immobile": "biu"}.get(name, "f")
            array = group.rows(dataset, count, kinds, (3,) if name in VECTORS else ())
            arrays[name], known[name] = array.astype(TYPES.get(name, np.float64), copy=False), dimension
    others = {}
    for name, (dataset, dimension) in columns_of_packages(group).items():
        if wanted(name):
            others[name], known[name] = group.rows(dataset, count, "biuf", row_shape=None), dimension
    return arrays, others, known


def tables_of(text: str, units: Units) -> dict[str, Any]:
    """Return the tables of the scene in a snapshot, from its TOML `text`.

    Only the entries that functions on snapshots read are checked. `units` are the units of the snapshot.
    """
    try:
        tables = tomllib.loads(text)
    except (ValueError, RecursionError) as fault:
        raise EntryError(f"the scene in the file is not valid TOML: {fault}") from None
    if "space" not in tables or not tables.keys() & {"gas", "dust"}:
        raise EntryError(
            "the scene in the file lacks [space], or has neither [gas] nor [dust]; expected the scene of a run"
        )
    for name, table in tables.items():
        listed = isinstance(table, list) and all(isinstance(each, dict) for each in table)
        if not (isinstance(table, str) if name == "title" else isinstance(table, dict) or listed):
            raise EntryError(f"{name} in the scene of the file is {clipped(repr(table))}; expected a table")
    for path in TEXT_KEYS:
        table, key = tables.get(path[0], {}), path[1]
        if not isinstance(table, dict) or not isinstance(table.get(key, ""), str):
            raise EntryError(f"{path[0]}.{key} in the scene of the file is not text; expected text")
    companions = tables.get("companion", [])
    for each in [companions] if isinstance(companions, dict) else companions:
        if not isinstance(each.get("eccentricity", 0.0), int | float):
            raise EntryError("companion.eccentricity in the scene of the file is not a number; expected a number")
    star = tables.get("star")
    for key in ("mass", "softening") if star is not None else ():
        value = star.get(key, 0.0 if key == "softening" else None)
        try:
            in_code(units, value, {"mass": "mass", "softening": "length"}[key])
        except (TypeError, ValueError) as fault:
            raise EntryError(f"star.{key} in the scene of the file is {clipped(repr(value))}: {fault}") from None
    return tables


def table_count(tables: dict[str, Any], name: str) -> int:
    """Return how many tables `name` a scene has: "dust" gives the number of populations, for example."""
    found = tables.get(name)
    return len(found) if isinstance(found, list) else int(found is not None)


def is_requested(columns: Collection[str] | None, kind: str, name: str) -> bool:
    """Return whether `read_snapshot` with the argument `columns` reads the array `name` of particles of a kind.

    Positions and masses, and all arrays of star and companions, are always read.
    """
    return columns is None or kind == "bodies" or name in ("pos", "mass") or f"{kind}.{name}" in columns
