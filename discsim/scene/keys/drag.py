"""The table [drag]."""

from typing import Annotated, Any, Literal

from pydantic import Field, StrictBool

from discsim.parts import LAWS, SCHEMES, USUAL_SCHEME
from discsim.scene.fields import Default, Length, Measure, Number, Table, Time, word_of

LawName: Any = word_of(LAWS)

SchemeName: Any = word_of(SCHEMES)


class Keys(Table):
    law: LawName = Field(description="drag law: formula of the stopping time")
    K: Annotated[float | None, Measure("drag_coefficient")] = Field(
        None, gt=0, description='drag coefficient K in the force density K (v - u), for law "constant"'
    )
    t_stop: Time | None = Field(None, gt=0, description='stopping time, for law "stopping-time"')
    stokes: Number | None = Field(
        None, gt=0, description='Stokes number t_stop Omega; for "stokes-over-density" the value at Sigma_ref'
    )
    convention: Literal["papers", "kinetic"] = Field(
        "kinetic", description='Epstein t_stop = sqrt(pi/8) s rho_s / (c_s rho_g); "papers": s rho_s / (c_s rho_g)'
    )
    supersonic: StrictBool = Field(
        False, description="supersonic correction: Epstein drag times sqrt(1 + (9 pi/128) (slip / c_s)^2)"
    )
    mean_free_column: Annotated[float | None, Measure("surface_density"), Default("mu m_u / 2e-15 cm2")] = Field(
        None, gt=0, description='rho_g times the mean free path, for law "epstein-stokes"'
    )
    direction: Literal["two-way", "one-way"] = Field(
        "two-way", description="two-way: dust acts on the gas; one-way: it does not"
    )
    scheme: SchemeName = Field(
        USUAL_SCHEME, description="numerical scheme of the drag; -ppm: gas and dust are fluids on a fixed 1D grid"
    )
    kernel: Literal["gas", "double-hump"] = Field(
        "gas", description='kernel of drag between pairs: W of the gas, or "double-hump": q^2 W'
    )
    cell: Annotated[
        Number | None, Default("1D: 1, at most 2 gas spacings; 2D: 2, at most 2.7 gas spacings and 0.7 H")
    ] = Field(None, gt=0, description="side of a drag cell, in local mean smoothing lengths h")
    cell_length: Length | None = Field(None, gt=0, description="side of a drag cell as a length, instead of cell")
    # The mean slip of a class is exact in steady drift; in steps below t_stop its error is at most (ln 1.4)^2 / 12.
    class_width: Number = Field(
        1.4, gt=1, description="largest ratio of stopping times in a class of grains, which relax together"
    )
    heating: Annotated[StrictBool, Default("true for adiabatic gas and two-way drag")] = Field(
        description="frictional heating of the gas"
    )
    integration: Literal["exponential", "implicit"] = Field(
        "exponential", description='time integration: exact exponential, or "implicit": first-order backward Euler'
    )
