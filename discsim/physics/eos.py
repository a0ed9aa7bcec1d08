"""Equations of state: pressure, sound speed and thermal energy of the gas, and its sound speed at the start.

isothermal          P = c_s^2 rho
locally-isothermal  P = c_s^2 rho,  c_s^2 = (H/r)_0^2 (G M / r_0) (r / r_0)^-q
adiabatic           P = (gamma - 1) rho u,  c_s^2 = gamma P / rho
polytropic          P = K rho^gamma,  c_s^2 = gamma P / rho

c_s is the speed of sound waves. The thermal speed, or isothermal sound speed, of any gas is c_T = sqrt(P / rho)
= sqrt(k_B T / m). It determines the scale height H = c_T / Omega, the drag on grains, turbulent viscosities and
temperatures.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field

from discsim.parts import EOS, STARTS, Lazy
from discsim.physics.centre import passive_speed
from discsim.scene.fields import MAX_GAMMA, Length, Measure, Number, Table, Velocity, fault
from discsim.scene.rules import Draft, Problem, Rule, missing_tables

if TYPE_CHECKING:
    from discsim.numerics.state import Gas
    from discsim.scene import Scene

growth = Lazy("discsim.physics.growth")
totals = Lazy("discsim.numerics.totals")
Array = np.ndarray


def _not_isothermal(value: float) -> float:
    # The thermal energy P / (gamma - 1) diverges at gamma = 1.
    if value == 1.0:
        raise fault('gamma = 1 is isothermal gas; set kind = "isothermal" and sound_speed = sqrt(constant)')
    return value


class Isothermal(Table):
    """P = c_s^2 rho."""

    kind: Literal["isothermal"] = "isothermal"
    sound_speed: Velocity = Field(gt=0, description="sound speed c_s")
    mean_molecular_weight: Number = Field(2.34, gt=0, description="mean molecular weight, for temperatures")


class LocallyIsothermal(Table):
    """P = c_s(r)^2 rho, c_s^2 ~ r^-q."""

    kind: Literal["locally-isothermal"] = "locally-isothermal"
    aspect_ratio: Number = Field(gt=0, description="aspect ratio H/r at reference_radius")
    temperature_index: Number = Field(0.5, description="q in c_s^2 ~ r^-q")
    reference_radius: Length = Field(1.0, gt=0, description="radius at which aspect_ratio holds")
    mean_molecular_weight: Number = Field(2.34, gt=0, description="mean molecular weight, for temperatures")


class Adiabatic(Table):
    """P = (gamma - 1) rho u; the initial temperature is uniform or a power law of radius."""

    kind: Literal["adiabatic"] = "adiabatic"
    gamma: Number = Field(gt=1, le=MAX_GAMMA, description="ratio of specific heats")
    sound_speed: Velocity | None = Field(None, gt=0, description="uniform sound speed at the start")
    aspect_ratio: Number | None = Field(
        None, gt=0, description="H/r at reference_radius at the start, instead of sound_speed"
    )
    temperature_index: Number = Field(0.5, description="q in c_s^2 ~ r^-q, with aspect_ratio")
    reference_radius: Length = Field(1.0, gt=0, description="radius at which aspect_ratio holds")
    mean_molecular_weight: Number = Field(2.34, gt=0, description="mean molecular weight, for temperatures")


class Polytropic(Table):
    """P = constant rho^gamma."""

    kind: Literal["polytropic"] = "polytropic"
    gamma: Annotated[Number, AfterValidator(_not_isothermal)] = Field(gt=0, le=MAX_GAMMA, description="exponent gamma")
    constant: Annotated[float, Measure("polytropic_constant")] = Field(
        gt=0, description="polytropic constant P / rho^gamma"
    )
    mean_molecular_weight: Number = Field(2.34, gt=0, description="mean molecular weight, for temperatures")


def _star_problems(draft: Draft) -> Iterator[Problem]:
    """Yield a problem of an aspect ratio without a star."""
    yield from missing_tables(draft, ("gas", "eos", "kind"), {"star": "H/r needs a star"})


def _temperature_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of adiabatic gas with no initial temperature or two."""
    eos = draft.gas.eos
    is_given = getattr(draft.start, "sets_pressure", False) or getattr(draft.initial, "sets_temperature", False)
    if eos.sound_speed is not None and eos.aspect_ratio is not None:
        yield ("gas", "eos", "sound_speed"), "gas.eos.aspect_ratio is also given; keep sound_speed or aspect_ratio"
    elif eos.sound_speed is None and eos.aspect_ratio is None and draft.start and not is_given:
        yield ("gas", "eos"), "no temperature at the start is given; add the key sound_speed or aspect_ratio"
    if eos.aspect_ratio is not None:
        yield from missing_tables(draft, ("gas", "eos", "aspect_ratio"), {"star": "H/r needs a star"})


def _toomre_problems(draft: Draft) -> Iterator[Problem]:
    """Yield a problem of initial.toomre_q in a polytropic disc whose Toomre Q does not depend on its mass."""
    if getattr(draft.initial, "toomre_q", None) is not None and draft.gas.eos.gamma == 3.0:
        wrong = "Toomre Q of a polytropic disc with gamma = 3 does not depend on its mass"
        yield ("initial", "toomre_q"), f"{wrong}; replace toomre_q by mass or surface_density"


SqrtLaw = tuple[float, float, bool]  # c_s at a reference radius, this radius, and whether c_s ~ r^(-1/4), else r^(-1/2)
TWO_ROOTS = {0.5: True, 1.0: False}  # the last entry of `SqrtLaw`, by q in c_s ~ r^(-q/2)


class Eos:
    """Equation of state P = c_s^2 rho with c_s a function of radius, and base class of all others.

    In all methods r (n,) is the radius, density (n,) is rho or Sigma, and eos is the table `gas.eos` of a scene.
    Results are arrays (n,) in code units unless noted.

    Attributes
    ----------
    keys : type of Table
        Keys of `gas.eos` for this kind.
    holds_heat : bool
        Whether the gas has an energy equation, for its specific internal energy u.
    closes_energy : bool
        Whether the total energy of a run is conserved.
    one_speed : bool
        Whether the sound speed is the same everywhere and at all times.
    on_grid : bool
        Whether drag schemes on a fixed grid support this equation of state.
    takes_temperature : bool
        Whether a start may define the temperature instead of the table.
    rules : tuple of Rule
        Additional rules for a scene with this equation of state.
    """

    keys: type[Table]
    holds_heat = False
    closes_energy = False
    one_speed = False
    on_grid = False
    takes_temperature = False
    rules: tuple[Rule, ...] = ()

    def thermal_speed(self, scene: Scene, r: Array, density: Array | None = None) -> Array:
        """Return sqrt(P / rho) from the temperature of the scene, which for adiabatic gas is the initial temperature.

        density: needed only if the temperature depends on it.
        """
        own = _speed_of_start(scene, r) if self.takes_temperature else None
        return self.table_thermal_speed(scene, r) if own is None else own

    def table_thermal_speed(self, scene: Scene, r: Array) -> Array:
        """Return sqrt(P / rho) from the temperature of the table, even if the start defines another temperature."""
        return _speed_of_temperature(scene, r)

    def sound_speed(self, scene: Scene, r: Array, density: Array) -> Array:
        """Return sqrt(dP/drho) for a fixed temperature as a function of radius."""
        return self.thermal_speed(scene, r)

    def wave_speed(self, scene: Scene, r: Array, density: Array) -> Array:
        """Return the speed of sound waves of the gas in a run."""
        return self.sound_speed(scene, r, density)

    def start_speed(self, scene: Scene, r: Array | None, density: Array) -> Array | None:
        """Return the initial `wave_speed`, or None if the scene does not define it, for example without a radius."""
        eos: Any = scene.gas.eos
        if self.takes_temperature and r is not None and _speed_of_start(scene, r) is not None:
            return self.wave_speed(scene, r, density)
        if getattr(eos, "sound_speed", None) is not None:
            return np.full_like(density, eos.sound_speed)
        if getattr(eos, "aspect_ratio", None) is not None and scene.star and r is not None:
            return self.wave_speed(scene, r, density)
        return None

    def index(self, eos: Any) -> float | None:
        """Return gamma for snapshots, for which P = (gamma - 1) rho u; None for isothermal gas."""
        return None

    def adiabatic_index(self, eos: Any, density: Array) -> Array | float:
        """Return d ln P / d ln rho = rho c_s^2 / P = (c_s / c_T)^2 of sound waves."""
        return self.index(eos) or 1.0

    def pressure_and_sound_speed(
        self, scene: Scene, pos: Array, density: Array, u: Array | None
    ) -> tuple[Array, Array]:
        """Return P and c_s. pos (n, d): positions. u (n,): specific internal energies; None without energy equation."""
        speed = self.thermal_speed(scene, radius(pos))
        return speed * speed * density, speed

    def roots(self, scene: Scene) -> SqrtLaw | None:
        """Return c_s ~ r^(-1/4) or c_s ~ r^(-1/2) for a fast kernel (`kernels/sph/eos.py`); None for another c_s."""
        return None

    def initial_energy(self, scene: Scene, r: Array) -> Array | None:
        """Return the initial specific internal energy; None for gas without energy equation."""
        return None

    def thermal_energy(self, eos: Any, mass: Array, density: Array, u: Array | None) -> float:
        """Return the total thermal energy: the sum of m u, or the work of compression for a polytrope, else 0."""
        return 0.0

    def toomre_power(self, eos: Any) -> float:
        """Return n in Q ~ Sigma^-n, for Toomre's Q at a fixed radius."""
        return 1.0

    def temperature_slope(self, eos: Any) -> float:
        """Return q in (1/Sigma) dP/dr = (d ln Sigma / d ln r - q) c_s^2 / r."""
        return eos.temperature_index if getattr(eos, "aspect_ratio", None) is not None else 0.0

    def power_law(self, scene: Scene, eos: Any, sigma: float, p: float) -> tuple[float, float, float]:
        """Return (c_T^2 at radius 1, q, f) of a disc with Sigma = sigma r^-p about a star.

        q and f are the exponents in c_T^2 = P / Sigma ~ r^-q and P ~ r^-f; -(1/Sigma) dP/dr = f c_T^2 / r.
        """
        return eos.sound_speed**2, 0.0, p


class IsothermalGas(Eos):
    """P = c_s^2 rho with a uniform c_s."""

    keys = Isothermal
    one_speed = on_grid = True

    def pressure_and_sound_speed(
        self, scene: Scene, pos: Array, density: Array, u: Array | None
    ) -> tuple[Array, Array]:
        speed = scene.gas.eos.sound_speed
        return speed * speed * density, np.full_like(density, speed)


class LocallyIsothermalGas(Eos):
    """P = c_s^2 rho with c_s a power law of radius, or a function of radius that the start defines."""

    keys = LocallyIsothermal
    takes_temperature = True
    rules = (_star_problems,)

    def roots(self, scene: Scene) -> SqrtLaw | None:
        eos, start = scene.gas.eos, scene.initial
        if type(self) is not LocallyIsothermalGas or eos.temperature_index not in TWO_ROOTS:
            return None
        if start and STARTS[start.kind].thermal_speed is not None:
            return None
        return _speed_at(scene, eos.reference_radius), eos.reference_radius, TWO_ROOTS[eos.temperature_index]

    def power_law(self, scene: Scene, eos: Any, sigma: float, p: float) -> tuple[float, float, float]:
        q, r0 = eos.temperature_index, eos.reference_radius
        return passive_speed(scene, eos.aspect_ratio, r0) ** 2 * r0**q, q, p + q


class AdiabaticGas(Eos):
    """P = (gamma - 1) rho u. The key sound_speed is the adiabatic one; aspect_ratio is H/r of the isothermal one."""

    keys = Adiabatic
    holds_heat = closes_energy = on_grid = takes_temperature = True
    rules = (_temperature_problems,)

    def table_thermal_speed(self, scene: Scene, r: Array) -> Array:
        eos: Any = scene.gas.eos
        speed = _speed_of_temperature(scene, r)
        return speed if eos.aspect_ratio is not None else speed / np.sqrt(eos.gamma)

    def wave_speed(self, scene: Scene, r: Array, density: Array) -> Array:
        return self.thermal_speed(scene, r) * np.sqrt(scene.gas.eos.gamma)

    def index(self, eos: Any) -> float | None:
        return eos.gamma

    def pressure_and_sound_speed(
        self, scene: Scene, pos: Array, density: Array, u: Array | None
    ) -> tuple[Array, Array]:
        gamma = scene.gas.eos.gamma
        pressure = (gamma - 1.0) * density * u
        with np.errstate(invalid="ignore"):  # a negative energy makes the time-step limit NaN, which is reported
            return pressure, np.sqrt(gamma * pressure / density)

    def initial_energy(self, scene: Scene, r: Array) -> Array | None:
        return self.thermal_speed(scene, r) ** 2 / (scene.gas.eos.gamma - 1.0)

    def thermal_energy(self, eos: Any, mass: Array, density: Array, u: Array | None) -> float:
        return float(totals.total(mass * u))


class PolytropicGas(Eos):
    """P = K rho^gamma."""

    keys = Polytropic
    closes_energy = True
    rules = (_toomre_problems,)

    def index(self, eos: Any) -> float | None:
        return eos.gamma

    def thermal_speed(self, scene: Scene, r: Array | None, density: Array | None = None) -> Array:
        return self.sound_speed(scene, r, density) / np.sqrt(scene.gas.eos.gamma)

    def sound_speed(self, scene: Scene, r: Array | None, density: Array) -> Array:
        eos: Any = scene.gas.eos
        has_gas = density > 0.0  # beyond an edge there is no gas, and the sound speed is set to 0
        speed2 = eos.gamma * eos.constant * np.where(has_gas, density, 1.0) ** (eos.gamma - 1.0)
        return np.where(has_gas, np.sqrt(speed2), 0.0)

    def start_speed(self, scene: Scene, r: Array | None, density: Array) -> Array | None:
        return self.sound_speed(scene, r, density)

    def pressure_and_sound_speed(
        self, scene: Scene, pos: Array, density: Array, u: Array | None
    ) -> tuple[Array, Array]:
        eos: Any = scene.gas.eos
        pressure = eos.constant * density**eos.gamma
        return pressure, np.sqrt(eos.gamma * pressure / density)

    def thermal_energy(self, eos: Any, mass: Array, density: Array, u: Array | None) -> float:
        return float(totals.total(mass * eos.constant * density ** (eos.gamma - 1.0)) / (eos.gamma - 1.0))

    def toomre_power(self, eos: Any) -> float:
        return 0.5 * (3.0 - eos.gamma)

    def power_law(self, scene: Scene, eos: Any, sigma: float, p: float) -> tuple[float, float, float]:
        return eos.constant * sigma ** (eos.gamma - 1), p * (eos.gamma - 1), p * eos.gamma


ISOTHERMAL = IsothermalGas()
LOCALLY_ISOTHERMAL = LocallyIsothermalGas()
ADIABATIC = AdiabaticGas()
POLYTROPIC = PolytropicGas()


def eos_of(scene: Scene) -> Eos:
    """Return the equation of state of a scene's gas."""
    return EOS[scene.gas.eos.kind]


def initial_energy(scene: Scene, r: Array) -> Array | None:
    """Return the initial specific internal energy (n,) of the gas at radius `r` (n,); None without energy equation."""
    return eos_of(scene).initial_energy(scene, r)


def pressure_and_sound_speed(scene: Scene, pos: Array, density: Array, u: Array | None) -> tuple[Array, Array]:
    """Return P (n,) and c_s (n,) of gas by `Eos.pressure_and_sound_speed` of the scene's equation of state."""
    return eos_of(scene).pressure_and_sound_speed(scene, pos, density, u)


def thermal_speed(scene: Scene, gas: Gas) -> Array:
    """Return sqrt(P / rho) (n,) of gas particles in a run, for H, drag and turbulence; rho excludes small dust."""
    eos, keys = eos_of(scene), scene.gas.eos
    index = eos.adiabatic_index(keys, gas.density)
    if gas.small is not None and eos.holds_heat:  # c_s is that of the mixture of gas and small dust
        index = index * growth.gas_fraction(scene, gas)
    if np.ndim(index) == 0 and index == 1.0:
        return gas.sound_speed
    return gas.sound_speed / np.sqrt(index)


def thermal_energy(scene: Scene, mass: Array, density: Array, u: Array | None) -> float:
    """Return the total thermal energy: the sum of m u, or the work of compression for a polytrope; 0 if isothermal."""
    return eos_of(scene).thermal_energy(scene.gas.eos, mass, density, u)


def radius(pos: Array) -> Array:
    """Return the distances (n,) of positions (n, d) from the origin."""
    square = pos[:, 0] * pos[:, 0]
    for k in range(1, pos.shape[1]):
        square += pos[:, k] * pos[:, k]
    return np.sqrt(square, out=square)


def _speed_of_start(scene: Scene, r: Array) -> Array | None:
    """Return the thermal speed (n,) that the start defines at radius `r` (n,); None if it defines none."""
    if scene.initial is None or (speed := STARTS[scene.initial.kind].thermal_speed) is None:
        return None
    return speed(scene, np.asarray(r, dtype=float))


def _speed_of_temperature(scene: Scene, r: Array) -> Array:
    """Return the sound speed (n,) of gas.eos at radius `r` (n,): c_s ~ r^(-q/2) with aspect_ratio, else uniform."""
    eos: Any = scene.gas.eos
    r = np.asarray(r, dtype=float)
    if getattr(eos, "aspect_ratio", None) is None:
        return np.full(r.shape, eos.sound_speed)
    r0 = eos.reference_radius
    return _speed_at(scene, r0) * _fast_power(np.maximum(r, 1e-12 * r0) / r0, -0.5 * eos.temperature_index)


def _speed_at(scene: Scene, r0: float) -> float:
    """Return the sound speed at the reference radius `r0` of gas.eos."""
    return passive_speed(scene, scene.gas.eos.aspect_ratio, r0)


def _fast_power(x: Array, exponent: float) -> Array:
    """Return x^exponent. Square roots make the exponents -1/4 and -1/2 four times as fast."""
    if exponent == -0.25:
        return 1.0 / np.sqrt(np.sqrt(x))
    if exponent == -0.5:
        return 1.0 / np.sqrt(x)
    return x**exponent
