"""Messages about faults of a scene, with file, line, key, and a hint that has the nearest valid name."""

from __future__ import annotations

from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from discsim.printable import UserError, printable
from discsim.scene import fields, tomltext
from discsim.scene.fields import models_in, shown
from discsim.scene.rules import Problem
from discsim.scene.tables import TABLES
from discsim.scene.units import MAX_ECHO, Units, clipped

KeyPath = tuple[str | int, ...]


class SceneError(UserError):
    """A scene that cannot be used, because it has faults.

    Attributes
    ----------
    problems : list of str
        One message per fault, each with file, line and key.
    """

    def __init__(self, problems: Sequence[str]) -> None:
        self.problems = [printable(problem) for problem in problems]
        Exception.__init__(self, "\n".join(self.problems))

    def __reduce__(self) -> tuple[type[SceneError], tuple[list[str]]]:
        return SceneError, (self.problems,)


class SecondaryFault(str):
    """Message of a fault that is reported only if the scene has no other fault, because another fault causes it."""


class Origins:
    """The source of every key of a scene, for messages: "scene.toml:12", a command-line option, or "scene" for a dict.

    The arguments are the path of the scene file, None for a dict, and its text.
    """

    def __init__(self, path: Path | None, text: str) -> None:
        lines = tomltext.line_numbers(text) if path else {}
        self.places: dict[KeyPath, str] = {key: f"{path}:{line}" for key, line in lines.items()}
        self.places[()] = f"{path}:1" if path else "scene"
        self.plain_dict = path is None

    def set_option(self, key: KeyPath, option: str) -> None:
        """Record the command-line option `option` as the source of a key, and of tables that it creates."""
        self.places[key] = option
        if not self.plain_dict:
            for end in range(1, len(key)):
                self.places.setdefault(key[:end], option)

    def source_of(self, key: KeyPath) -> str:
        """Return the source of a key, or of the innermost enclosing table whose source is known."""
        return next(self.places[key[:end]] for end in range(len(key), -1, -1) if key[:end] in self.places)


def nearest(word: str, choices: Sequence[str]) -> str | None:
    """Return the choice whose spelling is nearest to `word`; None if no choice is similar.

    A choice like "gas.eta" is preferred if its last part equals `word`.
    """
    near = get_close_matches(word[:MAX_ECHO].lower(), choices, n=1, cutoff=0.5)
    leaves = [choice for choice in choices if choice.split(".")[-1] == word]
    return next(iter(leaves or near), None)


def nearest_hint(word: str, choices: Sequence[str]) -> str:
    """Return the hint '; did you mean "..."?' with the choice nearest to `word`; "" if no choice is similar."""
    best = nearest(word, choices)
    return f'; did you mean "{best}"?' if best else ""


def name_of(path: KeyPath) -> str:
    """Return the dotted name of a key, like "gas.eos.kind", for messages."""
    return clipped(".".join(str(part) for part in path))


def message(fault: Problem, origins: Origins) -> str:
    """Return the message of a fault: the source of the key, the key, and what is wrong."""
    path, wrong = fault
    name = name_of(path)
    return f"{origins.source_of(path)}: {name}: {wrong}" if name else f"{origins.source_of(path)}: {wrong}"


def value_at(data: Any, *path: str | int) -> Any:
    """Return the value at `path` in nested tables and lists; None if there is no value."""
    for part in path:
        in_list = isinstance(data, list) and isinstance(part, int) and part < len(data)
        if not in_list and not (isinstance(data, dict) and part in data):
            return None
        data = data[part]
    return data


def drop_secondary_errors(details: list[Any]) -> list[Any]:
    """Return pydantic's errors `details` without the "missing" errors that mistyped keys cause.

    A mistyped key is one fault: the required key with the nearest name is not reported as missing as well.
    """
    missing = {detail["loc"] for detail in details if detail["type"] == "missing"}
    for detail in details:
        if detail["type"] == "extra_forbidden":
            siblings = [str(loc[-1]) for loc in missing if loc[:-1] == detail["loc"][:-1]]
            missing.discard((*detail["loc"][:-1], nearest(str(detail["loc"][-1]), siblings) or ""))
    return [detail for detail in details if detail["type"] != "missing" or detail["loc"] in missing]


def problem_from_error(table: str, detail: Any, filled: Any, units: Units) -> Problem:
    """Convert pydantic's error `detail` to a problem: the path of the key, and a message.

    table: name of the table. filled: the table that was validated, with defaults. pydantic's tags of union members are
    removed from the path.
    """
    path: KeyPath = (table,)
    models = models_in(TABLES[table])
    owner = None
    for part in detail["loc"]:
        tagged = [model for model in models if len(models) > 1 and _kind_of_model(model) == part]
        if tagged:
            models = tagged
            continue
        if part in ("#value", "#table"):  # tags of `fields.value_or_table`
            continue
        path += (part,)
        if isinstance(part, str) and models:
            owner = models[0]
            field = owner.model_fields.get(part)
            models = models_in(field.annotation) if field else []
    field = owner.model_fields.get(str(path[-1])) if owner else None
    # The last part of the path may be an index into a vector that validation made from one number.
    value = value_at({table: filled}, *path)
    value = value_at({table: filled}, *path[:-1]) if value is None and isinstance(path[-1], int) else value
    return _problem_at(detail, path, owner, field, models, value, units)


def _kind_of_model(model: type[fields.Table]) -> str | None:
    """Return the value of the key `kind` that selects a table model; None if the model has no such key."""
    return model.model_fields["kind"].default if "kind" in model.model_fields else None


def _problem_at(
    detail: Any, path: KeyPath, owner: Any, field: Any, models: list[type[fields.Table]], value: Any, units: Units
) -> Problem:
    """Return the problem of the key at `path`, with a message for pydantic's error `detail`.

    owner: table model that contains the key. field: field of the key in this model. models: table models that the key
    accepts. value: value of the key in the scene.
    """
    kind, context = detail["type"], detail.get("ctx", {})
    if kind == "fault":
        return path, detail["msg"]
    if kind == "secondary_fault":
        return path, SecondaryFault(detail["msg"])
    if kind == "missing":
        measure = fields.measure_of(field) if field else None
        words = f"; expected {units.expected(measure.name)}" if measure and measure.name else ""
        if measure and units.system == "code":
            words = "; expected a number without unit"
        meaning = f" ({field.description})" if field and field.description else ""
        return path, f"missing{meaning}{words}"
    if kind == "extra_forbidden":
        keys = list(owner.model_fields)
        hint = nearest_hint(str(path[-1]), keys) or _hint_elsewhere(path)
        return path, f"unknown key; expected one of {', '.join(keys)}{hint}"
    if kind in ("literal_error", "union_tag_invalid", "union_tag_not_found"):
        return _choice_problem(kind, context, path, models, value)
    limits = {
        "greater_than": ("gt", "more than"),
        "greater_than_equal": ("ge", "at least"),
        "less_than_equal": ("le", "at most"),
        "less_than": ("lt", "less than"),
    }
    if kind in limits:
        key, words = limits[kind]
        wrong = "is not positive" if (key, context[key]) == ("gt", 0) else "is out of range"
        return path, f"{shown(value)} {wrong}; expected {words} {context[key]:g}"
    if kind == "bool_type":
        return path, f"{shown(value)} is neither true nor false; expected true or false"
    if kind in ("model_type", "model_attributes_type"):
        return path, f"{shown(value)} is not a table; expected the table [{'.'.join(map(str, path))}]"
    return path, f"{shown(value)}: {detail['msg'][0].lower()}{detail['msg'][1:]}"


def _choice_problem(
    kind: str, context: dict[str, Any], path: KeyPath, models: list[type[fields.Table]], value: Any
) -> Problem:
    """Return the problem of a value that is none of the choices. kind, context: from pydantic's error."""
    expected = context.get("expected") or context.get("expected_tags") or ""
    choices = [part.strip(" '") for part in expected.replace(" or ", ", ").split(",")]
    words = ", ".join(f'"{choice}"' if not choice.isdecimal() else choice for choice in choices)
    if kind.startswith("union"):
        if not isinstance(value, dict):
            return path, f"{shown(value)} is not a table; expected the table [{'.'.join(map(str, path))}]"
        path, value = (*path, "kind"), value.get("kind")
        if kind == "union_tag_not_found":
            return path, "missing; expected one of " + ", ".join(f'"{_kind_of_model(model)}"' for model in models)
    return path, f"{shown(value)} is unknown; expected one of {words}{nearest_hint(str(value), choices)}"


def _hint_elsewhere(path: KeyPath) -> str:
    """Return a hint if another kind of the table, or another table, has a key with this name."""
    key = str(path[-1])
    places: list[tuple[KeyPath, type[fields.Table]]] = []
    for table, annotation in TABLES.items():
        for model in models_in(annotation):
            places += [((table, key), model)] if key in model.model_fields else []
            for name, field in model.model_fields.items():
                inner = (each for each in models_in(field.annotation) if key in each.model_fields)
                places += [((table, name, key), each) for each in inner]
    for place, model in places:
        if place == path:
            return f'; the key exists only with kind = "{_kind_of_model(model)}"'
    return f'; did you mean "{name_of(places[0][0])}"?' if places else ""
