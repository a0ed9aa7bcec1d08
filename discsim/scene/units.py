"""Code units with G = 1: units of length L and mass M fix the unit of time, T = sqrt(L^3 / (G M)).

Quantities with units are converted on input and on output; all computation is in code units. A dimension has a name
("length") and exponents of mass, length and time. The density of a scene is a surface density in 2D (M/L^2) and a
volume density in 1D (M/L^3).
"""

from __future__ import annotations

import math
import re
import warnings
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache, cached_property
from typing import Any

from discsim.parts import Lazy
from discsim.printable import printable

astropy = Lazy("discsim.scene.astropy_units")

Exponents = tuple[float, float, float]

# Exponents of mass, length, time.
DIMENSIONS: dict[str, Exponents] = {
    "length": (0, 1, 0),
    "mass": (1, 0, 0),
    "time": (0, 0, 1),
    "velocity": (0, 1, -1),
    "acceleration": (0, 1, -2),
    "frequency": (0, 0, -1),
    "diffusivity": (0, 2, -1),
    "accretion_rate": (1, 0, -1),
    "surface_density": (1, -2, 0),
    "volume_density": (1, -3, 0),
    "momentum": (1, 1, -1),
    "angular_momentum": (1, 2, -1),
    "energy": (1, 2, -2),
    "specific_energy": (0, 2, -2),
    "opacity": (-1, 2, 0),
}

# Quantities that messages show as examples, by dimension.
EXAMPLES = {
    "length": "10 au", "mass": "0.1 Msun", "time": "100 yr", "velocity": "1 km/s", "acceleration": "1 cm/s2",
    "frequency": "1 / yr", "diffusivity": "1e15 cm2/s", "accretion_rate": "1e-8 Msun/yr",
    "surface_density": "100 g/cm2", "volume_density": "3 g/cm3", "opacity": "1 cm2/g",
}  # fmt: skip

_UNITS_FOR_HINTS = (
    "au", "pc", "km", "m", "cm", "mm", "um", "Rsun", "Msun", "Mearth", "Mjup", "kg", "g",
    "yr", "kyr", "Myr", "day", "hour", "min", "s", "km/s", "m/s", "cm/s", "g/cm2", "g/cm3", "kg/m3",
)  # fmt: skip

_NUMBER = re.compile(r"\s*([+-]?(?:\d[\d_]*\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf))\s*\*?\s*(.*)", re.S)


class UnitError(ValueError):
    """A text that is not a quantity, or has the wrong dimension; the message says what is expected."""


MAX_ECHO = 80  # largest number of characters of the user's text in a message
# Smallest and largest code units, in cm and g. Between them, products of powers of the code units do not overflow.
RANGES = {"length": (1e-20, 1e40, "cm"), "mass": (1e-40, 1e60, "g")}


def clipped(text: str) -> str:
    """Return a text of the user for a message: printable, and shortened to MAX_ECHO characters."""
    text = printable(text)
    return text if len(text) <= MAX_ECHO else text[: MAX_ECHO - 3] + "..."


def with_article(name: str) -> str:
    """Return a dimension in words with an article: "a surface density"."""
    words = name.replace("_", " ").split("/")[0]
    return f"an {words}" if words[0] in "aeiou" else f"a {words}"


def split_number(text: str, expected: str) -> tuple[float, str]:
    """Return the number at the start of a text, and the rest without spaces at its ends, like (0.6, "au").

    expected: description of the expected value, for messages. Raises UnitError if the text has no number.
    """
    match = _NUMBER.fullmatch(text)
    try:
        if match:
            return float(match[1]), match[2].strip()
    except ValueError:  # underscores in wrong places, as in "1__0"
        pass
    raise UnitError(f'"{clipped(text)}" is not a quantity; expected {expected}')


def parse_quantity(text: str, expected: str = 'a number and a unit, like "10 au"') -> Any:
    """Convert a text such as "0.6 au" to an astropy Quantity.

    expected: description of the expected value, for messages. Raises UnitError if the text has no number, no unit or
    an unknown unit, or if the number is not finite.
    """
    number, name = split_number(text, expected)
    text = clipped(text)
    if not name:
        raise UnitError(f'"{text}" has no unit; expected {expected}')
    if len(name) > MAX_ECHO:
        raise UnitError(f'"{text}": unknown unit; expected a unit of astropy')
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # astropy warns about several slashes, as in "g / cm / s"
            unit = astropy.units.Unit("1" + name if name[0] == "/" else name)
            unit.decompose()
    except (ValueError, TypeError, AttributeError, ArithmeticError) as error:
        near = get_close_matches(name, _UNITS_FOR_HINTS, n=1, cutoff=0.5)
        hint = f'; did you mean "{near[0]}"?' if near else ""
        raise UnitError(f'"{text}": unknown unit "{name}"; expected a unit of astropy{hint}') from error
    if not math.isfinite(number):
        raise UnitError(f'"{text}" is not a finite number')
    return astropy.units.Quantity(number, unit)


@dataclass(frozen=True)
class Units:
    """The code units of a scene.

    Parameters
    ----------
    system : {"physical", "code"}
        In the system "code" all numbers are dimensionless; `length_text` and `mass_text` are unused.
    dimensions : int
        Dimensions of space; in 2D "density" is a surface density, in 1D a volume density.
    length_text, mass_text : str
        Code units of length and mass, for example "1 au" and "1 Msun".

    Raises
    ------
    UnitError
        If a text is not a positive length or mass in the allowed range.
    """

    system: str = "physical"
    dimensions: int = 2
    length_text: str = "1 au"
    mass_text: str = "1 Msun"

    def __post_init__(self) -> None:
        if self.system == "code":
            return
        for name, text in (("length", self.length_text), ("mass", self.mass_text)):
            quantity = parse_quantity(text, self.expected(name))
            if quantity.unit.physical_type != name:
                raise UnitError(f'"{text}" is {_dimension_words(quantity)}; expected {self.expected(name)}')
            if quantity.value <= 0:
                raise UnitError(f'"{text}" is not positive; expected {self.expected(name)}')
            least, most, unit = RANGES[name]
            if not least <= quantity.to_value(unit) <= most:
                raise UnitError(f'"{text}" is {quantity.to_value(unit):.3g} {unit}; expected {least:g} to {most:g}')

    def exponents(self, name: str, gamma: float = 1.0) -> Exponents:
        """Return the exponents of mass, length and time of the dimension `name`.

        gamma: adiabatic index, used only for "polytropic_constant", P / rho^gamma.
        """
        density = (1.0, -2.0 if self.dimensions == 2 else -3.0, 0.0)
        if name == "density":
            return density
        if name == "pressure":
            return (density[0], density[1] + 2, -2.0)
        if name == "drag_coefficient":
            return (density[0], density[1], -1.0)
        if name == "polytropic_constant":
            return (density[0] * (1 - gamma), density[1] * (1 - gamma) + 2, -2.0)
        return DIMENSIONS[name]

    @cached_property
    def length(self) -> Any:
        """The code unit of length as an astropy unit; None in the code system."""
        return self._parsed_unit(self.length_text)

    @cached_property
    def mass(self) -> Any:
        """The code unit of mass as an astropy unit; None in the code system."""
        return self._parsed_unit(self.mass_text)

    @cached_property
    def time(self) -> Any:
        """The code unit of time, sqrt(L^3 / (G M)), as an astropy unit in years; None in the code system."""
        if self.system == "code":
            return None
        squared = (1 * self.length) ** 3 / (astropy.constants.G * (1 * self.mass))
        return astropy.units.Unit((squared**0.5).to(astropy.units.yr))

    @property
    def velocity(self) -> Any:
        """The code unit of velocity as an astropy unit; None in the code system."""
        return self._code_unit("velocity")

    @property
    def density(self) -> Any:
        """The code unit of density as an astropy unit: per area in 2D, per volume in 1D; None in the code system."""
        return self._code_unit("density")

    def cgs(self, name: str) -> float:
        """Return the code unit of the dimension `name` in cgs units; 1 in the code system."""
        return self._cgs_factor(self.exponents(name))

    def quantity(self, array: Any, name: str) -> Any:
        """Return `array`, numbers in code units of the dimension `name`, as an astropy Quantity.

        In the code system the Quantity is dimensionless.
        """
        return astropy.units.Quantity(array, self._code_unit(name) or astropy.units.dimensionless_unscaled)

    def to_code(self, quantity: Any) -> Any:
        """Convert an astropy Quantity of any dimension to a float or array in code units.

        Raises UnitError if its unit does not reduce to mass, length and time.
        """
        return quantity.value * self._conversion_factor(quantity, self._exponents_of(quantity))

    def in_code(self, quantity: Any, name: str) -> Any:
        """Convert an astropy Quantity to code units. Raises UnitError unless it has the dimension `name`.

        In the code system a dimensionless Quantity is also accepted.
        """
        if self.system == "code" and not any(self._exponents_of(1 * quantity.unit)):
            return self.to_code(quantity)
        return quantity.value * self._checked_factor(1 * quantity.unit, f"{quantity.unit}", name)

    def parse(self, text: str, name: str, gamma: float = 1.0) -> float:
        """Convert a text such as "0.6 au" to code units. Raises UnitError unless it has the dimension `name`.

        gamma: adiabatic index, for the dimension "polytropic_constant".
        """
        quantity = parse_quantity(text, self.expected(name, gamma))
        value = quantity.value * self._checked_factor(quantity, clipped(text), name, gamma)
        if not math.isfinite(value):
            raise UnitError(f'"{clipped(text)}" is too large or too small in code units; expected a finite number')
        return value

    def of_text(self, text: str, name: str) -> float:
        """Convert a text to code units, as in `parse`; in the code system the text has to be a plain number.

        Raises UnitError.
        """
        if self.system != "code":
            return self.parse(text, name)
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise UnitError(f'"{clipped(text)}" is not a finite number; expected {with_article(name)} in code units')
        return value

    def _checked_factor(self, quantity: Any, text: str, name: str, gamma: float = 1.0) -> float:
        """Return the factor from a quantity's unit to code units. Raises UnitError unless its dimension is `name`.

        text: the quantity as the message writes it.
        """
        try:
            found = self._exponents_of(quantity)
        except UnitError as error:
            raise UnitError(f"{error}; expected {self.expected(name, gamma)}") from error
        if any(abs(x - y) > 1e-9 for x, y in zip(found, self.exponents(name, gamma), strict=True)):
            raise UnitError(f'"{text}" is {_dimension_words(quantity)}; expected {self.expected(name, gamma)}')
        return self._conversion_factor(quantity, found)

    def expected(self, name: str, gamma: float = 1.0) -> str:
        """Return a description of a value of the dimension `name` for messages, like 'a length, like "10 au"'."""
        example = EXAMPLES.get(self._density_resolved(name))
        if example:
            return f'{with_article(self._density_resolved(name))}, like "{example}"'
        return f'{with_article(name)}, like "1 {self._cgs_unit(self.exponents(name, gamma))}"'

    def show(self, value: float, name: str, gamma: float = 1.0, like: float | None = None) -> str:
        """Return `value`, in code units, as text: "123.4 yr", "5.2 au"; a bare number in the code system.

        like: value that chooses the unit; by default `value`.
        """
        if self.system == "code" or value == 0:
            return f"{value:.4g}"
        exponents = self.exponents(name, gamma)
        factor = self._cgs_factor(exponents)
        in_cgs, size = value * factor, abs((like or value) * factor)
        for text, least in _DISPLAY_UNITS.get(self._density_resolved(name), ()):
            if size / _cgs_value(text) >= least:
                return f"{in_cgs / _cgs_value(text):.4g} {text}"
        return f"{in_cgs:.4g} {self._cgs_unit(exponents)}"

    def _density_resolved(self, name: str) -> str:
        """Return the name of a dimension, where "density" becomes a surface density in 2D, a volume density in 1D."""
        if name == "density":
            return "surface_density" if self.dimensions == 2 else "volume_density"
        return name

    def _parsed_unit(self, text: str) -> Any:
        """Return a code unit, such as "1 au", as an astropy unit; None in the code system."""
        if self.system == "code":
            return None
        quantity = parse_quantity(text)
        return quantity.unit if quantity.value == 1 else astropy.units.Unit(quantity)

    def _code_unit(self, name: str) -> Any:
        """Return the code unit of the dimension `name` as an astropy unit; None in the code system."""
        if self.system == "code":
            return None
        mass, length, time = self.exponents(name)
        return self.mass**mass * self.length**length * self.time**time

    @cached_property
    def _bases_cgs(self) -> tuple[float, float, float]:
        """The code units of mass, length and time in cgs units; 1 in the code system."""
        if self.system == "code":
            return (1.0, 1.0, 1.0)
        return (self.mass.to(astropy.units.g), self.length.to(astropy.units.cm), self.time.to(astropy.units.s))

    def _cgs_factor(self, exponents: Exponents) -> float:
        """Return the code unit with these exponents of mass, length and time in cgs units; 1 in the code system."""
        return math.prod(base**power for base, power in zip(self._bases_cgs, exponents, strict=True))

    def _exponents_of(self, quantity: Any) -> Exponents:
        """Return the exponents of mass, length and time of a quantity's unit.

        Raises UnitError if the unit does not reduce to these, and in the code system if there is a unit.
        """
        try:
            unit = _in_cgs(quantity.unit)
        except astropy.units.UnitsError as error:
            raise UnitError(
                f'"{quantity}" has a unit that is not a product of powers of mass, length and time; use another unit'
            ) from error
        powers = {base.name: float(power) for base, power in zip(unit.bases, unit.powers, strict=True)}
        exponents = (powers.get("g", 0.0), powers.get("cm", 0.0), powers.get("s", 0.0))
        if self.system == "code" and any(exponents):
            raise UnitError(f'"{quantity}" has a unit, but the scene is in code units; give a number without unit')
        return exponents

    def _conversion_factor(self, quantity: Any, exponents: Exponents) -> float:
        """Return the factor from a quantity's unit to code units. Raises UnitError if the factor overflows.

        exponents: exponents of mass, length and time of the unit.
        """
        # Convert lengths and masses directly: if the code unit is 1 au, 1 au is exactly 1, not 1 + 1e-16.
        for name, own in (("mass", self.mass), ("length", self.length)):
            if own is not None and exponents == DIMENSIONS[name]:
                return float(quantity.unit.to(own))
        try:
            return float(_in_cgs(quantity.unit).scale / self._cgs_factor(exponents))
        except ArithmeticError:  # overflow, for example of cm100 for a steep polytrope
            wrong = f"{quantity.unit} overflows in code units"
            raise UnitError(f"{wrong}; use smaller powers, or other code units") from None

    @staticmethod
    def _cgs_unit(exponents: Exponents) -> str:
        """Return the cgs unit with these exponents as `parse_quantity` reads it, like "g cm-2".

        Powers that are not whole numbers are in brackets.
        """
        parts = []
        for base, power in zip(("g", "cm", "s"), exponents, strict=True):
            text = f"{power:.12g}"  # more digits would show the rounding of 1 - gamma
            if float(text) != 0.0:
                parts.append(base + ("" if text == "1" else text if float(text).is_integer() else f"({text})"))
        return " ".join(parts)


# Units of displayed values by dimension, in the order in which they are tried: (unit, smallest value shown in it).
_DISPLAY_UNITS = {
    "time": (("yr", 0.1), ("day", 0.1), ("s", 0.0)),
    "length": (("au", 1e-3), ("km", 1.0), ("m", 1.0), ("cm", 1.0), ("mm", 1.0), ("um", 1.0), ("nm", 0.0)),
    "mass": (("Msun", 1e-5), ("Mearth", 1e-7), ("g", 0.0)),
    "velocity": (("km/s", 0.1), ("m/s", 0.0)),
    "surface_density": (("g/cm2", 0.0),),
    "volume_density": (("g/cm3", 0.0),),
    "opacity": (("cm2/g", 0.0),),
}


def _in_cgs(unit: Any) -> Any:
    """Return an astropy unit as a number times powers of g, cm and s. Raises UnitsError for other bases."""
    return unit.decompose(bases=[astropy.units.g, astropy.units.cm, astropy.units.s])


@cache
def _cgs_value(text: str) -> float:
    """Return the unit that `text` names in cgs units."""
    return _in_cgs(astropy.units.Unit(text)).scale


def _dimension_words(quantity: Any) -> str:
    """Return the dimension of a quantity in words, like "a length", for messages."""
    words = str(quantity.unit.physical_type)
    if words == "unknown":
        return f"in {quantity.unit}"
    return "a plain number" if words == "dimensionless" else with_article(words)


def seconds(text: str) -> float:
    """Return the seconds of a wall-clock time such as "10 min". Raises UnitError."""
    expected = 'a wall-clock time, like "10 min"'
    quantity = parse_quantity(text, expected)
    if not quantity.unit.is_equivalent(astropy.units.s):
        raise UnitError(f'"{clipped(text)}" is {_dimension_words(quantity)}; expected {expected}')
    return quantity.to_value(astropy.units.s)


def clock(seconds: float) -> str:
    """Return a wall-clock time in seconds as text: "3.2 s", "4 min 5 s", "2 h 5 min"."""
    if seconds < 10.0:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 1:
        return f"{rest} s"
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {rest} s"
