"""Shock tube of gas and dust in the limit of strong drag (DustyShock; Laibe & Price 2012, Saito et al. 2003).

The two move as one gas of density rho_g (1 + eps) and the gas's own pressure; dust holds no heat and friction
heats the gas, so that gamma stays. The answer is the Riemann problem of that heavy gas, whose sound speed is
c_s/sqrt(1 + eps).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from discsim.exact import riemann


class Mixture(NamedTuple):
    """Fields at the asked places; both species share the velocity."""

    gas_density: np.ndarray
    dust_density: np.ndarray
    velocity: np.ndarray
    pressure: np.ndarray


def solution(
    x: np.ndarray,
    time: float,
    dust_ratio: float,
    left: tuple[float, float, float] = (1.0, 1.0, 0.0),
    right: tuple[float, float, float] = (0.125, 0.1, 0.0),
    gamma: float = 1.4,
) -> Mixture:
    """The tube at places `x` and `time` > 0; the states are the gas's (density, pressure, velocity)."""
    heavy = 1 + dust_ratio
    left = (left[0] * heavy, left[1], left[2])
    right = (right[0] * heavy, right[1], right[2])
    flow = riemann.solution(x, time, left, right, gamma)
    gas = flow.density / heavy
    return Mixture(gas, dust_ratio * gas, flow.velocity, flow.pressure)
