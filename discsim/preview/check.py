"""The text of `discsim check`: units, effects, derived numbers, forecast, accuracy and warnings of a scene."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from discsim.effects import effect_classes
from discsim.preview.accuracy import accuracy_rows
from discsim.preview.derived import derived_rows
from discsim.preview.forecast import forecast, memory_warnings, stored_slowness
from discsim.preview.warnings import warnings
from discsim.scene import Scene
from discsim.scene.fields import Table, measure_of
from discsim.scene.units import Units, clock

DOMINANT_FRACTION = 0.95  # if one effect limits at least this fraction of the steps, the text leaves the fraction out
# Row of a scene without estimates.
UNKNOWN_ACCURACY = ("no estimate", "measure the error with: discsim cost SCENE --error 1%")


def report(scene: Scene) -> str:
    """Return the text that `discsim check` prints for a scene."""
    tables = {
        "derived numbers": derived_rows(scene),
        "forecast": [*_forecast_rows(scene)],
        "accuracy, estimated": accuracy_rows(scene) or [UNKNOWN_ACCURACY],
    }
    width = max(34, *(len(name) for rows in tables.values() for name, _ in rows))  # 34: also for short names
    parts = [
        [scene.title or "(untitled)"],
        ["units", *(f"  {line}" for line in _unit_lines(scene.units))],
        ["effects", *(f"  {name:<18} {keys}" for name, keys in effect_lines(scene))],
        *([title, *(f"  {name:<{width}} {value}" for name, value in rows)] for title, rows in tables.items()),
        ["warnings", *(f"  {line}" for line in [*memory_warnings(scene), *warnings(scene)] or ["none"])],
    ]
    return "\n\n".join("\n".join(part) for part in parts)


def _forecast_rows(scene: Scene) -> Iterator[tuple[str, str]]:
    """Yield a row (name, value as text) for each number of the forecast of a run."""
    expected = forecast(scene)
    if expected is None:
        yield "no forecast", "no effect limits the time step"
        return
    steps = expected.steps
    yield "number of steps", f"{float(f'{steps.number:.2g}'):.0f}"
    yield (
        "time step set by",
        f"{steps.limiter} {steps.where}".rstrip()
        + (f", in {steps.share:.0%} of the steps" if steps.share < DOMINANT_FRACTION else ""),
    )
    if scene.space.dimensions == 1:
        yield "CPU time of the run", "seconds (one dimension)"
        return
    yield "CPU time of a step", f"{expected.step_seconds:.2g} s"
    if expected.relaxation > 0.0:
        yield "CPU time before t = 0", clock(expected.relaxation)
    yield "CPU time of the run", clock(expected.seconds)
    count = len(stored_slowness())
    runs = f"the last {count} long runs" if count > 1 else "the last long run"
    yield (
        "CPU times estimated from",
        f"{runs} on this machine" if count else "stored values, as no long run was made here yet",
    )
    yield "memory", f"{float(f'{expected.memory / 2**20:.2g}'):.0f} MiB"


def _unit_lines(units: Units) -> Iterator[str]:
    """Yield a line for each unit of the scene, with its value."""
    if units.system == "code":
        yield "code units, G = 1"
        return
    for name in ("length", "mass", "time", "velocity", "density"):
        yield f"{name:<10} {units.show(1.0, name)}"


def effect_lines(scene: Scene) -> Iterator[tuple[str, str]]:
    """Yield a row (name of the effect, its keys with their values as text) for each effect of a scene.

    An effect with several tables, such as [[dust]], has a row for each table.
    """
    classes = effect_classes(scene)
    for name in scene.effects:
        first, _, second = name.partition(".")
        skip = classes[name].unused(scene) if name in classes else ()
        skip += tuple(other.removeprefix(f"{name}.") for other in scene.effects)  # effects with their own lines
        table = getattr(scene.table(first), second) if second else scene.table(first)
        for one in table if isinstance(table, tuple) else (table,):
            yield name, _key_texts(scene.units, one, skip)


def _key_texts(units: Units, table: Table, skip: tuple[str, ...] = ()) -> str:
    """Return the keys of `table` with their values, as text.

    A table inside this table is named by its kind, or by its key if it has no kind. skip: keys to leave out.
    """
    texts = []
    for key, field in type(table).model_fields.items():
        value = getattr(table, key)
        if isinstance(value, Table) and key not in skip:
            texts.append(f"{getattr(value, 'kind', key)} ({_key_texts(units, value)})")
        elif value is not None and key != "kind" and key not in skip:
            texts.append(f"{key} {_value_text(units, value, measure_of(field), getattr(table, 'gamma', 1.0))}")
    return ", ".join(texts)


def _value_text(units: Units, value: Any, measure: Any, gamma: float) -> str:
    """Return the value of a key as text, with its unit if the key has a dimension.

    measure: dimension of the key (`scene.fields.Measure`), or None. gamma: exponent that some units depend on.
    """
    if type(value) is tuple:
        return "[" + ", ".join(_value_text(units, entry, measure, gamma) for entry in value) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return units.show(value, measure.name, gamma) if measure and measure.name else f"{value:g}"
    return str(value)
