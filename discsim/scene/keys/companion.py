"""The tables [[companion]]."""

from typing import Annotated, Any, Literal, NamedTuple

from pydantic import BeforeValidator, Field, ValidationInfo

from discsim.scene.fields import (
    AllowedValues,
    Default,
    Length,
    Mass,
    Number,
    Table,
    Time,
    fault,
    number,
    shown,
    units_of,
)
from discsim.scene.units import UnitError


class Softening(NamedTuple):
    """Plummer length: a length in code units, or a number of scale heights."""

    value: float
    in_heights: bool

    def __str__(self) -> str:
        return f"{self.value:g} {'H' if self.in_heights else 'in code units'}"


def _read_softening(value: Any, info: ValidationInfo) -> Softening:
    """Convert a value of the scene to a Softening: a number is in local scale heights H, a text is a length."""
    if not isinstance(value, str):
        found = Softening(number(value), True)
    elif units_of(info).system == "code":
        try:
            found = Softening(number(float(value)), False)
        except ValueError:
            raise fault(
                f'{shown(value)} is not a length; expected one like "0.03", or a number of scale heights'
            ) from None
    else:
        try:
            found = Softening(units_of(info).parse(value, "length", 2.0), False)
        except UnitError as error:
            raise fault(str(error)) from error
    if found.value < 0.0:
        raise fault(f"{shown(value)} is out of range; expected at least 0")
    return found


class Keys(Table):
    """A companion of the star."""

    mass: Mass = Field(gt=0, description="mass of the companion; its orbit always uses the full mass")
    semi_major_axis: Length = Field(
        gt=0, description="semi-major axis about the star; for a hyperbola its absolute value"
    )
    eccentricity: Number = Field(0.0, ge=0, description="eccentricity; above 1: a fly-by on a hyperbola")
    phase: Number = Field(0.0, description="true anomaly at t = 0 in degrees; pericentre at +x")
    orbit: Literal["fixed", "live"] = Field(
        "fixed", description='Kepler orbit, or "live": integrated with the forces listed in feels'
    )
    feels: Annotated[
        tuple[Literal["star", "companions", "gas", "dust"], ...] | None, Default("all in the scene, if live")
    ] = Field(None, description="sources of gravity that act on a live companion")
    softening: Annotated[Any, BeforeValidator(_read_softening), AllowedValues("length in quotes, or number of H")] = (
        Field(
            description="Plummer softening of the companion's gravity: a length, or a number of local scale heights H"
        )
    )
    ramp: Time = Field(
        0.0,
        ge=0,
        description="time over which the companion's gravity on gas and dust grows to full strength, as sin^2",
    )
    accretion_radius: Length = Field(0.0, ge=0, description="radius within which particles are accreted; 0: none")
    accretion_rate: Annotated[Number | None, Default("all at once")] = Field(
        None, gt=0, description="fraction of the mass within accretion_radius accreted per local orbit"
    )
    every: Annotated[Time | None, Default("every step")] = Field(
        None, gt=0, description="interval between rows of companions.csv"
    )
