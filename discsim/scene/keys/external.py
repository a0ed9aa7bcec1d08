"""The table [external]."""

from typing import Annotated

from pydantic import Field

from discsim.scene.fields import AccelerationVector, Measure, Table


class Keys(Table):
    gas: AccelerationVector = Field(0, validate_default=True, description="uniform acceleration of the gas")
    dust: AccelerationVector = Field(0, validate_default=True, description="uniform acceleration of the dust")
    vertical_frequency: Annotated[float, Measure("frequency")] = Field(
        0.0, ge=0, description="Omega in the vertical acceleration -Omega^2 z of gas and dust"
    )
