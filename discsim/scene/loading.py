"""Loading of scenes: from TOML text or a dict to a validated, frozen `Scene` in code units.

All faults that validation finds are reported together; each message has the file, line and key. An effect runs if the
scene has its table.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_origin

from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError

from discsim.formulas.smoothing import QUIET, SMOOTHING
from discsim.parts import EFFECTS, EOS, MODELS, STARTS, import_object
from discsim.printable import printable
from discsim.scene import tables, tomltext
from discsim.scene.fields import InputFile, shown
from discsim.scene.messages import (
    Origins,
    SceneError,
    SecondaryFault,
    drop_secondary_errors,
    message,
    nearest,
    nearest_hint,
    problem_from_error,
    value_at,
)
from discsim.scene.orbits import OrbitalPeriods, show_time
from discsim.scene.overrides import apply_options
from discsim.scene.populations import populations_of
from discsim.scene.reading import parse_scene, read_scene_text, refuse_deep, to_toml_types
from discsim.scene.rules import Draft, Problem, broken_rules
from discsim.scene.summary import Rows, Summarised
from discsim.scene.tables import COURANT, COURANT_OF_DISCS, REQUIRED, TABLES, optional_tables
from discsim.scene.units import UnitError, Units

if TYPE_CHECKING:
    from discsim.effects.models import GasModel
    from discsim.scene import keys
else:  # an effect and its keys are imported only if the scene has its table

    class keys:  # noqa: N801 - stands for the module
        """Types of the tables at run time, when pydantic does not check them again."""

        Gas = Background = Dust = Drag = SelfGravity = Star = Companion = RadiationPressure = External = Any
        Cooling = Damping = AlphaViscosity = Any


__all__ = ["Scene", "SceneError", "load_scene", "nearest_hint"]


class Scene(Summarised, BaseModel):
    """A validated scene: tables of keys in code units, from `load_scene`.

    Attributes
    ----------
    title : str
        Title, printable; "" if the scene gives none.
    units : Units
        Code units.
    run, space : Table
        The tables [run] and [space].
    initial : Table or None
        The table [initial]; None if the caller sets the particles.
    gas, background, drag, self_gravity, star, radiation_pressure : Table or None
        Tables of effects; None if the scene has no such table.
    external, cooling, damping, alpha_viscosity : Table or None
        More tables of effects.
    dust, companion : tuple of Table, or None
        Tables that may occur several times: populations of dust, companions.
    others : dict
        Tables of all other effects by name, among them effects of other packages.
    text : str
        The scene as TOML, with overrides applied.
    path : Path or None
        Scene file; None for a dict.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    title: str
    units: Units
    run: tables.Run
    space: tables.Space
    initial: Any = None
    gas: keys.Gas | None = None
    background: keys.Background | None = None
    dust: tuple[keys.Dust, ...] | None = None
    drag: keys.Drag | None = None
    self_gravity: keys.SelfGravity | None = None
    star: keys.Star | None = None
    companion: tuple[keys.Companion, ...] | None = None
    radiation_pressure: keys.RadiationPressure | None = None
    external: keys.External | None = None
    cooling: keys.Cooling | None = None
    damping: keys.Damping | None = None
    alpha_viscosity: keys.AlphaViscosity | None = None
    others: dict[str, Any] = {}  # effects without an attribute, and effects of other packages
    text: str
    path: Path | None = None

    @property
    def centred(self) -> bool:
        """True if the origin is the middle of space: with an open boundary.

        In a periodic box the origin is the lower left corner.
        """
        return self.space.boundary == "open"

    @property
    def model(self) -> GasModel:
        """The gas model: the first of `discsim.parts.MODELS` that applies to the scene."""
        return next(model for model in map(import_object, MODELS) if model.applies_to(self))

    @property
    def effects(self) -> tuple[str, ...]:
        """The names of the effects that run, in the order of a step.

        An optional table of an effect follows the effect under its full name, for example "gas.viscosity".
        """
        names: list[str] = []
        for name in self.named:
            table = self.table(name)
            parts = [] if isinstance(table, tuple) else optional_tables(type(table))
            names += [name, *(f"{name}.{part}" for part in parts if getattr(table, part) is not None)]
        return tuple(names)

    @property
    def named(self) -> tuple[str, ...]:
        """The names of the effects whose tables the scene has, in the order of a step."""
        return tuple(name for name in EFFECTS if self.table(name) is not None)

    @property
    def dust_phrases(self) -> tuple[str, ...]:
        """What texts call each dust population, like 'dust "pebbles"' or "dust 1 mm"; "dust" if there is one."""
        found = populations_of(tomllib.loads(self.text))
        return tuple(each.phrase for each in found) if len(found) > 1 else ("dust",) * len(found)

    def summary(self) -> tuple[str, Rows]:
        """Return the title, and the rows (name, value) for display."""
        return self.title or "A scene", self.facts

    @property
    def facts(self) -> list[tuple[str, str]]:
        """The rows (name, value) of the summary: end time, space, start, particle numbers and effects."""
        size = " x ".join(self.units.show(side, "length") for side in self.space.size)
        rows = [("until", self.show_time(self.run.until)), ("space", f"{size}, {self.space.boundary}")]
        rows += [("starts as", self.initial.kind)] if self.initial is not None else []
        rows += [("gas", f"{self.gas.particles:,}")] if self.gas is not None else []
        rows += [("dust", ", ".join(f"{each.particles:,}" for each in self.dust))] if self.dust is not None else []
        return [*rows, ("effects", ", ".join(self.effects))]

    def show_time(self, t: float) -> str:
        """Return a time of the run as text.

        Parameters
        ----------
        t : float
            Time in code units.

        Returns
        -------
        str
            The time, like "474.3 yr", or "474.3 yr (40 orbits at 5.2 au)" if run.until or run.every is a number of
            orbits, or if the scene has a single bound companion.
        """
        return show_time(t, self.units, self.text)

    def table(self, name: str) -> Any:
        """Return the table of an effect.

        Parameters
        ----------
        name : str
            Name of the effect, for example "drag".

        Returns
        -------
        Table, tuple of Table, or None
            The table, or all tables of an effect that may occur several times; None if the scene has none.
        """
        return getattr(self, name) if name in type(self).model_fields else self.others.get(name)


def load_scene(
    source: str | Path | dict[str, Any],
    overrides: Sequence[str] = (),
    without: Sequence[str] = (),
    *,
    own_particles: bool = False,
    folder: Path | None = None,
) -> Scene:
    """Read and validate a scene.

    Parameters
    ----------
    source : str, Path or dict
        Scene file (TOML), or a dict with the same tables. Values of a dict may be astropy Quantities.
    overrides : sequence of str, optional
        Changes "table.key=value", applied before validation.
    without : sequence of str, optional
        Names of the tables to remove.
    own_particles : bool, optional
        If True, the caller sets the particles: [initial] is optional, and so are numbers of particles (default 1).
    folder : Path, optional
        Directory for relative paths in the scene; by default the folder of the scene file, or the working directory for
        a dict.

    Returns
    -------
    Scene
        The validated scene in code units.

    Raises
    ------
    SceneError
        If the scene has faults; `problems` lists all of them.
    """
    if isinstance(source, dict):
        refuse_deep(source, "scene")
        path, text, data = None, "", to_toml_types(source)
    else:
        path = Path(source)
        text = read_scene_text(path)
        data = parse_scene(path, text)
        refuse_deep(data, f"{path}:1")
    origins = Origins(path, text)
    values, removed, problems = apply_options(data, overrides, without, origins)
    found, faults = _validate_tables(data, own_particles, folder or (path.parent if path else Path()))
    problems += [message(fault, origins) for fault in faults]
    if problems:
        raise SceneError(list(dict.fromkeys(problems)))
    named = [([table, key], str(file.path)) for table, key, file in files_of(found)]
    for where, place in named:  # absolute paths, so that the text is valid in any directory
        tomltext.set_value(data, where, place)
    text = tomltext.edit(text, data, [*values, *named], removed) if path else tomltext.dump(data)
    try:
        text.encode()
    except UnicodeEncodeError as error:  # from a command line or dict in another encoding
        wrong = f'"{printable(text[max(error.start - 20, 0) : error.end])}" is not valid Unicode'
        raise SceneError([f"{path or 'scene'}: {wrong}; expected UTF-8 text"]) from None
    scene = Scene(**found, text=text, path=path)
    start = None if scene.initial is None else STARTS[scene.initial.kind]
    if start is not None and start.problems is not None:
        problems = [message(_with_path_in_scene(fault, data), origins) for fault in start.problems(scene)]
        if problems:
            raise SceneError(problems)
    return scene


def files_of(tables: Mapping[str, Any]) -> Iterator[tuple[str, str, InputFile]]:
    """Yield (table name, key, file) for every input file in `tables`."""
    for name, table in tables.items():
        for key, value in table if isinstance(table, BaseModel) else ():
            if isinstance(value, InputFile):
                yield name, key, value


def _validate_tables(data: dict[str, Any], own_particles: bool, folder: Path) -> tuple[dict[str, Any], list[Problem]]:
    """Validate the tables `data`. Return the attributes of a Scene that are valid, by name, and all problems."""
    unknown = [name for name in data if name not in TABLES and name != "title"]
    faults: list[Problem] = [
        ((name,), f"unknown table; expected one of {', '.join(TABLES)}{nearest_hint(name, _table_names())}")
        for name in unknown
    ]
    title = data.get("title", "")
    if not isinstance(title, str):
        faults.append((("title",), f"{shown(title)} is not text; expected a title in quotes"))
    # A mistyped table name is one fault: do not report the intended table as missing as well.
    meant = {nearest(name, _table_names()) or "": None for name in unknown}
    required = [name for name in REQUIRED if not own_particles or name != "initial"]
    missing = [name for name in required if name not in data and name not in meant]
    faults += [((), f"missing table [{name}]; add it") for name in missing]
    units, unit_faults = _read_units(data)
    faults += unit_faults
    found: dict[str, Any] = {}
    filled = _with_defaults(data, own_particles)
    periods = OrbitalPeriods({**meant, **data}, units)
    for name in TABLES:
        if name in data and name != "units":
            found[name], table_faults = _validate_table(name, filled[name], data[name], units, folder, periods)
            faults += table_faults
            if table_faults:
                del found[name]
            elif name == "initial":
                _set_particle_counts(filled, getattr(found[name], "counts", {}))
    faults += [_with_path_in_scene(fault, data) for fault in broken_rules(Draft({**meant, **data}, found))]
    faults = [each for each in faults if not isinstance(each[1], SecondaryFault)] or faults
    others = {name: found.pop(name) for name in list(found) if name not in Scene.model_fields}
    return {"title": printable(title), "units": units, "others": others, **found}, faults


def _table_names() -> list[str]:
    """Return the names of tables that a mistyped table name may mean."""
    return [*TABLES, "gas.eos", "gas.viscosity", "gas.conductivity"]


def _read_units(data: dict[str, Any]) -> tuple[Units, list[Problem]]:
    """Return the units of a scene, and their problems. Defaults replace faulty units, to validate other tables."""
    dimensions = _given_dimensions(data)
    table, faults = _validate_table("units", data.get("units", {}), data.get("units", {}), Units())
    if table is None:
        code = value_at(data, "units", "system") == "code"
        return Units("code" if code else "physical", dimensions), faults
    written = {name: getattr(table, name) for name in ("length", "mass") if name in table.model_fields_set}
    for name, text in written.items():
        try:
            Units(**{f"{name}_text": text})
        except UnitError as error:
            faults.append((("units", name), str(error)))
        if table.system == "code":
            faults.append((("units", name), 'not used with units.system = "code"; remove this key'))
    if faults:
        return Units(table.system, dimensions), faults
    return Units(table.system, dimensions, table.length, table.mass), faults


def _given_dimensions(data: dict[str, Any]) -> int:
    """Return the dimensions of space that the tables `data` give, before validation; by default 2."""
    return 1 if value_at(data, "space", "dimensions") == 1 else 2


def _with_defaults(data: dict[str, Any], own_particles: bool) -> dict[str, Any]:
    """Return a copy of the tables `data` with the defaults that depend on other tables or on `own_particles`."""
    filled = deepcopy(data)
    run = filled.get("run")
    if isinstance(run, dict):
        run.setdefault("courant", COURANT_OF_DISCS if "star" in data else COURANT)
    gas = filled.get("gas")
    if isinstance(gas, dict):
        # An eta without a kernel refers to the cubic kernel.
        start = STARTS.get(str(value_at(data, "initial", "kind")))
        kernel = QUIET if gas.get("quiet") else start.kernel if start is not None else None
        if kernel is not None and not {"eta", "smoothing_length"} & gas.keys():
            gas.setdefault("kernel", kernel)
        smoothing = SMOOTHING.get(str(gas.get("kernel")), SMOOTHING["cubic"])
        gas.setdefault("eta", smoothing.eta[_given_dimensions(data) - 1])
    drag = filled.get("drag")
    if isinstance(drag, dict):
        if isinstance(drag.get("cell"), str):
            drag["cell_length"] = drag.pop("cell")
        kind = value_at(data, "gas", "eos", "kind")
        hot = isinstance(kind, str) and kind in EOS and EOS[kind].holds_heat
        drag.setdefault("heating", hot and drag.get("direction") != "one-way")
    for name, table in filled.items():
        if isinstance(table, dict) and _may_repeat(name):
            filled[name] = [table]
    if own_particles:
        dust = filled.get("dust")
        for table in (gas, *(dust if isinstance(dust, list) else ())):
            if isinstance(table, dict):
                table.setdefault("particles", 1)
    return filled


def _set_particle_counts(filled: dict[str, Any], counts: Mapping[str, Sequence[int]]) -> None:
    """Set, in the tables `filled` in place, the particle numbers that the start defines; not those of polar cells.

    counts: by table name, one particle number for each table of this name.
    """
    for name, numbers in counts.items():
        tables = filled.get(name)
        for table, number in zip(tables if isinstance(tables, list) else [tables], numbers, strict=False):
            if isinstance(table, dict) and table.get("method") != "grid":
                table["particles"] = number


def _with_path_in_scene(fault: Problem, data: dict[str, Any]) -> Problem:
    """Return a problem with the path that the key has in the scene itself, the tables `data`.

    Validation turns a single [dust] into a list, a scalar into a vector, and a length in drag.cell into
    drag.cell_length, so that the path of `fault` may differ.
    """
    path, wrong = fault
    if len(path) > 1 and isinstance(path[-1], int) and not isinstance(value_at(data, *path[:-1]), list):
        path = path[:-1]  # one number for every dimension
    if len(path) > 1 and _may_repeat(path[0]) and isinstance(data.get(str(path[0])), dict):
        path = (path[0], *path[2:])
    if path == ("drag", "cell_length") and value_at(data, *path) is None:
        path = ("drag", "cell")
    return path, wrong


def _may_repeat(name: str | int) -> bool:
    """Return whether the table `name` may occur several times. Only the effect of this table is imported."""
    return name in EFFECTS and get_origin(TABLES[str(name)]) is tuple


@cache
def _table_validator(name: str) -> TypeAdapter[Any]:
    """Return pydantic's validator of the table `name`."""
    return TypeAdapter(TABLES[name])


def _validate_table(
    name: str, filled: Any, raw: Any, units: Units, folder: Path = Path(), periods: OrbitalPeriods | None = None
) -> tuple[Any, list[Problem]]:
    """Validate the table `name`. Return the table, or None if it has faults, and its problems.

    filled: the table with defaults. raw: the table as the scene writes it. folder: directory for relative paths.
    periods: orbital periods of the scene, for tables that have times.
    """
    if not isinstance(raw, dict) and not (isinstance(raw, list) and _may_repeat(name)):
        return None, [((name,), f"{shown(raw)} is not a table; expected the table [{name}]")]
    if raw == []:
        return None, [((name,), f"the list is empty; expected [{name}] or [[{name}]]")]
    try:
        context = {"units": units, "folder": folder, "orbits": periods}
        return _table_validator(name).validate_python(filled, context=context), []
    except ValidationError as error:
        details = drop_secondary_errors(error.errors(include_url=False))
        return None, [
            _with_path_in_scene(problem_from_error(name, detail, filled, units), {name: raw}) for detail in details
        ]
