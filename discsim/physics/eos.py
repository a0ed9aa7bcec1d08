"""Equations of state: pressure and sound speed of the gas, and the sound speed that a disc starts with.

isothermal          P = c_s^2 rho
locally-isothermal  P = c_s^2 rho,  c_s^2 = (H/r)_0^2 (G M / r_0) (r / r_0)^-q
adiabatic           P = (gamma - 1) rho u,  c_s^2 = gamma P / rho
polytropic          P = K rho^gamma,  c_s^2 = gamma P / rho
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field

from discsim.scene.fields import STEEPEST, Length, Measure, Number, Table, Velocity, fault

if TYPE_CHECKING:
    from discsim.scene import Scene

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


@dataclass(frozen=True)
class Eos:
    """An equation of state: its keys, and whether the gas holds heat, an energy u of its own."""

    keys: type[Table]
    holds_heat: bool = False


ISOTHERMAL = Eos(Isothermal)
LOCALLY_ISOTHERMAL = Eos(LocallyIsothermal)
ADIABATIC = Eos(Adiabatic, holds_heat=True)
POLYTROPIC = Eos(Polytropic)


def radius(pos: Array) -> Array:
    """Distance from the origin (n,)."""
    return np.sqrt(np.einsum("ij,ij->i", pos, pos))


def thermal_speed(scene: Scene, r: Array | float) -> Array:
    """sqrt(P / rho) at radius `r` that the scene's temperature asks for (n,); the initial one for adiabatic gas.

    For adiabatic gas a given sound speed is the adiabatic one, an aspect ratio the isothermal one.
    """
    eos: Any = scene.gas.eos
    r = np.asarray(r, dtype=float)
    if getattr(eos, "aspect_ratio", None) is not None:
        r0 = eos.reference_radius
        at_r0 = eos.aspect_ratio * np.sqrt(scene.star.mass / r0)
        return at_r0 * (np.maximum(r, 1e-12 * r0) / r0) ** (-0.5 * eos.temperature_index)
    speed = np.full(r.shape, eos.sound_speed)
    return speed / np.sqrt(eos.gamma) if eos.kind == "adiabatic" else speed


def initial_energy(scene: Scene, r: Array) -> Array | None:
    """Specific internal energy (n,) of adiabatic gas at the start; None for gas without one."""
    if scene.gas.eos.kind != "adiabatic":
        return None
    return thermal_speed(scene, r) ** 2 / (scene.gas.eos.gamma - 1.0)


def pressure_and_sound_speed(scene: Scene, pos: Array, density: Array, u: Array | None) -> tuple[Array, Array]:
    """P and c_s, (n,) each, from positions, densities and specific internal energies."""
    eos: Any = scene.gas.eos
    if eos.kind == "adiabatic":
        pressure = (eos.gamma - 1.0) * density * u
        with np.errstate(invalid="ignore"):  # of an energy below zero: the step's limit is then not a number
            return pressure, np.sqrt(eos.gamma * pressure / density)
    if eos.kind == "polytropic":
        pressure = eos.constant * density**eos.gamma
        return pressure, np.sqrt(eos.gamma * pressure / density)
    speed = thermal_speed(scene, radius(pos))
    return speed * speed * density, speed


def thermal_energy(scene: Scene, mass: Array, density: Array, u: Array | None) -> float:
    """Thermal energy of the gas: of what it holds where it holds any, 0 for (locally) isothermal gas."""
    eos: Any = scene.gas.eos
    if eos.kind == "adiabatic":
        return float((mass * u).sum())
    if eos.kind == "polytropic":
        return float((mass * eos.constant * density ** (eos.gamma - 1.0)).sum() / (eos.gamma - 1.0))
    return 0.0
