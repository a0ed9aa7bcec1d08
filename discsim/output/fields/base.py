"""Definition of a field: a function of a snapshot, decorated by `of_particles`, `density` or `of_places`.

    @of_particles("gas", "velocity", "$v_r$", needs=("gas.vel", "plane"))
    def v_r(snap):
        \"\"\"Radial velocity: v_r = (x v_x + y v_y) / r\"\"\"
        return (snap.gas.pos * snap.gas.vel).sum(axis=1) / snap.gas.radius

The first line of the docstring is the description in lists of fields: name, colon, equation. The argument is a
snapshot in code units, relative to the disc's centre: a moving star is at rest at the origin. It has the columns in
`needs`.
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

# Units of axes by dimension. For a scene in code units, axes have no units.
AXIS_UNITS = {
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
FIXED_UNITS = {"": "", "temperature": "K", "intensity": "mJy/arcsec2"}  # dimensions with the same units in every system
UNIT_TEXT = {
    "g/cm2": "g cm$^{-2}$",
    "g/cm3": "g cm$^{-3}$",
    "g/s2": "g s$^{-2}$",
    "km/s": "km s$^{-1}$",
    "m/s": "m s$^{-1}$",
    "mJy/arcsec2": "mJy arcsec$^{-2}$",
}


class PlotError(UserError):
    """A field that cannot be drawn, or an invalid window or option; the message has the reason."""


class FieldError(UserError):
    """An unknown field, or a field that the run lacks; the message has the known fields or the reason."""


@dataclass(frozen=True)
class Field:
    """A field of a snapshot.

    `kind` says what `values` returns: "particles", a value per particle (n,); "density", a mass per particle (n,),
    which is divided by areas of bins later; "places", values in bins that follow from other fields in these bins.
    `dimension` is one of `discsim.scene.units`, "temperature", "intensity" or "". `unit` is the unit of axes, by
    default that of AXIS_UNITS. `label` is the label of axes in mathtext; SPECIES in it stands for the species. `needs`
    lists required columns like "gas.vel", and "plane" (two dimensions), "star" or "physical" (units). `reads` lists
    optional columns. `scale` is "log", "linear", or "signed" (linear, with a colour range symmetric about 0).
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
        """The description with its equation, from the docstring of the function."""
        return (self.values.__doc__ or "").strip().partition("\n")[0]

    def shown_unit(self, units: Units) -> str:
        """Return the unit of axes; "" for a plain number."""
        if units.system == "code" and self.dimension not in FIXED_UNITS:
            return ""
        if self.unit is not None:
            return self.unit
        name = self.dimension
        if name == "density":
            name = "surface_density" if units.dimensions == 2 else "volume_density"
        if name == "pressure" and units.dimensions == 1:
            return "g/(cm s2)"
        return AXIS_UNITS[name]

    def factor(self, units: Units) -> float:
        """Return the factor from code units to the unit of axes."""
        unit = self.shown_unit(units)
        if not unit or self.dimension in FIXED_UNITS:
            return 1.0
        return float(units.quantity(1.0, self.dimension).to_value(unit))

    def quantity(self, units: Units, values: Array) -> Any:
        """Return values in code units as an astropy Quantity in the unit of axes."""
        from discsim.scene.astropy_units import units as u

        return u.Quantity(self.factor(units) * values, self.shown_unit(units))

    def text(self, units: Units, of_all: bool = False) -> str:
        """Return the label of an axis with its unit; with `of_all`, without a species."""
        unit = self.shown_unit(units)
        label = self.label if units.dimensions == 2 else self.label.replace(r"\Sigma", r"\rho")
        if of_all:
            label = label.replace(",SPECIES", "").replace("_SPECIES", "")
        label = label.replace("SPECIES", rf"\mathrm{{{self.species}}}")
        return label + (f" [{UNIT_TEXT.get(unit, unit)}]" if unit else "")


def of_particles(
    species: str, dimension: str, label: str, **more: Any
) -> Callable[[Callable[[Snapshot], Array]], Field]:
    """Return a decorator for a field with one value per particle of a species.

    On pixels and in rings its value is the mass-weighted mean.
    """
    return lambda values: Field("particles", species, values, dimension, label, **more)


def density(species: str, label: str, **more: Any) -> Callable[[Callable[[Snapshot], Array]], Field]:
    """Return a decorator for a density; the function returns the mass (n,) in each particle."""
    return lambda values: Field("density", species, values, "density", label, **more)


def of_places(dimension: str, label: str, **more: Any) -> Callable[[Callable[[Any], Array]], Field]:
    """Return a decorator for a field in bins that is computed from other fields in the same bins.

    The argument `at` of the function has the other fields, as in `at["gas.temperature"]`.
    """
    return lambda values: Field("places", "", values, dimension, label, **more)
