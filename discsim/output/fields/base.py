"""Definition of a field: `of_particles`, `density` and `of_places` decorate a function of a snapshot.

    @of_particles("gas", "velocity", "$v_r$", needs=("gas.vel", "plane"))
    def v_r(snap):
        \"\"\"Radial velocity: v_r = (x v_x + y v_y) / r\"\"\"
        return (snap.gas.pos * snap.gas.vel).sum(axis=1) / snap.gas.radius

The first line of the docstring is the description in lists of fields: name, colon, equation. The snapshot passed to
the function is in code units, and in the frame of the disc's centre: a moving star is at rest at the origin. It has
the columns that the field `needs`.
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

# Units of axes by dimension; a density is per area in 2D and per volume in 1D. In the code system axes have no units.
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
OUTSIDE = {"": "", "temperature": "K", "intensity": "mJy/arcsec2"}  # dimensions with the same units in every system
WRITTEN = {
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

    `kind` is "particles" (values (n,)), "density" (masses (n,), divided by area later) or "places" (computed from
    other fields in the same bins). `dimension` is one of `discsim.scene.units`, "temperature", "intensity" or "".
    `unit` is the unit of axes, by default that of SHOWN. `label` is the label of axes in mathtext; SPECIES in it
    stands for the species. `needs` lists required columns like "gas.vel", and "plane" (two dimensions), "star" or
    "physical" (units). `reads` lists optional columns. `scale` is "log", "linear", or "signed" (linear about 0).
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
        """The description with the equation."""
        return (self.values.__doc__ or "").strip().partition("\n")[0]

    def shown_unit(self, units: Units) -> str:
        """Return the unit of axes; "" for a plain number."""
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
        """Return the factor from code units to the unit of axes."""
        unit = self.shown_unit(units)
        if not unit or self.dimension in OUTSIDE:
            return 1.0
        return float(units.quantity(1.0, self.dimension).to_value(unit))

    def quantity(self, units: Units, values: Array) -> Any:
        """Return values in code units as an astropy Quantity in the unit of axes."""
        from discsim.scene.astropy_units import units as u

        return u.Quantity(self.factor(units) * values, self.shown_unit(units))

    def text(self, units: Units, of_all: bool = False) -> str:
        """Return the label of an axis; `of_all`: the axis is shared by several species."""
        unit = self.shown_unit(units)
        label = self.label if units.dimensions == 2 else self.label.replace(r"\Sigma", r"\rho")
        if of_all:
            label = label.replace(",SPECIES", "").replace("_SPECIES", "")
        label = label.replace("SPECIES", rf"\mathrm{{{self.species}}}")
        return label + (f" [{WRITTEN.get(unit, unit)}]" if unit else "")


def of_particles(
    species: str, dimension: str, label: str, **more: Any
) -> Callable[[Callable[[Snapshot], Array]], Field]:
    """Return a decorator for a field with one value per particle of a species.

    On pixels and in rings the field is the mass-weighted mean.
    """
    return lambda values: Field("particles", species, values, dimension, label, **more)


def density(species: str, label: str, **more: Any) -> Callable[[Callable[[Snapshot], Array]], Field]:
    """Return a decorator for the density of a mass in each particle; the function returns these masses (n,)."""
    return lambda values: Field("density", species, values, "density", label, **more)


def of_places(dimension: str, label: str, **more: Any) -> Callable[[Callable[[Any], Array]], Field]:
    """Return a decorator for a field computed from other fields in the same bins.

    The function reads them as `at["gas.temperature"]`.
    """
    return lambda values: Field("places", "", values, dimension, label, **more)
