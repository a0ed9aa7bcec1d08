"""Types of the keys of a scene, with their dimensions, limits and descriptions of defaults.

The `Measure` of a key names its dimension. Validation converts texts such as "0.6 au" to floats in code units. The
validation context of pydantic, `info.context`, has the `Units` and `OrbitalPeriods` of the scene, and the folder of the
scene file.
"""

from __future__ import annotations

import errno
import hashlib
import math
import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel, BeforeValidator, ConfigDict, Discriminator, Field, Tag, ValidationInfo
from pydantic_core import PydanticCustomError, core_schema

from discsim.printable import printable
from discsim.scene.orbits import FaultyTableError, OrbitalPeriods, mentions_orbits
from discsim.scene.units import UnitError, Units, clipped, seconds
from discsim.userfiles import open_plain

MAX_PARTICLES = 10_000_000_000
MAX_SNAPSHOTS = 1_000_000
MAX_COURANT = 100.0  # above 2.5 sound and orbits are unstable; larger values suit drag alone, exact at any step
LARGEST = 1e60  # bound on |x| and |1/x| of a value x in code units, so that products do not overflow
MAX_GAMMA = 100.0  # bound on gamma, so that rho^gamma does not overflow


def fault(message: str) -> PydanticCustomError:
    """Return a validation error of pydantic with `message` as its text."""
    return PydanticCustomError("fault", "{message}", {"message": message})


def number(value: Any) -> float:
    """Return a plain number as a float. Raises a `fault` for other values, and for numbers out of range (LARGEST)."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise fault(f"{shown(value)} is not a number; expected a plain number, without unit or quotes")
    try:
        value = float(value)
    except OverflowError:
        value = math.inf
    return _check_range(value, f"{value}")


def _check_range(value: float, text: str) -> float:
    """Return `value`. Raises a `fault` unless it is 0, or its magnitude is from 1/LARGEST to LARGEST.

    text: `value` as the message writes it.
    """
    if not math.isfinite(value):
        raise fault(f"{text} is not a finite number")
    if value != 0.0 and not 1.0 / LARGEST <= abs(value) <= LARGEST:
        raise fault(
            f"{text} is out of range; expected 0, or an absolute value from {1.0 / LARGEST:g} to {LARGEST:g} "
            f"in code units"
        )
    return value


def units_of(info: ValidationInfo) -> Units:
    """Return the units of the scene that pydantic validates."""
    assert info.context is not None
    return info.context["units"]


def shown(value: Any) -> str:
    """Return a value as messages show it: as in TOML, and shortened if it is long."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{clipped(value)}"'
    try:
        return clipped(str(value))
    except (ValueError, RecursionError):  # too many digits for Python, or a list nested without end
        return f"the {type(value).__name__}"


@dataclass(frozen=True)
class Default:
    """Description of a default that depends on other keys or on the computer, for the reference of keys."""

    words: str


@dataclass(frozen=True)
class AllowedValues:
    """Description of the allowed values of a key whose type does not show them, for the reference of keys."""

    words: str


@dataclass(frozen=True)
class Measure:
    """Physical dimension of a key, and the conversion of its value to code units.

    name: a dimension of `discsim.scene.units`, or "" for plain numbers. vector: whether the value is a tuple, with one
    float per dimension of space. whole: whether the components of a vector must be whole numbers. words: texts that are
    allowed in place of a quantity.
    """

    name: str = ""
    vector: bool = False
    whole: bool = False
    words: tuple[str, ...] = ()

    def __get_pydantic_core_schema__(self, source: Any, handler: Callable[[Any], Any]) -> Any:
        read = self._read_vector if self.vector else self._read_quantity
        return core_schema.with_info_before_validator_function(read, handler(source))

    def _read_quantity(self, value: Any, info: ValidationInfo) -> Any:
        """Return a quantity in code units; None and the texts in `words` are returned unchanged."""
        if value is None or (isinstance(value, str) and value in self.words):
            return value
        units = units_of(info)
        if self.name == "time" and mentions_orbits(value):
            return _time_of_orbits(value, info)
        if not self.name or units.system == "code":
            if self.name and isinstance(value, str):
                raise fault(f"{shown(value)} is text, but the scene is in code units; expected a number without quotes")
            return number(value)
        gamma = info.data.get("gamma", 2.0)  # validated earlier, as a key of the same table
        or_words = "".join(f', or "{word}"' for word in self.words)
        if isinstance(value, str):
            try:
                return _check_range(units.parse(value, self.name, gamma), shown(value))
            except UnitError as error:
                raise fault(f"{error}{or_words}") from error
        expected = units.expected(self.name, gamma) + or_words
        if isinstance(value, int | float) and not isinstance(value, bool):
            raise fault(f"{shown(value)} has no unit; {expected.replace(', like', ' needs a unit, like')}")
        raise fault(f"{shown(value)} is not a quantity; expected {expected}")

    def _read_vector(self, value: Any, info: ValidationInfo) -> tuple[float, ...]:
        """Return a vector in code units, one component per dimension of space; a scalar is the x component."""
        if value == 0 and not isinstance(value, bool):  # zero, the default, needs no unit
            return (0.0,) * units_of(info).dimensions
        entries = _one_per_dimension(value, info) if isinstance(value, list | tuple) else [value]
        read = [self._read_quantity(entry, info) or 0.0 for entry in entries]
        read += [0.0] * (units_of(info).dimensions - len(read))
        if self.whole and any(entry != int(entry) for entry in read):
            raise fault(f"{shown(value)} is not a list of whole numbers")
        return tuple(read)


def _time_of_orbits(text: str, info: ValidationInfo) -> float:
    """Return a number of orbits like "40 orbits at 5.2 au" as a time in code units. Raises a `fault`.

    If this text is correct, but the star or a companion is not, the fault is secondary to theirs.
    """
    assert info.context is not None
    periods: OrbitalPeriods = info.context["orbits"]
    try:
        return _check_range(periods.parse(text), shown(text))
    except FaultyTableError as error:
        raise PydanticCustomError("secondary_fault", "{message}", {"message": str(error)}) from error
    except UnitError as error:
        raise fault(str(error)) from error


def _one_per_dimension(value: Sequence[Any], info: ValidationInfo) -> Sequence[Any]:
    """Return `value`. Raises a `fault` unless it has one entry per dimension of space."""
    dimensions = units_of(info).dimensions
    if len(value) != dimensions:
        raise fault(
            f"{shown(list(value))} has {len(value)} values; expected {dimensions}, one for each dimension of space"
        )
    return value


def whole_number(value: Any) -> int:
    """Return a whole number as an int. Raises a `fault` for any other value."""
    read = number(value)
    if read != int(read):
        raise fault(f"{shown(value)} is not a whole number")
    return int(read)


def _read_particles(value: Any) -> int:
    """Return a number of particles. Raises a `fault` unless it is a whole number from 1 to MAX_PARTICLES."""
    read = whole_number(value)
    if not 1 <= read <= MAX_PARTICLES:
        wrong = "is too large" if read > 1 else "is too small"
        raise fault(f"{shown(value)} {wrong}; expected a number of particles from 1 to 1e10")
    return read


def _read_seconds(value: Any) -> float:
    """Return the seconds of a wall-clock time such as "10 min". Raises a `fault` for any other value."""
    if not isinstance(value, str):
        raise fault(f'{shown(value)} is not a wall-clock time; expected a time in quotes, like "10 min"')
    try:
        return seconds(value)
    except UnitError as error:
        raise fault(str(error)) from error


def _read_orbits(value: Any) -> float:
    """Return the number of orbits that a value means, such as 2 or "2 orbits". Raises a `fault` for any other value."""
    if not isinstance(value, str):
        return number(value)
    words = value.split()
    try:
        if len(words) != 2 or words[1] not in ("orbit", "orbits"):
            raise ValueError
        return number(float(words[0]))
    except ValueError:  # also the fault of `number`
        raise fault(f'{shown(value)} is not a number of orbits; expected a number like 2 or "2 orbits"') from None


def sides_of_space(value: Any, info: ValidationInfo) -> Sequence[Any]:
    """Return the values of the sides of space, one per dimension; a single value is the side of a square."""
    is_list = isinstance(value, list | tuple)
    return _one_per_dimension(value if is_list else [value] * units_of(info).dimensions, info)


Number = Annotated[float, Measure()]
Count = Annotated[int, BeforeValidator(whole_number)]
Particles = Annotated[int, BeforeValidator(_read_particles)]
Seconds = Annotated[float, Field(gt=0), BeforeValidator(_read_seconds)]
Orbits = Annotated[float, BeforeValidator(_read_orbits), AllowedValues("number of orbits")]
Length = Annotated[float, Measure("length")]
Mass = Annotated[float, Measure("mass")]
Time = Annotated[float, Measure("time")]
Velocity = Annotated[float, Measure("velocity")]
Density = Annotated[float, Measure("density")]
Diffusivity = Annotated[float, Measure("diffusivity")]
SurfaceDensity = Annotated[float, Measure("surface_density")]
VelocityVector = Annotated[tuple[float, ...], Measure("velocity", vector=True)]
AccelerationVector = Annotated[tuple[float, ...], Measure("acceleration", vector=True)]


@dataclass(frozen=True)
class InputFile:
    """A file that a scene names, with the SHA-256 digest of its content.

    Two files are equal if their contents are equal; their paths may differ.
    """

    path: Path = field(compare=False)
    digest: str

    def __str__(self) -> str:
        return f'"{printable(self.path.name)}"'

    @classmethod
    def read(cls, value: Any, info: ValidationInfo, max_bytes: float = math.inf) -> InputFile:
        """Return the file that `value` names by a path relative to the scene's folder.

        Raises a `fault` if this is not a plain file that can be read, or if it has more than `max_bytes` bytes.
        """
        if not isinstance(value, str) or not value:
            raise fault(f'{shown(value)} is not a file name; expected a name in quotes, like "profile.txt"')
        try:
            path = (info.context or {}).get("folder", Path()) / Path(value).expanduser()
            with open_plain(path) as file:
                if os.fstat(file.fileno()).st_size > max_bytes:
                    raise OSError(errno.EFBIG, f"is larger than {max_bytes / 2**20:.3g} MiB")
                return cls(path.absolute(), hashlib.file_digest(file, "sha256").hexdigest())
        except OSError as error:
            where, reason = str(path), error.strerror or str(error)
        except (ValueError, RuntimeError) as error:  # an invalid file name, or a user without a home directory
            where, reason = "", str(error)
        begins = f"{shown(value)}: {where}: " if where else f"{shown(value)}: "
        wrong = f"{begins}{reason[:1].lower()}{reason[1:]}"
        raise fault(f"{wrong}; expected the path of a readable file, relative to the folder of the scene file")


class Table(BaseModel):
    """Base class of the tables of a scene: tables are frozen, and unknown keys are errors."""

    model_config = ConfigDict(frozen=True, extra="forbid")


def kinds_of(parts: Iterable[Any]) -> Any:
    """Return the type of a table whose key `kind` selects one of the table models `part.keys` of `parts`."""
    models = tuple(part.keys for part in parts)
    return Annotated[Union[models], Field(discriminator="kind")]  # noqa: UP007 - the members are known at run time only


def value_or_table(value: Any, table: type[Table]) -> Any:
    """Return the type of a key that accepts a value of the type `value`, or a `table`."""
    tagged = Annotated[value, Tag("#value")] | Annotated[table, Tag("#table")]  # type: ignore[valid-type]
    return Annotated[tagged, Discriminator(lambda given: "#table" if isinstance(given, dict | table) else "#value")]


def word_of(names: Iterable[str]) -> Any:
    """Return the type of a key that accepts one of `names`."""
    return Literal[tuple(names)]


def models_in(annotation: Any) -> list[type[Table]]:
    """Return the table models in a type; the members of a union are searched too."""
    if isinstance(annotation, type) and issubclass(annotation, Table):
        return [annotation]
    return [model for part in get_args(annotation) for model in models_in(part)]


def measure_of(field: Any) -> Measure | None:
    """Return the `Measure` of a pydantic field, from its metadata or its annotation; None if the field has none."""

    def search(part: Any) -> Any:
        found = [entry for entry in getattr(part, "__metadata__", ()) if isinstance(entry, Measure)]
        return found or [measure for inner in get_args(part) for measure in search(inner)]

    own = [entry for entry in field.metadata if isinstance(entry, Measure)]
    return next(iter(own or search(field.annotation)), None)


def choices_in(annotation: Any) -> list[Any]:
    """Return all values that the Literals in a type allow."""
    if get_origin(annotation) is Literal:
        return list(get_args(annotation))
    return [choice for part in get_args(annotation) for choice in choices_in(part)]
