"""Exact solution of the Riemann problem for ideal and isothermal gas (Toro 2009, ch. 4; LeVeque 2002, ch. 14).

A shock (p* > p_s) or a rarefaction connects each side s = L, R with the star state (p*, u*), u* = u_s -/+ f_s(p*):

    f_s = (p - p_s) sqrt(A_s/(p + B_s)),  A_s = 2/((g+1) rho_s),  B_s = p_s (g-1)/(g+1)     shock        (4.6)
    f_s = 2 c_s/(g-1) [(p/p_s)^((g-1)/2g) - 1]                                              rarefaction  (4.7)

and p* is the root of f_L + f_R + u_R - u_L = 0. For isothermal gas of sound speed c, f_s is a function of the density
r instead:

    f_s = c (r - r_s)/sqrt(r r_s)   shock          f_s = c ln(r/r_s)   rarefaction
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq


class Flow(NamedTuple):
    """Density, velocity and pressure at the requested positions."""

    density: np.ndarray
    velocity: np.ndarray
    pressure: np.ndarray


def solution(
    x: np.ndarray,
    time: float,
    left: tuple[float, float, float] = (1.0, 1.0, 0.0),
    right: tuple[float, float, float] = (0.125, 0.1, 0.0),
    gamma: float = 1.4,
) -> Flow:
    """Return the flow of an ideal gas from two states separated at x = 0; the defaults are Sod's shock tube.

    Parameters
    ----------
    x : ndarray, shape (n,)
        Position. Any consistent units.
    time : float
        Time, above 0.
    left, right : (float, float, float)
        Density, pressure and velocity at x < 0 and at x > 0.
    gamma : float
        Ratio of specific heats.

    Returns
    -------
    Flow
        Density, velocity and pressure (n,).

    Raises
    ------
    ValueError
        If the two sides separate and leave a vacuum.
    """
    pressure = _find_root(
        lambda p: _velocity_change(p, left, gamma) + _velocity_change(p, right, gamma) + right[2] - left[2],
        left[1],
        right[1],
    )
    velocity = 0.5 * (
        left[2] + right[2] + _velocity_change(pressure, right, gamma) - _velocity_change(pressure, left, gamma)
    )
    speed = np.asarray(x, dtype=float) / time
    # The right side is a mirror image of the left side.
    west = _left_of_contact(speed, left, pressure, velocity, gamma)
    mirrored = (right[0], right[1], -right[2])
    east = _left_of_contact(-speed, mirrored, pressure, -velocity, gamma)
    east = Flow(east.density, -east.velocity, east.pressure)
    return Flow(*(np.where(speed < velocity, w, e) for w, e in zip(west, east, strict=True)))


def isothermal_solution(
    x: np.ndarray,
    time: float,
    left: tuple[float, float] = (1.0, 0.0),
    right: tuple[float, float] = (0.125, 0.0),
    sound_speed: float = 1.0,
) -> Flow:
    """Return the flow of an isothermal gas from two states separated at x = 0.

    Parameters
    ----------
    x : ndarray, shape (n,)
        Position. Any consistent units.
    time : float
        Time, above 0.
    left, right : (float, float)
        Density and velocity at x < 0 and at x > 0.
    sound_speed : float
        Isothermal sound speed c.

    Returns
    -------
    Flow
        Density, velocity and pressure (n,).

    Raises
    ------
    ValueError
        If the density between the two sides falls below the range of floats.
    """
    c = sound_speed

    def jump(density: float, side: float) -> float:
        shock = (density - side) / np.sqrt(density * side)
        return c * (shock if density > side else np.log(density / side))

    star = _find_root(lambda r: jump(r, left[0]) + jump(r, right[0]) + right[1] - left[1], left[0], right[0])
    velocity = 0.5 * (left[1] + right[1] + jump(star, right[0]) - jump(star, left[0]))
    speed = np.asarray(x, dtype=float) / time
    west = _isothermal_left_of_contact(speed, left[0], left[1], star, velocity, c)
    mirrored = _isothermal_left_of_contact(-speed, right[0], -right[1], star, -velocity, c)
    density = np.where(speed < velocity, west[0], mirrored[0])
    return Flow(density, np.where(speed < velocity, west[1], -mirrored[1]), c**2 * density)


def _find_root(balance: Callable[[float], float], left: float, right: float) -> float:
    """Return the zero of the rising function `balance`; `left` and `right` are the first bracket.

    Raises ValueError if there is no zero above 0, as for states that separate.
    """
    low, high = min(left, right), max(left, right)
    while balance(low) > 0:
        low /= 2
        if low == 0:
            raise ValueError("the two states separate and leave a vacuum between them")
    while balance(high) < 0:
        high *= 2
    return float(brentq(balance, low, high, xtol=1e-300, rtol=1e-15)) if high > low else low


def _velocity_change(p: float, side: tuple[float, float, float], gamma: float) -> float:
    """Return f_s(p), eqs. (4.6) and (4.7)."""
    density, pressure, _ = side
    if p > pressure:
        a, b = 2 / ((gamma + 1) * density), pressure * (gamma - 1) / (gamma + 1)
        return (p - pressure) * np.sqrt(a / (p + b))
    sound = np.sqrt(gamma * pressure / density)
    return 2 * sound / (gamma - 1) * ((p / pressure) ** ((gamma - 1) / (2 * gamma)) - 1)


def _left_of_contact(
    speed: np.ndarray,
    side: tuple[float, float, float],
    star_pressure: float,
    star_velocity: float,
    gamma: float,
) -> Flow:
    """Return the flow left of the contact at speeds x/t (n,)."""
    density, pressure, velocity = side
    sound = np.sqrt(gamma * pressure / density)
    ratio, g = star_pressure / pressure, (gamma - 1) / (gamma + 1)
    if ratio > 1:
        star_density = density * (ratio + g) / (g * ratio + 1)
        head = velocity - sound * np.sqrt((gamma + 1) / (2 * gamma) * ratio + (gamma - 1) / (2 * gamma))
        fan = (star_density, star_velocity, star_pressure)
        tail = head
    else:
        star_density = density * ratio ** (1 / gamma)
        head = velocity - sound
        tail = star_velocity - np.sqrt(gamma * star_pressure / star_density)
        inside = np.clip(speed, head, tail)
        factor = 2 / (gamma + 1) + g / sound * (velocity - inside)
        fan = (
            density * factor ** (2 / (gamma - 1)),
            2 / (gamma + 1) * (sound + (gamma - 1) / 2 * velocity + inside),
            pressure * factor ** (2 * gamma / (gamma - 1)),
        )
    before = (density, velocity, pressure)
    star = (star_density, star_velocity, star_pressure)
    parts = zip(before, fan, star, strict=True)
    return Flow(*(np.where(speed < head, u, np.where(speed < tail, f, s)) for u, f, s in parts))


def _isothermal_left_of_contact(
    speed: np.ndarray, density: float, velocity: float, star: float, star_velocity: float, c: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return density and velocity left of the contact at speeds x/t (n,)."""
    if star > density:
        front = velocity - c * np.sqrt(star / density)
        return np.where(speed < front, density, star), np.where(speed < front, velocity, star_velocity)
    inside = np.clip(speed, velocity - c, star_velocity - c)
    fan_velocity = inside + c
    return density * np.exp(-(fan_velocity - velocity) / c), fan_velocity
