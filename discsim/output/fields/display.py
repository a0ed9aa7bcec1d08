"""Display options of fields: window, range of colours, distance, wavelength and opacity.

`Snapshot.field`, `discsim.plot` and the command line have the same arguments; `display_options` converts them to
`DisplayOptions`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from numbers import Integral
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.output.fields.base import FieldError, PlotError
from discsim.output.fields.binned import Optics
from discsim.output.fields.names import field_named, matching_fields, of_population, single_field
from discsim.output.fields.values import (
    Window,
    default_window,
    fields_in_rings,
    fields_on_pixels,
    full_radius,
    polar_range,
)
from discsim.scene.units import UnitError, Units, clipped, parse_quantity

if TYPE_CHECKING:
    from discsim.output.snapshot import Snapshot

Array = np.ndarray
PIXELS = 480
MAX_PIXELS = 20_000  # a map of more takes more than 3 GB for each field
MAX_SIZE = 1e60  # numbers on axes are 0 or from 1/MAX_SIZE to MAX_SIZE in magnitude, as values of a scene
MARKS = ("bodies", "companions", "damping", "gap", "hill", "initial")  # what `plot/marks.py` can draw
MAX_LEVELS = 20
# Options of figures, and the kinds of figures that use them.
KINDS_OF_OPTION = {
    "cmap": ("map", "polar", "time", "phase"),
    "log_radius": ("profile", "polar", "time"),
    "contours": ("map", "polar", "time"),
    "streamlines": ("map", "polar"),
}
KIND_TEXT = {
    "map": "maps",
    "polar": "polar maps",
    "profile": "profiles",
    "time": "maps in radius and time",
    "phase": "scatter plots",
}
FRAMES = ("scene", "kepler", "companion", "companion.N")  # of streamlines; N is the number of a companion from 1
RANGE_TEXT = f"{1.0 / MAX_SIZE:g} to {MAX_SIZE:g}"


@dataclass(frozen=True)
class DisplayOptions:
    """Display options of a figure or field.

    `window` is the region to show. Its numbers are (R), half the side of a square or the outer radius; (R1, R2), a
    range of radii; or (X, Y, R), the middle and half the side. `window` is a text like "50 au,80 au", a Quantity, or
    an array in code units. A Quantity or an array may also have the corners (lower, upper). `limits` are the lowest
    and the highest value on the colour bar or axis, in its unit. `distance` is the distance of the disc as an
    astropy Quantity, with which maps have angles in arcsec. `corners` (of a map) and `ends` (a range of radii), in
    code units, replace `window` if they are set; see `common_to`. `marks` are names in MARKS of what to draw besides
    the field; None stands for the defaults of a figure. `cmap` is a colour map of matplotlib. With `log_radius` radii
    are on a logarithmic axis. `contours` are the name of a field and the levels of its contour lines in the unit of
    axes, () for levels by default. `streamlines` is a frame for the velocity, one of FRAMES. `prefix` precedes the
    names of arguments in messages, such as "--".
    """

    window: Any = None
    limits: tuple[float, float] | None = None
    distance: Any = None
    optics: Optics | None = None
    corners: Window | None = None
    ends: tuple[float, float] | None = None
    pixels: int = PIXELS
    marks: frozenset[str] | None = None
    prefix: str = ""
    cmap: Any = None
    log_radius: bool = False
    contours: tuple[str, tuple[float, ...]] | None = None
    streamlines: str | None = None

    def used_for(self, kind: str) -> DisplayOptions:
        """Return these options. Raises PlotError if one of them has no effect on a figure of this kind."""
        for name, kinds in KINDS_OF_OPTION.items():
            if getattr(self, name) and kind not in kinds:
                used = ", ".join(KIND_TEXT[each] for each in kinds)
                raise PlotError(
                    f"{self._argument(name)}: used only for {used}, not for {KIND_TEXT[kind]}; leave it out"
                )
        return self

    def _argument(self, name: str) -> str:
        """Return the name of an argument for messages."""
        return f"{self.prefix}{name.replace('_', '-') if self.prefix else name}"

    def map_window(self, snap: Snapshot) -> Window:
        """Return the corners of the window in code units; by default those around the disc or box. Raises PlotError."""
        if self.corners is not None:
            return self.corners
        given = self._lengths(snap.units)
        if given.ndim == 2:
            return given[0], given[1]
        if len(given) == 0:
            return default_window(snap)
        if len(given) == 2:
            raise self._wrong('is a range of radii; for a map expected "R" or "X,Y,R"')
        middle = given[:2] if len(given) == 3 else np.zeros(2)
        return middle - given[-1], middle + given[-1]

    def radii(self, snap: Snapshot, is_polar: bool = False) -> tuple[float, float]:
        """Return the range of radii (in 1D of positions) to show, in code units. Raises PlotError.

        Radii that `window` does not give are those of the disc: for a polar map the radii of `polar_range`, otherwise
        0 and `full_radius`. On a logarithmic axis the inner radius is that of a polar map, and radii must be positive.
        """
        if not self.log_radius:
            return self._radii(snap, is_polar)
        if snap.dimensions == 1:
            raise PlotError(f"{self._argument('log_radius')}: the run is in one dimension; leave it out")
        low, high = self._radii(snap, is_polar)
        if not 0.0 < low < high:
            wanted = 'expected two radii above 0; give them as --window "R1,R2"'.replace("--", self.prefix)
            raise PlotError(
                f"{self._argument('log_radius')}: the radii are {low:g} to {high:g} in code units; {wanted}"
            )
        return low, high

    def _radii(self, snap: Snapshot, is_polar: bool) -> tuple[float, float]:
        """Return the range of radii to show, which may start at 0. Raises PlotError."""
        if self.ends is not None:
            return self.ends
        given = self._lengths(snap.units)
        if given.ndim == 2 or len(given) == 3:
            raise self._wrong('is a region of the plane; expected a radius "R" or two radii "R1,R2"')
        if len(given) == 2:
            return float(given[0]), float(given[1])
        if snap.dimensions == 1:
            low, high = (-given[0], given[0]) if len(given) else (snap.lower[0], snap.upper[0])
            return float(low), float(high)
        inner, outer = polar_range(snap) if is_polar else (0.0, full_radius(snap))
        if self.log_radius:
            inner = polar_range(snap)[0]
        return inner, float(given[0]) if len(given) else outer

    def common_to(self, snaps: Sequence[Snapshot], kind: str) -> DisplayOptions:
        """Return these options with one region for several snapshots, which contains the regions of all snapshots.

        For `kind` "map" the region is in `corners`, otherwise in `ends`. Raises PlotError.
        """
        if kind == "map":
            windows = [self.map_window(snap) for snap in snaps]
            corners = np.min([low for low, _ in windows], axis=0), np.max([high for _, high in windows], axis=0)
            return replace(self, corners=corners)
        spans = [self.radii(snap, kind == "polar") for snap in snaps]
        return replace(self, ends=(min(low for low, _ in spans), max(high for _, high in spans)))

    def _lengths(self, units: Units) -> Array:
        """Return `window` in code units: one to three lengths, or corners (2, 2); without a window, an empty array.

        Raises PlotError.
        """
        if self.window is None:
            return np.zeros(0)
        try:
            if isinstance(self.window, str):
                given = np.array([self._length(text, units) for text in self.window.split(",")])
            else:
                given = np.atleast_1d(self._in_code(self.window, units, _message_text(self.window)))
        except UnitError as error:
            raise PlotError(f"{self.prefix}window: {error}") from None
        if not _in_range(given):
            raise self._wrong(f"is out of range; expected 0, or absolute values from {RANGE_TEXT} in code units")
        if given.ndim > 1:
            if given.shape == (2, 2) and (given[0] < given[1]).all():
                return given
            raise self._wrong('is not a region of the plane; expected text like "50 au", or corners (lower, upper)')
        rising = len(given) != 2 or given[0] < given[1]
        if len(given) not in (1, 2, 3) or not rising or (len(given) != 2 and given[-1] <= 0.0):
            raise self._wrong('is not a region of the disc; expected "R", "R1,R2" or "X,Y,R", with R > 0 and R1 < R2')
        return given

    def _wrong(self, words: str) -> PlotError:
        """Return the error for a wrong window; `words` continue the sentence."""
        return PlotError(f'{self.prefix}window: "{_message_text(self.window)}" {words}')

    def _length(self, text: str, units: Units) -> float:
        """Return the length in a text, in code units; the text may give an angle if `distance` is set.

        Raises UnitError.
        """
        if units.system == "code":
            return units.of_text(text, "length")
        given = parse_quantity(text, units.expected("length"))
        if given.unit.is_equivalent("arcsec"):
            return float(self._in_code(given, units, text))
        return units.parse(text, "length")

    def _in_code(self, given: Any, units: Units, text: str) -> Any:
        """Return a length or lengths in code units: numbers unchanged, a Quantity converted.

        The Quantity may be an angle if `distance` is set. `text` is the argument in messages. Raises UnitError.
        """
        if not hasattr(given, "unit"):
            return given
        if given.unit.is_equivalent("arcsec"):
            if self.distance is None:
                raise UnitError(f'"{text}" is an angle, but no distance is given; give a length, or add the distance')
            given = given.to_value("rad") * self.distance
        return units.in_code(given, "length")

    def arcsec_per_au(self, units: Units) -> float | None:
        """Return arcsec per au at `distance`; None if `distance` is not set.

        Raises PlotError for a scene in code units.
        """
        if self.distance is None:
            return None
        if units.system == "code":
            wrong = "the scene is in code units, so lengths cannot be converted to angles; remove the distance"
            raise PlotError(f"{self.prefix}distance: {wrong}")
        return 1.0 / float(self.distance.to_value("pc"))


def display_options(
    window: Any = None, limits: Any = None, distance: Any = None, wavelength: Any = None, opacity: Any = None,
    pixels: int = PIXELS, mark: Any = None, prefix: str = "", *, cmap: Any = None, log_radius: bool = False,
    contours: str | None = None, streamlines: str | None = None,
) -> DisplayOptions:  # fmt: skip
    """Return display options from arguments of the command line or of Python functions. Raises PlotError.

    The first five arguments are texts like "50 au", "1e-3,10", "140 pc", "1.3 mm" and "2 cm2/g". They may also be
    Quantities, except `limits`, which may be a pair of numbers. `window` may also be an array in code units. `mark` is
    a text like "gap,hill" or "none", or a sequence of names. `contours` is a text like "toomre_q=1,2".
    """
    optics = None
    if wavelength is not None or opacity is not None:
        seen = positive_quantity(
            Optics.default().wavelength if wavelength is None else wavelength, f"{prefix}wavelength", "mm"
        )
        optics = Optics(seen, None if opacity is None else positive_quantity(opacity, f"{prefix}opacity", "cm2/g"))
    away = None if distance is None else positive_quantity(distance, f"{prefix}distance", "pc")
    ends = None if limits is None else _parse_limits(limits, "--range" if prefix else "limits")
    if cmap is not None:
        from discsim.output.ink import checked_colour_map  # imports matplotlib

        cmap = checked_colour_map(cmap, prefix)
    return DisplayOptions(
        _parse_window(window, prefix), ends, away, optics, pixels=checked_pixels(pixels, prefix),
        marks=_parse_marks(mark, prefix), prefix=prefix, cmap=cmap, log_radius=bool(log_radius),
        contours=_parse_contours(contours, f"{prefix}contours"),
        streamlines=_parse_frame(streamlines, f"{prefix}streamlines"),
    )  # fmt: skip


def _parse_contours(given: Any, name: str) -> tuple[str, tuple[float, ...]] | None:
    """Return the field and the increasing levels in a text like "toomre_q=1,2"; no levels in "toomre_q".

    Raises PlotError, FieldError.
    """
    if given is None:
        return None
    word, equals, text = str(given).partition("=")
    try:
        matching_fields(word or "no field")
    except FieldError as error:
        raise FieldError(f"{name}: {error}") from None
    try:
        levels = sorted({float(part) for part in text.split(",")}) if equals else []
    except ValueError:
        levels = [math.nan]
    if not all(math.isfinite(level) and _in_range(level) for level in levels) or len(levels) > MAX_LEVELS:
        wanted = f"expected FIELD, or FIELD=LEVEL,LEVEL,... with at most {MAX_LEVELS} numbers in the unit of the field"
        raise PlotError(f'{name}: "{_message_text(given)}"; {wanted}')
    return word, tuple(levels)


def _parse_frame(given: Any, name: str) -> str | None:
    """Return the frame of streamlines. Raises PlotError."""
    if given is None:
        return None
    kind, dot, number = str(given).partition(".")
    is_number = number.isascii() and number.isdigit() and len(number) < 4 and int(number) > 0
    if kind not in FRAMES or (dot and not (kind == "companion" and is_number)):
        raise PlotError(f'{name}: "{_message_text(given)}"; expected one of {", ".join(FRAMES)}')
    return str(given)


def checked_pixels(pixels: Any, prefix: str = "") -> int:
    """Return a number of pixels as int. Raises PlotError unless it is a whole number from 1 to MAX_PIXELS."""
    if isinstance(pixels, bool) or not isinstance(pixels, Integral) or not 1 <= int(pixels) <= MAX_PIXELS:
        raise PlotError(f"{prefix}pixels: {_message_text(pixels)}; expected a whole number from 1 to {MAX_PIXELS:_}")
    return int(pixels)


def _parse_marks(given: Any, prefix: str) -> frozenset[str] | None:
    """Return the argument `mark`, names with commas or a sequence of names, as a set. Raises PlotError."""
    if given is None:
        return None
    names = given.split(",") if isinstance(given, str) else list(given) if isinstance(given, Iterable) else [given]
    if names == ["none"]:
        return frozenset()
    for name in names:
        if name not in MARKS:
            wanted = f"names of {', '.join(MARKS)}, separated by commas, or none"
            raise PlotError(f'{prefix}mark: "{_message_text(name)}" is unknown; expected {wanted}')
    return frozenset(names)


def _parse_window(given: Any, prefix: str) -> Any:
    """Return the argument `window` as a text, Quantity or array of floats. Raises PlotError."""
    if given is None or isinstance(given, str) or hasattr(given, "unit"):
        return given
    try:
        return np.asarray(given, dtype=float)
    except (TypeError, ValueError):
        wanted = 'text like "50 au", a Quantity, or numbers in code units'
        raise PlotError(f"{prefix}window: {_message_text(given)}; expected {wanted}") from None


def _parse_limits(given: Any, name: str) -> tuple[float, float]:
    """Return the argument `limits`, a text or a pair, as two numbers. Raises PlotError."""
    try:
        low, high = (float(part) for part in (given.split(",") if isinstance(given, str) else given))
    except (TypeError, ValueError):
        wanted = "expected two numbers, LOW,HIGH, in the unit of the colour bar or axis"
        raise PlotError(f'{name}: "{_message_text(given)}"; {wanted}') from None
    if not low < high:
        raise PlotError(f'{name}: "{_message_text(given)}"; expected LOW below HIGH')
    if not _in_range((low, high)):
        raise PlotError(
            f'{name}: "{_message_text(given)}" is out of range; expected 0, or absolute values from {RANGE_TEXT}'
        )
    return low, high


def _in_range(given: Any) -> bool:
    """Return whether each number is 0, or its magnitude lies in the range that axes can show."""
    size = np.abs(given)
    return bool(((size == 0.0) | ((size >= 1.0 / MAX_SIZE) & (size <= MAX_SIZE))).all())


def _message_text(given: Any) -> str:
    """Return the argument `given` for a message, as one line of limited length."""
    return clipped(" ".join(str(given).split()))


def positive_quantity(given: Any, name: str, unit: str) -> Any:
    """Return an argument as a positive astropy Quantity with the dimension of `unit`. Raises PlotError."""
    expected = f"a value above 0 with a unit like {unit}"
    try:
        value = given if hasattr(given, "unit") else parse_quantity(str(given), expected)
    except UnitError as error:
        raise PlotError(f"{name}: {error}") from None
    if np.ndim(value.value) != 0 or not value.unit.is_equivalent(unit) or not value.value > 0.0:
        raise PlotError(f'{name}: "{_message_text(given)}"; expected {expected}')
    if not _in_range(value.to_value(unit)):
        raise PlotError(f'{name}: "{_message_text(given)}" is out of range; expected {RANGE_TEXT} {unit}')
    return value


def field_of(snap: Snapshot, name: str, edges: Any = None, **given: Any) -> Any:
    """Return the field `name` as a Quantity, as `Snapshot.field` does; `given` are arguments of `display_options`."""
    name = single_field(name, snap)
    field, snap, display = field_named(name), snap.about_centre(), display_options(**given)
    display.arcsec_per_au(snap.units)  # raises PlotError for a distance without physical units
    if edges is not None:
        values = fields_in_rings(snap, edges_in_code_units(edges, snap.units, snap.dimensions), display.optics)[name]
    elif display.window is not None or field.kind != "particles":
        if snap.dimensions == 1:
            raise FieldError(f"{name}: a run in one dimension has no map; give the argument edges, for bins in x")
        values = fields_on_pixels(snap, display.map_window(snap), display.pixels, display.optics)[name]
    else:
        values = field.values(of_population(name, snap)[0])
    return field.quantity(snap.units, values)


def edges_in_code_units(given: Any, units: Units, dimensions: int) -> Array:
    """Return `given`, the user's edges of rings (in 1D: of bins), as floats in code units. Raises PlotError."""
    try:
        edges = np.asarray(units.in_code(given, "length") if hasattr(given, "unit") else given, dtype=float)
    except UnitError as error:
        raise PlotError(f"edges: {error}") from None
    except (TypeError, ValueError):
        raise PlotError(f"edges: {_message_text(given)}; expected numbers in code units, or a Quantity") from None
    if edges.ndim != 1 or len(edges) < 2 or not (np.diff(edges) > 0.0).all():
        raise PlotError(f"edges: {_message_text(given)}; expected at least two increasing numbers")
    if dimensions == 2 and edges[0] < 0.0:
        raise PlotError(f"edges: {_message_text(given)}; expected radii of 0 or more")
    return edges
