"""How a figure is to look: the part of the disc, the range of colours, how far away it is and how its dust is seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.output.fields.binned import Optics
from discsim.output.fields.values import Window, hole, reach, shown_window
from discsim.plot.sources import PlotError
from discsim.scene.units import UnitError, Units, parse_quantity

if TYPE_CHECKING:
    from discsim.output.snapshot import Snapshot

PIXELS = 480


@dataclass(frozen=True)
class Look:
    """window: "R", "R1,R2" or "X,Y,R", lengths as texts like "50 au". limits: least and greatest value of the colours
    or axis, in the unit shown. distance: an astropy Quantity, for angles in arcsec. corners, ends: of a part of the
    plane and of radius that several snapshots share, in code units.
    """

    window: str | None = None
    limits: tuple[float, float] | None = None
    distance: Any = None
    optics: Optics | None = None
    corners: Window | None = None
    ends: tuple[float, float] | None = None
    pixels: int = PIXELS

    def map_window(self, snap: Snapshot) -> Window:
        """Corners in code units: the given part of the plane, or the disc, or the box. Raises PlotError."""
        if self.corners is not None:
            return self.corners
        given = self._lengths(snap.units)
        if not given:
            return shown_window(snap)
        if len(given) == 2:
            raise PlotError(f'--window: "{self.window}" is a range of radii; expected "R" or "X,Y,R" for a map')
        middle = np.array(given[:2]) if len(given) == 3 else np.zeros(2)
        return middle - given[-1], middle + given[-1]

    def radii(self, snap: Snapshot, inner: float = 0.0) -> tuple[float, float]:
        """Radii (in 1D places) between which to draw, in code units, by default from `inner`. Raises PlotError."""
        if self.ends is not None:
            return self.ends
        given = self._lengths(snap.units)
        if len(given) == 3:
            raise PlotError(f'--window: "{self.window}" is a part of the plane; expected "R" or "R1,R2" in radius')
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
        texts = self.window.split(",")
        try:
            given = [float(text) if units.system == "code" else units.parse(text, "length") for text in texts]
        except ValueError as error:
            words = str(error) if isinstance(error, UnitError) else "expected numbers, as lengths in code units are"
            raise PlotError(f"--window: {words}") from None
        rising = len(given) != 2 or given[0] < given[1]
        if len(given) > 3 or not rising or (len(given) != 2 and given[-1] <= 0.0):
            raise PlotError(f'--window: "{self.window}"; expected "R", "R1,R2" or "X,Y,R", with R above 0 and R1 < R2')
        return given

    def arcsec(self, units: Units) -> float | None:
        """Arcsec in an au; None where no distance is given. Raises PlotError in code units."""
        if self.distance is None:
            return None
        if units.system == "code":
            raise PlotError("--distance: the scene is in code units, in which lengths have no angle")
        return 1.0 / float(self.distance.to_value("pc"))


def quantity(text: str, option: str, unit: str, above_zero: bool = True) -> Any:
    """The value of an option as an astropy Quantity of the dimension of `unit`. Raises PlotError."""
    try:
        value = parse_quantity(text)
    except UnitError as error:
        raise PlotError(f"{option}: {error}") from None
    if not value.unit.is_equivalent(unit) or (above_zero and value.value <= 0):
        raise PlotError(f'{option}: "{text}"; expected a value above 0 with a unit like {unit}')
    return value
