"""Pressureless dust in the cells of a fixed 1D grid: density, and step limit dx / |u|. The drag scheme moves the
dust.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from discsim.effects import base
from discsim.numerics.state import State

if TYPE_CHECKING:
    from discsim.scene import Scene


class Effect(base.Effect):
    acts_on = ()

    def __init__(self, scene: Scene, state: State) -> None:
        self.dx = scene.space.size[0] / state.dust.count
        state.dust.density = np.zeros(state.dust.count)

    @classmethod
    def unused(cls, scene: Scene) -> tuple[str, ...]:
        return "offset", "placement"

    def accelerate(self, state: State) -> None:
        state.dust.density = state.dust.mass / self.dx

    def limit(self, state: State) -> float:
        fastest = float(np.abs(state.dust.vel).max(initial=0.0))
        return self.dx / fastest if fastest > 0.0 else np.inf
