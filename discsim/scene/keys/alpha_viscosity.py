"""The table [alpha_viscosity]."""

from typing import Literal

from pydantic import Field

from discsim.scene.fields import Diffusivity, Length, Number, Table


class Keys(Table):
    alpha: Number | None = Field(None, gt=0, description="alpha in the viscosity nu = alpha c_s H")
    nu: Diffusivity | None = Field(None, gt=0, description="uniform viscosity, instead of alpha")
    index: Number = Field(
        0.0, description="power-law index of alpha ~ r^index; alpha holds at initial.reference_radius"
    )
    inner_alpha: Number | None = Field(
        None, ge=0, description="alpha far inside `radius`; with outer_alpha, instead of alpha"
    )
    outer_alpha: Number | None = Field(None, ge=0, description="alpha far outside `radius`")
    radius: Length | None = Field(None, gt=0, description="radius of the step from inner_alpha to outer_alpha")
    width: Number | None = Field(None, gt=0, description="width of the step in ln r: tanh(ln(r / radius) / width)")
    step: Literal["linear", "logarithmic"] = Field(
        "linear", description="quantity that follows the tanh: alpha, or ln alpha"
    )
    dead_alpha: Number | None = Field(None, ge=0, description="alpha inside the dead zone")
    dead_inner: Length | None = Field(None, gt=0, description="inner edge of the dead zone")
    dead_outer: Length | None = Field(None, gt=0, description="outer edge of the dead zone")
    dead_width: Number | None = Field(
        None, gt=0, description="width of the dead zone's edges in ln r: tanh(ln(r / edge) / dead_width)"
    )
