"""Settling of grains in an isothermal layer (the settling test of Loren-Aguilar & Bate 2014, arXiv:1406.3250).

Gas in balance with -Omega^2 z is a Gaussian of scale height H = c_s / Omega. A grain in this gas at rest obeys

    rho = rho_0 exp(-z^2 / 2 H^2)                                                                   (1)
    dz/dt = u,     du/dt = -Omega^2 z - u / t_stop(z)                                               (2)

Grains with t_stop Omega << 1 soon fall at the terminal velocity of (3), and grains with t_stop Omega > 1/2 oscillate
about the midplane:

    u = -t_stop Omega^2 z                                                                           (3)

t_stop is constant, or ~ 1/rho(z) by Epstein's law. For a constant drag coefficient K it is rho_d / K and depends on the
density of the dust itself, so that (2) is not closed; (3) still holds.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp

Array = np.ndarray


def gas_density(height: ArrayLike, midplane: float, scale_height: float) -> Array:
    """Return the density of the gas, eq. (1).

    Parameters
    ----------
    height : array_like
        Height z. Any consistent units.
    midplane : float
        Density rho_0 in the midplane.
    scale_height : float
        Scale height H.

    Returns
    -------
    ndarray
        Density, of the shape of `height`.
    """
    return midplane * np.exp(-0.5 * (np.asarray(height, dtype=float) / scale_height) ** 2)


def terminal_velocity(height: ArrayLike, stopping_time: ArrayLike, frequency: float) -> Array:
    """Return the terminal velocity of grains with short stopping times, eq. (3).

    Parameters
    ----------
    height : array_like
        Height z. Any consistent units.
    stopping_time : array_like
        Stopping time at `height`; the two broadcast.
    frequency : float
        Vertical frequency Omega.

    Returns
    -------
    ndarray
        Vertical velocity, of the arguments' joint shape.
    """
    return -np.asarray(stopping_time, dtype=float) * frequency**2 * np.asarray(height, dtype=float)


def trajectories(
    time: float, height: Array, stopping_time: Callable[[Array], Array], frequency: float
) -> tuple[Array, Array]:
    """Return heights and velocities of grains that start at rest, by integration of eq. (2).

    Parameters
    ----------
    time : float
        Time since the start. Any consistent units.
    height : ndarray, shape (n,)
        Heights at the start.
    stopping_time : callable (height)
        Return the stopping times (n,) at heights (n,).
    frequency : float
        Vertical frequency Omega.

    Returns
    -------
    height, velocity : ndarray, shape (n,)
        Heights and vertical velocities at `time`.
    """
    start = np.asarray(height, dtype=float)
    count = len(start)
    if time == 0.0:
        return start.copy(), np.zeros(count)

    def rates(_: float, y: Array) -> Array:
        z, u = y[:count], y[count:]
        return np.concatenate([u, -(frequency**2) * z - u / stopping_time(z)])

    # Short stopping times make (2) stiff. Grains do not interact, so its Jacobian has three diagonals.
    sparsity = np.tile(np.eye(count, dtype=bool), (2, 2))
    run = solve_ivp(
        rates, (0.0, time), np.concatenate([start, np.zeros(count)]), method="Radau", rtol=1e-8,
        atol=1e-12 * np.abs(start).max(), jac_sparsity=sparsity,
    )  # fmt: skip
    return run.y[:count, -1], run.y[count:, -1]
