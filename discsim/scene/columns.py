"""A disc as a table in a text file: r, Sigma and, optionally, T, dust-to-gas ratio and resolution, with units in the
header.

    # r [au]   Sigma [g/cm2]   T [K]   ratio
    10         200             60      0.01
    ...

ln Sigma and ln T are interpolated as functions of ln r by monotone cubics (Fritsch & Carlson 1980). The slopes of
these cubics give the pressure gradient. Beyond the ends Sigma and T are power laws of r. The resolution, which is
proportional to the number of particles per mass, is interpolated in the same way; the ratio linearly in ln r.
In a scene in code units the header has no units, and T is c_s^2 = P / Sigma.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, ValidationInfo

from discsim.scene.fields import LARGEST, AllowedValues, InputFile, fault, units_of
from discsim.scene.units import UnitError, Units, astropy, clipped
from discsim.userfiles import read_text, system_message

Array = np.ndarray
COLUMN_OF_HEADING = {
    "r": "r", "radius": "r", "sigma": "Sigma", "surface_density": "Sigma", "t": "T", "temperature": "T",
    "ratio": "ratio", "dust_ratio": "ratio", "resolution": "resolution",
}  # fmt: skip
EXAMPLE_UNITS = {"r": "au", "Sigma": "g/cm2", "T": "K"}  # examples for messages
COLUMN_LIST = ", ".join(dict.fromkeys(COLUMN_OF_HEADING.values()))
SMOOTH_COLUMNS = ("Sigma", "T", "resolution")  # interpolated by cubics
UNITLESS = {"ratio": "a ratio", "resolution": "a resolution"}  # columns without unit: their names in messages
MAX_TABLE_BYTES = 2**24  # bytes
COLUMN = re.compile(r"([A-Za-z_]\w*)(?:\s*[\[(]([^\])]*)[\])])?[\s,]*")


@dataclass(frozen=True)
class Columns(InputFile):
    """A disc read from a text file: arrays (n,) of its columns by name, in code units; the radii r increase.

    kelvin: whether T is in kelvin; if not, T is c_s^2 in code units. Two files are equal if their contents are equal;
    their paths may differ.
    """

    values: dict[str, Array] = field(default_factory=dict, compare=False, repr=False)
    kelvin: bool = True

    __str__ = InputFile.__str__

    @property
    def inner(self) -> float:
        """The smallest radius."""
        return float(self.values["r"][0])

    @property
    def outer(self) -> float:
        """The largest radius."""
        return float(self.values["r"][-1])

    def has(self, name: str) -> bool:
        """Return whether the file has the column `name`."""
        return name in self.values

    @property
    def uneven(self) -> bool:
        """True if the resolution varies with radius, so that gas particles have different masses."""
        return self.has("resolution") and np.ptp(self.values["resolution"]) > 0.0

    def value(self, name: str, r: Array) -> Array:
        """Return the column `name` (n,), "Sigma", "T" or "resolution", at the radii `r` (n,) > 0."""
        x, within = self._log_radii(r)
        curve, slope = self._curves[name]
        return np.exp(curve(within) + slope(within) * (x - within))

    def slope(self, name: str, r: Array) -> Array:
        """Return d ln(column) / d ln r (n,) of the column `name`, as in `value`, at the radii `r` (n,) > 0."""
        return self._curves[name][1](self._log_radii(r)[1])

    def ratio(self, r: Array) -> Array:
        """Return the dust-to-gas ratio (n,) at the radii `r` (n,) > 0."""
        return np.interp(np.log(r), np.log(self.values["r"]), self.values["ratio"])

    def speed2(self, r: Array, weight: float, velocity: float) -> Array:
        """Return P / Sigma (n,) at the radii `r` (n,) in code units.

        weight: mean molecular weight. velocity: code unit of velocity in cgs.
        """
        if not self.kelvin:
            return self.value("T", r)
        molecule = weight * (astropy.constants.m_p + astropy.constants.m_e).cgs.value
        return self.value("T", r) * (astropy.constants.k_B.cgs.value / molecule / velocity**2)

    def _log_radii(self, r: Array) -> tuple[Array, Array]:
        """Return ln r (n,), and ln r (n,) limited to the range of radii of the table."""
        x, log = np.log(np.maximum(r, 1e-300)), np.log(self.values["r"])
        return x, np.clip(x, log[0], log[-1])

    @cached_property
    def _curves(self) -> dict[str, Any]:
        """For each column name, the cubic for ln Sigma, ln T or ln resolution in ln r, and its derivative."""
        from scipy.interpolate import PchipInterpolator  # slow to import

        log = np.log(self.values["r"])
        curves = {n: PchipInterpolator(log, np.log(self.values[n])) for n in SMOOTH_COLUMNS if n in self.values}
        return {name: (curve, curve.derivative()) for name, curve in curves.items()}


def _read_columns(value: Any, info: ValidationInfo) -> Columns | None:
    """Read the file that `value` names; return None for None. Raises a `fault` for a file that is no such table."""
    if value is None:
        return None
    found = InputFile.read(value, info, MAX_TABLE_BYTES)
    try:
        text = read_text(found.path)
    except UnicodeDecodeError:
        raise fault(
            f"{found.path}: not a text file; expected a table with {_expected_header(units_of(info))}"
        ) from None
    except OSError as error:
        raise fault(system_message(error, "read", found.path)) from None
    lines = [(number, line.strip()) for number, line in enumerate(text.splitlines(), 1) if line.strip()]
    try:
        names, factors = _parse_header(lines, units_of(info))
        rows = [_parse_row(number, line, names) for number, line in lines[1:] if line[0] != "#"]
        _check_rows(names, rows, factors)
    except _RowError as wrong:
        raise fault(f"{found.path}{wrong}") from None
    table = np.array([row for _, row in rows]).T * np.array(factors)[:, None]
    return Columns(found.path, found.digest, dict(zip(names, table, strict=True)), units_of(info).system != "code")


ColumnsFile = Annotated[
    Any, BeforeValidator(_read_columns), AllowedValues("path of a text file, relative to the folder of the scene")
]


class _RowError(Exception):
    """A fault of the file. The message follows the path of the file: ":12: ..." with a line number, or ": ..."."""


def _expected_header(units: Units) -> str:
    """Return a description of the header, for messages."""
    example = "# r  Sigma  T  ratio" if units.system == "code" else "# r [au]  Sigma [g/cm2]  T [K]  ratio"
    return f"a header like {example}"


def _parse_header(lines: list[tuple[int, str]], units: Units) -> tuple[list[str], list[float]]:
    """Return the names of the columns, and the factors that convert their numbers to code units. Raises _RowError.

    lines: (line number, text) of every line of the file that is not blank; the first one is the header.
    """
    if not lines:
        raise _RowError(f": the file is empty; expected {_expected_header(units)}, and rows of numbers below")
    number, line = lines[0]
    text = line.lstrip("# \t")
    found = COLUMN.findall(text)
    if COLUMN.sub("", text) or not any(word.lower() in COLUMN_OF_HEADING for word, _ in found):
        # Do not show the line, which could be text of any other file.
        raise _RowError(f":{number}: not a table header; expected {_expected_header(units)}")
    names, factors = [], []
    for word, unit in found:
        name = COLUMN_OF_HEADING.get(word.lower())
        if name is None or name in names:
            wrong = "unknown" if name is None else "given twice"
            raise _RowError(
                f':{number}: column "{clipped(word)}" is {wrong}; expected the columns {COLUMN_LIST}, each at most once'
            )
        try:
            factors.append(_unit_factor(name, unit.strip(), units))
        except UnitError as error:
            raise _RowError(f":{number}: column {word}: {error}") from None
        names.append(name)
    for name in ("r", "Sigma"):
        if name not in names:
            raise _RowError(f":{number}: no column {name}; expected {_expected_header(units)}")
    return names, factors


def _unit_factor(name: str, unit: str, units: Units) -> float:
    """Return the factor from `unit` to code units for the column `name`; 1 for T, which stays in kelvin.

    Raises UnitError.
    """
    if units.system == "code" or name in UNITLESS:
        if unit not in ("", "1"):
            raise UnitError(
                f'"{clipped(unit)}" is a unit, but {UNITLESS.get(name, "a scene in code units")} has no '
                f"unit; remove the unit"
            )
        return 1.0
    if not unit:
        raise UnitError(f"the header gives no unit; expected a unit in brackets, like {name} [{EXAMPLE_UNITS[name]}]")
    if name == "T":
        if unit not in ("K", "kelvin"):
            raise UnitError(f'"{clipped(unit)}" is not the unit kelvin; expected T [K]')
        return 1.0
    return units.parse(f"1 {unit}", "length" if name == "r" else "surface_density")


def _parse_row(number: int, line: str, names: list[str]) -> tuple[int, list[float]]:
    """Return the line number, and the numbers in the line, one per column. Raises _RowError."""
    row = []
    for entry in line.partition("#")[0].replace(",", " ").split():
        try:
            row.append(float(entry))
        except ValueError:
            raise _RowError(
                f':{number}: "{clipped(entry)}" is not a number; expected numbers in the columns {", ".join(names)}'
            ) from None
    if len(row) != len(names):
        raise _RowError(
            f":{number}: {len(row)} numbers; expected {len(names)} numbers, in the columns {', '.join(names)}"
        )
    return number, row


def _check_rows(names: list[str], rows: list[tuple[int, list[float]]], factors: list[float]) -> None:
    """Raise _RowError for too few rows, a number out of range, radii that do not increase, or only zero ratios."""
    if len(rows) < 2:
        raise _RowError(f": {len(rows)} rows; expected at least two rows, from the inner to the outer edge")
    before = 0.0
    for number, row in rows:
        for name, entry, factor in zip(names, row, factors, strict=True):
            least = 0.0 if name == "ratio" else 1.0 / LARGEST
            if not math.isfinite(entry) or not least <= entry * factor <= LARGEST:
                words = "0 or more" if name == "ratio" else "a positive number"
                raise _RowError(f":{number}: {name} = {entry:g} is out of range; expected {words}")
        r = row[names.index("r")]
        if r <= before:
            wrong = f"r = {r:g} is not larger than {before:g} of the previous row"
            raise _RowError(f":{number}: {wrong}; expected increasing radii")
        before = r
    if "ratio" in names and not any(row[names.index("ratio")] > 0.0 for _, row in rows):
        raise _RowError(": the column ratio is 0 everywhere; expected a positive ratio in some row, or no such column")
