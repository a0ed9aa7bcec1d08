"""The reference of effects and keys, made from what runs: module docstrings and the tables' own fields."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import discsim
from discsim import tables
from discsim.effects import EFFECTS
from discsim.tables import TABLES, Default, Table, measure_of, models_in

_HOME = Path(discsim.__file__).parent


def effects_text() -> str:
    """Every effect with its equation and keys, then the tables that set up a run."""
    lines: list[str] = []
    for name, module in EFFECTS.items():
        source = _HOME.parent / (module.replace(".", "/") + ".py")
        if source.exists():
            lines += ["", f"[{name}]", *_indented(docstring(source)), *_table_lines(name, TABLES[name])]
        if name == "drag":
            lines += _schemes()
    lines += ["", "Tables that set up a run"]
    for name in ("units", "run", "space", "initial"):
        lines += ["", f"[{name}]", *_table_lines(name, TABLES[name])]
    return "\n".join(lines[1:])


def docstring(source: Path) -> str:
    """The docstring of a module, which is its equation, without importing it."""
    return ast.get_docstring(ast.parse(source.read_text(encoding="utf-8"))) or ""


def _schemes() -> Iterator[str]:
    for source in sorted((_HOME / "drag").glob("[!_]*.py")):
        yield f"  drag.{source.stem}"
        yield from _indented(docstring(source), "    ")


def _indented(text: str, space: str = "  ") -> Iterator[str]:
    for line in text.splitlines():
        yield space + line if line else ""


def _table_lines(name: str, annotation: Any) -> Iterator[str]:
    """The keys of a table, of each of its kinds, and of the tables in it."""
    models = models_in(annotation)
    for model in models:
        if len(models) > 1:
            yield f'  kind = "{model.model_fields["kind"].default}": {model.__doc__}'
        inner = []
        for key, field in model.model_fields.items():
            if key == "kind" and len(models) > 1:
                continue
            if models_in(field.annotation):
                inner.append((key, field))
            else:
                yield "    {:<24} {:<27} {:<22} {}".format(*key_row(model, key))
        for key, field in inner:
            yield f"  [{name}.{key}]"
            yield from _table_lines(f"{name}.{key}", field.annotation)


def key_row(model: type[Table], key: str) -> tuple[str, str, str, str]:
    """Name, unit, default and meaning of a key, in words."""
    field = model.model_fields[key]
    return key, _unit_words(model, key), _default_words(field), field.description or ""


def _unit_words(model: type[Table], key: str) -> str:
    field = model.model_fields[key]
    measure = measure_of(field)
    if model is tables.Shock:
        return "density, pressure, velocity"
    if measure and measure.name:
        return measure.name.replace("_", " ")
    choices = tables.choices_in(field.annotation)
    if choices:
        return " | ".join(str(choice) for choice in choices)
    if key in ("checkpoint_every", "walltime"):
        return "wall-clock time"
    return "text" if field.annotation is str else ""


def _default_words(field: Any) -> str:
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
    return tables.shown(list(field.default) if isinstance(field.default, tuple) else field.default)
