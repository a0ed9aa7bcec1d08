"""The table [background]."""

from typing import Any

from pydantic import Field

from discsim.parts import EOS
from discsim.scene.columns import ColumnsFile
from discsim.scene.fields import Length, Number, SurfaceDensity, Table, kinds_of

EosWithoutHeat: Any = kinds_of(eos for eos in EOS.values() if not eos.holds_heat)


class Bump(Table):
    """More gas about a radius: Sigma times 1 + height exp(-(r - radius)^2 / (2 width^2))."""

    radius: Length = Field(gt=0, description="radius of the maximum")
    width: Length = Field(gt=0, description="standard deviation of the Gaussian bump")
    height: Number = Field(gt=0, description="relative increase of Sigma at the maximum")


class Gap(Table):
    """Less gas about a radius, like the gap of a planet: Sigma times 1 - depth exp(-(r - radius)^2 / (2 width^2))."""

    radius: Length = Field(gt=0, description="radius of the minimum")
    width: Length = Field(gt=0, description="standard deviation of the Gaussian gap")
    depth: Number = Field(gt=0, lt=1, description="relative decrease of Sigma at the minimum")


class Keys(Table):
    """Prescribed gas disc in equilibrium about the star, instead of [gas]. It drags the dust and does not change."""

    surface_density: SurfaceDensity | None = Field(None, gt=0, description="surface density at reference_radius")
    file: ColumnsFile = Field(
        None,
        description="text file with columns r, Sigma and optionally T, instead of the power law and the "
        "temperature of eos; "
        'with units in the header: "# r [au]  Sigma [g/cm2]  T [K]"',
    )
    surface_density_index: Number = Field(1.0, description="p in Sigma ~ r^-p")
    reference_radius: Length = Field(1.0, gt=0, description="radius at which surface_density holds")
    eos: EosWithoutHeat = Field(description="equation of state")
    bump: Bump | None = None
    gap: Gap | None = None
