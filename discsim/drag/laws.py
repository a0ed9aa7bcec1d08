"""What the laws of the stopping time (`kernels/drag.py`) take from a scene."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.kernels.drag import LAWS, stopping_times
from discsim.units import epstein_stopping_time

if TYPE_CHECKING:
    from discsim.scene import Scene

Array = np.ndarray


class Law:
    """The scene's law; `values` has one number a population, which is what the law needs of its grains."""

    def __init__(self, scene: Scene):
        self.drag: Any = scene.drag
        self.code = LAWS[self.drag.law]
        self.values = np.array([self._value(population) for population in scene.dust])

    def _value(self, population: Any) -> float:
        if self.drag.law == "epstein":
            # t_stop c_s rho_g, all of it that is the grain's.
            grain = population.grain_size, population.grain_density
            return epstein_stopping_time(*grain, 1.0, 1.0, self.drag.convention)
        return {"constant": self.drag.K, "stopping-time": self.drag.t_stop}.get(self.drag.law, self.drag.stokes)

    def stopping_time(self, population: int, density: Array, sound: Array, omega: Array, ratio: float) -> Array:
        """Stopping time of a population in gas of given density, sound speed and Omega (n,)."""
        return stopping_times(self.code, self.values[population], ratio, density, sound, omega)
