"""The tables of a scene: every key with its type, unit, default and meaning.

A field's `Measure` names its dimension; it turns the texts of a scene ("0.6 au") into floats in code units
while the table is validated, with the scene's `Units` as the validation context. All tables are frozen.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, Literal, get_args, get_origin

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, StrictBool, ValidationInfo
from pydantic_core import PydanticCustomError, core_schema

from discsim.scene.units import UnitError, Units, clipped, seconds

MOST_PARTICLES = 10_000_000_000
MOST_SNAPSHOTS = 1_000_000
MOST_COURANT = 100.0  # far above 2.5, where sound and orbits grow: of drag alone, which is exact at any step
MOST_ETA = 30.0  # thousands of neighbours
LARGEST = 1e60  # of any number in code units, and of one over it: their products stay within floats
STEEPEST = 100.0  # of gamma, whose powers of densities stay within floats
# h = eta (m/rho)^(1/d), such that sound on an even lattice has the right speed. In 1D whole numbers of spacings: only
# then is a B-spline's sum density exact. In 2D on a square lattice, along an axis, c_s^2 is right to .5% with the
# B-splines (with eta = 1.2 the cubic one is 8% off), to 2% with Wendland's. quintic-h is the quintic squeezed to
# support h: thrice the eta.
ETA = {
    1: {"cubic": 2.0, "quintic": 2.0, "quintic-h": 6.0, "wendland-c4": 2.0},
    2: {"cubic": 1.345, "quintic": 1.1, "quintic-h": 3.3, "wendland-c4": 1.7},
}
# W(0)^(1/d) in units of h: with less a particle is dense enough by itself at any h, which then falls to nothing.
LEAST_ETA = {
    1: {"cubic": 0.667, "quintic": 0.55, "quintic-h": 1.65, "wendland-c4": 0.75},
    2: {"cubic": 0.675, "quintic": 0.555, "quintic-h": 1.665, "wendland-c4": 0.847},
}


def fault(message: str) -> PydanticCustomError:
    """An error whose text is shown to the user as it stands."""
    return PydanticCustomError("fault", "{message}", {"message": message})


def number(value: Any) -> float:
    """A finite bare number as a float."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise fault(f"{shown(value)} is not a number; expected a plain number, without unit or quotes")
    try:
        value = float(value)
    except OverflowError:
        value = math.inf
    return _in_reach(value, f"{value}")


def _in_reach(value: float, text: str) -> float:
    if not math.isfinite(value):
        raise fault(f"{text} is not a finite number")
    if value != 0.0 and not 1.0 / LARGEST <= abs(value) <= LARGEST:
        raise fault(
            f"{text} is out of range; expected 0, or a size from {1.0 / LARGEST:g} to {LARGEST:g} in code units"
        )
    return value


def _units(info: ValidationInfo) -> Units:
    assert info.context is not None
    return info.context["units"]


def shown(value: Any) -> str:
    """A value as it stands in TOML, or its beginning."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{clipped(value)}"'
    try:
        return clipped(str(value))
    except (ValueError, RecursionError):  # more digits than Python writes, or lists in lists without end
        return f"the {type(value).__name__}"


@dataclass(frozen=True)
class Default:
    """Words for a default that other keys or the machine decide."""

    words: str


@dataclass(frozen=True)
class Measure:
    """The dimension of a float, or of a tuple with one float a dimension ("x" and "y").

    `name` is one of `discsim.scene.units`, or "" for a plain number. `whole` demands whole numbers.
    """

    name: str = ""
    vector: bool = False
    whole: bool = False

    def __get_pydantic_core_schema__(self, source: Any, handler: Callable[[Any], Any]) -> Any:
        read = self._vector if self.vector else self._float
        return core_schema.with_info_before_validator_function(read, handler(source))

    def _float(self, value: Any, info: ValidationInfo) -> float | None:
        if value is None:
            return None
        units = _units(info)
        if not self.name or units.system == "code":
            if self.name and isinstance(value, str):
                raise fault(f"{shown(value)} is a text, but the scene is in code units; expected a plain number")
            return number(value)
        gamma = info.data.get("gamma", 2.0)  # an earlier key of the same table
        if isinstance(value, str):
            try:
                return _in_reach(units.parse(value, self.name, gamma), shown(value))
            except UnitError as error:
                raise fault(str(error)) from error
        words = units.expected(self.name, gamma)
        if isinstance(value, int | float) and not isinstance(value, bool):
            raise fault(f"{shown(value)} has no unit; {words.replace(', like', ' needs a unit, like')}")
        raise fault(f"{shown(value)} is not a quantity; expected {words}")

    def _vector(self, value: Any, info: ValidationInfo) -> tuple[float, ...]:
        """A scalar is the x component."""
        dimensions = _units(info).dimensions
        is_list = isinstance(value, list | tuple)
        if is_list and len(value) != dimensions:
            raise fault(f"{shown(list(value))} has {len(value)} entries; expected {dimensions}, one a dimension")
        if value == 0 and not isinstance(value, bool):  # zero, the default, is zero in every unit
            return (0.0,) * dimensions
        read = [self._float(entry, info) or 0.0 for entry in (value if is_list else [value])]
        read += [0.0] * (dimensions - len(read))
        if self.whole and any(entry != int(entry) for entry in read):
            raise fault(f"{shown(value)} is not made of whole numbers")
        return tuple(read)


def _count(value: Any) -> Any:
    read = number(value)
    if read != int(read):
        raise fault(f"{shown(value)} is not a whole number")
    return int(read)


def _particles(value: Any) -> Any:
    read = _count(value)
    if not 1 <= read <= MOST_PARTICLES:
        wrong = "is absurd" if read > 1 else "are no particles"
        raise fault(f"{shown(value)} {wrong}; expected a number of particles from 1 to 1e10")
    return read


def _seconds(value: Any) -> Any:
    if not isinstance(value, str):
        raise fault(f'{shown(value)} is not a wall-clock time; expected one in quotes, like "10 min"')
    try:
        return seconds(value)
    except UnitError as error:
        raise fault(str(error)) from error


def _size(value: Any, info: ValidationInfo) -> Any:
    """One number is the side of a square."""
    dimensions = _units(info).dimensions
    if not isinstance(value, list | tuple):
        return [value] * dimensions
    if len(value) != dimensions:
        raise fault(f"{shown(list(value))} has {len(value)} entries; expected {dimensions}, one a dimension")
    return value


def _direction(value: Any, info: ValidationInfo) -> Any:
    # The default [1, 0] is along x in 1D as well.
    return [1] if value == _ALONG_X and _units(info).dimensions == 1 else value


def _not_isothermal(value: float) -> float:
    # Its thermal energy, P / (gamma - 1), has no limit there.
    if value == 1.0:
        raise fault('1 is isothermal gas; expected kind = "isothermal" with sound_speed = sqrt(constant)')
    return value


_ALONG_X = (1, 0)

Number = Annotated[float, Measure()]
Count = Annotated[int, BeforeValidator(_count)]
Particles = Annotated[int, BeforeValidator(_particles)]
Seconds = Annotated[float, Field(gt=0), BeforeValidator(_seconds)]
Length = Annotated[float, Measure("length")]
Mass = Annotated[float, Measure("mass")]
Time = Annotated[float, Measure("time")]
Velocity = Annotated[float, Measure("velocity")]
Density = Annotated[float, Measure("density")]
SurfaceDensity = Annotated[float, Measure("surface_density")]
VelocityVector = Annotated[tuple[float, ...], Measure("velocity", vector=True)]
AccelerationVector = Annotated[tuple[float, ...], Measure("acceleration", vector=True)]


class Table(BaseModel):
    """A frozen table that knows all its keys."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class UnitsTable(Table):
    system: Literal["physical", "code"] = Field("physical", description='"code": the scene is dimensionless, G = 1')
    length: str = Field("1 au", description="code unit of length")
    mass: str = Field("1 Msun", description="code unit of mass; G = 1 fixes the time")


class Run(Table):
    until: Time = Field(gt=0, description="end time; the last step lands on it exactly")
    snapshots: Count = Field(
        10, ge=1, le=MOST_SNAPSHOTS, description="snapshots after the initial state, evenly in time"
    )
    every: Time | None = Field(None, gt=0, description="their interval, instead of their number")
    seed: Count = Field(1, ge=0, description="of one random stream a species")
    courant: Number = Field(0.3, gt=0, le=MOST_COURANT, description="share of each effect's limit on the step")
    timestep: Time | None = Field(None, gt=0, description="fixed step")
    integrator: Literal["kdk", "euler"] = Field(
        "kdk", description='kick-drift-kick, or "euler": forward Euler, positions with the old velocity'
    )
    threads: Annotated[Count | None, Default("all cores")] = Field(
        None, ge=1, description="results do not depend on it"
    )
    checkpoint_every: Annotated[Seconds, Default('"10 min"')] = Field(600.0, description="between checkpoints")
    walltime: Seconds | None = Field(None, description='end after it, with a checkpoint; like "2 h"')


class Space(Table):
    dimensions: Annotated[Literal[1, 2], BeforeValidator(_count)] = Field(2, description="dimensions of space")
    size: Annotated[tuple[Annotated[float, Field(gt=0), Measure("length")], ...], BeforeValidator(_size)] = Field(
        description="side, or [x, y]"
    )
    cells: Annotated[Count | None, Default("from the particles")] = Field(
        None, ge=1, le=65536, description="grid cells along the longest side; cells are square"
    )
    boundary: Literal["open", "periodic"] = Field("open", description="of gas, dust and gravity")


class Disc(Table):
    """A disc with Sigma ~ r^-p around the origin."""

    kind: Literal["disc"] = "disc"
    mass: Mass | None = Field(None, gt=0, description="of the gas")
    toomre_q: Number | None = Field(None, gt=0, description="least Toomre Q of the gas, instead of its mass")
    surface_density: SurfaceDensity | None = Field(
        None, gt=0, description="of the gas at reference_radius, instead of its mass"
    )
    inner: Length = Field(gt=0, description="inner edge")
    outer: Length = Field(gt=0, description="outer edge")
    reference_radius: Length = Field(1.0, gt=0, description="where surface_density holds")
    surface_density_index: Number = Field(1.0, description="p in Sigma ~ r^-p")
    inner_taper: Length = Field(0.0, ge=0, description="width of the inner taper")
    outer_taper: Length = Field(0.0, ge=0, description="width of the outer taper")
    perturbation: Number = Field(
        0.0, ge=0, lt=0.2, description="amplitude in Sigma of each of the azimuthal modes 2 to 6, of random phases"
    )


class Box(Table):
    """A uniform periodic box (DustyBox)."""

    kind: Literal["box"] = "box"
    density: Density = Field(1.0, gt=0, description="of the gas")
    gas_velocity: VelocityVector = Field(0, validate_default=True, description="a number (along x) or [x, y]")
    dust_velocity: VelocityVector = Field(0, validate_default=True, description="a number (along x) or [x, y]")


class Wave(Table):
    """A sin(k x) in density and velocity of both species on [0, size)."""

    kind: Literal["wave"] = "wave"
    amplitude: Number = Field(1e-4, gt=-1, lt=1, description="A")
    wavenumber: Count = Field(1, ge=1, description="whole waves on the side")
    velocity: VelocityVector = Field(0, validate_default=True, description="uniform boost of everything")
    direction: Annotated[tuple[float, ...], Measure(vector=True, whole=True), BeforeValidator(_direction)] = Field(
        _ALONG_X, validate_default=True, description="whole waves along x and y"
    )


class Shock(Table):
    """Two states meeting at 0 of [-size/2, size/2]."""

    kind: Literal["shock"] = "shock"
    left: tuple[
        Annotated[float, Field(gt=0), Measure("density")],
        Annotated[float, Field(gt=0), Measure("pressure")],
        Velocity,
    ] = Field((1.0, 1.0, 0.0), description="gas [density, pressure, velocity] at x < 0")
    right: tuple[
        Annotated[float, Field(gt=0), Measure("density")],
        Annotated[float, Field(gt=0), Measure("pressure")],
        Velocity,
    ] = Field((0.125, 0.1, 0.0), description="gas [density, pressure, velocity] at x > 0")


class Sheet(Table):
    """A periodic sheet with a standing density wave."""

    kind: Literal["sheet"] = "sheet"
    surface_density: SurfaceDensity = Field(1.0, gt=0, description="mean")
    amplitude: Number = Field(1e-3, gt=-1, lt=1, description="relative amplitude of the density wave")
    wavenumber: Count = Field(1, ge=1, description="whole waves on the side")


class Blast(Table):
    """Heat in the middle of uniform gas at rest (Sedov)."""

    kind: Literal["blast"] = "blast"
    density: Density = Field(1.0, gt=0, description="of the gas")
    energy: Annotated[float, Measure("energy")] = Field(1.0, gt=0, description="of the blast")
    radius: Length = Field(gt=0, description="within which it is put")


class Settling(Table):
    """An isothermal layer in balance with external.vertical_frequency, and dust at rest in it."""

    kind: Literal["settling"] = "settling"
    density: Density = Field(1.0, gt=0, description="of the gas in the midplane")
    vertical_extent: Annotated[Length | None, Default("half of space.size")] = Field(
        None, gt=0, description="height on both sides up to which gas moves and dust begins"
    )


class Vortex(Table):
    """Gresho's vortex in the middle of a periodic box."""

    kind: Literal["vortex"] = "vortex"
    density: Density = Field(1.0, gt=0, description="of the gas")
    speed: Velocity = Field(1.0, gt=0, description="largest speed of rotation")
    radius: Length = Field(0.2, gt=0, description="where it is reached; it falls to nothing at twice this radius")
    velocity: VelocityVector = Field(0, validate_default=True, description="uniform boost of everything")


class Isothermal(Table):
    """P = c_s^2 rho."""

    kind: Literal["isothermal"] = "isothermal"
    sound_speed: Velocity = Field(gt=0, description="c_s")
    mean_molecular_weight: Number = Field(2.34, gt=0, description="for temperatures")


class LocallyIsothermal(Table):
    """P = c_s(r)^2 rho, c_s^2 ~ r^-q."""

    kind: Literal["locally-isothermal"] = "locally-isothermal"
    aspect_ratio: Number = Field(gt=0, description="H/r at reference_radius")
    temperature_index: Number = Field(0.5, description="q in c_s^2 ~ r^-q")
    reference_radius: Length = Field(1.0, gt=0, description="where aspect_ratio holds")
    mean_molecular_weight: Number = Field(2.34, gt=0, description="for temperatures")


class Adiabatic(Table):
    """P = (gamma - 1) rho u; the start has the sound speed of one of the isothermal kinds."""

    kind: Literal["adiabatic"] = "adiabatic"
    gamma: Number = Field(gt=1, le=STEEPEST, description="ratio of specific heats")
    sound_speed: Velocity | None = Field(None, gt=0, description="at the start, uniform")
    aspect_ratio: Number | None = Field(None, gt=0, description="H/r at reference_radius at the start, instead")
    temperature_index: Number = Field(0.5, description="q in c_s^2 ~ r^-q, with aspect_ratio")
    reference_radius: Length = Field(1.0, gt=0, description="where aspect_ratio holds")
    mean_molecular_weight: Number = Field(2.34, gt=0, description="for temperatures")


class Polytropic(Table):
    """P = constant rho^gamma."""

    kind: Literal["polytropic"] = "polytropic"
    gamma: Annotated[Number, AfterValidator(_not_isothermal)] = Field(gt=0, le=STEEPEST, description="exponent")
    constant: Annotated[float, Measure("polytropic_constant")] = Field(gt=0, description="P / rho^gamma")
    mean_molecular_weight: Number = Field(2.34, gt=0, description="for temperatures")


class Viscosity(Table):
    """Artificial viscosity."""

    alpha: Number = Field(1.0, ge=0, description="linear term")
    beta: Number = Field(2.0, ge=0, description="quadratic term")
    switch: Literal["none", "balsara"] = Field("none", description="less viscosity in shear")
    pairs: Literal["approaching", "all"] = Field(
        "approaching", description="whom the linear term brakes; all: quieter discs, and no pressure from shear"
    )


class Conductivity(Table):
    """Artificial conductivity."""

    alpha: Number = Field(1.0, ge=0, description="strength")


class Gas(Table):
    particles: Particles = Field(description="number of SPH particles")
    kernel: Annotated[
        Literal["cubic", "quintic", "quintic-h", "wendland-c4"],
        Default('"cubic"; where no eta is named, in a disc "quintic", in a settling layer "wendland-c4"'),
    ] = Field("cubic", description="SPH kernel")
    eta: Annotated[
        Number,
        Default("cubic 1.345, quintic 1.1, quintic-h 3.3, wendland-c4 1.7; in 1D 2, quintic-h 6"),
    ] = Field(gt=0, le=MOST_ETA, description="h = eta (m/rho)^(1/d)")
    smoothing_length: Length | None = Field(None, gt=0, description="fixed h, instead of eta")
    eos: Annotated[Isothermal | LocallyIsothermal | Adiabatic | Polytropic, Field(discriminator="kind")] = Field(
        description="equation of state"
    )
    viscosity: Viscosity | None = None
    conductivity: Conductivity | None = None


class Background(Table):
    """The gas as a given disc in balance about the star, instead of [gas]; it drags the dust and nothing moves it."""

    surface_density: SurfaceDensity = Field(gt=0, description="Sigma at reference_radius")
    surface_density_index: Number = Field(1.0, description="p in Sigma ~ r^-p")
    reference_radius: Length = Field(1.0, gt=0, description="where surface_density holds")
    eos: Annotated[Isothermal | LocallyIsothermal | Polytropic, Field(discriminator="kind")] = Field(
        description="equation of state"
    )


class Dust(Table):
    """One population of dust."""

    particles: Particles = Field(description="number of particles")
    ratio: Number = Field(gt=0, description="dust-to-gas mass ratio")
    grain_size: Length | None = Field(None, gt=0, description="for the Epstein law")
    grain_density: Annotated[float | None, Measure("volume_density")] = Field(
        None, gt=0, description="of the grain's material"
    )
    offset: Number = Field(0.0, description="placement against the gas, in gas spacings")
    inner: Length | None = Field(None, gt=0, description="dust only outside this radius")
    outer: Length | None = Field(None, gt=0, description="dust only inside this radius")
    placement: Literal["even", "random"] = Field("even", description="of the particles at the start")


class Drag(Table):
    law: Literal["epstein", "epstein-stokes", "constant", "stopping-time", "stokes-number", "stokes-over-density"] = (
        Field(description="of the stopping time")
    )
    K: Annotated[float | None, Measure("drag_coefficient")] = Field(
        None, gt=0, description='law "constant": force density K (v - u)'
    )
    t_stop: Time | None = Field(None, gt=0, description='law "stopping-time"')
    stokes: Number | None = Field(
        None, gt=0, description='t_stop Omega; with "stokes-over-density" where the disc has its Sigma_ref'
    )
    convention: Literal["papers", "kinetic"] = Field(
        "papers", description='Epstein: t_stop = s rho_s / (c_s rho_g), or "kinetic": times sqrt(pi/8)'
    )
    supersonic: StrictBool = Field(False, description="Epstein: faster by sqrt(1 + (9 pi/128) (slip / c_s)^2)")
    mean_free_column: Annotated[float | None, Measure("surface_density"), Default("mu m_u / 2e-15 cm2")] = Field(
        None, gt=0, description='law "epstein-stokes": rho_g times the mean free path'
    )
    direction: Literal["two-way", "one-way"] = Field("two-way", description="does the dust push back")
    scheme: Literal[
        "idic", "idic-linear", "tsc", "mk", "lab14", "reconstructed", "esph", "isph", "sios-ppm", "emsi-ppm"
    ] = Field("tsc", description="how gas and dust exchange momentum; -ppm: gas and dust as fluids on a fixed 1D grid")
    kernel: Literal["gas", "double-hump"] = Field(
        "gas", description='of the drag between pairs of particles: W of the gas, or "double-hump": q^2 W'
    )
    cell: Annotated[Number | None, Default("1 in 1D, 2 in 2D")] = Field(
        None, gt=0, description="side of a drag cell in local mean h; or a length"
    )
    cell_length: Length | None = Field(None, gt=0, description="side of a drag cell as a length, instead of cell")
    heating: Annotated[StrictBool, Default("true for adiabatic gas and two-way drag")] = Field(
        description="frictional heat goes to the gas"
    )
    integration: Literal["exponential", "implicit"] = Field(
        "exponential", description='exact exponential, or "implicit": first-order backward Euler'
    )


class SelfGravity(Table):
    softening: Length | None = Field(None, gt=0, description='Plummer length, for kernel "plummer"')
    kernel: Literal["plummer", "thin-disc"] = Field(
        "plummer", description='1 / sqrt(r^2 + softening^2), or the mean over a Gaussian disc of height "thickness"'
    )
    thickness: Length | None = Field(None, gt=0, description='constant scale height H, for kernel "thin-disc"')
    sources: tuple[Literal["gas", "dust"], ...] = Field(("gas", "dust"), min_length=1, description="what attracts")


class Star(Table):
    mass: Mass = Field(gt=0, description="fixed at the origin")
    accretion_radius: Length = Field(0.0, ge=0, description="what comes closer is removed and accounted for")
    softening: Length = Field(0.0, ge=0, description="Plummer length")


class External(Table):
    gas: AccelerationVector = Field(0, validate_default=True, description="constant acceleration of the gas")
    dust: AccelerationVector = Field(0, validate_default=True, description="constant acceleration of the dust")
    vertical_frequency: Annotated[float, Measure("frequency")] = Field(
        0.0, ge=0, description="Omega in -Omega^2 z, on both"
    )


Initial = Annotated[Disc | Box | Wave | Shock | Sheet | Blast | Settling | Vortex, Field(discriminator="kind")]

# Every table by its name; `dust` may be a list of tables.
TABLES: dict[str, Any] = {
    "units": UnitsTable,
    "run": Run,
    "space": Space,
    "initial": Initial,
    "gas": Gas,
    "background": Background,
    "dust": tuple[Dust, ...],
    "drag": Drag,
    "self_gravity": SelfGravity,
    "star": Star,
    "external": External,
}
REQUIRED = ("run", "space", "initial")
# Drag schemes of gas and dust that are fluids on a fixed grid, their particles its cells.
ON_CELLS = ("sios-ppm", "emsi-ppm")
# What `--without` can remove, in the order of a step.
EFFECTS = ("gas", "gas.viscosity", "gas.conductivity", "background", "dust", "star", "self_gravity", "external", "drag")


def models_in(annotation: Any) -> list[type[Table]]:
    """The tables that a type allows: of a union each of its members."""
    if isinstance(annotation, type) and issubclass(annotation, Table):
        return [annotation]
    return [model for part in get_args(annotation) for model in models_in(part)]


def measure_of(field: Any) -> Measure | None:
    """The measure of a key, found in its metadata or in that of the types that it is made of."""

    def search(part: Any) -> Any:
        found = [entry for entry in getattr(part, "__metadata__", ()) if isinstance(entry, Measure)]
        return found or [measure for inner in get_args(part) for measure in search(inner)]

    own = [entry for entry in field.metadata if isinstance(entry, Measure)]
    return next(iter(own or search(field.annotation)), None)


def choices_in(annotation: Any) -> list[Any]:
    """The words that a type of literals allows."""
    if get_origin(annotation) is Literal:
        return list(get_args(annotation))
    return [choice for part in get_args(annotation) for choice in choices_in(part)]
