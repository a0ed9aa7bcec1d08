"""The table [damping]."""

from typing import Annotated

from pydantic import Field

from discsim.scene.fields import AllowedValues, Length, Number, Table

Zone = Annotated[tuple[Length, Length], AllowedValues("two lengths: [from, to]")]


class Keys(Table):
    """Zones at the edges in which velocities relax to the local equilibrium."""

    inner: Zone | None = Field(None, description="zone at the inner edge [from, to]; full damping at and inside from")
    outer: Zone | None = Field(None, description="zone at the outer edge [from, to]; full damping at and outside to")
    time: Number = Field(0.3, gt=0, description="relaxation time at full damping, in local orbits")
