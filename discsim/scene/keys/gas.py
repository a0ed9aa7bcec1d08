"""The table [gas]."""

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from discsim.parts import EOS
from discsim.scene.fields import Default, Length, Number, Particles, Table, kinds_of

AnyEos: Any = kinds_of(EOS.values())

MAX_ETA = 30.0  # largest eta, with thousands of neighbours


class Viscosity(Table):
    """Artificial viscosity."""

    alpha: Number = Field(1.0, ge=0, description="coefficient of the linear term")
    beta: Number = Field(2.0, ge=0, description="coefficient of the quadratic term")
    switch: Literal["none", "balsara"] = Field("none", description="switch that reduces viscosity in shear")
    pairs: Annotated[
        Literal["approaching", "all", "reconstructed"],
        Default('"reconstructed"; with switch = "balsara" "approaching"'),
    ] = Field(
        "reconstructed",
        description="pairs with a linear term: approaching, all (no pressure from shear), or reconstructed: all, with "
        "velocities extrapolated to the pair's midpoint, so smooth flows have no viscosity",
    )

    @model_validator(mode="before")
    @classmethod
    def _set_default_pairs(cls, given: Any) -> Any:
        if isinstance(given, dict) and given.get("switch") == "balsara":
            return {"pairs": "approaching"} | given
        return given

    @property
    def acts_in_shear(self) -> bool:
        """True if the viscosity brakes a smooth shear flow; a switch only weakens it there."""
        return self.pairs != "reconstructed"

    @property
    def signal(self) -> float:
        """Factor of c_s / h in the time-step limit, for sound waves and the linear term."""
        return 1.0 + 1.2 * self.alpha

    @property
    def closing(self) -> float:
        """Factor of -div v in the time-step limit, for the quadratic term."""
        return 1.0 + 1.2 * self.beta


class Quiet(Table):
    """Pressure with less noise in shear (`effects/quiet.py`); true stands for the defaults below."""

    share: Number = Field(0.9, ge=0, le=1, description="fraction of the mean pressure that is left out of pair forces")
    time: Number = Field(
        10.0, gt=0, description="time in 1 / Omega over which the density relaxes to the SPH sum, in discs"
    )
    guard: Number = Field(0.75, ge=0, description="pressure kept in pair forces, in standard deviations of the density")


def _true_or_table(given: Any) -> Any:
    """Return an empty table for true, None for false, and any other value as it is."""
    return {True: {}, False: None}[given] if isinstance(given, bool) else given


class Conductivity(Table):
    """Artificial conductivity."""

    alpha: Number = Field(1.0, ge=0, description="coefficient of artificial conductivity")


class Keys(Table):
    particles: Particles = Field(description="number of SPH particles")
    kernel: Annotated[
        Literal["cubic", "quintic", "quintic-h", "wendland-c2", "wendland-c4"],
        Default('"cubic"; without eta: "wendland-c2" in discs, "wendland-c4" in quiet gas and settling layers'),
    ] = Field("cubic", description="SPH kernel")
    eta: Annotated[
        Number,
        Default("cubic 1.345, quintic 1.1, quintic-h 3.3, wendland-c2 and wendland-c4 1.7; in 1D 2, quintic-h 6"),
    ] = Field(gt=0, le=MAX_ETA, description="eta in h = eta (m/rho)^(1/d)")
    smoothing_length: Length | None = Field(
        None, gt=0, description="smoothing length, the same for all particles, instead of eta"
    )
    eos: AnyEos = Field(description="equation of state")
    precision: Literal["double", "single"] = Field(
        "double", description="floating-point precision of the terms in SPH sums; the rest is double"
    )
    viscosity: Annotated[Viscosity | None, Default("none; for quiet gas {alpha = 0.3, beta = 0.5}")] = None
    conductivity: Conductivity | None = None
    quiet: Annotated[Quiet | None, BeforeValidator(_true_or_table)] = Field(
        None, description="noise reduction for isothermal discs and periodic planes; true, or a table"
    )

    @model_validator(mode="before")
    @classmethod
    def _set_default_viscosity(cls, given: Any) -> Any:
        if isinstance(given, dict) and given.get("quiet") and "viscosity" not in given:
            return given | {"viscosity": {"alpha": 0.3, "beta": 0.5}}
        return given
