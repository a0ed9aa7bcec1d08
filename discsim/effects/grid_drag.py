"""Drag between gas and dust on a fixed 1D grid, in one operator with their motion (`discsim/numerics/ppm.py`).

Fluxes and drag are solved together by the schemes sios-ppm and emsi-ppm, so that the move is the whole step and
there is nothing to kick. It limits no step.
"""

import numpy as np

from discsim.effects import base
from discsim.kernels.drag_grid import stopping_times
from discsim.numerics.ppm import Tube
from discsim.numerics.state import State
from discsim.parts import SCHEMES
from discsim.physics.laws import SceneLaw


class Effect(base.Effect):
    name = "drag"
    acts_on = ()  # it is the kick

    def __init__(self, scene, state):
        self.advance = SCHEMES[scene.drag.scheme].advance
        self.law = SceneLaw(scene)
        self.exponential = scene.drag.integration == "exponential"
        self.heating = scene.drag.heating
        self.tube = Tube(scene, state)

    def move(self, state: State, dt: float) -> None:
        self.tube.write(state, self.advance(self, self.tube, self.tube.read(state), dt))

    def current_stopping_times(self, state: State) -> np.ndarray:
        """Stopping times of the dust in each cell (n,)."""
        gas, dust = state.gas, state.dust
        return stopping_times(self.law.code, self.law.grains[0], gas.density, dust.density, gas.sound_speed)
