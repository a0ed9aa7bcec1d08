"""Drag and motion of gas and dust on a fixed 1D grid (`discsim/numerics/ppm.py`).

The schemes sios-ppm and emsi-ppm solve fluxes and drag in one operator in the slot MOVE; there is no kick. The drag
sets no time-step limit.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from discsim.drag import cautions
from discsim.drag.classes import law_of
from discsim.effects import base
from discsim.effects.stopping import stopping_columns
from discsim.numerics.state import State
from discsim.parts import SCHEMES, Lazy
from discsim.physics.eos import thermal_speed
from discsim.physics.laws import SceneLaw

if TYPE_CHECKING:
    from discsim.physics.local import Local
    from discsim.scene import Scene

kernels = Lazy("discsim.kernels.fluid1d.drag")
ppm = Lazy("discsim.numerics.ppm")


class Effect(base.KickEffect):
    def __init__(self, scene: Scene, state: State) -> None:
        self.advance = SCHEMES[scene.drag.scheme].advance
        self.law = law_of(scene, SceneLaw(scene))
        self.heating = scene.drag.heating
        self.tube = ppm.Tube(scene, state)

    @classmethod
    def unused(cls, scene: Scene) -> tuple[str, ...]:
        return sum(SCHEMES[scene.drag.scheme].unused.values(), ())

    @classmethod
    def report(cls, scene: Scene, at: Local) -> base.Report:
        return base.Report(warnings=cautions.warnings(scene, at))

    def operators(self, state: State) -> list[base.Operator]:
        """Return the only operator, which applies fluxes and drag."""
        return [base.Operator("drag.move", base.Slot.MOVE, self.move)]

    def move(self, state: State, dt: float) -> None:
        self.tube.write(state, self.advance(self.law, self.tube, self.tube.read(state), dt, self.heating))

    def current_stopping_times(self, state: State) -> np.ndarray:
        """Return the stopping time of the dust in each cell (n,)."""
        gas, dust = state.gas, state.dust
        sound = thermal_speed(state.scene, gas)
        return kernels.stopping_times(self.law.code, self.law.grains[0], gas.density, dust.density, sound)

    def columns(self, state: State) -> dict[str, dict[str, np.ndarray]]:
        return stopping_columns(state, self.current_stopping_times(state))
