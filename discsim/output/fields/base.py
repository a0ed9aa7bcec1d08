"""Definition of a field: a function of a snapshot, decorated by `of_particles`, `density` or `of_places`.

    @of_particles("gas", "velocity", "$v_r$", needs=("gas.vel", "plane"))
    def v_r(snap):
        \"\"\"Radial velocity: v_r = (x v_x + y v_y) / r\"\"\"
        return (snap.gas.pos * snap.gas.vel).sum(axis=1) / snap.gas.radius

The first line of the docstring describes the field in lists of fields: name, colon, equation. The argument is a
snapshot in code units, relative to the disc's centre: a moving star is at rest at the origin. The snapshot has the
columns in `needs`.
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

# Units of axes by dimension, for a scene in physical units. In code units, axes have no units.
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
    """A figure that cannot be drawn, or an invalid window or option; the message has the reason."""


class FieldError(UserError):
    """An unknown field, or a field that the run does not have; the message lists all fields, or gives the reason."""


@dataclass(frozen=True)
class Field:
    """A field of a snapshot.

    Attributes
    ----------
    kind : str
        Result of the function `values`. "particles": a value for each particle (n,). "density": a mass for each
        particle (n,); sums of these masses are later divided by areas of bins. "places": values in bins, computed from
        other fields in these bins.
    species : str
        "gas" or "dust"; "" for a field in bins.
    dimension, unit : str, str or None
        Physical dimension: one of `discsim.scene.units`, "temperature", "intensity" or "". Unit of axes, by default
        that of AXIS_UNITS.
    label : str
        Label of axes in mathtext, in which SPECIES stands for the species.
    needs, reads : tuple of str
        Required and optional columns, like "gas.vel". `needs` may also have the requirements "plane" (two dimensions),
        "star" and "physical" (physical units).
    scale, colours : str
        "log", "linear", or "signed" (linear, with a colour range symmetric about 0). Colour map of matplotlib.
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
        """The description with its equation, from the docstring of the function `values`."""
        return (self.values.__doc__ or "").strip().partition("\n")[0]

    def shown_unit(self, units: Units) -> str:
        """Return the unit of axes, for a snapshot with these code units; "" for a plain number."""
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
        """Return `values`, given in code units, as an astropy Quantity in the unit of axes."""
        from discsim.scene.astropy_units import units as u

        return u.Quantity(self.factor(units) * values, self.shown_unit(units))

    def text(self, units: Units, of_all: bool = False) -> str:
        """Return the label of an axis with its unit; with `of_all`, for all species, without the name of a species."""
        unit = self.shown_unit(units)
        label = self.label if units.dimensions == 2 else self.label.replace(r"\Sigma", r"\rho")
        if of_all:
            label = label.replace(",SPECIES", "").replace("_SPECIES", "")
        label = label.replace("SPECIES", rf"\mathrm{{{self.species}}}")
        return label + (f" [{UNIT_TEXT.get(unit, unit)}]" if unit else "")


def of_particles(
    species: str, dimension: str, label: str, **more: Any
) -> Callable[[Callable[[Snapshot], Array]], Field]:
    """Return a decorator that turns a function into a field.

    The function returns a value for each particle of a species. On pixels and in rings, the field is the mass-weighted
    mean of these values. `more` are attributes of `Field`.
    """
    return lambda values: Field("particles", species, values, dimension, label, **more)


def density(species: str, label: str, **more: Any) -> Callable[[Callable[[Snapshot], Array]], Field]:
    """Return a decorator that turns a function into a density field.

    The function returns a mass (n,) for each particle of a species. `more` are attributes of `Field`.
    """
    return lambda values: Field("density", species, values, "density", label, **more)


def of_places(dimension: str, label: str, **more: Any) -> Callable[[Callable[[Any], Array]], Field]:
    """Return a decorator that turns a function of other fields in the same bins into a field in bins.

    The argument `at` of the function has the other fields, as in `at["gas.temperature"]`. `more` are attributes of
    `Field`.
    """
    return lambda values: Field("places", "", values, dimension, label, **more)
