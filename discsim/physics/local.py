"""Estimates of a scene's gas at sample points, for previews and warnings, without particles."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from discsim.formulas.smoothing import SMOOTHING
from discsim.parts import Lazy

if TYPE_CHECKING:
    from discsim.scene import Scene

polar = Lazy("discsim.physics.polar")

Array = np.ndarray


def resolution(scene: Scene, h: Array) -> Array:
    """Return the smoothing lengths `h` (n,) of a scene's kernel, converted to the usual definition of h.

    Only the kernel quintic-h has another definition: its h is the support radius, three times the usual h.
    """
    return h / SMOOTHING[scene.gas.kernel].squeezed if scene.gas else h


def longest_step(scene: Scene, h: Array, sound_speed: Array, closing: Array | float = 0.0) -> Array:
    """Return the time-step limit (n,) of the gas before the Courant factor (`effects/gas.py`, `effects/polar.py`).

    h (n,): smoothing length as the kernel defines it. sound_speed (n,): sound speed. closing: -div v of converging
    SPH gas, (n,) or one number; 0 for other gas.
    """
    if scene.model.polar:
        found: Array = polar.longest_step(scene, h, sound_speed)
        return found
    viscosity = scene.gas.viscosity if scene.gas else None
    signal, rate = (viscosity.signal, viscosity.closing) if viscosity else (1.0, 1.0)
    return 1.0 / (sound_speed * signal / resolution(scene, h) + rate * closing)


PHASES = 256  # number of sample times in an orbit


class Expected(NamedTuple):
    """Estimated time-step limit of an effect.

    step: the limit, or limits (PHASES,) at PHASES equidistant times in an orbit. where: place that sets the limit, as
    text for messages like "at 12 au".
    """

    step: Array | float = math.inf
    where: str = ""


@dataclass(frozen=True)
class ForecastState:
    """Estimated state of a run at some time, in code units.

    Attributes
    ----------
    time, elapsed : float
        Time of the run, and the time since its start.
    at : GasSamples
        Estimates of the gas at points throughout the disc or box.
    inner, outer : float
        Innermost and outermost radius of the particles that limit the step.
    nearest : float
        Smallest distance of these particles from the star; inf without star or particles.
    spacing : callable (r)
        Returns the mean distance between neighbouring particles at a radius.
    """

    time: float
    elapsed: float
    at: GasSamples
    inner: float
    outer: float
    nearest: float
    spacing: Callable[[float], float]


@dataclass(frozen=True)
class GasSamples:
    """Estimates of the gas at sample points, arrays (n,) in code units. A quantity is None if the scene does not define
    it.

    Attributes
    ----------
    places : list of str
        Names of the points for messages, like "12 au" or "everywhere".
    radius, density, sound_speed, thermal_speed, omega, h : ndarray or None
        Radius, density, speed of sound waves, sqrt(P / rho), orbital frequency and smoothing length.
    resolution : ndarray or None
        Smoothing length in the usual definition of h (see `resolution`).
    step : ndarray or None
        Time-step limit of the gas.
    by_mass : callable ()
        Returns (h/H, fraction), arrays (m,): values of h/H in rising order, and the mass fraction of the gas with an
        h/H up to each value.
    in_drag_cells : callable ()
        Returns (side, gas, dust), arrays (n,): side of a drag cell at the start, and its mean numbers of gas and dust
        particles. None if the scene has no drag cells.
    relative_mass : ndarray
        Mass of a gas particle divided by the mean over all gas particles.
    particle_mass : float or None
        Mean mass of a gas particle.
    cell : float or None
        Side of a grid cell.
    jump : ndarray or None
        Velocity jump of a shock at the point.
    """

    places: list[str]
    radius: Array | None
    density: Array
    sound_speed: Array | None
    thermal_speed: Array | None
    omega: Array | None
    h: Array | None
    resolution: Array | None
    step: Array | None
    by_mass: Callable[[], tuple[Array, Array]]
    in_drag_cells: Callable[[], tuple[Array, Array, Array] | None]
    relative_mass: Array
    particle_mass: float | None
    cell: float | None
    jump: Array | None = None

    def where(self, number: int) -> str:
        """Return the place of the point with the index `number`, as text for messages like "at 12 au"."""
        if not self.places:
            return ""
        place = self.places[number]
        return place if place == "everywhere" else f"at {place}"

    def smallest(self, steps: Array, where: str = "") -> Expected:
        """Return the smallest of the time-step limits `steps` (n,).

        where: place of the limit as text, by default the place of the sample point.
        """
        worst = int(np.argmin(steps))
        return Expected(float(steps[worst]), where or self.where(worst))

    @property
    def scale_height(self) -> Array | None:
        """Scale height H = c_T / Omega (n,)."""
        if self.thermal_speed is None or self.omega is None:
            return None
        return self.thermal_speed / self.omega

    @property
    def toomre_q(self) -> Array | None:
        """Toomre's Q = c_s Omega / (pi G Sigma) (n,)."""
        if self.sound_speed is None or self.omega is None:
            return None
        return self.sound_speed * self.omega / (math.pi * self.density)
