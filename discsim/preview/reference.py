"""Reference texts of effects and keys, generated from module docstrings and from the fields of the table models.

`python -m discsim.preview.reference` prints the tables of keys as Markdown, for the documentation.
"""

from __future__ import annotations

import ast
import re
import textwrap
from collections.abc import Iterable, Iterator
from importlib.util import find_spec
from itertools import zip_longest
from pathlib import Path
from typing import Any, NamedTuple, get_origin

from discsim.parts import EFFECTS, SCHEMES
from discsim.printable import UserError
from discsim.scene import fields
from discsim.scene.fields import Default, Table, measure_of, models_in
from discsim.scene.messages import nearest_hint
from discsim.scene.tables import TABLES
from discsim.scene.units import clipped

SETUP_TABLES = ("units", "run", "space", "initial")
COLUMNS = ("key", "value", "default", "meaning")
COLUMN_WIDTHS = (22, 20, 18, 46)


class Section(NamedTuple):
    """Reference of one table of a scene, or of one kind of this table.

    kind: the kind; "" if the table has no kinds. rows: one row for each key, with one entry for each of COLUMNS.
    """

    table: str
    kind: str
    description: str
    rows: list[tuple[str, str, str, str]]


def effects_text(name: str | None = None) -> str:
    """Return the reference of the table `name` as text: the equations of an effect, and all keys.

    If `name` is None, return all effects, and the tables that set up a run.
    Raises UserError, with the closest valid name, if there is no such table, and PartError if a part of another package
    cannot be used.
    """
    if name is None:
        return "\n\n".join([*map(_table_text, EFFECTS), "Tables that set up a run", *map(_table_text, SETUP_TABLES)])
    known = [*EFFECTS, *SETUP_TABLES]
    if name not in known:
        raise UserError(
            f"{clipped(name)}: unknown table; expected one of {', '.join(known)}{nearest_hint(name, known)}"
        )
    return _table_text(name)


def _table_text(name: str) -> str:
    """Return the reference of one table as text: equations of an effect, keys, and the schemes of drag."""
    if name not in EFFECTS:
        return "\n".join([f"[{name}]", *_key_lines(name)])
    effect = EFFECTS[name]
    lines = [f"[{name}]", *_indent_lines(docstring(EFFECTS.module(name))), "", *_key_lines(name)]
    return "\n".join([*lines, *(_scheme_lines() if effect.role.lists_schemes else [])])


def scene_markdown() -> str:
    """Return the tables of a scene and their keys as Markdown, for the documentation."""
    lines: list[str] = []
    for name in (*SETUP_TABLES, *EFFECTS):
        for section in _sections(name, TABLES[name]):
            heading = f"`[{section.table}]`" + (f" with `kind = {section.kind}`" if section.kind else "")
            lines += [
                "",
                f"{'##' if section.table == name else '###'} {heading}",
                "",
                *([section.description, ""] if section.description else []),
            ]
            lines += [_markdown_row(COLUMNS), _markdown_row("-" * len(COLUMNS))]
            lines += [_markdown_row((f"`{key}`", *rest)) for key, *rest in section.rows]
    return "\n".join(lines[1:])


def docstring(module: str) -> str:
    """Return the docstring of a module, which has its equations, without importing the module.

    Return "" if the module has no Python source or no docstring.
    """
    found = find_spec(module)
    if found is None or found.origin is None or not found.origin.endswith(".py"):
        return ""
    return ast.get_docstring(ast.parse(Path(found.origin).read_text(encoding="utf-8"))) or ""


def paragraphs(text: str) -> list[str]:
    """Split a docstring into paragraphs, with equation numbers moved to the left. Indented paragraphs are equations."""
    text = re.sub(r" {5,}(\(\d+\w?\))$", r"    \1", text.strip("\n"), flags=re.M)
    return [part for part in re.split(r"\n\s*\n", text) if part.strip()]


def split_code(paragraph: str) -> list[str]:
    """Split a paragraph into pieces of plain text and, at odd indices, pieces of code with their backquotes."""
    return re.split(r"(`[^`]+`)", paragraph)


def _scheme_lines() -> Iterator[str]:
    for name in SCHEMES:
        yield ""
        yield f'  scheme = "{name}"' + ("" if SCHEMES[name].conserves else ": does not conserve momentum")
        yield from _indent_lines(docstring(SCHEMES.module(name)).removeprefix(f"{name}: "), "    ")


def _indent_lines(text: str, space: str = "  ") -> Iterator[str]:
    for line in text.splitlines():
        yield space + line if line else ""


def _markdown_row(entries: Iterable[str]) -> str:
    return "| " + " | ".join(entries) + " |"


def _key_lines(name: str) -> Iterator[str]:
    for section in _sections(name, TABLES[name]):
        if section.kind:
            yield f"  {section.table}.kind = {section.kind}: {section.description}"
        elif section.description:
            yield f"  {section.description}" if section.table == name else f"  [{section.table}] {section.description}"
        for row in section.rows:
            yield from _row_lines(row)


def _row_lines(row: Iterable[str]) -> Iterator[str]:
    cells = zip(row, COLUMN_WIDTHS, strict=True)
    columns = [textwrap.wrap(text, width, break_on_hyphens=False) for text, width in cells]
    for line in zip_longest(*columns, fillvalue=""):
        shown = (f"{text:<{width}}" for text, width in zip(line, COLUMN_WIDTHS, strict=True))
        yield "    " + " ".join(shown).rstrip()


def _sections(name: str, annotation: Any) -> Iterator[Section]:
    """Yield the sections for the table `name`.

    Each kind of the table has a section, which is followed by the sections of tables inside this kind. annotation: type
    of the table, with one model or several kinds.
    """
    models = models_in(annotation)
    for model in models:
        kinds = len(models) > 1
        keys = [key for key in model.model_fields if not (kinds and key == "kind")]
        inner = [key for key in keys if models_in(model.model_fields[key].annotation)]
        # A key that may be a table or a value has both a section and a row.
        rows = [key_row(model, key) for key in keys if key not in inner or measure_of(model.model_fields[key])]
        kind = fields.shown(model.model_fields["kind"].default) if kinds else ""
        yield Section(name, kind, _table_description(name, annotation, model), rows)
        for key in inner:
            yield from _sections(f"{name}.{key}", model.model_fields[key].annotation)


def _table_description(name: str, annotation: Any, model: type[Table]) -> str:
    """Return the docstring of a table, and how the table is repeated if a scene may have several of them."""
    words = "" if model.__doc__ == Table.__doc__ else model.__doc__ or ""
    several = f" Repeat the table as `[[{name}]]` for more than one." if get_origin(annotation) is tuple else ""
    return words + several


def key_row(model: type[Table], key: str) -> tuple[str, str, str, str]:
    """Return the row of a key: its name, its dimension or choices, its default and its meaning, as text."""
    field = model.model_fields[key]
    return key, _value_description(model, key), _default_description(field), field.description or ""


def _value_description(model: type[Table], key: str) -> str:
    """Return which values a key may have: a dimension, choices or a type."""
    field = model.model_fields[key]
    measure = measure_of(field)
    for entry in field.metadata:
        if isinstance(entry, fields.AllowedValues):
            return entry.words
    if measure:
        table = ", or a table" if models_in(field.annotation) else ""
        return (measure.name.replace("_", " ") or "number") + table
    choices = fields.choices_in(field.annotation)
    if choices:
        return ", ".join(fields.shown(choice) for choice in choices)
    if field.annotation is bool:
        return "true, false"
    return "text" if field.annotation is str else "whole number"


def _default_description(field: Any) -> str:
    for entry in field.metadata:
        if isinstance(entry, Default):
            return entry.words
    if field.is_required():
        return "required"
    if field.default is None:
        return "none"
    measure = measure_of(field)
    if measure and field.default == 0:
        return "0"
    if measure and measure.name and isinstance(field.default, float):
        return f"{field.default:g} code unit"
    if isinstance(field.default, tuple):
        return "[" + ", ".join(fields.shown(entry) for entry in field.default) + "]"
    return fields.shown(field.default)


if __name__ == "__main__":
    print(scene_markdown())
