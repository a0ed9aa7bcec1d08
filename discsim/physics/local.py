"""The gas of a scene at sample points, estimated before particles are made; input of previews and warnings."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from discsim.formulas.smoothing import SMOOTHING

if TYPE_CHECKING:
    from discsim.scene import Scene

Array = np.ndarray


def resolution(scene: Scene, h: Array) -> Array:
    """Return h in the usual units of kernels: the h of quintic-h is its support radius, 3 h of the quintic."""
    return h / SMOOTHING[scene.gas.kernel].squeezed if scene.gas else h


def longest_step(scene: Scene, h: Array, sound_speed: Array, closing: Array | float = 0.0) -> Array:
    """Return the time-step limit (n,) of the gas over the Courant factor (`effects/gas.py`).

    h: smoothing length as the kernel defines it. closing: -div v of converging gas.
    """
    given = scene.gas.viscosity if scene.gas else None
    signal, rate = (given.signal, given.closing) if given else (1.0, 1.0)
    return 1.0 / (sound_speed * signal / resolution(scene, h) + rate * closing)


PHASES = 256  # sample times of an orbit


class Expected(NamedTuple):
    """Estimated time-step limit of an effect.

    step: the limit, or limits (PHASES,) at even times of an orbit. where: its place for messages, like "at 12 au".
    """

    step: Array | float = math.inf
    where: str = ""


@dataclass(frozen=True)
class Outlook:
    """The estimated state of a run at a time, in code units.

    Attributes
    ----------
    time, passed : float
        Time of the run, and time since its start.
    at : Local
        Gas at points throughout the disc or box (n,).
    inner, outer : float
        Radii of the particles that limit the step.
    nearest : float
        Distance from the star of the nearest of these particles; inf without star or particles.
    spacing : callable (r)
        Return the particle spacing at a radius.
    """

    time: float
    passed: float
    at: Local
    inner: float
    outer: float
    nearest: float
    spacing: Callable[[float], float]


@dataclass(frozen=True)
class Local:
    """Estimates at sample points of the gas in code units, arrays (n,); None if the scene does not define them.

    Attributes
    ----------
    places : list of str
        Names of the points.
    radius, density, sound_speed, thermal_speed, omega, h : ndarray or None
        Radius, density, speed of sound waves, sqrt(P / rho), orbital frequency and smoothing length.
    resolution : ndarray or None
        `h` in the usual units of kernels.
    step : ndarray or None
        Time-step limit of the gas.
    by_mass : callable ()
        Return the rising h/H (m,) of points throughout the gas, and the mass fraction of gas up to each (m,).
    in_drag_cells : callable ()
        Return the side of a drag cell at the start, and its mean numbers of gas and dust particles; None without cells.
    relative_mass : ndarray
        Mass of a gas particle over the mean mass.
    particle_mass, cell : float or None
        Mean mass of a gas particle, and side of the grid's cells, of the whole scene.
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
        """Return the phrase for one of the places in a message, like "at 12 au"."""
        if not self.places:
            return ""
        place = self.places[number]
        return place if place == "everywhere" else f"at {place}"

    @property
    def scale_height(self) -> Array | None:
        if self.thermal_speed is None or self.omega is None:
            return None
        return self.thermal_speed / self.omega

    @property
    def toomre_q(self) -> Array | None:
        if self.sound_speed is None or self.omega is None:
            return None
        return self.sound_speed * self.omega / (math.pi * self.density)
