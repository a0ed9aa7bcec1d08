"""Reading of costs.csv, the table with the CPU seconds of each effect in a run (`run/costs.py` writes it)."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import NamedTuple

from discsim.printable import UserError
from discsim.userfiles import read_text

COLUMNS = ("effect", "calls", "cpu_seconds", "share")
REMEDY = "repair the file, or move it away"


class CostsError(UserError):
    """A damaged costs.csv, or another file in its place; the message has the line."""


class Cost(NamedTuple):
    """A row of costs.csv: an effect, its number of calls, its CPU seconds, and its share of the total CPU time."""

    effect: str
    calls: int
    seconds: float
    share: float


def read_costs(path: Path) -> list[Cost]:
    """Read the rows of a costs.csv. Raises CostsError, OSError."""
    try:
        lines = list(csv.reader(read_text(path).splitlines()))
    except (ValueError, csv.Error):  # no UTF-8, or a field without end
        raise CostsError(f"{path}: not a text table like the costs.csv of a run; {REMEDY}") from None
    if not lines or lines[0] != [*COLUMNS]:
        raise CostsError(f"{path}:1: not the header of costs.csv, {','.join(COLUMNS)}; {REMEDY}")
    return [_parse_cost(path, number, line) for number, line in enumerate(lines[1:], 2)]


def _parse_cost(path: Path, number: int, line: list[str]) -> Cost:
    """Return line `number` of the file as a row. Raises CostsError."""
    try:
        effect, calls, seconds, share = line
        found = Cost(effect, int(calls), float(seconds), float(share))
    except ValueError:
        found = Cost("", 0, math.nan, math.nan)
    if not (math.isfinite(found.seconds) and math.isfinite(found.share)):
        raise CostsError(f"{path}:{number}: not a row of costs.csv, with the columns {','.join(COLUMNS)}; {REMEDY}")
    return found
