"""Parts that analysis scripts share: tables with units on the terminal, CSV files, messages, and options with units.

Lengths on the command line are texts like "20 au"; numbers without a unit are in the unit of tables, au, or in code
units for a scene in code units. Times are numbers of orbits, "3 orbits" or 3, of an orbit that the script names; or
texts like "500 yr" and "3 orbits at 20 au", as in scenes.
"""

from __future__ import annotations

import argparse
import csv
import math
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from discsim.output.files import replace_atomically
from discsim.printable import UserError, printable, printable_lines
from discsim.scene.orbits import time_in_code_units
from discsim.scene.units import UnitError, clipped, split_number
from discsim.userfiles import system_message

if TYPE_CHECKING:
    from discsim.scene import Scene
    from discsim.scene.units import Units


class OptionError(UserError):
    """An option of a script that does not suit the run; the message has the reason."""


CODE_UNITS = "code units"  # unit of quantities with a dimension, in the code system
MAX_WIDTH = 200  # characters of a line; narrower tables do not fill it
NO_VALUE = "-"


def display_unit(units: Units, dimension: str, unit: str) -> tuple[float, str]:
    """Return the factor from code units of `dimension` to `unit`, and the unit; (1, "code units") in code units."""
    if units.system == "code":
        return 1.0, CODE_UNITS
    return float(units.quantity(1.0, dimension).to_value(unit)), unit


def with_unit(name: str, unit: str) -> str:
    """Return the head of a column of a file, like "radius [au]"; the name alone for code units and plain numbers."""
    return name if unit in ("", CODE_UNITS) else f"{name} [{unit}]"


def print_table(title: str, head: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Print a title and a table, with one line per row. None is an empty entry, and "-" stands for NaN."""
    from rich.box import SIMPLE
    from rich.console import Console
    from rich.table import Table

    table, lines = Table(box=SIMPLE), list(rows)
    for name, entries in zip(head, zip(*lines, strict=True) if lines else [()] * len(head), strict=True):
        is_text = any(isinstance(entry, str) for entry in entries)
        table.add_column(printable(name), justify="left" if is_text else "right", no_wrap=True)
    for line in lines:
        table.add_row(*map(_entry, line))
    console = Console(width=MAX_WIDTH, markup=False, highlight=False, emoji=False, soft_wrap=True)
    console.print(printable_lines(title))
    console.print(table)


def _entry(value: object) -> str:
    """Return the text of an entry of a table; floats have four significant digits."""
    if value is None:
        return ""
    if isinstance(value, float):
        return NO_VALUE if math.isnan(value) else f"{value:.4g}"
    return printable(value)


def write_table(path: Path, head: Sequence[str], rows: Iterable[Iterable[object]]) -> None:
    """Write a CSV file, and its directory if needed; the file appears when it is complete. Raises OSError."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with replace_atomically(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(head)
        writer.writerows(rows)


def print_fault(script: str, fault: UserError | OSError) -> int:
    """Print one message about a fault on standard error, and return the exit status: 2 for input, 1 for files."""
    message = str(fault) if isinstance(fault, UserError) else system_message(fault, "read or written", "a file")
    print(printable_lines(f"{script}: {message}"), file=sys.stderr)
    return 2 if isinstance(fault, UserError) else 1


def script_parser(text: str | None, prog: str | None, file: str) -> argparse.ArgumentParser:
    """Return the parser of a script's command line. `text` describes the script in its help, `file` is its path."""
    raw = argparse.RawDescriptionHelpFormatter
    return argparse.ArgumentParser(prog, None, text, f"The script, to copy and change: {file}", formatter_class=raw)


def positive_text(text: str) -> str:
    """Return a text that starts with a positive number, as a type of argparse. Raises ArgumentTypeError.

    The unit is read by `length_in_code` and `orbits_of`, as it may depend on the run.
    """
    _check_number(text)
    return text


def positive_texts(text: str) -> list[str]:
    """Return texts that start with positive numbers, from one text with commas. Raises ArgumentTypeError."""
    return [positive_text(part) for part in text.split(",")]


def number_text(text: str) -> str:
    """Return a text that starts with a number from 0, as a type of argparse. Raises ArgumentTypeError."""
    _check_number(text, has_zero=True)
    return text


def _check_number(text: str, has_zero: bool = False) -> None:
    """Raise ArgumentTypeError unless the text starts with a number above 0; with `has_zero` it may be 0."""
    try:
        value = split_number(text, "a number")[0]
    except UnitError:
        value = math.nan
    if not (0.0 < value < math.inf or (has_zero and value == 0.0)):
        raise argparse.ArgumentTypeError(f"{clipped(text)!r}: expected a number {'from' if has_zero else 'above'} 0")


def length_in_code(text: str, units: Units, name: str) -> float:
    """Return a length like "20 au" in code units; a number without unit is in the unit of tables.

    `name` is the option in messages. Raises OptionError.
    """
    try:
        value, rest = split_number(text, units.expected("length"))
        return units.of_text(text, "length") if rest else value / display_unit(units, "length", "au")[0]
    except UnitError as error:
        raise OptionError(f"{name}: {error}") from None


def orbits_of(given: str | float, period: float, scene: Scene, name: str) -> float:
    """Return a time as a number of orbits with the given period in code units.

    `given` is a number of these orbits like 3, "3" or "3 orbits", or a time like "500 yr" or "3 orbits at 20 au".
    `scene` is that of the run, `name` the option in messages. Raises OptionError.
    """
    try:
        value, rest = split_number(str(given), "a number of orbits")
        if rest in ("", "orbit", "orbits"):
            return value
        return time_in_code_units(given, scene.units, scene.text) / period
    except UnitError as error:
        raise OptionError(f"{name}: {error}") from None
