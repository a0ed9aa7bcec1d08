"""Checked reading of snapshot entries: columns, units, time and the tables of the scene.

Every reading function raises EntryError if an entry is missing or has a wrong type, shape or value.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Collection
from typing import Any

import numpy as np

from discsim.numerics.entries import TYPES, VECTORS, EntryError
from discsim.output import hdf5
from discsim.output.fields.frame import in_code
from discsim.output.layout import Field, other_columns
from discsim.scene.units import UnitError, Units, clipped

Array = np.ndarray
REQUIRED = ("pos", "vel", "mass", "ids")  # columns that every species must have
# Keys of a scene with a text that functions on snapshots read.
TEXT_KEYS = (("space", "boundary"), ("initial", "kind"), ("star", "frame"), ("star", "centre"), ("drag", "direction"))


def time_of(file: hdf5.CheckedGroup) -> float:
    """Return the time of an open snapshot, in its code units."""
    return float(file.group("Header").numbers("Time", (1,))[0])


def units_of(file: hdf5.CheckedGroup) -> Units:
    """Return the code units of an open snapshot."""
    own = file.group("discsim")
    texts, dimensions = own.texts("units"), own.whole("dimensions")
    if len(texts) != 3 or dimensions not in (1, 2):
        raise EntryError(f"{len(texts)} units and {dimensions} dimensions; expected 3 units, and 1 or 2 dimensions")
    system, length, mass = texts
    try:
        return Units(system, dimensions, length, mass)
    except UnitError as fault:
        raise EntryError(f"its units are wrong: {fault}") from None


def columns_of(
    group: hdf5.CheckedGroup, fields: dict[str, Field], wanted: Callable[[str], bool]
) -> tuple[dict[str, Array], dict[str, Array], dict[str, str]]:
    """Return three dicts by name: arrays that the layout defines, columns of other packages, dimensions of both.

    `fields` are the datasets of the layout, and `wanted(name)` is True for columns to read.
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
    for name, (stored, dimension) in other_columns(group).items():
        if wanted(name):
            if len(stored) != count:
                raise EntryError(f"{stored.name} has {len(stored)} rows; expected {count}, as the other columns")
            others[name], known[name] = stored.read(), dimension
    return arrays, others, known


def tables_of(text: str, units: Units) -> dict[str, Any]:
    """Return the tables of a snapshot's scene; only entries that functions on snapshots read are checked."""
    try:
        tables = tomllib.loads(text)
    except (ValueError, RecursionError) as fault:
        raise EntryError(f"its scene is not valid TOML: {fault}") from None
    if "space" not in tables or not tables.keys() & {"gas", "dust"}:
        raise EntryError("its scene lacks [space], or both [gas] and [dust]; expected the scene of a run")
    for name, table in tables.items():
        listed = isinstance(table, list) and all(isinstance(each, dict) for each in table)
        if not (isinstance(table, str) if name == "title" else isinstance(table, dict) or listed):
            raise EntryError(f"{name} of its scene is {clipped(repr(table))}; expected a table")
    for path in TEXT_KEYS:
        table, key = tables.get(path[0], {}), path[1]
        if not isinstance(table, dict) or not isinstance(table.get(key, ""), str):
            raise EntryError(f"{path[0]}.{key} of its scene is not a text; expected a text")
    companions = tables.get("companion", [])
    for each in [companions] if isinstance(companions, dict) else companions:
        if not isinstance(each.get("eccentricity", 0.0), int | float):
            raise EntryError("companion.eccentricity of its scene is not a number; expected a number")
    star = tables.get("star")
    for key in ("mass", "softening") if star is not None else ():
        value = star.get(key, 0.0 if key == "softening" else None)
        try:
            in_code(units, value, {"mass": "mass", "softening": "length"}[key])
        except (TypeError, ValueError) as fault:
            raise EntryError(f"star.{key} of its scene is {clipped(repr(value))}: {fault}") from None
    return tables


def table_count(tables: dict[str, Any], name: str) -> int:
    """Return the number of tables `name` in a scene, such as "dust" (populations) or "companion"."""
    found = tables.get(name)
    return len(found) if isinstance(found, list) else int(found is not None)


def is_requested(columns: Collection[str] | None, kind: str, name: str) -> bool:
    """Return whether `read_snapshot` with this argument `columns` reads the column `name` of a kind."""
    return columns is None or kind == "bodies" or name in ("pos", "mass") or f"{kind}.{name}" in columns
