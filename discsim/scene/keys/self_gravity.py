"""The table [self_gravity]."""

from typing import Literal

from pydantic import Field

from discsim.scene.fields import Length, Table


class Keys(Table):
    softening: Length | None = Field(None, gt=0, description='Plummer softening length, for kernel "plummer"')
    kernel: Literal["plummer", "thin-disc"] = Field(
        "plummer",
        description="softened potential: 1 / sqrt(r^2 + softening^2), or the average over a Gaussian disc with "
        "scale height thickness",
    )
    thickness: Length | None = Field(None, gt=0, description='constant scale height H, for kernel "thin-disc"')
    sources: tuple[Literal["gas", "dust"], ...] = Field(
        ("gas", "dust"), min_length=1, description="species that make the gravitational field"
    )
