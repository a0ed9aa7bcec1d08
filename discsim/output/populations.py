"""Dust populations of a run: chosen by name, their words in labels, grain sizes, particles."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import TYPE_CHECKING

import numpy as np

from discsim.output.fields.base import FieldError
from discsim.output.fields.frame import in_code
from discsim.scene.populations import Population, populations_of, size_text
from discsim.scene.units import UnitError, clipped

if TYPE_CHECKING:
    from discsim.output.snapshot import Snapshot

Array = np.ndarray


def population_of(snap: Snapshot, given: str) -> Population:
    """Return the dust population with the name or number `given`. Raises FieldError if the run has none."""
    known = populations_of(snap.tables)
    found = [each for each in known if each.name == given] or [each for each in known if str(each.number) == given]
    if not found:
        names = ", ".join(each.name if each.name == each.text else f"{each.name} ({each.size})" for each in known)
        wanted = f"expected one of {names}" if names else "the run has no dust"
        raise FieldError(f'"{clipped(given)}" is not a population of dust; {wanted}')
    return found[0]


def only_population(snap: Snapshot, given: str) -> Snapshot:
    """Return a snapshot whose dust is one population, given by name or number. Raises FieldError."""
    number, dust = population_of(snap, given).number, snap.dust
    if dust is None or (dust.species is None and number == 0 and len(populations_of(snap.tables)) == 1):
        return snap
    if dust.species is None:
        raise FieldError('the snapshot was read without "dust.species"; read all columns, or this one too')
    member = np.asarray(dust.species) == number
    arrays = {f.name: getattr(dust, f.name) for f in fields(dust)}
    kept = {name: array[member] for name, array in arrays.items() if isinstance(array, np.ndarray)}
    return replace(snap, dust=replace(dust, columns={k: v[member] for k, v in dust.columns.items()}, **kept))


def mean_text(snap: Snapshot, is_mean: bool) -> str:
    """Return the words that a label of a field of all dust needs: "all dust", or "mean over 2 sizes" with `is_mean`.

    The text is "" for a run with one population.
    """
    found = populations_of(snap.tables)
    if len(found) < 2:
        return ""
    several = "sizes" if _have_sizes(snap) else "populations"
    return f"mean over {len(found)} {several}" if is_mean else "all dust"


def _have_sizes(snap: Snapshot) -> bool:
    """Return whether the populations of a run have different grain sizes."""
    sizes = [size_text(table.get("grain_size")) for table in snap.tables["dust"]]
    return "" not in sizes and len(set(sizes)) == len(sizes)


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
