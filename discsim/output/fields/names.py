"""Look-up of fields by name, and messages about fields that a run does not have."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

from discsim.output.fields.base import AXIS_UNITS, Field, FieldError
from discsim.output.populations import mean_text, only_population, population_of
from discsim.parts import FIELDS
from discsim.scene.messages import nearest_hint
from discsim.scene.units import clipped

if TYPE_CHECKING:
    from discsim.output.snapshot import Snapshot


def split_population(name: str) -> tuple[str | None, str]:
    """Return the population in the name of a field and the name without it: "0" and "dust.size" for "dust.0.size".

    The population is None for a field of all dust, or of gas.
    """
    population, _, last = name.removeprefix("dust.").rpartition(".")
    if name in FIELDS or not name.startswith("dust.") or not population:
        return None, name
    return population, f"dust.{last}" if f"dust.{last}" in FIELDS else last


def of_population(name: str, snap: Snapshot) -> tuple[Snapshot, str]:
    """Return the snapshot with only the population in the name of a field, and the name without the population."""
    population, plain = split_population(name)
    return (snap, plain) if population is None else (only_population(snap, population), plain)


def field_named(name: str) -> Field:
    """Return the field with a full name; that of a population, like "dust.0.size", is the field of all dust."""
    found: Field = FIELDS[split_population(name)[1]]
    return found


def species_text(name: str, snap: Snapshot, of_each: bool = False) -> str:
    """Return the species of a field for legends: "gas", "dust", "all dust", "dust 1 mm".

    With `of_each` the values are those of particles, otherwise means over particles in bins.
    """
    field, (population, plain) = field_named(name), split_population(name)
    if population is not None:
        return escaped(population_of(snap, population).legend)
    if not is_of_dust(field):
        return plain.partition(".")[0].replace("_", " ")
    words = mean_text(snap, is_mean=field.kind == "particles" and not of_each)
    return {"": "dust", "all dust": "all dust"}.get(words, f"dust, {words}")


def field_label(name: str, snap: Snapshot, of_all: bool = False, of_each: bool = False) -> str:
    """Return the label of a field with its unit, and with the size of its population, or that it is of all dust.

    With `of_all` the label is for curves of several species. With `of_each` the values are those of particles,
    otherwise means over particles in bins.
    """
    field, (population, _) = field_named(name), split_population(name)
    words = ""
    if population is not None:
        words = population_of(snap, population).text
    elif is_of_dust(field):
        words = mean_text(snap, is_mean=field.kind == "particles" and not of_each)
    label, bracket, unit = field.text(snap.units, of_all).partition(" [")
    shown = f", {escaped(words)}" if words and not of_all else ""
    return f"{label}{shown}{bracket}{unit}"


def is_of_dust(field: Field) -> bool:
    """Return whether a field depends on the dust particles, so that it exists for each population."""
    return field.species == "dust" or any(need.startswith("dust.") for need in field.needs)


def escaped(text: str) -> str:
    """Return a text in which matplotlib finds no mathematics."""
    return text.replace("$", r"\$")


def matching_fields(word: str) -> list[str]:
    """Return the full names of the fields that match a word. A word like "v_r" matches the field of every species.

    A word like "dust.0.v_r" matches the field of one population; whether a run has it depends on the run. Raises
    FieldError if there is none, with the most similar name and a list of all fields.
    """
    population, plain = split_population(word)
    if plain in FIELDS and (population is None or is_of_dust(FIELDS[plain])):
        return [word]
    found = [name for name in FIELDS if name.partition(".")[2] == word]
    if found:
        return found
    last = [name.rpartition(".")[2] for name in FIELDS]
    hint = nearest_hint(word, list(FIELDS)) or nearest_hint(word.rpartition(".")[2], list(dict.fromkeys(last)))
    some = "" if population is None else ', or a field of one population of dust, like "dust.0.size"'
    raise FieldError(f'"{clipped(word)}" is not a field; expected one of {", ".join(FIELDS)}{some}{hint}')


def with_populations(names: Sequence[str], populations: Sequence[str]) -> list[str]:
    """Return the names of fields, each field of all dust replaced by those of the `populations`, if there are any."""
    found = []
    for name in names:
        population, plain = split_population(name)
        if populations and population is None and is_of_dust(FIELDS[plain]):
            found += [f"dust.{each}.{plain.removeprefix('dust.')}" for each in populations]
        else:
            found.append(name)
    return found


def needed_columns(names: Iterable[str]) -> set[str]:
    """Return the columns of a snapshot, besides positions and masses, that the fields `names` use."""
    names = list(names)
    fields = [field_named(name) for name in names]
    apart = {"dust.species"} if any(split_population(name)[0] is not None for name in names) else set()
    return apart | {need for field in fields for need in (*field.needs, *field.reads) if "." in need}


def available_fields(word: str, snap: Snapshot) -> list[str]:
    """Return the full names of the fields that match a word and that `snap` has. Raises FieldError if there is none."""
    names = matching_fields(word)
    lacks = {name: missing_reason(field_named(name), snap) for name in names}
    there = [name for name in names if lacks[name] is None]
    if not there:
        same = len(set(lacks.values())) == 1
        raise FieldError("; ".join([f"{word}: {lacks[names[0]]}"] if same else [f"{n}: {lacks[n]}" for n in names]))
    for name in there:
        of_population(name, snap)  # raises FieldError for an unknown population
    return there


def single_field(word: str, snap: Snapshot) -> str:
    """Return the full name of the one field of `snap` that matches a word. Raises FieldError."""
    found = available_fields(word, snap)
    if len(found) > 1:
        raise FieldError(f'"{word}" exists for several species; expected one of {", ".join(found)}')
    return found[0]


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
    if name == "across":
        return ": the scene has no [shearing_box]"
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
