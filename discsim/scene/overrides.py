"""Command-line changes to the tables of a scene: `--set table.key=value` and `--without table`."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Sequence
from typing import Any

from discsim.parts import EFFECTS
from discsim.scene import tomltext
from discsim.scene.messages import Origins, nearest_hint
from discsim.scene.reading import MAX_DEPTH
from discsim.scene.tables import removable_tables
from discsim.scene.units import clipped

_NUMBER = re.compile(r"[+-]?(?:\d[\d_]*\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")


class Option(str):
    """A change "table.key=value" from an option with its own name, such as --until; `typed` is the text of the option.

    with_key: the option is typed with the key, as in --vary.

    >>> Option("--until", "run.until", "5"), Option("--until", "run.until", "5").typed
    ('run.until=5', '--until 5')
    >>> Option("--vary", "gas.eta", "5", with_key=True).typed
    '--vary gas.eta=5'
    """

    typed: str

    def __new__(cls, name: str, key: str, value: object, with_key: bool = False) -> Option:
        self = super().__new__(cls, f"{key}={value}")
        self.typed = f"{name} {clipped(self if with_key else str(value))}"
        return self


def apply_options(
    data: dict[str, Any], overrides: Sequence[str], without: Sequence[str], origins: Origins
) -> tuple[list[tuple[list[str], Any]], list[list[str]], list[str]]:
    """Apply the options --set (`overrides`) and --without to the tables `data`, in place.

    Return the new values, each as (path, value); the paths of the removed tables; and the messages about faulty
    options. In `origins`, the option becomes the source of each key that it sets.
    """
    values: list[tuple[list[str], Any]] = []
    problems: list[str] = []
    for assignment in overrides:
        name, equals, written = assignment.partition("=")
        typed = assignment.typed if isinstance(assignment, Option) else f"--set {clipped(assignment)}"
        path = [part.strip() for part in name.split(".")]
        if not equals or not all(path):
            problems.append(f'{typed}: not an assignment; expected table.key=value, like run.until="10 yr"')
            continue
        if len(path) > MAX_DEPTH:
            problems.append(f"{typed}: nested too deeply; expected table.key=value")
            continue
        value = _override_value(written)
        try:
            tomltext.set_value(data, path, value)
        except KeyError as error:
            problems.append(f"{typed}: {error.args[0]}")
            continue
        values.append((path, value))
        key = tuple(int(part) if part.isdecimal() else part for part in path)
        origins.set_option(key, typed)
    removed = []
    for name in without:
        if name not in EFFECTS and name not in (known := removable_tables()):
            expected = f"expected one of {', '.join(known)}{nearest_hint(name, known)}"
            problems.append(f"--without {clipped(name)}: unknown table; {expected}")
            continue
        removed.append(name.split("."))
        tomltext.remove_table(data, removed[-1])
    return values, removed, problems


def _override_value(text: str) -> Any:
    """Return the value that `text` means as TOML, else as a number, else as a text.

    Numbers that TOML does not allow (.09, 5.) are accepted. A text needs no quotes, because the shell removes them.
    """
    try:
        read = tomllib.loads("value = " + text)
    except (ValueError, RecursionError):
        bare = text.strip()
        return float(bare) if _NUMBER.fullmatch(bare) else bare
    return read["value"] if len(read) == 1 else text.strip()
