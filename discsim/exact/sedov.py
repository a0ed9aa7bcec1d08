"""Strong cylindrical blast wave in cold uniform gas (Sedov 1959, ch. 4), the point explosion of a 2D code.

With R(t) = (E t^2 / (alpha rho_0))^(1/4) and R' = R / 2t every field is a function of x = r/R alone,

    v = R' V(x)      rho = rho_0 G(x)      P = rho_0 R'^2 Q(x)                                      (1)

With a = V - x (and R R'' / R'^2 = -1) the equations of continuity, momentum and entropy become

    V' = (2Q - gamma Q V/x - a G V) / (gamma Q - a^2 G)                                             (2)
    (ln G)' = -(V' + V/x) / a          (ln Q)' = 2/a + gamma (ln G)'                                (3)

They are integrated inwards from the strong shock at x = 1, V = Q = 2/(gamma + 1), G = (gamma + 1)/(gamma - 1). The
energy determines

    alpha = (pi/2) int_0^1 [G V^2 / 2 + Q / (gamma - 1)] x dx                                       (4)

Tightly coupled dust replaces rho_0 by rho_0 (1 + eps) and leaves the pressure unchanged, as friction heats the gas.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

Array = np.ndarray
INNERMOST = 1e-3  # x below which V/x and Q are constant, and G falls as x^(2/(gamma - 1))


class BlastProfile(NamedTuple):
    """Density, velocity and pressure at the requested radii."""

    density: Array
    velocity: Array
    pressure: Array


def shock_radius(time: float, energy: float = 1.0, density: float = 1.0, gamma: float = 1.4) -> float:
    """Return the radius R of the shock.

    Parameters
    ----------
    time : float
        Time since the explosion. Any consistent units.
    energy : float
        Energy E per unit height.
    density : float
        Density rho_0 ahead of the shock.
    gamma : float
        Ratio of specific heats.

    Returns
    -------
    float
        Radius of the shock.
    """
    return (energy * time**2 / (alpha(gamma) * density)) ** 0.25


def arrival_time(radius: float, energy: float = 1.0, density: float = 1.0, gamma: float = 1.4) -> float:
    """Return the time at which the shock reaches a radius.

    Parameters
    ----------
    radius : float
        Radius R of the shock. Any consistent units.
    energy : float
        Energy E per unit height.
    density : float
        Density rho_0 ahead of the shock.
    gamma : float
        Ratio of specific heats.

    Returns
    -------
    float
        Time since the explosion.
    """
    return radius**2 * (alpha(gamma) * density / energy) ** 0.5


def solution(radius: Array, time: float, energy: float = 1.0, density: float = 1.0, gamma: float = 1.4) -> BlastProfile:
    """Return the blast wave at a time; the gas ahead of the shock is at rest without pressure.

    Parameters
    ----------
    radius : ndarray, shape (n,)
        Distance from the explosion. Any consistent units.
    time : float
        Time since the explosion, above 0.
    energy : float
        Energy E per unit height.
    density : float
        Density rho_0 ahead of the shock.
    gamma : float
        Ratio of specific heats.

    Returns
    -------
    BlastProfile
        Density, radial velocity and pressure (n,).
    """
    front = shock_radius(time, energy, density, gamma)
    speed = 0.5 * front / time
    x = np.asarray(radius, dtype=float) / front
    speeds, densities, pressures = similarity(np.minimum(x, 1.0), gamma)
    behind = x <= 1.0
    return BlastProfile(
        density * np.where(behind, densities, 1.0),
        speed * np.where(behind, speeds, 0.0),
        density * speed**2 * np.where(behind, pressures, 0.0),
    )


def similarity(x: Array, gamma: float) -> tuple[Array, Array, Array]:
    """Return the dimensionless profiles of eq. (1).

    Parameters
    ----------
    x : ndarray, shape (n,)
        Radius over that of the shock, from 0 to 1.
    gamma : float
        Ratio of specific heats.

    Returns
    -------
    V, G, Q : ndarray, shape (n,)
        Velocity, density and pressure.
    """
    at = np.log(np.maximum(x, INNERMOST))
    ratio, density, pressure, _ = _similarity_solution(gamma).sol(at)
    inside = np.log(np.maximum(x, 1e-300)) - at
    return x * ratio, np.exp(density + 2.0 / (gamma - 1.0) * inside), np.exp(pressure)


def alpha(gamma: float) -> float:
    """Return the constant of R = (E t^2 / (alpha rho_0))^(1/4), eq. (4).

    Parameters
    ----------
    gamma : float
        Ratio of specific heats.

    Returns
    -------
    float
        alpha.
    """
    _, _, pressure, above = _similarity_solution(gamma).y[:, -1]
    # Within INNERMOST Q / (gamma - 1) is constant, and the kinetic energy of the thin gas is negligible.
    below = 0.5 * np.exp(pressure) / (gamma - 1.0) * INNERMOST**2
    return float(0.5 * np.pi * (below - above))


@cache
def _similarity_solution(gamma: float) -> Any:
    """Integrate V/x, ln G, ln Q and the integral of (4) inwards from the shock in ln x, in which all are smooth."""

    def slopes(log_x: float, y: Array) -> list[float]:
        x = np.exp(log_x)
        ratio, density, pressure = y[0], np.exp(y[1]), np.exp(y[2])
        speed = x * ratio
        lag = speed - x
        rise = (2.0 * pressure - gamma * pressure * ratio - lag * density * speed) / (
            gamma * pressure - lag**2 * density
        )  # eq. (2)
        thinning = -(rise + ratio) / lag
        energy = 0.5 * density * speed**2 + pressure / (gamma - 1.0)
        return [rise - ratio, x * thinning, x * (2.0 / lag + gamma * thinning), energy * x**2]  # eqs. (3), (4)

    strong = 2.0 / (gamma + 1.0)
    start = [strong, np.log((gamma + 1.0) / (gamma - 1.0)), np.log(strong), 0.0]
    return solve_ivp(
        slopes, (0.0, np.log(INNERMOST)), start, method="DOP853", rtol=1e-10, atol=1e-12, dense_output=True
    )
