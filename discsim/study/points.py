"""Data types of parameter studies: keys that vary, and combinations of their values with results of runs."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from statistics import median
from typing import Any

import numpy as np

from discsim.printable import UserError, printable

ALL = "all"  # label of the line of all points, if no other setting varies
Settings = dict[str, str]  # keys of a scene to set, with their values as text


class StudyError(UserError):
    """A study that cannot be made or continued; the message has the reason."""


@dataclass(frozen=True)
class Varied:
    """Keys that vary together, one or more, and their values.

    An entry of `values` is one value for all keys, or one value per key separated by colons, as in "100:0.06".
    """

    keys: tuple[str, ...]
    values: tuple[str, ...]

    @classmethod
    def from_text(cls, text: str) -> Varied:
        """Parse "table.key=a,b", "table.key,table.key=a,b" or "table.key,table.key=a:c,b:d".

        Raises StudyError.
        """
        names, equals, written = text.partition("=")
        keys, values = _split_at_commas(names), _split_at_commas(written)
        if not equals or not all(keys) or not all(values) or not values:
            wanted = "expected table.key=a,b,c, like drag.scheme=mk,tsc"
            raise StudyError(f"--vary {text}: not a key with values; {wanted}")
        for value in values:
            if values.count(value) > 1:
                raise StudyError(f"--vary {text}: {value} occurs twice; give each value once")
            if value.count(":") not in (0, len(keys) - 1):
                some = f"{len(keys)} values, one per key, or one value for all keys" if len(keys) > 1 else "one value"
                raise StudyError(f"--vary {text}: {value} has a wrong number of values; give {some}")
        return cls(tuple(keys), tuple(values))

    @property
    def name(self) -> str:
        """The keys as text, like "gas.particles,dust.particles"."""
        return ",".join(self.keys)

    def settings(self, value: str) -> Settings:
        """Return the settings for one entry of `values`."""
        parts = value.split(":") if ":" in value else [value] * len(self.keys)
        return {key: part.strip() for key, part in zip(self.keys, parts, strict=True)}

    @property
    def numbers(self) -> tuple[float, ...] | None:
        """The values of the first key as numbers without their units; None if one of them is not a number."""
        found = [number_in(value.partition(":")[0]) for value in self.values]
        return tuple(number for number in found if number is not None) if None not in found else None


def _split_at_commas(text: str) -> list[str]:
    """Split a text at commas that are not inside quotes or brackets."""
    parts, depth, quote = [""], 0, ""
    for letter in text:
        if letter in "\"'":
            quote = "" if quote == letter else quote or letter
        depth += (letter in "[{") - (letter in "]}") if not quote else 0
        if letter == "," and depth == 0 and not quote:
            parts.append("")
        else:
            parts[-1] += letter
    return [part.strip() for part in parts]


def number_in(text: str) -> float | None:
    """Return the number in a value such as "10 au"; None if the value does not start with a number."""
    words = text.strip("\"'").split()
    try:
        value = float(words[0].replace("_", "")) if words else np.nan
    except ValueError:
        return None
    return value if np.isfinite(value) else None


@dataclass
class Point:
    """A combination of values of the varied keys, with the results of its runs, and the errors by species."""

    settings: Settings
    runs: list[dict[str, Any]] = field(default_factory=list)
    errors: dict[str, float] = field(default_factory=dict)

    @property
    def done(self) -> bool:
        """True if the first run of the combination has reached its end."""
        return bool(self.runs) and "stopped" not in self.runs[0]

    @property
    def cpu(self) -> float:
        """Median of the CPU seconds of the runs."""
        return median(run["cpu"] for run in self.runs)

    @property
    def error(self) -> float | None:
        """The larger of the errors of gas and dust; None for the reference run, and for a run without an error."""
        return max(self.errors.values()) if self.errors else None


def combinations(varied: Sequence[Varied]) -> list[Point]:
    """Return a point for every combination of values. Raises StudyError if a key occurs twice."""
    names = keys_of(varied)
    for name in names:
        if names.count(name) > 1:
            raise StudyError(f"--vary {name}: the key occurs twice; give each key once")
    return [
        Point({key: part for settings in together for key, part in settings.items()})
        for together in itertools.product(*([each.settings(value) for value in each.values] for each in varied))
    ]


def keys_of(varied: Sequence[Varied]) -> list[str]:
    """Return all varied keys."""
    return [key for each in varied for key in each.keys]


def pareto_front(found: Iterable[Any]) -> list[Any]:
    """Return the Pareto front, the cheapest first: no other entry of `found` is both cheaper and at least as accurate.

    found: objects with the attributes `cpu` and `error`, such as `Point` and `Trial`.
    """
    front: list[Any] = []
    for each in sorted(found, key=lambda each: each.cpu):
        if not front or each.error < front[-1].error:
            front.append(each)
    return front


def axis_of(varied: Sequence[Varied]) -> Varied | None:
    """Return the varied keys for the x axis of figures and the lines of tables: numeric keys with the most values.

    None if no key has several numeric values.
    """
    numeric = [each for each in varied if each.numbers and len(each.values) > 1]
    return max(numeric, key=lambda each: len(each.values), default=None)


def points_by_line(points: Iterable[Point], axis: Varied | None) -> dict[str, list[Point]]:
    """Group points into lines of a figure: lists of points that differ only in the keys of `axis`.

    Returns the lists by a label that has all other settings. The order of the points is kept.
    """
    along = set(axis.keys) if axis else set()
    out: dict[str, list[Point]] = {}
    for point in points:
        shared = {key: value for key, value in point.settings.items() if key not in along}
        out.setdefault(label_of(shared) or ALL, []).append(point)
    return out


def label_of(settings: Settings, whole: bool = False) -> str:
    """Return settings as printable text, like "courant = 0.2, eta = 1.2", or with whole keys, "run.courant = 0.2"."""
    pairs = zip(settings if whole else short_names(settings), settings.values(), strict=True)
    return printable(", ".join(f"{name} = {value}" for name, value in pairs))


def short_names(keys: Iterable[str]) -> list[str]:
    """Return a short name of each key: its last part, or the whole key if another key has the same last part."""
    ends = [key.rpartition(".")[2] for key in keys]
    return [end if ends.count(end) == 1 else key for key, end in zip(keys, ends, strict=True)]


def percent(value: float) -> str:
    """Return a fraction as text in per cent."""
    return f"{100.0 * value:.2g}%"
