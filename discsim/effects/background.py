"""One-way drag in a given gas disc (`[background]`): no SPH, no cells, no grid.

Sigma ~ r^-p, c_s^2 ~ r^-q, turning in balance, Omega_g^2 r = GM r / (r^2 + s^2)^(3/2) + (1/Sigma) dP/dr. The kick
relaxes each particle exactly in the frame of the gas (`kernels/background.py`). It limits no step.
"""

import numpy as np

from discsim.background import GivenDisc
from discsim.drag.laws import Law
from discsim.effects import base
from discsim.kernels.background import relax_background
from discsim.state import State
from discsim.threads import share


class Effect(base.Effect):
    name = "drag"

    def __init__(self, scene, state):
        self.law = Law(scene)
        self.ratios = np.array([population.ratio for population in scene.dust])
        self.star = scene.star
        self.disc = GivenDisc(scene)

    def stopping_time(self, population: int, density, sound, omega, ratio) -> np.ndarray:
        return self.law.stopping_time(population, density, sound, omega, ratio)

    def kick(self, state: State, dt: float) -> None:
        self._relax(state, state.dust.vel, dt)

    def current_stopping_times(self, state: State) -> np.ndarray:
        """Stopping times of the dust where it is now (n,); changes no velocity."""
        return self._relax(state, state.dust.vel.copy(), 0.0)

    def _relax(self, state: State, vel: np.ndarray, dt: float) -> np.ndarray:
        dust = state.dust
        times = np.empty(dust.count)
        share(
            relax_background, dust.count, dust.pos, vel, dust.acc, dust.species, self.law.code, self.law.grains,
            self.law.nonlinear, self.ratios, self.star.mass, self.star.softening, self.disc.laws, state.lag, dt, times,
        )  # fmt: skip
        return times
