"""What the laws of the stopping time (`kernels/laws.py`) take from a scene."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.parts import Lazy
from discsim.physics import profile
from discsim.physics.grains import epstein_stopping_time, mean_free_column

if TYPE_CHECKING:
    from discsim.scene import Scene

kernels = Lazy("discsim.kernels.laws")
Array = np.ndarray


class Law:
    """The scene's law; `grains` (populations, 5) is what it needs of them, `nonlinear` whether the slip changes it."""

    def __init__(self, scene: Scene):
        self.drag: Any = scene.drag
        self.code = kernels.LAWS[self.drag.law]
        self.nonlinear = self.drag.supersonic or self.code == kernels.EPSTEIN_STOKES
        self.populations = len(scene.dust or ())
        self.several = True if self.populations > 1 else None  # None: not compiled
        self.grains = np.array([self._grain(scene, population) for population in scene.dust or ()])

    def _grain(self, scene: Scene, population: Any) -> list[float]:
        drag = self.drag
        if drag.law in ("epstein", "epstein-stokes"):
            # t_stop c_s rho_g, all of it that is the grain's.
            value = epstein_stopping_time(population.grain_size, population.grain_density, 1.0, 1.0, drag.convention)
        elif drag.law == "stokes-over-density":
            value = drag.stokes * profile.reference_density(scene) / math.sqrt(2 * math.pi)
        else:
            value = {"constant": drag.K, "stopping-time": drag.t_stop}.get(drag.law, drag.stokes)
        if self.code != kernels.EPSTEIN_STOKES:
            return [value, kernels.KWOK * drag.supersonic, 0.0, 0.0, 0.0]
        thermal = population.grain_size * population.grain_density / value
        return [value, kernels.KWOK * drag.supersonic, population.grain_size, mean_free_column(scene), thermal]

    def stopping_time(self, population: int, density: Array, sound: Array, omega: Array, ratio: float) -> Array:
        """Stopping time at vanishing slip of a population in gas of given density, sound speed and Omega (n,)."""
        return kernels.stopping_times(self.code, self.grains[population], ratio, density, sound, omega)
