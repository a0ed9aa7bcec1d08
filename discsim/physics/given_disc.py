"""The gas of `[background]` as functions of radius: power laws in balance about the star. Numpy only."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

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
        if eos.kind == "polytropic":
            # dP/dSigma is gamma K Sigma^(gamma - 1).
            speed2, q, f = eos.gamma * eos.constant * sigma ** (eos.gamma - 1), p * (eos.gamma - 1), p
        elif eos.kind == "isothermal":
            speed2, q, f = eos.sound_speed**2, 0.0, p
        else:
            q, r0 = eos.temperature_index, eos.reference_radius
            speed2, f = eos.aspect_ratio**2 * scene.star.mass / r0 * r0**q, p + q
        self.laws = np.array([sigma, p, speed2, q, f])

    def surface_density(self, r: Array) -> Array:
        return self.laws[0] * r ** -self.laws[1]

    def sound_speed(self, r: Array) -> Array:
        return np.sqrt(self.laws[2] * r ** -self.laws[3])
