"""The gas of a scene at a few places, before any particle is made: what previews show and warnings rest on."""

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
    """h as other kernels mean it: that of quintic-h is its whole support, 3 h of the quintic."""
    return h / SMOOTHING[scene.gas.kernel].squeezed if scene.gas else h


def longest_step(scene: Scene, h: Array, sound_speed: Array, closing: Array | float = 0.0) -> Array:
    """The longest step of the gas (`effects/gas.py`), h as other kernels mean it.

    closing: -div v of gas that comes together.
    """
    given = scene.gas.viscosity if scene.gas else None
    signal, rate = (given.signal, given.closing) if given else (1.0, 1.0)
    return 1.0 / (sound_speed * signal / resolution(scene, h) + rate * closing)


PHASES = 256  # of an orbit


class Expected(NamedTuple):
    """A step that is expected to be the longest that an effect allows, or such steps at PHASES even times of an orbit
    (PHASES,), and where: like "at 12 au", or "".
    """

    step: Array | float = math.inf
    where: str = ""


@dataclass(frozen=True)
class Outlook:
    """A run as its forecast expects it at a time, numbers in code units.

    passed: time since the start. at: the gas all over (n,). inner, outer: the radii between which particles are that
    limit the step. nearest: the distance from the star of the nearest of them; inf where there is no star, or none of
    them. spacing(r): between particles at a radius.
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
    """Numbers at a few places of the gas, arrays of one shape; None where the scene does not define them.

    resolution: `h` as other kernels mean it. step: the longest one. by_mass: makes h/H all over the gas (n,), rising,
    and the share of the gas with less than each (n,). in_drag_cells: the side of a drag cell there at the start, and
    its mean numbers of gas and dust particles; None where drag has no cells. relative_mass: of a gas particle there,
    over their mean. For the whole scene: particle_mass of the gas, the mean, and `cell`, the side of the grid's cells.
    jump: of the velocity in a shock there.
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
        """One of the places, for a sentence."""
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
