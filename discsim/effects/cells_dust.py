"""Pressureless dust in the cells of a fixed 1D grid: density, and the step dx / |u|; the drag's scheme moves it."""

import numpy as np

from discsim.effects import base
from discsim.numerics.state import State


class Effect(base.Effect):
    acts_on = ()

    def __init__(self, scene, state):
        self.dx = scene.space.size[0] / state.dust.count
        state.dust.density = np.zeros(state.dust.count)

    @classmethod
    def unused(cls, scene):
        return "offset", "placement"

    def accelerate(self, state: State) -> None:
        state.dust.density = state.dust.mass / self.dx

    def limit(self, state: State) -> float:
        fastest = float(np.abs(state.dust.vel).max())
        return self.dx / fastest if fastest > 0.0 else np.inf
