"""Dust populations of a snapshot: names, grain sizes, particles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.output.fields.frame import in_code
from discsim.printable import printable
from discsim.scene.units import UnitError

if TYPE_CHECKING:
    from discsim.output.snapshot import Snapshot

Array = np.ndarray


@dataclass(frozen=True)
class Population:
    """A dust population: number, name (`dust.name` or the number), and `text` with the size for legends."""

    number: int
    name: str
    text: str


def populations_of(snap: Snapshot) -> list[Population]:
    """Return the dust populations of the run of a snapshot, in the order of their tables."""
    found = []
    tables = snap.tables.get("dust", [])
    for number, table in enumerate([tables] if isinstance(tables, dict) else tables):
        name = printable(str(table.get("name", number)))
        size = size_text(table.get("grain_size"))
        text = f"{name}, {size}" if size and size != name and "name" in table else size or name
        found.append(Population(number, name, text))
    return found


def size_text(given: Any) -> str:
    """Return a grain size of a scene as text; "" for none."""
    if isinstance(given, dict):
        return f"{printable(str(given.get('smallest')))} to {printable(str(given.get('largest')))}"
    return "" if given is None else printable(str(given))


def grain_sizes(snap: Snapshot) -> Array | None:
    """Return the radius (n,) of each dust grain in cm, from the snapshot or its scene; None if the run has no sizes."""
    dust = snap.dust
    assert dust is not None
    to_cm = snap.units.cgs("length")
    if dust.size is not None:
        return dust.size * to_cm
    tables = snap.tables.get("dust", [])
    try:
        sizes = [
            in_code(snap.units, table["grain_size"], "length") * to_cm
            for table in ([tables] if isinstance(tables, dict) else tables)
        ]
    except (KeyError, TypeError, ValueError, UnitError):
        return None
    number = np.zeros(dust.count, int) if dust.species is None else np.asarray(dust.species, dtype=int)
    return np.asarray(sizes)[number] if number.max(initial=-1) < len(sizes) else None


def small_dust_size(snap: Snapshot) -> float:
    """Return the largest radius in cm of the small dust that gas particles carry (`growth.small_size`)."""
    given = snap.tables.get("growth", {}).get("small_size", "1 um")
    return in_code(snap.units, given, "length") * snap.units.cgs("length")
