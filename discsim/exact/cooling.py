"""Specific energy u of a zone of gas with constant heating, and cooling proportional to u or to u^4.

    linear          du/dt = rate - (u - u_eq) / t_cool:
                    u(t) = u_inf + (u_0 - u_inf) exp(-t / t_cool),      u_inf = u_eq + rate t_cool            (1)
    fourth power    du/dt = a (u_inf^4 - u^4):
                    t(u) = [F(u / u_inf) - F(u_0 / u_inf)] / (2 a u_inf^3),  F(x) = atanh(x^(1 or -1)) + atan x  (2)

The exponent in F is 1 for u below u_inf, and -1 for u above it. (2) is the solution for a grey zone of constant
opacity, whose surfaces radiate as T^4.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def linear(u: ArrayLike, settled: ArrayLike, rate: ArrayLike, t_cool: ArrayLike, time: ArrayLike) -> np.ndarray:
    """Return the specific energy of gas that is heated, and cools in proportion to u - u_eq, eq. (1).

    Parameters
    ----------
    u : array_like
        Specific energy u_0 at the start. Arguments broadcast; any consistent units.
    settled : array_like
        Specific energy u_eq to which the gas cools without heating.
    rate : array_like
        Heating rate per mass.
    t_cool : array_like
        Cooling time.
    time : array_like
        Time since the start.

    Returns
    -------
    ndarray
        Specific energy at `time`, of the arguments' joint shape.
    """
    u, settled, rate, t_cool, time = (np.asarray(x, dtype=float) for x in (u, settled, rate, t_cool, time))
    return u * np.exp(-time / t_cool) - (settled + rate * t_cool) * np.expm1(-time / t_cool)


def fourth_power(u: ArrayLike, settled: float, strength: float, time: ArrayLike) -> np.ndarray:
    """Return the specific energy of gas that cools in proportion to u^4, du/dt = strength (settled^4 - u^4), eq. (2).

    Parameters
    ----------
    u : array_like
        Specific energy u_0 at the start. `u` and `time` broadcast; any consistent units.
    settled : float
        Final energy u_inf, above 0.
    strength : float
        Coefficient a.
    time : array_like
        Time since the start.

    Returns
    -------
    ndarray
        Specific energy at `time`, of the joint shape of `u` and `time`, to a relative error of 1e-14.
    """
    start, time = np.broadcast_arrays(np.asarray(u, float) / settled, np.asarray(time, float))
    above = start > 1.0

    def scaled_time(x: np.ndarray) -> np.ndarray:
        return np.arctanh(np.where(above, 1.0 / x, x)) + np.arctan(x)

    with np.errstate(divide="ignore"):
        begin = scaled_time(start)
    end = begin + 2.0 * strength * settled**3 * time
    # Bisection in the value of atanh, as u near the end of its path differs from u_inf by less than rounding.
    low, high = np.zeros(start.shape), np.full(start.shape, 400.0)
    for _ in range(200):
        middle = 0.5 * (low + high)
        x = np.where(above, 1.0 / np.tanh(np.maximum(middle, 1e-300)), np.tanh(middle))
        early = middle + np.arctan(x) < end
        low, high = np.where(early, middle, low), np.where(early, high, middle)
    return settled * np.where(above, 1.0 / np.tanh(low), np.tanh(low))
