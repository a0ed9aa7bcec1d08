"""Grains that settle in an isothermal layer (after Loren-Aguilar & Bate 2014, arXiv:1406.3250, their settling test).

Gas in balance with -Omega^2 z is a Gaussian of height H = c_s / Omega, and a grain that meets it at rest obeys

    rho = rho_0 exp(-z^2 / 2 H^2)                                                                   (1)
    dz/dt = u,     du/dt = -Omega^2 z - u / t_stop(z)                                               (2)

Grains with t_stop Omega << 1 soon fall at the terminal velocity of (3), those with t_stop Omega > 1/2 swing through the
midplane:

    u = -t_stop Omega^2 z                                                                           (3)

t_stop is constant, or ~ 1/rho(z) by Epstein's law. Under a constant K it is rho_d / K, the dust's own density, and (2)
is not closed; (3) is.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp

Array = np.ndarray


def gas_density(height: ArrayLike, midplane: float, scale_height: float) -> Array:
    """Density at `height`; eq. (1)."""
    return midplane * np.exp(-0.5 * (np.asarray(height, dtype=float) / scale_height) ** 2)


def terminal_velocity(height: ArrayLike, stopping_time: ArrayLike, frequency: float) -> Array:
    """Velocity of a grain with a short `stopping_time` at `height`; eq. (3)."""
    return -np.asarray(stopping_time, dtype=float) * frequency**2 * np.asarray(height, dtype=float)


def trajectories(
    time: float, height: Array, stopping_time: Callable[[Array], Array], frequency: float
) -> tuple[Array, Array]:
    """Heights and velocities (n,) at `time` of grains that start at rest at `height` (n,); eq. (2).

    `stopping_time` gives t_stop at heights (n,).
    """
    start = np.asarray(height, dtype=float)
    count = len(start)
    if time == 0.0:
        return start.copy(), np.zeros(count)

    def rates(_: float, y: Array) -> Array:
        z, u = y[:count], y[count:]
        return np.concatenate([u, -(frequency**2) * z - u / stopping_time(z)])

    # Short stopping times make (2) stiff; grains do not meet, so its Jacobian has three diagonals.
    sparsity = np.tile(np.eye(count, dtype=bool), (2, 2))
    run = solve_ivp(
        rates, (0.0, time), np.concatenate([start, np.zeros(count)]), method="Radau", rtol=1e-8,
        atol=1e-12 * np.abs(start).max(), jac_sparsity=sparsity,
    )  # fmt: skip
    return run.y[:count, -1], run.y[count:, -1]
