"""Gas in the cells of a fixed 1D grid: density, pressure, and the step limit dx / (|v| + c_s).

The effect of [drag] moves the gas.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from discsim.drag.published.fixed_grid import OF_SPH
from discsim.effects import base
from discsim.numerics.state import State
from discsim.physics.eos import pressure_and_sound_speed
from discsim.physics.local import Expected

if TYPE_CHECKING:
    from discsim.physics.local import Outlook
    from discsim.scene import Scene


class Effect(base.Effect):
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

    def operators(self, state: State) -> list[base.Operator]:
        found = base.arrays("gas", "density pressure sound_speed")
        return [
            base.Operator("gas.density", base.Slot.FORCE, self.find_density, base.arrays("gas", "pos mass u"), found),
            base.Operator("gas.limit", base.Slot.LIMIT, self.limit, base.arrays("gas", "vel sound_speed")),
        ]

    def find_density(self, view: base.View) -> None:
        gas = view.gas
        gas.density = gas.mass / self.dx
        gas.pressure, gas.sound_speed = pressure_and_sound_speed(self.scene, gas.pos, gas.density, gas.u)

    def limit(self, view: base.View) -> dict[str, base.Limit]:
        fastest = float((np.abs(view.gas.vel[:, 0]) + view.gas.sound_speed).max(initial=0.0))
        return {base.ALL: base.Limit(self.dx / fastest)} if fastest != 0.0 else {}
