"""A scene: TOML text or a dict -> one validated, frozen `Scene` in code units.

Every fault of a scene is found in one pass and told with its file, line and key. A table present = that
effect runs.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Sequence
from copy import deepcopy
from difflib import get_close_matches
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError

from discsim.formulas.smoothing import SMOOTHING
from discsim.parts import EFFECTS, MODELS
from discsim.scene import fields, tables, tomltext
from discsim.scene.fields import models_in, shown
from discsim.scene.rules import Draft, Problem, broken_rules
from discsim.scene.tables import REQUIRED, TABLES, optional_tables, removable
from discsim.scene.units import ECHOED, UnitError, Units, clipped

if TYPE_CHECKING:
    from discsim.effects.drag import Keys as Drag
    from discsim.effects.dust import Keys as Dust
    from discsim.effects.external import Keys as External
    from discsim.effects.gas import Keys as Gas
    from discsim.effects.given_disc import Keys as Background
    from discsim.effects.models import GasModel
    from discsim.effects.self_gravity import Keys as SelfGravity
    from discsim.effects.star import Keys as Star
else:  # imported only where a scene has them
    Background = Drag = Dust = External = Gas = SelfGravity = Star = Any

# Of starts that want another kernel than the cubic: quieter for its cost (analysis/noise.py); one that feels every wave
# of a stretched layer, so that it has a balance.
KERNEL_OF = {"disc": "quintic", "settling": "wendland-c4"}
DEEPEST = 8  # tables and lists within each other; a scene needs four
KeyPath = tuple[str | int, ...]
_NUMBER = re.compile(r"[+-]?(?:\d[\d_]*\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")


class SceneError(Exception):
    """A scene that cannot run; `problems` has one message a fault."""

    def __init__(self, problems: Sequence[str]) -> None:
        super().__init__("\n".join(problems))
        self.problems = list(problems)


class Scene(BaseModel):
    """What a run is to do, in code units. A table that the scene does not have is None."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    title: str
    units: Units
    run: tables.Run
    space: tables.Space
    initial: Any = None
    gas: Gas | None = None
    background: Background | None = None
    dust: tuple[Dust, ...] | None = None
    drag: Drag | None = None
    self_gravity: SelfGravity | None = None
    star: Star | None = None
    external: External | None = None
    others: dict[str, Any] = {}  # tables of effects that other packages bring
    text: str
    path: Path | None = None

    @property
    def centred(self) -> bool:
        """Whether the origin is the middle of space, as for a disc and a shock, or the corner of a periodic box."""
        return self.space.boundary == "open"

    @property
    def model(self) -> GasModel:
        """What the gas is made of."""
        return next(model for model in MODELS.values() if model.is_of(self))

    @property
    def on_cells(self) -> bool:
        """Whether gas and dust are fluids on a fixed grid, and their particles its cells."""
        return self.model.cells

    @property
    def effects(self) -> tuple[str, ...]:
        """The names of the effects that run, in the order of a step."""
        names: list[str] = []
        for name in self.named:
            table = self.table(name)
            parts = [] if isinstance(table, tuple) else optional_tables(type(table))
            names += [name, *(f"{name}.{part}" for part in parts if getattr(table, part) is not None)]
        return tuple(names)

    @property
    def named(self) -> tuple[str, ...]:
        """The tables of effects that the scene has, in the order of a step."""
        return tuple(name for name in EFFECTS if self.table(name) is not None)

    def table(self, name: str) -> Any:
        """The table of an effect, None where the scene does not have it."""
        return getattr(self, name) if name in type(self).model_fields else self.others.get(name)


def load_scene(
    source: str | Path | dict[str, Any],
    overrides: Sequence[str] = (),
    without: Sequence[str] = (),
    *,
    own_particles: bool = False,
) -> Scene:
    """Read and validate a scene file or dict, with `overrides` ("table.key=value") and `without` (tables).

    Where the caller has `own_particles`, the scene needs no [initial], and no numbers of particles (1 stands for them).
    Raises SceneError with every fault.
    """
    if isinstance(source, dict):
        _refuse_deep(source, "scene")
        path, text, data = None, "", _plain(source)
    else:
        path = Path(source)
        text = _read(path)
        data = _parsed(path, text)
        _refuse_deep(data, f"{path}:1")
    origins = _Origins(path, text)
    values, removed, problems = _changed(data, overrides, without, origins)
    found, faults = _validated(data, own_particles)
    problems += [_message(fault, origins) for fault in faults]
    if problems:
        raise SceneError(list(dict.fromkeys(problems)))
    text = tomltext.edited(text, data, values, removed) if path else tomltext.dumped(data)
    return Scene(**found, text=text, path=path)


class _Origins:
    """Where each key of a scene comes from: a line of its file, an override, or a dict."""

    def __init__(self, path: Path | None, text: str) -> None:
        lines = tomltext.positions(text) if path else {}
        self.places: dict[KeyPath, str] = {key: f"{path}:{line}" for key, line in lines.items()}
        self.places[()] = f"{path}:1" if path else "scene"
        self.plain_dict = path is None

    def override(self, key: KeyPath, option: str) -> None:
        self.places[key] = option
        if not self.plain_dict:
            for end in range(1, len(key)):
                self.places.setdefault(key[:end], option)

    def of(self, key: KeyPath) -> str:
        """The place of a key, or of the table that it is missing in."""
        return next(self.places[key[:end]] for end in range(len(key), -1, -1) if key[:end] in self.places)


def _read(path: Path) -> str:
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        raise SceneError([f"{path}: there is no such file; expected a scene, a TOML file"]) from None
    except IsADirectoryError:
        raise SceneError([f"{path}: is a directory; expected a scene, a TOML file"]) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise SceneError([f"{path}: cannot be read: {reason}; expected a scene, a TOML file"]) from None
    try:
        return content.decode("utf-8").removeprefix("\ufeff").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        byte = content[error.start]
        wrong = f"byte 0x{byte:02x} at offset {error.start} is not UTF-8; expected a TOML file in UTF-8"
        raise SceneError([f"{path}:{line}: {wrong}"]) from None


def _parsed(path: Path, text: str) -> dict[str, Any]:
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        reason, _, place = str(error).partition(" (at ")
        line = place.split(",")[0].removeprefix("line ")
        if not line.isdecimal():
            line = str(text.rstrip().count("\n") + 1)
        raise SceneError([f"{path}:{line}: not valid TOML: {reason}"]) from None
    except (RecursionError, ValueError) as error:
        reason = "nested too deeply" if isinstance(error, RecursionError) else str(error)
        raise SceneError([f"{path}:1: not valid TOML: {reason}"]) from None
    if not data:
        wanted = ", ".join(f"[{name}]" for name in REQUIRED)
        raise SceneError([f"{path}:1: the scene is empty; expected tables {wanted} and [gas] or [dust]"])
    return data


def _refuse_deep(data: dict[str, Any], where: str) -> None:
    """Raise SceneError where tables and lists nest deeper than any scene's."""
    left: list[tuple[Any, KeyPath]] = [(data, ())]
    while left:
        value, path = left.pop()
        if len(path) > DEEPEST:
            raise SceneError([f"{where}: {_name(path)}: nested too deeply; expected tables like [gas.eos]"])
        entries = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
        left += [(entry, (*path, key)) for key, entry in entries]


def _plain(value: Any) -> Any:
    """A value of a dict scene as TOML could hold it: Quantities as texts, arrays and tuples as lists."""
    if isinstance(value, dict):
        return {str(key): _plain(entry) for key, entry in value.items() if entry is not None}
    if hasattr(value, "unit") and hasattr(value, "value"):
        if getattr(value, "isscalar", True):
            return f"{float(value.value)!r} {value.unit}"
        return [_plain(entry) for entry in value]
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    return str(value) if isinstance(value, Path) else value


def _changed(
    data: dict[str, Any], overrides: Sequence[str], without: Sequence[str], origins: _Origins
) -> tuple[list, list, list[str]]:
    """Apply the command line to `data` in place. Returns values set, tables removed, problems."""
    values: list[tuple[list[str], Any]] = []
    problems: list[str] = []
    for assignment in overrides:
        name, equals, written = assignment.partition("=")
        text = clipped(assignment)
        path = [part.strip() for part in name.split(".")]
        if not equals or not all(path):
            problems.append(f'--set {text}: not an assignment; expected table.key=value, like run.until="10 yr"')
            continue
        if len(path) > DEEPEST:
            problems.append(f"--set {text}: nested too deeply; expected table.key=value")
            continue
        value = _override_value(written)
        try:
            tomltext.with_value(data, path, value)
        except KeyError as error:
            problems.append(f"--set {text}: {error.args[0]}")
            continue
        values.append((path, value))
        key = tuple(int(part) if part.isdecimal() else part for part in path)
        origins.override(key, f"--set {text}")
    removed = []
    for name in without:
        if name not in EFFECTS and name not in (known := removable()):
            problems.append(
                f"--without {clipped(name)}: unknown table; expected one of {', '.join(known)}{near(name, known)}"
            )
            continue
        removed.append(name.split("."))
        tomltext.without_table(data, removed[-1])
    return values, removed, problems


def _override_value(text: str) -> Any:
    """The value as TOML, as a number that TOML has no word for (.09, 5.), or else as a bare text, so that quotes need
    not survive the shell."""
    try:
        read = tomllib.loads("value = " + text)
    except (ValueError, RecursionError):
        bare = text.strip()
        return float(bare) if _NUMBER.fullmatch(bare) else bare
    return read["value"] if len(read) == 1 else text.strip()


def _nearest(word: str, choices: Sequence[str]) -> str | None:
    """The right word that was meant, perhaps by the last part of its name."""
    near = get_close_matches(word[:ECHOED].lower(), choices, n=1, cutoff=0.5)
    leaves = [choice for choice in choices if choice.split(".")[-1] == word]
    return next(iter(leaves or near), None)


def near(word: str, choices: Sequence[str]) -> str:
    """The hint of a message: the nearest right word, or nothing."""
    best = _nearest(word, choices)
    return f'; did you mean "{best}"?' if best else ""


def _name(path: KeyPath) -> str:
    return clipped(".".join(str(part) for part in path))


def _message(fault: Problem, origins: _Origins) -> str:
    path, wrong = fault
    name = _name(path)
    return f"{origins.of(path)}: {name}: {wrong}" if name else f"{origins.of(path)}: {wrong}"


def _validated(data: dict[str, Any], own_particles: bool) -> tuple[dict[str, Any], list[Problem]]:
    """The parts of the Scene that could be read, and every fault."""
    faults: list[Problem] = [
        ((name,), f"unknown table; expected one of {', '.join(TABLES)}{near(name, _table_names())}")
        for name in data
        if name not in TABLES and name != "title"
    ]
    title = data.get("title", "")
    if not isinstance(title, str):
        faults.append((("title",), f"{shown(title)} is not a text; expected one in quotes"))
    # A mistyped table is one fault: the one that was meant is neither missing nor absent.
    meant = {_nearest(name, _table_names()) or "": None for name in data if name not in TABLES}
    required = [name for name in REQUIRED if not own_particles or name != "initial"]
    missing = [name for name in required if name not in data and name not in meant]
    faults += [((), f"missing table [{name}]; expected one") for name in missing]
    units, unit_faults = _units(data)
    faults += unit_faults
    found: dict[str, Any] = {}
    filled = _filled(data, own_particles)
    for name in TABLES:
        if name in data and name != "units":
            found[name], table_faults = _table(name, filled[name], data[name], units)
            faults += table_faults
            if table_faults:
                del found[name]
    faults += [_as_written(fault, data) for fault in broken_rules(Draft({**meant, **data}, found))]
    others = {name: found.pop(name) for name in list(found) if name not in Scene.model_fields}
    return {"title": title, "units": units, "others": others, **found}, faults


def _table_names() -> list[str]:
    return [*TABLES, "gas.eos", "gas.viscosity", "gas.conductivity"]


def _units(data: dict[str, Any]) -> tuple[Units, list[Problem]]:
    """The units, or usable ones beside the faults that say why they are not the scene's."""
    space = data.get("space")
    dimensions = 1 if isinstance(space, dict) and space.get("dimensions") == 1 else 2
    table, faults = _table("units", data.get("units", {}), data.get("units", {}), Units())
    if table is None:
        given = data.get("units")
        code = isinstance(given, dict) and given.get("system") == "code"
        return Units("code" if code else "physical", dimensions), faults
    written = {name: getattr(table, name) for name in ("length", "mass") if name in table.model_fields_set}
    for name, text in written.items():
        try:
            Units(**{f"{name}_text": text})
        except UnitError as error:
            faults.append((("units", name), str(error)))
        if table.system == "code":
            faults.append((("units", name), 'means nothing in a scene with system = "code"; expected none'))
    if faults:
        return Units(table.system, dimensions), faults
    return Units(table.system, dimensions, table.length, table.mass), faults


def _filled(data: dict[str, Any], own_particles: bool) -> dict[str, Any]:
    """A copy with the defaults that depend on other tables, or on the particles that the caller has."""
    filled = deepcopy(data)
    dimensions = 1 if _get(data, "space", "dimensions") == 1 else 2
    gas = filled.get("gas")
    if isinstance(gas, dict):
        # An eta alone is the cubic's.
        kernel = KERNEL_OF.get(str(_get(data, "initial", "kind")))
        if kernel is not None and not {"eta", "smoothing_length"} & gas.keys():
            gas.setdefault("kernel", kernel)
        smoothing = SMOOTHING.get(str(gas.get("kernel")), SMOOTHING["cubic"])
        gas.setdefault("eta", smoothing.eta[dimensions - 1])
    drag = filled.get("drag")
    if isinstance(drag, dict):
        if isinstance(drag.get("cell"), str):
            drag["cell_length"] = drag.pop("cell")
        if "cell_length" not in drag:
            drag.setdefault("cell", dimensions)
        adiabatic = _get(data, "gas", "eos", "kind") == "adiabatic"
        drag.setdefault("heating", adiabatic and drag.get("direction") != "one-way")
    if isinstance(filled.get("dust"), dict):
        filled["dust"] = [filled["dust"]]
    if own_particles:
        dust = filled.get("dust")
        for table in (gas, *(dust if isinstance(dust, list) else ())):
            if isinstance(table, dict):
                table.setdefault("particles", 1)
    return filled


def _get(data: Any, *path: str | int) -> Any:
    """The value at `path` of nested tables and lists; None where there is none."""
    for part in path:
        in_list = isinstance(data, list) and isinstance(part, int) and part < len(data)
        if not in_list and not (isinstance(data, dict) and part in data):
            return None
        data = data[part]
    return data


def _as_written(fault: Problem, data: dict[str, Any]) -> Problem:
    """The fault at the key that the scene wrote: [dust] is no list; a length may stand in drag.cell."""
    path, wrong = fault
    if len(path) > 1 and isinstance(path[-1], int) and not isinstance(_get(data, *path[:-1]), list):
        path = path[:-1]  # one number for every dimension
    if path[:1] == ("dust",) and len(path) > 1 and isinstance(data.get("dust"), dict):
        path = ("dust", *path[2:])
    if path == ("drag", "cell_length") and _get(data, *path) is None:
        path = ("drag", "cell")
    return path, wrong


@cache
def _adapter(name: str) -> TypeAdapter:
    return TypeAdapter(TABLES[name])


def _table(name: str, filled: Any, raw: Any, units: Units) -> tuple[Any, list[Problem]]:
    if not isinstance(raw, dict) and not (name == "dust" and isinstance(raw, list)):
        return None, [((name,), f"{shown(raw)} is not a table; expected [{name}] with its keys")]
    if raw == []:
        return None, [((name,), f"an empty list; expected [{name}] or [[{name}]]")]
    try:
        return _adapter(name).validate_python(filled, context={"units": units}), []
    except ValidationError as error:
        details = _without_echoes(error.errors(include_url=False))
        return None, [_as_written(_explained(name, detail, filled, units), {name: raw}) for detail in details]


def _without_echoes(details: list[Any]) -> list[Any]:
    """A mistyped key is one fault: without "missing" for the key that was meant."""
    missing = {detail["loc"] for detail in details if detail["type"] == "missing"}
    for detail in details:
        if detail["type"] == "extra_forbidden":
            beside = [str(loc[-1]) for loc in missing if loc[:-1] == detail["loc"][:-1]]
            missing.discard((*detail["loc"][:-1], _nearest(str(detail["loc"][-1]), beside) or ""))
    return [detail for detail in details if detail["type"] != "missing" or detail["loc"] in missing]


def _explained(table: str, detail: Any, filled: Any, units: Units) -> Problem:
    """One of pydantic's errors in our words, at the path of the key without the tags of unions."""
    path: KeyPath = (table,)
    models = models_in(TABLES[table])
    owner = None
    for part in detail["loc"]:
        tagged = [model for model in models if len(models) > 1 and _tag(model) == part]
        if tagged:
            models = tagged
            continue
        path += (part,)
        if isinstance(part, str) and models:
            owner = models[0]
            field = owner.model_fields.get(part)
            models = models_in(field.annotation) if field else []
    field = owner.model_fields.get(str(path[-1])) if owner else None
    # The last part of the path may be an index that only the vector made of one number has.
    value = _get({table: filled}, *path)
    value = _get({table: filled}, *path[:-1]) if value is None and isinstance(path[-1], int) else value
    return _worded(detail, path, owner, field, value, units)


def _tag(model: type[fields.Table]) -> str | None:
    return model.model_fields["kind"].default if "kind" in model.model_fields else None


def _worded(detail: Any, path: KeyPath, owner: Any, field: Any, value: Any, units: Units) -> Problem:
    kind, context = detail["type"], detail.get("ctx", {})
    if kind == "fault":
        return path, detail["msg"]
    if kind == "missing":
        measure = fields.measure_of(field) if field else None
        words = f"; expected {units.expected(measure.name)}" if measure and measure.name else ""
        if measure and units.system == "code":
            words = "; expected a plain number"
        meaning = f" ({field.description})" if field and field.description else ""
        return path, f"missing{meaning}{words}"
    if kind == "extra_forbidden":
        keys = list(owner.model_fields)
        hint = near(str(path[-1]), keys) or _near_elsewhere(str(path[-1]))
        return path, f"unknown key; expected one of {', '.join(keys)}{hint}"
    if kind in ("literal_error", "union_tag_invalid", "union_tag_not_found"):
        return _worded_choice(kind, context, path, value)
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
        return path, f"{shown(value)} is neither true nor false"
    if kind in ("model_type", "model_attributes_type"):
        return path, f"{shown(value)} is not a table; expected [{'.'.join(map(str, path))}] with its keys"
    return path, f"{shown(value)}: {detail['msg'][0].lower()}{detail['msg'][1:]}"


def _worded_choice(kind: str, context: dict[str, Any], path: KeyPath, value: Any) -> Problem:
    expected = context.get("expected") or context.get("expected_tags") or ""
    choices = [part.strip(" '") for part in expected.replace(" or ", ", ").split(",")]
    words = ", ".join(f'"{choice}"' if not choice.isdecimal() else choice for choice in choices)
    if kind.startswith("union"):
        if not isinstance(value, dict):
            return path, f"{shown(value)} is not a table; expected [{'.'.join(map(str, path))}] with its keys"
        path, value = (*path, "kind"), value.get("kind")
        if kind == "union_tag_not_found":
            union = models_in(
                TABLES["initial"] if path[0] == "initial" else TABLES[str(path[0])].model_fields["eos"].annotation
            )
            tags = [str(_tag(model)) for model in union]
            return path, "missing; expected one of " + ", ".join(f'"{tag}"' for tag in tags)
    return path, f"{shown(value)} is unknown; expected one of {words}{near(str(value), choices)}"


def _near_elsewhere(key: str) -> str:
    """The hint where a key of another table has this very name."""
    for table, annotation in TABLES.items():
        for model in models_in(annotation):
            for name, field in model.model_fields.items():
                if name == key:
                    return f'; did you mean "{table}.{key}"?'
                if any(key in inner.model_fields for inner in models_in(field.annotation)):
                    return f'; did you mean "{table}.{name}.{key}"?'
    return ""
