"""What a field is. A function of a snapshot becomes one with `of_particles`, `density` or `of_places`.

    @of_particles("gas", "velocity", "$v_r$", needs=("gas.vel", "plane"))
    def v_r(snap):
        \"\"\"Radial velocity: v_r = (x v_x + y v_y) / r\"\"\"
        return (snap.gas.pos * snap.gas.vel).sum(axis=1) / snap.gas.radius

The first line of its docstring is the text of the lists: a name, a colon, the equation. The snapshot that it is given
is about the centre of the disc (a moving star is at the origin, at rest), in code units, and holds the columns that the
field `needs`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.printable import UserError

if TYPE_CHECKING:
    from discsim.output.snapshot import Snapshot
    from discsim.scene.units import Units

Array = np.ndarray

# What axes show, by dimension; a density is per area in 2D and per volume in 1D. In code units nothing has a unit.
SHOWN = {
    "": "",
    "length": "au",
    "time": "yr",
    "velocity": "km/s",
    "surface_density": "g/cm2",
    "volume_density": "g/cm3",
    "pressure": "g/s2",
    "temperature": "K",
    "intensity": "mJy/arcsec2",
}
OUTSIDE = {"": "", "temperature": "K", "intensity": "mJy/arcsec2"}  # dimensions that code units do not reach
WRITTEN = {
    "g/cm2": "g cm$^{-2}$",
    "g/cm3": "g cm$^{-3}$",
    "g/s2": "g s$^{-2}$",
    "km/s": "km s$^{-1}$",
    "m/s": "m s$^{-1}$",
    "mJy/arcsec2": "mJy arcsec$^{-2}$",
}


class PlotError(UserError):
    """A field that cannot be drawn, or a wrong part or look of it; the message says why, and what was expected."""


class FieldError(UserError):
    """A field that there is not, or that a run lacks; the message says which, and what there is."""


@dataclass(frozen=True)
class Field:
    """kind: "particles" (values (n,)), "density" (masses (n,), to be divided by area) or "places" (of other fields).

    dimension: one of `discsim.scene.units`, "temperature", "intensity", or "". unit: of axes, where not that of SHOWN.
    label: of axes, with mathtext, SPECIES for the name of its own. needs: columns like "gas.vel", and "plane" (two
    dimensions), "star" or "physical" (units); reads: columns that it takes where there are any.
    scale: "log", "linear", or "signed" about 0.
    """

    kind: str
    species: str
    values: Callable[[Any], Array]
    dimension: str
    label: str
    needs: tuple[str, ...] = ()
    reads: tuple[str, ...] = ()
    unit: str | None = None
    scale: str = "log"
    colours: str = "viridis"

    @property
    def about(self) -> str:
        """What it is, and its equation."""
        return (self.values.__doc__ or "").strip().partition("\n")[0]

    def shown_unit(self, units: Units) -> str:
        """The unit of axes, "" for a plain number."""
        if units.system == "code" and self.dimension not in OUTSIDE:
            return ""
        if self.unit is not None:
            return self.unit
        name = self.dimension
        if name == "density":
            name = "surface_density" if units.dimensions == 2 else "volume_density"
        if name == "pressure" and units.dimensions == 1:
            return "g/(cm s2)"
        return SHOWN[name]

    def factor(self, units: Units) -> float:
        """From code units to those of axes."""
        unit = self.shown_unit(units)
        if not unit or self.dimension in OUTSIDE:
            return 1.0
        return float(units.quantity(1.0, self.dimension).to_value(unit))

    def quantity(self, units: Units, values: Array) -> Any:
        """Values in code units as an astropy Quantity, in the unit of axes."""
        from discsim.scene.astropy_units import units as u

        return u.Quantity(self.factor(units) * values, self.shown_unit(units))

    def text(self, units: Units, of_all: bool = False) -> str:
        """The label of an axis; of_all: of one that several species share."""
        unit = self.shown_unit(units)
        label = self.label if units.dimensions == 2 else self.label.replace(r"\Sigma", r"\rho")
        if of_all:
            label = label.replace(",SPECIES", "").replace("_SPECIES", "")
        label = label.replace("SPECIES", rf"\mathrm{{{self.species}}}")
        return label + (f" [{WRITTEN.get(unit, unit)}]" if unit else "")


def of_particles(
    species: str, dimension: str, label: str, **more: Any
) -> Callable[[Callable[[Snapshot], Array]], Field]:
    """A field of which each particle of a species has a value; on pixels and in rings its mean over their mass."""
    return lambda values: Field("particles", species, values, dimension, label, **more)


def density(species: str, label: str, **more: Any) -> Callable[[Callable[[Snapshot], Array]], Field]:
    """The density of what each particle carries; the function gives its masses (n,)."""
    return lambda values: Field("density", species, values, "density", label, **more)


def of_places(dimension: str, label: str, **more: Any) -> Callable[[Callable[[Any], Array]], Field]:
    """A field made of others at the same places, which the function takes as `at["gas.temperature"]`."""
    return lambda values: Field("places", "", values, dimension, label, **more)
