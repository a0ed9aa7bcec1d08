"""A disc as a table: r, Sigma, and perhaps T, the dust-to-gas ratio and the resolution, in a text file with units in
its header.

    # r [au]   Sigma [g/cm2]   T [K]   ratio
    10         200             60      0.01
    ...

Sigma and T are interpolated as ln Sigma and ln T of ln r by monotone cubics (Fritsch & Carlson 1980), whose slopes are
those that pressure is made of; beyond the ends they go on as powers of r. The resolution, particles per mass up to a
factor, is such a cubic too. The ratio is interpolated linearly in ln r.
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

from discsim.scene.fields import LARGEST, InputFile, Words, fault, units_of
from discsim.scene.units import UnitError, Units, clipped
from discsim.userfiles import read_text, system_message

Array = np.ndarray
NAMES = {
    "r": "r", "radius": "r", "sigma": "Sigma", "surface_density": "Sigma", "t": "T", "temperature": "T",
    "ratio": "ratio", "dust_ratio": "ratio", "resolution": "resolution",
}  # fmt: skip
UNITS = {"r": "au", "Sigma": "g/cm2", "T": "K"}  # like which those of the columns are
EACH = ", ".join(dict.fromkeys(NAMES.values()))
SMOOTH = ("Sigma", "T", "resolution")  # as cubics
PLAIN = {"ratio": "a ratio", "resolution": "a resolution"}  # which have no unit
LARGEST_TABLE = 2**24  # bytes
COLUMN = re.compile(r"([A-Za-z_]\w*)(?:\s*[\[(]([^\])]*)[\])])?[\s,]*")


@dataclass(frozen=True)
class Columns(InputFile):
    """What the file holds: columns (n,) by name at rising radii r, in code units; T in kelvin, or c_s^2 in code units.

    Tables of the same content are equal, wherever they are.
    """

    values: dict[str, Array] = field(default_factory=dict, compare=False, repr=False)
    kelvin: bool = True

    __str__ = InputFile.__str__

    @property
    def inner(self) -> float:
        return float(self.values["r"][0])

    @property
    def outer(self) -> float:
        return float(self.values["r"][-1])

    def has(self, name: str) -> bool:
        return name in self.values

    @property
    def uneven(self) -> bool:
        """Whether particles differ in mass: there is a resolution, and it is not the same everywhere."""
        return self.has("resolution") and np.ptp(self.values["resolution"]) > 0.0

    def value(self, name: str, r: Array) -> Array:
        """Column "Sigma", "T" or "resolution" at the radii `r` (n,) > 0."""
        x, within = self._places(r)
        curve, slope = self._curves[name]
        return np.exp(curve(within) + slope(within) * (x - within))

    def slope(self, name: str, r: Array) -> Array:
        """d ln Sigma / d ln r, or of T, at the radii `r` (n,) > 0."""
        return self._curves[name][1](self._places(r)[1])

    def ratio(self, r: Array) -> Array:
        """Dust over gas at the radii `r` (n,) > 0."""
        return np.interp(np.log(r), np.log(self.values["r"]), self.values["ratio"])

    def speed2(self, r: Array, weight: float, velocity: float) -> Array:
        """P / Sigma at the radii `r` (n,), of gas of mean molecular weight `weight`; velocity: its code unit in cgs."""
        if not self.kelvin:
            return self.value("T", r)
        from discsim.scene.astropy_units import constants

        molecule = weight * (constants.m_p + constants.m_e).cgs.value
        return self.value("T", r) * (constants.k_B.cgs.value / molecule / velocity**2)

    def _places(self, r: Array) -> tuple[Array, Array]:
        """ln r, and the same within the table."""
        x, log = np.log(np.maximum(r, 1e-300)), np.log(self.values["r"])
        return x, np.clip(x, log[0], log[-1])

    @cached_property
    def _curves(self) -> dict[str, Any]:
        """The cubics through ln Sigma, ln T and ln resolution, and their slopes."""
        from scipy.interpolate import PchipInterpolator  # slow to import

        log = np.log(self.values["r"])
        curves = {n: PchipInterpolator(log, np.log(self.values[n])) for n in SMOOTH if n in self.values}
        return {name: (curve, curve.derivative()) for name, curve in curves.items()}


def _read(value: Any, info: ValidationInfo) -> Columns | None:
    if value is None:
        return None
    found = InputFile.read(value, info, LARGEST_TABLE)
    try:
        text = read_text(found.path)
    except UnicodeDecodeError:
        raise fault(f"{found.path}: not a text; expected a table, {_wanted(units_of(info))}") from None
    except OSError as error:
        raise fault(system_message(error, "read", found.path)) from None
    lines = [(number, line.strip()) for number, line in enumerate(text.splitlines(), 1) if line.strip()]
    try:
        names, factors = _header(lines, units_of(info))
        rows = [_row(number, line, names) for number, line in lines[1:] if line[0] != "#"]
        _check(names, rows, factors)
    except _Wrong as wrong:
        raise fault(f"{found.path}{wrong}") from None
    table = np.array([row for _, row in rows]).T * np.array(factors)[:, None]
    return Columns(found.path, found.digest, dict(zip(names, table, strict=True)), units_of(info).system != "code")


ColumnsFile = Annotated[Any, BeforeValidator(_read), Words("path of a text file, relative to the scene's folder")]


class _Wrong(Exception):
    """What is wrong with the file, from its line on."""


def _wanted(units: Units) -> str:
    return (
        f"a header like {'# r  Sigma  T  ratio' if units.system == 'code' else '# r [au]  Sigma [g/cm2]  T [K]  ratio'}"
    )


def _header(lines: list[tuple[int, str]], units: Units) -> tuple[list[str], list[float]]:
    """Names of the columns, and what their numbers are multiplied with."""
    if not lines:
        raise _Wrong(f": empty; expected {_wanted(units)}, and rows of numbers below")
    number, line = lines[0]
    text = line.lstrip("# \t")
    found = COLUMN.findall(text)
    if COLUMN.sub("", text) or not any(word.lower() in NAMES for word, _ in found):
        raise _Wrong(f":{number}: no header of a table; expected {_wanted(units)}")  # says nothing of another file
    names, factors = [], []
    for word, unit in found:
        name = NAMES.get(word.lower())
        if name is None or name in names:
            wrong = "unknown" if name is None else "there twice"
            raise _Wrong(f':{number}: column "{clipped(word)}" is {wrong}; expected each of {EACH} once')
        try:
            factors.append(_factor(name, unit.strip(), units))
        except UnitError as error:
            raise _Wrong(f":{number}: column {word}: {error}") from None
        names.append(name)
    for name in ("r", "Sigma"):
        if name not in names:
            raise _Wrong(f":{number}: no column {name}; expected {_wanted(units)}")
    return names, factors


def _factor(name: str, unit: str, units: Units) -> float:
    """The code unit's worth of a column's unit."""
    if units.system == "code" or name in PLAIN:
        if unit not in ("", "1"):
            raise UnitError(f'"{clipped(unit)}" is a unit, but {PLAIN.get(name, "the scene")} has none')
        return 1.0
    if not unit:
        raise UnitError(f"has no unit; expected one, like {name} [{UNITS[name]}]")
    if name == "T":
        if unit not in ("K", "kelvin"):
            raise UnitError(f'"{clipped(unit)}" is not kelvin; expected T [K]')
        return 1.0
    return units.parse(f"1 {unit}", "length" if name == "r" else "surface_density")


def _row(number: int, line: str, names: list[str]) -> tuple[int, list[float]]:
    entries = line.partition("#")[0].replace(",", " ").split()
    row = []
    for entry in entries:
        try:
            row.append(float(entry))
        except ValueError:
            raise _Wrong(f':{number}: "{clipped(entry)}" is not a number; expected {", ".join(names)}') from None
    if len(row) != len(names):
        raise _Wrong(f":{number}: {len(row)} numbers; expected {len(names)}: {', '.join(names)}")
    return number, row


def _check(names: list[str], rows: list[tuple[int, list[float]]], factors: list[float]) -> None:
    if len(rows) < 2:
        raise _Wrong(f": {len(rows)} rows; expected two at least, from the inner edge to the outer one")
    before = 0.0
    for number, row in rows:
        for name, entry, factor in zip(names, row, factors, strict=True):
            least = 0.0 if name == "ratio" else 1.0 / LARGEST
            if not math.isfinite(entry) or not least <= entry * factor <= LARGEST:
                words = "0 or more" if name == "ratio" else "a positive number"
                raise _Wrong(f":{number}: {name} = {entry:g} is out of range; expected {words}")
        r = row[names.index("r")]
        if r <= before:
            raise _Wrong(f":{number}: r = {r:g} is not beyond {before:g} of the row before; expected rising radii")
        before = r
    if "ratio" in names and not any(row[names.index("ratio")] > 0.0 for _, row in rows):
        raise _Wrong(": the ratio is 0 everywhere; expected dust somewhere, or no such column")
