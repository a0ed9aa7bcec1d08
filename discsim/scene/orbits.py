"""Orbits as a unit of time: texts like "40 orbits at 5.2 au", and times shown with their number of orbits.

    P(r) = 2 pi / Omega_K(r)               "orbits at r": circular orbits about the central mass of the disc        (1)
    P    = 2 pi [a^3 / (G mu)]^(1/2)       "orbits", "orbits of the companion": of the only bound companion         (2)

`formulas/centre.py` defines Omega_K, the central mass and mu. In a disc about the star, (1) has the mass of the star;
in a disc about the barycentre, the masses of the bound companions too. In (2) mu = M + m, the total mass. Masses are
those of the scene: accretion and ramps do not change the length of an orbit.

Scenes and snapshots store the text. The functions read the tables of a scene as written, because a time is converted
before the other tables are validated.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from discsim.formulas import centre
from discsim.scene.units import UnitError, Units, clipped, split_number

OF_COMPANION = "of the companion"
_WORD = re.compile(r"(?<![^\W\d_])orbits?\b")  # not after a letter, but after a number, as in "40orbits"
_UNIT = re.compile(rf"orbits?(?:\s+(?:{OF_COMPANION}|at\s+(\S.*)))?", re.S)


class FaultyTableError(UnitError):
    """Error for a number of orbits that is correct itself, in a scene whose star or companion has faults."""


@dataclass(frozen=True)
class Orbit:
    """A unit of time: the period in code units, and the words that follow "orbits", like "at 5.2 au"."""

    period: float
    words: str

    @property
    def unit(self) -> str:
        """The unit for labels of axes, like "orbits at 5.2 au"."""
        return f"orbits {self.words}"

    def count(self, t: float) -> str:
        """Return the time `t`, in code units, as text: "40 orbits at 5.2 au"."""
        number = f"{t / self.period:.4g}"
        return f"{number} orbit{'' if number == '1' else 's'} {self.words}"


def mentions_orbits(given: Any) -> bool:
    """Return whether a value is a text with the word "orbit" or "orbits"."""
    return isinstance(given, str) and _WORD.search(given) is not None


class OrbitalPeriods:
    """The orbital periods of a scene.

    tables: tables of the scene as written. units: units of the scene.
    """

    def __init__(self, tables: Mapping[str, Any], units: Units) -> None:
        self._tables, self._units = tables, units

    def parse(self, text: str) -> float:
        """Return a time like "40 orbits at 5.2 au" or "2 orbits" in code units. Raises UnitError."""
        number, orbit = self._number_and_orbit(text)
        value = number * orbit.period
        if not math.isfinite(value):
            raise UnitError(f'"{clipped(text)}" is too large in code units; expected a finite number')
        return value

    def stated_orbit(self) -> Orbit | None:
        """Return the orbit of run.until or else run.every; None if neither is a number of orbits. Raises UnitError."""
        run = self._tables.get("run")
        texts = [run.get(key) for key in ("until", "every")] if isinstance(run, dict) else []
        return next((self._number_and_orbit(text)[1] for text in texts if mentions_orbits(text)), None)

    def companion_orbit(self) -> Orbit | None:
        """Return the orbit of the only bound companion, eq. (2); None if there is not exactly one. Raises UnitError."""
        star, bound = self._star(), self._bound_companions()
        if star is None or len(bound) != 1:
            return None
        ((name, companion),) = bound.items()
        sources = star.get("indirect")
        if not isinstance(sources, list | None):
            raise FaultyTableError("star.indirect is wrong; correct it first")
        mass, axis = self._value(name, companion, "mass"), self._value(name, companion, "semi_major_axis")
        mu = centre.orbital_mass(self._value("star", star, "mass"), mass, sources)
        return Orbit(_checked(lambda: centre.period(mu, axis)), OF_COMPANION)

    def _number_and_orbit(self, text: str) -> tuple[float, Orbit]:
        """Return the number of orbits in a text, and the orbit. Raises UnitError."""
        example = "40 orbits at 2.0" if self._units.system == "code" else "40 orbits at 5.2 au"
        expected, shown = f'a time, like "{example}"', clipped(text)
        number, unit = split_number(text, expected)
        found = _UNIT.fullmatch(unit)
        if not found:
            raise UnitError(f'"{shown}" is not a number of orbits; expected {expected}')
        if not math.isfinite(number):
            raise UnitError(f'"{shown}" is not a finite number')
        try:
            orbit = self._orbit_at(found[1]) if found[1] else self.companion_orbit()
            if self._star() is None:
                raise UnitError('the scene has no central mass; add a table [star], or give the time without "orbits"')
            if orbit is None:
                wrong = f"there are {len(self._bound_companions())} companions on bound orbits, not one"
                raise UnitError(f'{wrong}; give a radius too, like "{example}"')
        except UnitError as error:
            raise type(error)(f'"{shown}": {error}') from error
        return number, orbit

    def _orbit_at(self, text: str) -> Orbit | None:
        """Return the circular orbit at a radius given as text, eq. (1); None without a star. Raises UnitError."""
        radius = self._units.of_text(text, "length")
        if radius <= 0.0:
            raise UnitError(f'the radius "{clipped(text)}" is not positive')
        star = self._star()
        if star is None:
            return None
        mass, softening = self._value("star", star, "mass"), self._value("star", star, "softening")
        if star.get("centre") == "barycentre":
            mass += sum(self._value(name, each, "mass") for name, each in self._bound_companions().items())
        period = _checked(lambda: 2.0 * math.pi / float(centre.omega(mass, radius, softening)))
        return Orbit(period, f"at {self._units.show(radius, 'length')}")

    def _star(self) -> Mapping[str, Any] | None:
        """Return the table [star]; None without one. Raises FaultyTableError."""
        if "star" not in self._tables:
            return None
        star = self._tables["star"]
        if not isinstance(star, dict):
            raise FaultyTableError("[star] is wrong; correct it first")
        return star

    def _bound_companions(self) -> dict[str, Mapping[str, Any]]:
        """Return the tables of companions on bound orbits, by names like "companion.0". Raises FaultyTableError."""
        given = self._tables.get("companion", [])
        found: dict[str, Mapping[str, Any]] = {}
        for number, each in enumerate(given if isinstance(given, list) else [given]):
            name = f"companion.{number}" if isinstance(given, list) else "companion"
            if not isinstance(each, dict):
                raise FaultyTableError(f"[{name}] is wrong; correct it first")
            if self._value(name, each, "eccentricity") < 1.0:
                found[name] = each
        return found

    def _value(self, name: str, table: Mapping[str, Any], key: str) -> float:
        """Return the value of a key of the star or a companion, in code units. Raises FaultyTableError."""
        dimension, default, least = _KEYS[key]
        given = table.get(key, default)
        has_unit = dimension and self._units.system != "code" and key in table
        value = math.nan
        with suppress(UnitError, OverflowError):
            if has_unit and isinstance(given, str):
                value = self._units.parse(given, dimension)
            elif not has_unit and isinstance(given, int | float):
                value = float(given)
        if not least <= value < math.inf:
            raise FaultyTableError(f"{name}.{key} is missing or wrong; correct it first")
        return value


# Keys of star and companion: dimension, default, and smallest allowed value.
_KEYS: dict[str, tuple[str, float | None, float]] = {
    "mass": ("mass", None, math.nextafter(0.0, 1.0)),
    "semi_major_axis": ("length", None, math.nextafter(0.0, 1.0)),
    "softening": ("length", 0.0, 0.0),
    "eccentricity": ("", 0.0, 0.0),
}


def _checked(period: Callable[[], float]) -> float:
    """Return the result of `period`. Raises UnitError unless it is finite and positive."""
    try:
        with np.errstate(all="raise"):
            value = period()
    except ArithmeticError:  # overflow or underflow
        value = math.nan
    if not 0.0 < value < math.inf:
        raise UnitError("the orbital period is too large or too small in code units; expected a finite number")
    return value


@lru_cache(maxsize=32)
def stated_orbit(scene_text: str, units: Units) -> Orbit | None:
    """Return the orbit in which a scene gives run.until or else run.every; None if neither is a number of orbits.

    scene_text: the scene as TOML. A scene with faults, as a file from others may have, gives None.
    """
    try:
        return OrbitalPeriods(tomllib.loads(scene_text), units).stated_orbit()
    except (ValueError, RecursionError):  # a UnitError is a ValueError
        return None


@lru_cache(maxsize=32)
def shown_orbit(scene_text: str, units: Units) -> Orbit | None:
    """Return the orbit that times of a run are shown in, besides years: that of `stated_orbit`, or of the companion.

    None if there is neither. scene_text: the scene as TOML.
    """
    try:
        return stated_orbit(scene_text, units) or OrbitalPeriods(tomllib.loads(scene_text), units).companion_orbit()
    except (ValueError, RecursionError):
        return None


@lru_cache(maxsize=32)
def _end_of_run(scene_text: str, units: Units) -> float | None:
    """Return run.until of a scene, given as TOML, in code units; None for a scene with faults."""
    try:
        return time_in_code_units(tomllib.loads(scene_text)["run"]["until"], units, scene_text)
    except (KeyError, TypeError, ValueError, RecursionError):
        return None


def show_plain_time(t: float, units: Units, scene_text: str) -> str:
    """Return the time `t` of a run, in code units, as text: "474.3 yr". All times of a run have the unit of run.until.

    scene_text: the scene of the run as TOML.
    """
    return units.show(t, "time", like=_end_of_run(scene_text, units))


def show_time(t: float, units: Units, scene_text: str) -> str:
    """Return a time as `show_plain_time`, with the number of orbits if the scene counts them, "(40 orbits at 5.2 au)".

    scene_text: the scene of the run as TOML.
    """
    orbit = shown_orbit(scene_text, units)
    return show_plain_time(t, units, scene_text) + (f" ({orbit.count(t)})" if orbit else "")


def time_in_code_units(given: Any, units: Units, scene_text: str) -> float:
    """Return a time in code units: of a text like "500 yr" or "40 orbits at 5.2 au", a Quantity, or a number.

    scene_text: the scene of the run as TOML. Raises UnitError, and TypeError or ValueError for any other object.
    """
    if not isinstance(given, str):
        return float(units.in_code(given, "time") if hasattr(given, "unit") else given)
    if not mentions_orbits(given):
        return float(units.of_text(given, "time"))
    return OrbitalPeriods(tomllib.loads(scene_text), units).parse(given)
