"""One zone of gas that is heated at a constant rate and cools: du/dt = rate - (u - u_eq) / t_cool, or by u^4.

    towards u_eq    u(t) = u_inf + (u_0 - u_inf) exp(-t / t_cool),      u_inf = u_eq + rate t_cool            (1)
    by u^4          du/dt = a (u_inf^4 - u^4):
                    t(u) = [F(u / u_inf) - F(u_0 / u_inf)] / (2 a u_inf^3),  F(x) = atanh(x^(1 or -1)) + atan x  (2)

atanh of 1/x where u is above u_inf. (2) is a grey zone of constant opacity, whose surfaces radiate as T^4.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def towards(u: ArrayLike, settled: ArrayLike, rate: ArrayLike, t_cool: ArrayLike, time: ArrayLike) -> np.ndarray:
    """u after `time` (eq. 1); arrays of one shape, any units."""
    u, settled, rate, t_cool, time = (np.asarray(x, dtype=float) for x in (u, settled, rate, t_cool, time))
    gone = -np.expm1(-time / t_cool)
    return u * np.exp(-time / t_cool) + (settled + rate * t_cool) * gone


def fourth_power(u: ArrayLike, settled: float, strength: float, time: ArrayLike) -> np.ndarray:
    """u after `time` (...) where du/dt = strength (settled^4 - u^4) (eq. 2), to 1e-14 of it; settled above 0."""
    start, time = np.broadcast_arrays(np.asarray(u, float) / settled, np.asarray(time, float))
    above = start > 1.0

    def passed(x: np.ndarray) -> np.ndarray:
        return np.arctanh(np.where(above, 1.0 / x, x)) + np.arctan(x)

    with np.errstate(divide="ignore"):
        begun = passed(start)
    wanted = begun + 2.0 * strength * settled**3 * time
    # Bisection in atanh's argument: near the end of the path u itself has no digits to tell it from u_inf.
    low, high = np.zeros(start.shape), np.full(start.shape, 400.0)
    for _ in range(200):
        middle = 0.5 * (low + high)
        x = np.where(above, 1.0 / np.tanh(np.maximum(middle, 1e-300)), np.tanh(middle))
        early = middle + np.arctan(x) < wanted
        low, high = np.where(early, middle, low), np.where(early, high, middle)
    return settled * np.where(above, 1.0 / np.tanh(low), np.tanh(low))
