"""Look-up of fields by name, and messages about fields that a run does not have."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from discsim.output.fields.base import AXIS_UNITS, Field, FieldError
from discsim.parts import FIELDS
from discsim.scene.messages import nearest_hint

if TYPE_CHECKING:
    from discsim.output.snapshot import Snapshot


def matching_fields(word: str) -> list[str]:
    """Return the full names of the fields that match a word. A word like "v_r" matches the field of every species.

    Raises FieldError if there is none, with the most similar name and a list of all fields.
    """
    if word in FIELDS:
        return [word]
    found = [name for name in FIELDS if name.partition(".")[2] == word]
    if found:
        return found
    last = [name.rpartition(".")[2] for name in FIELDS]
    hint = nearest_hint(word, list(FIELDS)) or nearest_hint(word.rpartition(".")[2], list(dict.fromkeys(last)))
    raise FieldError(f'"{word}" is not a field; expected one of {", ".join(FIELDS)}{hint}')


def needed_columns(names: Iterable[str]) -> set[str]:
    """Return the columns of a snapshot, besides positions and masses, that the fields `names` use."""
    fields = [FIELDS[name] for name in names]
    return {need for field in fields for need in (*field.needs, *field.reads) if "." in need}


def available_fields(word: str, snap: Snapshot) -> list[str]:
    """Return the full names of the fields that match a word and that `snap` has. Raises FieldError if there is none."""
    names = matching_fields(word)
    lacks = {name: missing_reason(FIELDS[name], snap) for name in names}
    there = [name for name in names if lacks[name] is None]
    if not there:
        same = len(set(lacks.values())) == 1
        raise FieldError("; ".join([f"{word}: {lacks[names[0]]}"] if same else [f"{n}: {lacks[n]}" for n in names]))
    return there


def missing_reason(field: Field, snap: Snapshot) -> str | None:
    """Return the reason why the snapshot does not have `field`; None if it has it."""
    needs = (f"{field.species}.mass", *field.needs) if field.species else field.needs
    return next((why for need in needs if (why := _missing_need(need, snap))), None)


def _missing_need(need: str, snap: Snapshot) -> str | None:
    """Return the reason why the snapshot does not have `need`, an entry of `Field.needs`; None if it has it."""
    tables = snap.tables
    if need == "plane":
        return (
            None if snap.dimensions == 2 else "the field needs a run in two dimensions, but the run is in one dimension"
        )
    if need == "star":
        return None if "star" in tables else "the field needs a star, but the scene has no [star]"
    if need == "physical":
        return _code_units_reason("quantities have no units") if snap.units.system == "code" else None
    kind, _, name = need.partition(".")
    particles = snap.species.get(kind)
    if particles is None:
        given = ": its gas is the prescribed disc [background]" if kind == "gas" and "background" in tables else ""
        return f"the run has no {kind}{given}" + (" particles" if not given and kind == "gas" else "")
    if getattr(particles, name, None) is not None or name in particles.columns:
        return None
    if name == "temperature" and snap.units.system == "code":
        return _code_units_reason("gas has no temperature")
    return f"the snapshot has no {need}{_column_hint(name, tables)}"


def _code_units_reason(what: str) -> str:
    """Return the reason why a field does not exist in code units; `what` continues "where", like "gas has no ..."."""
    return f'the scene is in code units, where {what}; use a run with units.system = "physical"'


def _column_hint(name: str, tables: dict[str, object]) -> str:
    """Return the reason why a snapshot of a scene with these tables lacks a column, with a colon; "" if unknown."""
    if name == "small":
        return ": the scene has no [growth]"
    if name == "size":
        return ": the grains have one size; only a size distribution or [growth] stores sizes"
    if name in ("stokes", "stopping_time"):
        return ": the scene has no [drag]" if "drag" not in tables else ": the scene has no [star]"
    return ""


def field_rows() -> Iterator[tuple[str, str, str]]:
    """Yield the name, unit and description of every field."""
    for name, field in FIELDS.items():
        dimension = {"density": "surface_density"}.get(field.dimension, field.dimension)
        yield name, field.unit or AXIS_UNITS.get(dimension, ""), field.about


def field_table() -> str:
    """Return the table of all fields as text."""
    rows = [("name", "unit", "description"), *field_rows()]
    wide = [max(len(row[k]) for row in rows) for k in (0, 1)]
    return "\n".join(f"{name:<{wide[0]}}  {unit:<{wide[1]}}  {about}".rstrip() for name, unit, about in rows)
