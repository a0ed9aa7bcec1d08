"""Options of an export: the arguments of `discsim.export.write` and of the command."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Integral, Real
from typing import Any

import numpy as np

from discsim.output.fields.base import PlotError
from discsim.output.fields.display import positive_quantity
from discsim.scene.units import clipped

CODES = ("radmc3d", "mcfost")
MAX_CELLS, MAX_SIZES = 2048, 200


@dataclass(frozen=True)
class ExportOptions:
    """Arguments of an export, as `discsim.export.write` documents them; `prefix` precedes their names in messages."""

    alpha: Any = None
    sizes: int = 10
    cells: int = 256
    opacity: Any = None
    temperature: Any = None
    star_radius: Any = "2 Rsun"
    star_temperature: Any = "4000 K"
    prefix: str = ""

    def checked_alpha(self) -> float | None:
        """Return alpha as a number; None if it is not given. Raises PlotError."""
        if self.alpha is None:
            return None
        if isinstance(self.alpha, bool) or not isinstance(self.alpha, Real) or not 0.0 < float(self.alpha) < np.inf:
            raise PlotError(f"{self.prefix}alpha: {clipped(str(self.alpha))}; expected a number above 0, like 1e-3")
        return float(self.alpha)

    def checked_number(self, name: str, lowest: int, highest: int) -> int:
        """Return the option `name` as int. Raises PlotError unless it is a whole number in this range."""
        value = getattr(self, name)
        if isinstance(value, bool) or not isinstance(value, Integral) or not lowest <= int(value) <= highest:
            raise PlotError(
                f"{self.prefix}{name}: {clipped(str(value))}; expected a whole number from {lowest} to {highest}"
            )
        return int(value)

    def star(self, unit: str) -> tuple[float, float]:
        """Return the radius of the star in `unit` and its temperature in K. Raises PlotError."""
        dash = "-" if self.prefix else "_"
        radius = positive_quantity(self.star_radius, f"{self.prefix}star{dash}radius", "Rsun")
        temperature = positive_quantity(self.star_temperature, f"{self.prefix}star{dash}temperature", "K")
        return float(radius.to_value(unit)), float(temperature.to_value("K"))
