"""Keys of the tables of effects that are attributes of a `Scene`.

One class describes one table: `SelfGravity` the table [self_gravity], `Viscosity` the table [gas.viscosity]. The
reference of keys is made from the docstrings and descriptions.
"""

from typing import Annotated, Any, Literal, NamedTuple

from pydantic import BeforeValidator, Field, StrictBool, ValidationInfo, model_validator

from discsim.parts import DEFAULT_SCHEME, EOS, LAWS, SCHEMES
from discsim.scene.columns import ColumnsFile
from discsim.scene.fields import (
    AccelerationVector,
    AllowedValues,
    Count,
    Default,
    Diffusivity,
    Length,
    Mass,
    Measure,
    Number,
    Particles,
    SurfaceDensity,
    Table,
    Time,
    Velocity,
    fault,
    kinds_of,
    number,
    shown,
    units_of,
    value_or_table,
    word_of,
)
from discsim.scene.units import UnitError

AnyEos: Any = kinds_of(EOS.values())
EosWithoutHeat: Any = kinds_of(eos for eos in EOS.values() if not eos.holds_heat)
LawName: Any = word_of(LAWS)
SchemeName: Any = word_of(SCHEMES)
Zone = Annotated[tuple[Length, Length], AllowedValues("two lengths: [from, to]")]

MAX_NAME = 40  # largest number of characters in the name of a dust population
MAX_ETA = 30.0  # largest eta, with thousands of neighbours
OPACITY_TABLE = "bell-lin"  # name of the table of Bell & Lin (1994) in scenes


class Viscosity(Table):
    """Artificial viscosity."""

    alpha: Number = Field(1.0, ge=0, description="coefficient of the linear term of artificial viscosity")
    beta: Number = Field(2.0, ge=0, description="coefficient of the quadratic term of artificial viscosity")
    switch: Literal["none", "balsara"] = Field("none", description="switch that reduces viscosity in shear")
    pairs: Annotated[
        Literal["approaching", "all", "reconstructed"],
        Default('"reconstructed"; with switch = "balsara" "approaching"'),
    ] = Field(
        "reconstructed",
        description='pairs of particles with a linear term: "approaching"; "all", without pressure from shear; or '
        '"reconstructed": all, with velocities extrapolated to the pair\'s midpoint, so smooth flows have no viscosity',
    )

    @model_validator(mode="before")
    @classmethod
    def _set_default_pairs(cls, given: Any) -> Any:
        if isinstance(given, dict) and given.get("switch") == "balsara":
            return {"pairs": "approaching"} | given
        return given

    @property
    def acts_in_shear(self) -> bool:
        """True if the viscosity brakes a smooth shear flow. A switch weakens this braking, but does not remove it."""
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

    share: Number = Field(0.9, ge=0, le=1, description="fraction of the mean pressure that pair forces omit")
    time: Number = Field(
        10.0, gt=0, description="time in 1 / Omega over which the density relaxes to the SPH sum, in discs"
    )
    guard: Number = Field(
        0.75, ge=0, description="pressure that pair forces keep, in standard deviations of the density"
    )


def _true_or_table(given: Any) -> Any:
    """Return {} for true, which stands for a table with all defaults, None for false, any other value unchanged."""
    return {True: {}, False: None}[given] if isinstance(given, bool) else given


class Conductivity(Table):
    """Artificial conductivity."""

    alpha: Number = Field(1.0, ge=0, description="coefficient of artificial conductivity")


class PolarGrid(Table):
    """Polar grid of the gas (`method = "grid"`): rings of nearly square cells, even in ln r."""

    inner: Length | None = Field(None, gt=0, description="inner edge of the grid; default: that of the initial disc")
    outer: Length | None = Field(None, gt=0, description="outer edge of the grid; default: that of the initial disc")
    rings: Annotated[int | None, Default("such that cells are square")] = Field(
        None, ge=5, description="number of rings"
    )
    edges: Literal["open", "closed"] = Field(
        "open", description='"open": gas flows out, and none flows in; "closed": walls that reflect waves'
    )


class Gas(Table):
    particles: Particles = Field(description="number of SPH particles, or of cells of a polar grid")
    method: Literal["sph", "grid"] = Field(
        "sph", description='"sph": smoothed particle hydrodynamics; "grid": polar grid of about gas.particles cells'
    )
    grid: PolarGrid | None = None
    kernel: Annotated[
        Literal["cubic", "quintic", "quintic-h", "wendland-c2", "wendland-c4"],
        Default('"cubic"; without eta: "wendland-c2" in discs, "wendland-c4" in quiet gas and settling layers'),
    ] = Field("cubic", description="SPH kernel")
    eta: Annotated[
        Number,
        Default("cubic 1.345, quintic 1.1, quintic-h 3.3, wendland-c2 and wendland-c4 1.7; in 1D 2, quintic-h 6"),
    ] = Field(gt=0, le=MAX_ETA, description="eta in h = eta (m/rho)^(1/d)")
    smoothing_length: Length | None = Field(
        None, gt=0, description="uniform smoothing length of all particles, instead of eta"
    )
    eos: AnyEos = Field(description="equation of state")
    precision: Literal["double", "single"] = Field(
        "double", description="floating-point precision of the terms in SPH sums; all else is double"
    )
    viscosity: Annotated[Viscosity | None, Default("none; for quiet gas {alpha = 0.3, beta = 0.5}")] = None
    conductivity: Conductivity | None = None
    quiet: Annotated[Quiet | None, BeforeValidator(_true_or_table)] = Field(
        None, description="noise reduction for isothermal discs and periodic planes; true, or a table of options"
    )

    @model_validator(mode="before")
    @classmethod
    def _set_default_viscosity(cls, given: Any) -> Any:
        if isinstance(given, dict) and given.get("quiet") and "viscosity" not in given:
            return given | {"viscosity": {"alpha": 0.3, "beta": 0.5}}
        return given


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


class Background(Table):
    """Prescribed gas disc in equilibrium about the star, instead of [gas].

    The gas drags the dust, and does not change.
    """

    surface_density: SurfaceDensity | None = Field(
        None, gt=0, description="surface density of the gas at reference_radius"
    )
    file: ColumnsFile = Field(
        None,
        description="text file with columns r, Sigma and optionally T, instead of the power law and the "
        "temperature of background.eos; "
        'with units in the header: "# r [au]  Sigma [g/cm2]  T [K]"',
    )
    surface_density_index: Number = Field(1.0, description="p in Sigma ~ r^-p")
    reference_radius: Length = Field(1.0, gt=0, description="radius at which surface_density holds")
    eos: EosWithoutHeat = Field(description="equation of state")
    bump: Bump | None = None
    gap: Gap | None = None


class Sizes(Table):
    """Grains of many sizes, n(s) ~ s^-index: bins of equal width in ln s with equal numbers of particles, or one size
    per particle. The masses of the particles follow.
    """

    smallest: Length = Field(gt=0, description="smallest grain radius")
    largest: Length = Field(gt=0, description="largest grain radius")
    index: Number = Field(
        3.5, description="p in the size distribution n(s) ~ s^-p; 3.5 is a collisional cascade (Dohnanyi 1969)"
    )
    bins: Count | None = Field(
        None, ge=1, description="number of different sizes; without this key every particle has its own size"
    )


GrainSize: Any = value_or_table(Annotated[Length, Field(gt=0)], Sizes)


def _read_name(value: Any) -> str:
    """Return the name of a dust population. Raises a `fault` unless it is a short printable text without commas."""
    if not isinstance(value, str):
        raise fault(f'{shown(value)} is not a text; expected a name in quotes, like "pebbles"')
    fits = 0 < len(value) <= MAX_NAME and value == value.strip() and value.isprintable() and "," not in value
    if not fits:
        raise fault(
            f"{shown(value)} is not a name; expected 1 to {MAX_NAME} printable characters, without commas and "
            "spaces at the ends"
        )
    return value


class Dust(Table):
    """One population of dust."""

    name: Annotated[
        str | None, BeforeValidator(_read_name), AllowedValues("text"), Default("number of the table: 0, 1, ...")
    ] = Field(None, description='name of the population in figures, as in "dust.NAME.surface_density"')
    particles: Particles = Field(description="number of dust particles of the population")
    ratio: Number = Field(gt=0, description="dust-to-gas mass ratio")
    grain_size: GrainSize | None = Field(
        None, description="grain radius, or a size distribution {smallest, largest, index, bins}"
    )
    grain_density: Annotated[float | None, Measure("volume_density")] = Field(
        None, gt=0, description="material density of the grains"
    )
    t_stop: Annotated[Time | None, Default("drag.t_stop")] = Field(
        None, gt=0, description='stopping time of the population, for drag.law "stopping-time"'
    )
    offset: Number = Field(0.0, description="offset of dust from gas particles, in gas spacings")
    inner: Length | None = Field(None, gt=0, description="inner edge of the dust at the start")
    outer: Length | None = Field(None, gt=0, description="outer edge of the dust at the start")
    placement: Literal["even", "random"] = Field("even", description="placement of the particles at the start")


class Drag(Table):
    law: LawName = Field(description="drag law: formula of the stopping time")
    K: Annotated[float | None, Measure("drag_coefficient")] = Field(
        None,
        gt=0,
        description="drag coefficient K in the force density K (v - u) between dust (v) and gas (u), for law "
        '"constant"',
    )
    t_stop: Time | None = Field(None, gt=0, description='stopping time, for law "stopping-time"')
    stokes: Number | None = Field(
        None,
        gt=0,
        description='Stokes number t_stop Omega; for law "stokes-over-density" its value at the surface '
        "density Sigma_ref",
    )
    convention: Literal["papers", "kinetic"] = Field(
        "kinetic",
        description='Epstein law: "kinetic" t_stop = sqrt(pi/8) s rho_s / (c_s rho_g); "papers" s rho_s / (c_s rho_g)',
    )
    supersonic: StrictBool = Field(
        False, description="supersonic correction: Epstein drag times sqrt(1 + (9 pi/128) (slip / c_s)^2)"
    )
    mean_free_column: Annotated[float | None, Measure("surface_density"), Default("mu m_u / 2e-15 cm2")] = Field(
        None, gt=0, description='gas density rho_g times the mean free path, for law "epstein-stokes"'
    )
    direction: Literal["two-way", "one-way"] = Field(
        "two-way", description='"two-way": dust acts on the gas; "one-way": dust does not act on the gas'
    )
    scheme: SchemeName = Field(
        DEFAULT_SCHEME,
        description="numerical scheme of the drag; names in -ppm: gas and dust are fluids on a fixed 1D grid",
    )
    kernel: Literal["gas", "double-hump"] = Field(
        "gas",
        description='kernel of drag between particle pairs: "gas" is W(q) of gas.kernel, "double-hump" is q^2 W(q)',
    )
    cell: Annotated[
        Number | None, Default("1D: 1, at most 2 gas spacings; 2D: 2, at most 2.7 gas spacings and 0.7 H")
    ] = Field(None, gt=0, description="side of a drag cell, in local mean smoothing lengths h")
    cell_length: Length | None = Field(None, gt=0, description="side of a drag cell as a length, instead of drag.cell")
    # The mean slip of a class is exact in steady drift; in steps below t_stop its error is at most (ln 1.4)^2 / 12.
    class_width: Number = Field(
        1.4,
        gt=1,
        description="largest ratio of stopping times in a class of grains; the grains of a class relax together",
    )
    heating: Annotated[StrictBool, Default("true for adiabatic gas and two-way drag")] = Field(
        description="frictional heating of the gas"
    )
    integration: Literal["exponential", "implicit"] = Field(
        "exponential", description='time integration: "exponential" is exact, "implicit" is first-order backward Euler'
    )


class SelfGravity(Table):
    softening: Length | None = Field(None, gt=0, description='Plummer softening length, for kernel "plummer"')
    kernel: Literal["plummer", "thin-disc"] = Field(
        "plummer",
        description='potential: "plummer" -G m / sqrt(r^2 + softening^2), "thin-disc" averaged over a '
        "Gaussian disc with "
        "the scale height `thickness`",
    )
    thickness: Length | None = Field(None, gt=0, description='constant scale height H, for kernel "thin-disc"')
    sources: tuple[Literal["gas", "dust"], ...] = Field(
        ("gas", "dust"), min_length=1, description="species that make the gravitational field"
    )


class Star(Table):
    mass: Mass = Field(gt=0, description="mass of the star")
    accretion_radius: Length = Field(
        0.0, ge=0, description="radius within which particles are accreted; 0: no accretion"
    )
    softening: Length = Field(0.0, ge=0, description="Plummer softening length")
    frame: Literal["star", "inertial"] = Field(
        "star", description='frame: "star" has its origin at the star; in "inertial" the star moves'
    )
    indirect: Annotated[
        tuple[Literal["companions", "gas", "dust"], ...] | None,
        Default("companions; gas and dust with [self_gravity]"),
    ] = Field(None, description="sources of gravity that accelerate the star")
    grows: StrictBool = Field(
        False,
        description="the mass of accreted particles, in the inertial frame also their momentum, is added to the star",
    )
    centre: Literal["star", "barycentre"] = Field(
        "star",
        description="centre of the disc: the star, or the barycentre of star and bound companions, for frame "
        '= "inertial"',
    )


class Softening(NamedTuple):
    """Plummer softening length of a companion, in local scale heights H if `in_heights`, else in code units."""

    value: float
    in_heights: bool

    def __str__(self) -> str:
        return f"{self.value:g} {'H' if self.in_heights else 'in code units'}"


def _read_softening(value: Any, info: ValidationInfo) -> Softening:
    """Return the Softening that the value of a key means: a number counts scale heights H, a text is a length.

    Raises a `fault` for other values, and for negative numbers.
    """
    if not isinstance(value, str):
        found = Softening(number(value), True)
    else:
        units = units_of(info)
        try:
            length = number(float(value)) if units.system == "code" else units.parse(value, "length")
        except UnitError as error:
            raise fault(str(error)) from error
        except ValueError:  # also the fault of `number`
            raise fault(
                f'{shown(value)} is not a length; expected a length like "0.03", or a number of scale heights'
            ) from None
        found = Softening(length, False)
    if found.value < 0.0:
        raise fault(f"{shown(value)} is out of range; expected at least 0")
    return found


class Companion(Table):
    """A companion of the star."""

    mass: Mass = Field(
        gt=0, description="mass of the companion; the orbit is computed with the full mass even during `ramp`"
    )
    semi_major_axis: Length = Field(
        gt=0, description="semi-major axis of the orbit about the star; of a hyperbola the absolute value"
    )
    eccentricity: Number = Field(0.0, ge=0, description="eccentricity; above 1: a fly-by on a hyperbola")
    phase: Number = Field(0.0, description="true anomaly at t = 0 in degrees; the pericentre is at +x")
    orbit: Literal["fixed", "live"] = Field(
        "fixed", description='"fixed": a Kepler orbit; "live": an orbit integrated with the forces listed in `feels`'
    )
    feels: Annotated[
        tuple[Literal["star", "companions", "gas", "dust"], ...] | None, Default("all in the scene, if live")
    ] = Field(None, description='sources of gravity that act on a companion with orbit = "live"')
    softening: Annotated[Any, BeforeValidator(_read_softening), AllowedValues("length in quotes, or number of H")] = (
        Field(
            description="Plummer softening of the companion's gravity: a length, or a number of local scale heights H"
        )
    )
    ramp: Time = Field(
        0.0,
        ge=0,
        description="time over which the companion's gravity on gas and dust grows to full strength, as sin^2",
    )
    accretion_radius: Length = Field(
        0.0, ge=0, description="radius within which particles are accreted; 0: no accretion"
    )
    accretion_rate: Annotated[Number | None, Default("all at once; polar grid: see companions")] = Field(
        None, gt=0, description="fraction of the mass within accretion_radius that is accreted per local orbit"
    )
    every: Annotated[Time | None, Default("every step")] = Field(
        None, gt=0, description="interval between rows of companions.csv"
    )


def _as_list(value: Any) -> Any:
    """Return the value of the key beta, a number or a list, as a list. Raises a `fault` for an empty list."""
    if isinstance(value, list | tuple) and not value:
        raise fault("the list is empty; expected a number, or a list of one number per population of dust")
    return list(value) if isinstance(value, list | tuple) else [value]


class RadiationPressure(Table):
    beta: Annotated[
        tuple[Annotated[Number, Field(ge=0)], ...],
        BeforeValidator(_as_list),
        AllowedValues("number, or list of numbers"),
    ] = Field(
        description="ratio of radiation force to gravity, F_rad / F_grav, of the grains; a list has one "
        "number per population of dust"
    )


class External(Table):
    gas: AccelerationVector = Field(0, validate_default=True, description="uniform acceleration of the gas")
    dust: AccelerationVector = Field(0, validate_default=True, description="uniform acceleration of the dust")
    vertical_frequency: Annotated[float, Measure("frequency")] = Field(
        0.0, ge=0, description="Omega in the vertical acceleration -Omega^2 z of gas and dust"
    )


class ShearingBox(Table):
    """A small plane of radius x and height y in a disc, without vertical gravity; everything is uniform in azimuth."""

    omega: Annotated[float, Measure("frequency")] = Field(gt=0, description="orbital frequency at the centre")
    shear: Number = Field(1.5, ge=0, lt=2, description="q in Omega ~ r^-q; 1.5 about a point mass")
    headwind: Velocity = Field(
        0.0, description="eta v_K, the Keplerian velocity minus the azimuthal velocity of gas without dust"
    )


class Cooling(Table):
    """Cooling of the gas, which needs eos.kind = "adiabatic"."""

    kind: Literal["beta", "constant", "radiative"] = Field(description="cooling law")
    beta: Number | None = Field(None, gt=0, description='cooling time in units of 1 / Omega_K, for kind "beta"')
    t_cool: Time | None = Field(None, gt=0, description='cooling time, for kind "constant"')
    opacity: Annotated[
        Any, Measure("opacity", words=(OPACITY_TABLE,)), AllowedValues(f'opacity, "{OPACITY_TABLE}"')
    ] = Field(None, description=f'opacity, for kind "radiative"; "{OPACITY_TABLE}": table of Bell & Lin (1994)')
    aspect_ratio: Annotated[Number | None, Default("same as gas.eos")] = Field(
        None, ge=0, description="H/r at reference_radius to which the gas cools; 0: the gas cools to zero energy"
    )
    temperature_index: Annotated[Number | None, Default("same as gas.eos")] = Field(
        None, description="q in c_s^2 ~ r^-q of the temperature to which the gas cools"
    )
    reference_radius: Annotated[Length | None, Default("same as gas.eos")] = Field(
        None, gt=0, description="radius at which aspect_ratio holds"
    )


class Damping(Table):
    """Zones at the edges in which velocities relax to the local equilibrium."""

    inner: Zone | None = Field(
        None, description="damping zone [from, to] at the inner edge; full damping up to the radius `from`"
    )
    outer: Zone | None = Field(
        None, description="damping zone [from, to] at the outer edge; full damping from the radius `to` outwards"
    )
    time: Number = Field(0.3, gt=0, description="relaxation time at full damping, in local orbits")
    surface_density: bool = Field(
        False, description="whether the surface density of gas on a polar grid relaxes to its initial profile too"
    )


class AlphaViscosity(Table):
    alpha: Number | None = Field(None, gt=0, description="alpha in the viscosity nu = alpha c_s H")
    nu: Diffusivity | None = Field(None, gt=0, description="uniform viscosity nu, instead of alpha")
    index: Number = Field(
        0.0, description="power-law index of alpha ~ r^index; `alpha` is the value at initial.reference_radius"
    )
    inner_alpha: Number | None = Field(
        None, ge=0, description="alpha far inside `radius`; inner_alpha and outer_alpha replace alpha"
    )
    outer_alpha: Number | None = Field(None, ge=0, description="alpha far outside `radius`")
    radius: Length | None = Field(None, gt=0, description="radius of the step from inner_alpha to outer_alpha")
    width: Number | None = Field(None, gt=0, description="width of the step in ln r: tanh(ln(r / radius) / width)")
    step: Literal["linear", "logarithmic"] = Field(
        "linear", description='quantity that follows the tanh: "linear" alpha, "logarithmic" ln alpha'
    )
    dead_alpha: Number | None = Field(None, ge=0, description="alpha inside the dead zone")
    dead_inner: Length | None = Field(None, gt=0, description="inner edge of the dead zone")
    dead_outer: Length | None = Field(None, gt=0, description="outer edge of the dead zone")
    dead_width: Number | None = Field(
        None, gt=0, description="width of the edges of the dead zone in ln r: tanh(ln(r / edge) / dead_width)"
    )
