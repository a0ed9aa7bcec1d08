"""Gas and dust in a uniform box under drag and constant accelerations (DustyBox; Laibe & Price 2011).

    dv/dt = a_g + (K/rho_g) (u - v)         du/dt = a_d - (K/rho_d) (u - v)

The slip s = u - v obeys ds/dt = (a_d - a_g) - lam s with lam = K (1/rho_g + 1/rho_d). By the time t the dust has
transferred to the gas the momentum J per unit reduced mass,

    J = s_0 (1 - exp(-lam t)) + (a_d - a_g) t [1 - (1 - exp(-lam t))/(lam t)]                       (1)
    v = v_0 + a_g t + J eps/(1 + eps)       u = u_0 + a_d t - J/(1 + eps)                            (2)

with eps = rho_d/rho_g. Each term of (1) is evaluated without cancellation at any lam t. If drag depends on the slip,
no such formula exists, and `velocities_by_speed` integrates the equations with a tolerance of 1e-11.
"""

from __future__ import annotations

from collections.abc import Callable
from math import factorial

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp

# 1 - (1 - exp(-z))/z = z/2! - z^2/3! + ...: at z <= 1/2 the next term is below 1e-18 of the sum.
_SERIES = [0.0] + [(-1) ** (n + 1) / factorial(n + 1) for n in range(1, 15)]


def velocities(
    time: ArrayLike,
    gas_velocity: ArrayLike,
    dust_velocity: ArrayLike,
    gas_density: ArrayLike,
    dust_ratio: ArrayLike,
    drag_coefficient: ArrayLike,
    gas_acceleration: ArrayLike = 0.0,
    dust_acceleration: ArrayLike = 0.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the velocities of gas and dust under linear drag and constant accelerations, eqs. (1) and (2).

    Parameters
    ----------
    time : array_like
        Time since the start. All arguments broadcast; any consistent units.
    gas_velocity, dust_velocity : array_like
        Velocities v_0 and u_0 at the start.
    gas_density : array_like
        Density rho_g.
    dust_ratio : array_like
        Dust-to-gas ratio eps = rho_d/rho_g, above 0.
    drag_coefficient : array_like
        K, the force density on the gas per unit slip.
    gas_acceleration, dust_acceleration : array_like
        Accelerations a_g and a_d.

    Returns
    -------
    gas, dust : ndarray
        Velocities v and u at `time`, of the arguments' joint shape, to rounding of the largest velocity.
    """
    t, v, u, density, ratio, k, a_gas, a_dust = (
        np.asarray(x, dtype=float)
        for x in (
            time,
            gas_velocity,
            dust_velocity,
            gas_density,
            dust_ratio,
            drag_coefficient,
            gas_acceleration,
            dust_acceleration,
        )
    )
    z = k * t / density * (1 + 1 / ratio)
    exchanged = -(u - v) * np.expm1(-z) + (a_dust - a_gas) * t * _one_minus_phi(z)  # eq. (1)
    gas = v + a_gas * t + exchanged * ratio / (1 + ratio)  # eq. (2)
    dust = u + a_dust * t - exchanged / (1 + ratio)
    return gas, dust


def velocities_by_speed(
    time: float,
    gas_velocity: ArrayLike,
    dust_velocity: ArrayLike,
    dust_ratio: float,
    rate: Callable[[float], float],
    gas_acceleration: ArrayLike = 0.0,
    dust_acceleration: ArrayLike = 0.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the velocities of gas and dust under drag that depends on the slip, by numerical integration.

    Parameters
    ----------
    time : float
        Time since the start. Any consistent units.
    gas_velocity, dust_velocity : array_like, shape (d,)
        Velocities at the start.
    dust_ratio : float
        Dust-to-gas ratio rho_d/rho_g, above 0.
    rate : callable (slip)
        Return 1/t_stop of the dust at a slip |u - v|.
    gas_acceleration, dust_acceleration : array_like, shape (d,) or scalar
        Constant accelerations.

    Returns
    -------
    gas, dust : ndarray, shape (d,)
        Velocities at `time`.
    """
    v, u, a_gas, a_dust = (
        np.atleast_1d(np.asarray(x, dtype=float))
        for x in (gas_velocity, dust_velocity, gas_acceleration, dust_acceleration)
    )

    def slope(_: float, slip: np.ndarray) -> np.ndarray:
        return a_dust - a_gas - (1 + dust_ratio) * rate(float(np.sqrt((slip**2).sum()))) * slip

    slip = u - v
    found = solve_ivp(slope, (0.0, time), slip, method="Radau", rtol=1e-11, atol=1e-13 * np.abs(slip).max())
    exchanged = slip + (a_dust - a_gas) * time - found.y[:, -1]
    gas = v + a_gas * time + exchanged * dust_ratio / (1 + dust_ratio)
    return gas, u + a_dust * time - exchanged / (1 + dust_ratio)


def _one_minus_phi(z: np.ndarray) -> np.ndarray:
    """Return 1 - (1 - exp(-z))/z without cancellation at small z."""
    small = np.polynomial.polynomial.polyval(np.minimum(z, 0.5), _SERIES)
    large = np.maximum(z, 0.5)
    return np.where(z < 0.5, small, 1 + np.expm1(-large) / large)
