"""The table [star]."""

from typing import Annotated, Literal

from pydantic import Field, StrictBool

from discsim.scene.fields import Default, Length, Mass, Table


class Keys(Table):
    mass: Mass = Field(gt=0, description="mass of the star")
    accretion_radius: Length = Field(0.0, ge=0, description="radius within which particles are accreted; 0: none")
    softening: Length = Field(0.0, ge=0, description="Plummer softening length")
    frame: Literal["star", "inertial"] = Field(
        "star", description='"star": origin at the star; "inertial": the star moves'
    )
    indirect: Annotated[
        tuple[Literal["companions", "gas", "dust"], ...] | None,
        Default("companions; gas and dust with [self_gravity]"),
    ] = Field(None, description="sources of gravity that accelerate the star")
    grows: StrictBool = Field(
        False, description="accreted mass is added to the star (and momentum, in the inertial frame)"
    )
    centre: Literal["star", "barycentre"] = Field(
        "star",
        description='centre of the disc; "barycentre": of star and bound companions, needs frame = "inertial"',
    )
