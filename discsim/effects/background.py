"""One-way drag in a given gas disc (`[background]`): no SPH, no cells, no grid.

Sigma ~ r^-p, c_s^2 ~ r^-q, turning in balance, Omega_g^2 r = GM r / (r^2 + s^2)^(3/2) + (1/Sigma) dP/dr. The kick
relaxes each particle exactly to its steady drift there (`kernels/background.py`). It limits no step.
"""

from typing import Any

import numpy as np
from pydantic import Field

from discsim.effects import base
from discsim.numerics.state import State
from discsim.numerics.threads import share
from discsim.parts import EOS, Lazy
from discsim.physics.given_disc import GivenDisc
from discsim.physics.laws import SceneLaw
from discsim.scene.fields import Length, Number, SurfaceDensity, Table, kinds_of

kernels = Lazy("discsim.kernels.background")
EosWithoutHeat: Any = kinds_of(eos for eos in EOS.values() if not eos.holds_heat)


class Keys(Table):
    """The gas as a given disc in balance about the star, instead of [gas]; it drags the dust and nothing moves it."""

    surface_density: SurfaceDensity = Field(gt=0, description="Sigma at reference_radius")
    surface_density_index: Number = Field(1.0, description="p in Sigma ~ r^-p")
    reference_radius: Length = Field(1.0, gt=0, description="where surface_density holds")
    eos: EosWithoutHeat = Field(description="equation of state")


class Effect(base.Effect):
    keys = Keys
    name = "drag"
    acts_on = ()  # it is the kick

    def __init__(self, scene, state):
        self.law = SceneLaw(scene)
        self.ratios = np.array([population.ratio for population in scene.dust])
        self.star = scene.star
        self.disc = GivenDisc(scene)

    def kick(self, state: State, dt: float) -> None:
        self._relax(state, state.dust.vel, dt)

    def current_stopping_times(self, state: State) -> np.ndarray:
        """Stopping times of the dust where it is now (n,); changes no velocity."""
        return self._relax(state, state.dust.vel.copy(), 0.0)

    def drift(self, state: State) -> np.ndarray:
        """Radial and azimuthal velocity (n, 2) of the dust's steady drift, the latter beyond Kepler's."""
        dust, out = state.dust, np.empty_like(state.dust.vel)
        share(kernels.path_velocities, dust.count, dust.pos, dust.species, *self._disc, out)
        return out

    @property
    def _disc(self) -> tuple:
        """What kernels take of the law, the star and the gas."""
        law = self.law.code, self.law.grains, self.law.nonlinear, self.ratios
        return *law, self.star.mass, self.star.softening, self.disc.laws

    def _relax(self, state: State, vel: np.ndarray, dt: float) -> np.ndarray:
        dust = state.dust
        times = np.empty(dust.count)
        share(kernels.kick_dust, dust.count, dust.pos, vel, dust.acc, dust.species, *self._disc, state.lag, dt, times)
        return times
