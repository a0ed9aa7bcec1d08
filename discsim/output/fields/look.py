"""How a field is seen: the part of the disc, the range of colours, how far away it is and how its dust is seen.

`Snapshot.field`, `discsim.plot` and the command line take the same arguments, and make a `Look` of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.output.fields.base import FieldError, PlotError
from discsim.output.fields.binned import Optics
from discsim.output.fields.names import of_run
from discsim.output.fields.values import Window, hole, in_rings, on_pixels, reach, shown_window
from discsim.parts import FIELDS
from discsim.scene.units import UnitError, Units, parse_quantity

if TYPE_CHECKING:
    from discsim.output.snapshot import Snapshot

PIXELS = 480


@dataclass(frozen=True)
class Look:
    """window: "R", "R1,R2" or "X,Y,R", lengths as texts like "50 au". limits: least and greatest value of the colours
    or axis, in the unit shown. distance: an astropy Quantity, for angles in arcsec. corners, ends: of a part of the
    plane and of radius that several snapshots share, in code units. prefix: of the arguments' names in messages.
    """

    window: str | None = None
    limits: tuple[float, float] | None = None
    distance: Any = None
    optics: Optics | None = None
    corners: Window | None = None
    ends: tuple[float, float] | None = None
    pixels: int = PIXELS
    prefix: str = ""

    def map_window(self, snap: Snapshot) -> Window:
        """Corners in code units: the given part of the plane, or the disc, or the box. Raises PlotError."""
        if self.corners is not None:
            return self.corners
        given = self._lengths(snap.units)
        if not given:
            return shown_window(snap)
        if len(given) == 2:
            raise self._wrong('is a range of radii; expected "R" or "X,Y,R" for a map')
        middle = np.array(given[:2]) if len(given) == 3 else np.zeros(2)
        return middle - given[-1], middle + given[-1]

    def radii(self, snap: Snapshot, inner: float = 0.0) -> tuple[float, float]:
        """Radii (in 1D places) between which to draw, in code units, by default from `inner`. Raises PlotError."""
        if self.ends is not None:
            return self.ends
        given = self._lengths(snap.units)
        if len(given) == 3:
            raise self._wrong('is a part of the plane; expected "R" or "R1,R2" in radius')
        if snap.dimensions == 1:
            low, high = float(snap.lower[0]), float(snap.upper[0])
            return (given[0], given[1]) if len(given) == 2 else (-given[0], given[0]) if given else (low, high)
        return (given[0], given[1]) if len(given) == 2 else (inner, given[0] if given else reach(snap))

    def shared(self, snaps: Sequence[Snapshot], kind: str) -> Look:
        """The same for all snapshots: what is shown of any of them. Raises PlotError."""
        if kind == "map":
            windows = [self.map_window(snap) for snap in snaps]
            corners = np.min([low for low, _ in windows], axis=0), np.max([high for _, high in windows], axis=0)
            return replace(self, corners=corners)
        spans = [self.radii(snap, 0.9 * hole(snap) if kind == "polar" else 0.0) for snap in snaps]
        return replace(self, ends=(min(low for low, _ in spans), max(high for _, high in spans)))

    def _lengths(self, units: Units) -> list[float]:
        if self.window is None:
            return []
        try:
            given = [self._length(text, units) for text in self.window.split(",")]
        except ValueError as error:
            words = str(error) if isinstance(error, UnitError) else "expected numbers, as lengths in code units are"
            raise PlotError(f"{self.prefix}window: {words}") from None
        rising = len(given) != 2 or given[0] < given[1]
        if len(given) > 3 or not rising or (len(given) != 2 and given[-1] <= 0.0):
            raise self._wrong('is no part of a disc; expected "R", "R1,R2" or "X,Y,R", with R above 0 and R1 < R2')
        return given

    def _wrong(self, words: str) -> PlotError:
        return PlotError(f'{self.prefix}window: "{self.window}" {words}')

    def _length(self, text: str, units: Units) -> float:
        if units.system == "code":
            return float(text)
        given = parse_quantity(text, units.expected("length"))
        if not given.unit.is_equivalent("arcsec"):
            return units.parse(text, "length")
        if self.distance is None:
            raise UnitError(f'"{text}" is an angle; expected a length, or a distance too')
        return float(units.in_code(given.to_value("rad") * self.distance, "length"))

    def arcsec(self, units: Units) -> float | None:
        """Arcsec in an au; None where no distance is given. Raises PlotError in code units."""
        if self.distance is None:
            return None
        if units.system == "code":
            raise PlotError(f"{self.prefix}distance: the scene is in code units, in which lengths have no angle")
        return 1.0 / float(self.distance.to_value("pc"))


def look_of(
    window: Any = None,
    limits: Any = None,
    distance: Any = None,
    wavelength: Any = None,
    opacity: Any = None,
    pixels: int = PIXELS,
    prefix: str = "",
) -> Look:
    """A look from texts like "50 au", "1e-3,10", "140 pc", "1.3 mm" and "2 cm2/g", or from what Python has for these:
    Quantities, corners of a window and a pair of limits. Raises PlotError.
    """
    optics = None
    if wavelength is not None or opacity is not None:
        usual = Optics.usual().wavelength
        seen = usual if wavelength is None else _quantity(wavelength, f"{prefix}wavelength", "mm")
        optics = Optics(seen, None if opacity is None else _quantity(opacity, f"{prefix}opacity", "cm2/g"))
    away = None if distance is None else _quantity(distance, f"{prefix}distance", "pc")
    text, corners = _window(window, prefix)
    ends = None if limits is None else _limits(limits)
    return Look(text, ends, away, optics, corners, pixels=pixels, prefix=prefix)


def _window(given: Any, prefix: str) -> tuple[str | None, Window | None]:
    """The text of a window, or its corners in code units."""
    if given is None or isinstance(given, str):
        return given, None
    if hasattr(given, "unit"):
        return ",".join(f"{value} {given.unit}" for value in np.ravel(given.value)), None
    if np.ndim(given) == 0:
        return str(given), None
    corners = np.asarray(given, dtype=float)
    if corners.shape != (2, 2) or not (corners[0] < corners[1]).all():
        raise PlotError(f'{prefix}window: {given}; expected a text like "50 au", or corners (lower, upper)')
    return None, (corners[0], corners[1])


def _limits(given: Any) -> tuple[float, float]:
    try:
        low, high = (float(part) for part in (given.split(",") if isinstance(given, str) else given))
    except (TypeError, ValueError):
        raise PlotError(f'--range: "{given}"; expected two numbers, LOW,HIGH, in the unit shown') from None
    if not low < high:
        raise PlotError(f'--range: "{given}"; expected LOW below HIGH')
    return low, high


def _quantity(given: Any, name: str, unit: str) -> Any:
    """An argument as an astropy Quantity above 0, of the dimension of `unit`. Raises PlotError."""
    expected = f"a value above 0 with a unit like {unit}"
    try:
        value = given if hasattr(given, "unit") else parse_quantity(str(given), expected)
    except UnitError as error:
        raise PlotError(f"{name}: {error}") from None
    if not value.unit.is_equivalent(unit) or value.value <= 0:
        raise PlotError(f'{name}: "{given}"; expected {expected}')
    return value


def field_of(snap: Snapshot, name: str, edges: Any = None, **given: Any) -> Any:
    """Result of `Snapshot.field`."""
    found = of_run(name, snap)
    if len(found) > 1:
        raise FieldError(f'"{name}" is of several species; expected one of {", ".join(found)}')
    field, snap, look = FIELDS[found[0]], snap.about_centre(), look_of(**given)
    look.arcsec(snap.units)
    if edges is not None:
        radii = snap.units.in_code(edges, "length") if hasattr(edges, "unit") else edges
        values = in_rings(snap, radii, look.optics)[found[0]]
    elif look.window is not None or look.corners is not None or field.kind != "particles":
        if snap.dimensions == 1:
            raise FieldError(f"{found[0]}: a run in one dimension has no map; expected edges, between which to average")
        values = on_pixels(snap, look.map_window(snap), look.pixels, look.optics)[found[0]]
    else:
        values = field.values(snap)
    return field.quantity(snap.units, values)
