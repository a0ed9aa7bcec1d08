"""The tables [[dust]]."""

from typing import Annotated, Any, Literal

from pydantic import Field

from discsim.scene.fields import Count, Length, Measure, Number, Particles, Table, or_table


class Sizes(Table):
    """Grains of many sizes, n(s) ~ s^-index: bins of equal width in ln s with equal numbers of particles, or one size
    per particle. The masses of the particles follow.
    """

    smallest: Length = Field(gt=0, description="smallest grain radius")
    largest: Length = Field(gt=0, description="largest grain radius")
    index: Number = Field(
        3.5, description="p in the size distribution n(s) ~ s^-p; 3.5: collisional cascade (Dohnanyi 1969)"
    )
    bins: Count | None = Field(
        None, ge=1, description="number of different sizes; none: every particle has its own size"
    )


GrainSize: Any = or_table(Annotated[Length, Field(gt=0)], Sizes)


class Keys(Table):
    """One population of dust."""

    particles: Particles = Field(description="number of particles")
    ratio: Number = Field(gt=0, description="dust-to-gas mass ratio")
    grain_size: GrainSize | None = Field(
        None, description="grain radius, or a size distribution {smallest, largest, index, bins}"
    )
    grain_density: Annotated[float | None, Measure("volume_density")] = Field(
        None, gt=0, description="material density of the grains"
    )
    offset: Number = Field(0.0, description="offset of dust from gas particles, in gas spacings")
    inner: Length | None = Field(None, gt=0, description="inner edge of the dust at the start")
    outer: Length | None = Field(None, gt=0, description="outer edge of the dust at the start")
    placement: Literal["even", "random"] = Field("even", description="placement of the particles at the start")
