"""Pressureless dust in the cells of a fixed 1D grid: density, and the step limit dx / |u| with the dust velocity u.

The effect of [drag] moves the dust.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from discsim.effects import base
from discsim.numerics.state import State

if TYPE_CHECKING:
    from discsim.scene import Scene


class Effect(base.Effect):
    def __init__(self, scene: Scene, state: State) -> None:
        self.dx = scene.space.size[0] / state.dust.count
        state.dust.density = np.zeros(state.dust.count)

    @classmethod
    def unused(cls, scene: Scene) -> tuple[str, ...]:
        return "offset", "placement"

    def operators(self, state: State) -> list[base.Operator]:
        mass, vel, density = (base.arrays("dust", name) for name in ("mass", "vel", "density"))
        return [
            base.Operator("dust.density", base.Slot.FORCE, self.find_density, mass, density),
            base.Operator("dust.limit", base.Slot.LIMIT, self.limit, vel),
        ]

    def find_density(self, view: base.View) -> None:
        view.dust.density = view.dust.mass / self.dx

    def limit(self, view: base.View) -> dict[str, base.Limit]:
        fastest = float(np.abs(view.dust.vel).max(initial=0.0))
        return {base.ALL: base.Limit(self.dx / fastest)} if fastest > 0.0 else {}
