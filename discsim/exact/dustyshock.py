"""Shock tube of gas and dust in the limit of strong drag (DustyShock; Laibe & Price 2012, Saito et al. 2003).

Gas and dust move as one gas of density rho_g (1 + eps) with the pressure of the gas. Dust has no heat capacity and
friction heats the gas, so that gamma is unchanged. The solution is the Riemann problem of this heavy gas, whose sound
speed is c_s/sqrt(1 + eps).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from discsim.exact import riemann


class Mixture(NamedTuple):
    """Densities, common velocity and pressure of gas and dust at the requested positions (n,)."""

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
    """Return the flow in a shock tube of tightly coupled gas and dust.

    Parameters
    ----------
    x : ndarray, shape (n,)
        Position; the states are separated at 0. Any consistent units.
    time : float
        Time, above 0.
    dust_ratio : float
        Dust-to-gas ratio eps, the same on both sides.
    left, right : (float, float, float)
        Density, pressure and velocity of the gas at x < 0 and at x > 0.
    gamma : float
        Ratio of specific heats.

    Returns
    -------
    Mixture
        Densities of gas and dust, velocity and pressure (n,).

    Raises
    ------
    ValueError
        If the two sides separate and leave a vacuum.
    """
    heavy = 1 + dust_ratio
    left = (left[0] * heavy, left[1], left[2])
    right = (right[0] * heavy, right[1], right[2])
    flow = riemann.solution(x, time, left, right, gamma)
    gas = flow.density / heavy
    return Mixture(gas, dust_ratio * gas, flow.velocity, flow.pressure)
