"""The table [cooling]."""

from typing import Annotated, Any, Literal

from pydantic import Field

from discsim.scene.fields import AllowedValues, Default, Length, Measure, Number, Table, Time

TABLE = "bell-lin"


class Keys(Table):
    """Cooling of the gas, which needs eos.kind = "adiabatic"."""

    kind: Literal["beta", "constant", "radiative"] = Field(description="cooling law")
    beta: Number | None = Field(None, gt=0, description='cooling time in 1 / Omega_K, for kind "beta"')
    t_cool: Time | None = Field(None, gt=0, description='cooling time, for kind "constant"')
    opacity: Annotated[Any, Measure("opacity", words=(TABLE,)), AllowedValues(f'opacity, "{TABLE}"')] = Field(
        None, description=f'opacity, for kind "radiative"; "{TABLE}": table of Bell & Lin (1994)'
    )
    aspect_ratio: Annotated[Number | None, Default("same as gas.eos")] = Field(
        None, ge=0, description="H/r at reference_radius that the gas cools to; 0: cools to zero energy"
    )
    temperature_index: Annotated[Number | None, Default("same as gas.eos")] = Field(
        None, description="q in c_s^2 ~ r^-q of the disc that the gas cools to"
    )
    reference_radius: Annotated[Length | None, Default("same as gas.eos")] = Field(
        None, gt=0, description="radius at which aspect_ratio holds"
    )
