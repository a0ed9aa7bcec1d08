"""Gas in the cells of a fixed 1D grid: density, pressure, and step limit dx / (|v| + c_s).

The drag scheme moves the gas.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from discsim.drag.fixed_grid import OF_SPH
from discsim.effects import base
from discsim.numerics.state import State
from discsim.physics.eos import pressure_and_sound_speed
from discsim.physics.local import Expected

if TYPE_CHECKING:
    from discsim.physics.local import Outlook
    from discsim.scene import Scene


class Effect(base.Effect):
    acts_on = ()

    def __init__(self, scene: Scene, state: State) -> None:
        self.scene = scene
        self.dx = scene.space.size[0] / state.gas.count
        state.gas.h[:] = self.dx

    @classmethod
    def unused(cls, scene: Scene) -> tuple[str, ...]:
        return OF_SPH

    @classmethod
    def expected_limit(cls, scene: Scene, outlook: Outlook) -> Expected:
        sound = outlook.at.sound_speed
        return Expected() if sound is None else Expected(scene.space.size[0] / scene.gas.particles / float(sound.max()))

    def accelerate(self, state: State) -> None:
        gas = state.gas
        gas.density = gas.mass / self.dx
        gas.pressure, gas.sound_speed = pressure_and_sound_speed(self.scene, gas.pos, gas.density, gas.u)

    def limit(self, state: State) -> float:
        fastest = float((np.abs(state.gas.vel[:, 0]) + state.gas.sound_speed).max(initial=0.0))
        return self.dx / fastest if fastest != 0.0 else np.inf
