"""Equations of state: pressure and sound speed of the gas, the sound speed that it starts with, and what it holds.

isothermal          P = c_s^2 rho
locally-isothermal  P = c_s^2 rho,  c_s^2 = (H/r)_0^2 (G M / r_0) (r / r_0)^-q
adiabatic           P = (gamma - 1) rho u,  c_s^2 = gamma P / rho
polytropic          P = K rho^gamma,  c_s^2 = gamma P / rho

c_s is the speed of sound waves. The thermal speed of any gas is c_T = sqrt(P / rho) = sqrt(k_B T / m), the isothermal
sound speed: it sets the scale height H = c_T / Omega, the drag on grains, turbulent viscosities and temperatures.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field

from discsim.parts import EOS, STARTS, Lazy
from discsim.physics.centre import passive_speed
from discsim.scene.fields import STEEPEST, Length, Measure, Number, Table, Velocity, fault
from discsim.scene.rules import Draft, Problem, Rule

if TYPE_CHECKING:
    from discsim.numerics.state import Gas
    from discsim.scene import Scene

growth = Lazy("discsim.physics.growth")
totals = Lazy("discsim.numerics.totals")
Array = np.ndarray


def _not_isothermal(value: float) -> float:
    # Its thermal energy, P / (gamma - 1), has no limit there.
    if value == 1.0:
        raise fault('1 is isothermal gas; expected kind = "isothermal" with sound_speed = sqrt(constant)')
    return value


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


def _needs_star(draft: Draft) -> Iterator[Problem]:
    if not draft.has("star"):
        yield ("gas", "eos", "kind"), "H/r needs a star to orbit; expected a table [star] too"


def _one_temperature(draft: Draft) -> Iterator[Problem]:
    eos = draft.gas.eos
    brings = getattr(draft.start, "brings_pressure", False) or getattr(draft.initial, "brings_temperature", False)
    if eos.sound_speed is not None and eos.aspect_ratio is not None:
        yield ("gas", "eos", "sound_speed"), "aspect_ratio is there too; expected one of the two"
    elif eos.sound_speed is None and eos.aspect_ratio is None and draft.start and not brings:
        yield ("gas", "eos"), "the gas has no temperature at the start; expected sound_speed or aspect_ratio"
    if eos.aspect_ratio is not None and not draft.has("star"):
        yield ("gas", "eos", "aspect_ratio"), "H/r needs a star to orbit; expected a table [star] too"


def _q_of_the_mass(draft: Draft) -> Iterator[Problem]:
    if getattr(draft.initial, "toomre_q", None) is not None and draft.gas.eos.gamma == 3.0:
        wrong = "Q does not depend on the mass of a polytropic disc with gamma = 3"
        yield ("initial", "toomre_q"), f"{wrong}; expected mass or surface_density"


Roots = tuple[float, float, bool]  # c_s at a radius, that radius, and whether the root is taken twice
TWICE = {0.5: True, 1.0: False}  # by q of c_s ~ r^(-q/2)


class Eos:
    """An equation of state, here P = c_s^2 rho with c_s a function of radius; others override what differs.

    Radii, densities, pressures and speeds are arrays (n,) in code units; `eos` is the table that a scene gives.
    """

    keys: type[Table]
    holds_heat = False  # whether the gas has an energy u of its own
    closes_energy = False  # whether the total energy of a run is to stay what it is
    one_speed = False  # whether sound has one speed, the table's, everywhere and at any time
    on_grid = False  # whether fluids on a fixed grid may have it
    takes_temperature = False  # whether a start may bring a temperature of its own, in place of the table's
    rules: tuple[Rule, ...] = ()  # what a scene whose [gas] has it must have

    def thermal_speed(self, scene: Scene, r: Array, density: Array | None = None) -> Array:
        """sqrt(P / rho) at radius `r` that the scene's temperature asks for; of adiabatic gas the initial one.

        Gas whose temperature follows from its density needs that too.
        """
        own = _speed_of_start(scene, r) if self.takes_temperature else None
        return self.scene_speed(scene, r) if own is None else own

    def scene_speed(self, scene: Scene, r: Array) -> Array:
        """The same by the temperature of the table, whatever the start brings."""
        return _speed_of_temperature(scene, r)

    def sound_speed(self, scene: Scene, r: Array, density: Array) -> Array:
        """sqrt(dP/drho) at radius `r` and a density, the temperature being what it is there."""
        return self.thermal_speed(scene, r)

    def wave_speed(self, scene: Scene, r: Array, density: Array) -> Array:
        """Speed of sound waves, as the gas of a run has it."""
        return self.sound_speed(scene, r, density)

    def start_speed(self, scene: Scene, r: Array | None, density: Array) -> Array | None:
        """`wave_speed` at the start, of whatever kind; None where the table does not say, as where it has no radius."""
        eos: Any = scene.gas.eos
        if self.takes_temperature and r is not None and _speed_of_start(scene, r) is not None:
            return self.wave_speed(scene, r, density)
        if getattr(eos, "sound_speed", None) is not None:
            return np.full_like(density, eos.sound_speed)
        if getattr(eos, "aspect_ratio", None) is not None and scene.star and r is not None:
            return self.wave_speed(scene, r, density)
        return None

    def index(self, eos: Any) -> float | None:
        """gamma of P = (gamma - 1) rho u, for snapshots; None where the gas has no such energy."""
        return None

    def adiabatic_index(self, eos: Any, density: Array) -> Array | float:
        """Adiabatic index d ln P / d ln rho = rho c_s^2 / P at a density: the squared ratio of c_s to thermal speed."""
        return self.index(eos) or 1.0

    def pressure_and_sound_speed(
        self, scene: Scene, pos: Array, density: Array, u: Array | None
    ) -> tuple[Array, Array]:
        """P and c_s from positions (n, d), densities and specific internal energies."""
        speed = self.thermal_speed(scene, radius(pos))
        return speed * speed * density, speed

    def roots(self, scene: Scene) -> Roots | None:
        """What `kernels.eos` takes, where the speed of sound is given by the radius and roots of it."""
        return None

    def initial_energy(self, scene: Scene, r: Array) -> Array | None:
        """Specific internal energy at the start; None for gas that holds none."""
        return None

    def thermal_energy(self, eos: Any, mass: Array, density: Array, u: Array | None) -> float:
        """Thermal energy of the gas: of what it holds where it holds any, else the work that compressed it."""
        return 0.0

    def toomre_power(self, eos: Any) -> float:
        """n in Q ~ Sigma^-n, at a radius."""
        return 1.0

    def temperature_slope(self, eos: Any) -> float:
        """q in (1/Sigma) dP/dr = (d ln Sigma / d ln r - q) c_s^2 / r, beyond that of the density."""
        return eos.temperature_index if getattr(eos, "aspect_ratio", None) is not None else 0.0

    def power_law(self, scene: Scene, eos: Any, sigma: float, p: float) -> tuple[float, float, float]:
        """(c_T^2 at radius 1, q, f) of a disc of this gas with Sigma = sigma r^-p about a star:

        c_T^2 = P / Sigma ~ r^-q, and P ~ r^-f: the pull of the pressure is -(1/Sigma) dP/dr = f c_T^2 / r.
        """
        return eos.sound_speed**2, 0.0, p


class IsothermalGas(Eos):
    keys = Isothermal
    one_speed = on_grid = True

    def pressure_and_sound_speed(
        self, scene: Scene, pos: Array, density: Array, u: Array | None
    ) -> tuple[Array, Array]:
        speed = scene.gas.eos.sound_speed
        return speed * speed * density, np.full_like(density, speed)


class LocallyIsothermalGas(Eos):
    keys = LocallyIsothermal
    takes_temperature = True
    rules = (_needs_star,)

    def roots(self, scene: Scene) -> Roots | None:
        eos, start = scene.gas.eos, scene.initial
        if type(self) is not LocallyIsothermalGas or eos.temperature_index not in TWICE:
            return None
        if start and STARTS[start.kind].thermal_speed is not None:
            return None
        return _speed_at(scene, eos.reference_radius), eos.reference_radius, TWICE[eos.temperature_index]

    def power_law(self, scene: Scene, eos: Any, sigma: float, p: float) -> tuple[float, float, float]:
        q, r0 = eos.temperature_index, eos.reference_radius
        return passive_speed(scene, eos.aspect_ratio, r0) ** 2 * r0**q, q, p + q


class AdiabaticGas(Eos):
    """A given sound speed is the adiabatic one, an aspect ratio the isothermal one."""

    keys = Adiabatic
    holds_heat = closes_energy = on_grid = takes_temperature = True
    rules = (_one_temperature,)

    def scene_speed(self, scene: Scene, r: Array) -> Array:
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
        with np.errstate(invalid="ignore"):  # of an energy below zero: the step's limit is then not a number
            return pressure, np.sqrt(gamma * pressure / density)

    def initial_energy(self, scene: Scene, r: Array) -> Array | None:
        return self.thermal_speed(scene, r) ** 2 / (scene.gas.eos.gamma - 1.0)

    def thermal_energy(self, eos: Any, mass: Array, density: Array, u: Array | None) -> float:
        return float(totals.total(mass * u))


class PolytropicGas(Eos):
    keys = Polytropic
    closes_energy = True
    rules = (_q_of_the_mass,)

    def index(self, eos: Any) -> float | None:
        return eos.gamma

    def thermal_speed(self, scene: Scene, r: Array | None, density: Array | None = None) -> Array:
        assert density is not None
        return self.sound_speed(scene, r, density) / np.sqrt(scene.gas.eos.gamma)

    def sound_speed(self, scene: Scene, r: Array | None, density: Array) -> Array:
        eos: Any = scene.gas.eos
        there = density > 0.0  # beyond an edge, where there is no gas, sound has no speed
        speed2 = eos.gamma * eos.constant * np.where(there, density, 1.0) ** (eos.gamma - 1.0)
        return np.where(there, np.sqrt(speed2), 0.0)

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
    """The equation of state of a scene's gas."""
    return EOS[scene.gas.eos.kind]


def initial_energy(scene: Scene, r: Array) -> Array | None:
    """Specific internal energy (n,) of the gas at the start; None for gas that holds none."""
    return eos_of(scene).initial_energy(scene, r)


def pressure_and_sound_speed(scene: Scene, pos: Array, density: Array, u: Array | None) -> tuple[Array, Array]:
    """P and c_s, (n,) each, from positions, densities and specific internal energies."""
    return eos_of(scene).pressure_and_sound_speed(scene, pos, density, u)


def thermal_speed(scene: Scene, gas: Gas) -> Array:
    """sqrt(P / rho) (n,) of gas particles, for H, drag and turbulence; rho leaves out small dust that they carry."""
    eos, keys = eos_of(scene), scene.gas.eos
    index = eos.adiabatic_index(keys, gas.density)
    if gas.small is not None and eos.holds_heat:  # c_s is that of gas and small dust together
        index = index * growth.gas_share(scene, gas)
    if np.ndim(index) == 0 and index == 1.0:
        return gas.sound_speed
    return gas.sound_speed / np.sqrt(index)


def thermal_energy(scene: Scene, mass: Array, density: Array, u: Array | None) -> float:
    """Thermal energy of the gas: of what it holds where it holds any, 0 for (locally) isothermal gas."""
    return eos_of(scene).thermal_energy(scene.gas.eos, mass, density, u)


def radius(pos: Array) -> Array:
    """Distance from the origin (n,)."""
    square = pos[:, 0] * pos[:, 0]
    for k in range(1, pos.shape[1]):
        square += pos[:, k] * pos[:, k]
    return np.sqrt(square, out=square)


def _speed_of_start(scene: Scene, r: Array) -> Array | None:
    """The speed of the temperature that the start brings at radius `r`; None where it brings none."""
    if scene.initial is None or (speed := STARTS[scene.initial.kind].thermal_speed) is None:
        return None
    found: Array | None = speed(scene, np.asarray(r, dtype=float))
    return found


def _speed_of_temperature(scene: Scene, r: Array) -> Array:
    """The sound speed that the table has at radius `r`: c_s ~ r^(-q/2) by an aspect ratio, or everywhere the same."""
    eos: Any = scene.gas.eos
    r = np.asarray(r, dtype=float)
    if getattr(eos, "aspect_ratio", None) is None:
        return np.full(r.shape, eos.sound_speed)
    r0 = eos.reference_radius
    return _speed_at(scene, r0) * _power(np.maximum(r, 1e-12 * r0) / r0, -0.5 * eos.temperature_index)


def _speed_at(scene: Scene, r0: float) -> float:
    return passive_speed(scene, scene.gas.eos.aspect_ratio, r0)


def _power(x: Array, exponent: float) -> Array:
    """x^exponent; that of the usual temperatures, r^-1/2 and r^-1, by square roots, in a quarter of the time."""
    if exponent == -0.25:
        return 1.0 / np.sqrt(np.sqrt(x))
    if exponent == -0.5:
        return 1.0 / np.sqrt(x)
    return x**exponent
