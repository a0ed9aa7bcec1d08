"""The gas of `[background]` as functions of radius: power laws in balance about the star. Numpy only."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.parts import EOS

if TYPE_CHECKING:
    from discsim.scene import Scene

Array = np.ndarray


class GivenDisc:
    """Sigma ~ r^-p and c_s^2 ~ r^-q in code units; radii (n,) in, values (n,) out.

    laws: (Sigma, p, c_s^2, q, f), the first and third at radius 1, with -(1/Sigma) dP/dr = f c_s^2 / r.
    """

    def __init__(self, scene: Scene):
        given: Any = scene.background
        eos, p = given.eos, given.surface_density_index
        sigma = given.surface_density * given.reference_radius**p
        speed2, q, f = EOS[eos.kind].power_law(eos, scene.star, sigma, p)
        self.laws = np.array([sigma, p, speed2, q, f])

    def surface_density(self, r: Array) -> Array:
        return self.laws[0] * r ** -self.laws[1]

    def sound_speed(self, r: Array) -> Array:
        return np.sqrt(self.laws[2] * r ** -self.laws[3])
