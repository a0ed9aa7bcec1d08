"""Steady drift of gas and dust in a Keplerian disc (Nakagawa, Sekiya & Hayashi 1986), with any number of populations.

Velocities are relative to the Keplerian one, in units of the headwind eta v_K. With St_j = Omega t_j and
eps_j = rho_j/rho_g of each population, A = sum_j eps_j / (1 + St_j^2), B = sum_j eps_j St_j / (1 + St_j^2) and
N = (1 + A)^2 + B^2, they are

    gas    radial    2 B / N                                      (1)
    gas    azimuth   -(1 + A) / N                                 (2)
    dust   radial    2 (B - (1 + A) St_j) / (N (1 + St_j^2))      (3)
    dust   azimuth   -(1 + A + B St_j) / (N (1 + St_j^2))         (4)

where pressure, drag, and the Coriolis and shear terms balance (Tanaka, Himeno & Ida 2005, sec. 2.2;
Benitez-Llambay, Krapp & Pessah 2019, arXiv:1811.07925, sec. 3.5.1). For one population these are Youdin & Johansen
(2007), eqs. (7a)-(7d). For grains without mass (7) is Takeuchi & Artymowicz (2001), eq. (23), at small St. (3) is
evaluated in terms of differences of Stokes numbers, which avoids cancellation at any St.

An outward force on the grains alone, of acceleration Omega f_j (f_j = beta_j v_K for radiation pressure), adds
velocities in the unit of f. With C = sum_j f_j eps_j / (1 + St_j^2) and D = sum_j f_j eps_j St_j / (1 + St_j^2) they
are

    gas    radial    V = (B C - (1 + A) D) / N                    (5)
    gas    azimuth   W = -((1 + A) C + B D) / (2 N)               (6)
    dust   radial    (V + 2 St_j W + St_j f_j) / (1 + St_j^2)     (7)
    dust   azimuth   (W - St_j V / 2 - St_j^2 f_j / 2) / (1 + St_j^2)    (8)

Equations (1) to (8) are linear in eta. `drift_about_circular_orbits` keeps the full centrifugal forces. Gas without
dust is on a circle of speed v_g = v_K (1 - 2 eta)^(1/2). The gas has the velocity (V, v_g + W) and the frequency
Omega_c = (v_g + W) / r, and the dust the velocity (v_j, v_g + w_j) and the frequency Omega_j = (v_g + w_j) / r. With
the radial accelerations F_j = (v_K^2 - v_g^2) / r - Omega f_j,

    (2 v_g + W) W / r   = sum_j eps_j (V - v_j) / t_j,    Omega_c V / 2   = sum_j eps_j (w_j - W) / t_j          (9)
    (2 v_g + w_j) w_j / r = F_j + (v_j - V) / t_j,        Omega_j v_j / 2 = -(w_j - W) / t_j                     (10)

Gas without dust, dust without gas, and a mixture with St -> 0 at any ratio are then on exact circles. As in (1) to (8),
the term v dv/dr, of order (St eta)^2, is neglected, and angular momentum rises with radius as on Keplerian circles.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

ROUNDS, CLOSE = 60, 1e-15  # largest number of iterations for the factors of (9) and (10), and their tolerance in v_K
SLOWEST = 1e-3  # lower bound of the rotation over the Keplerian one; there is no balance below


class Drift(NamedTuple):
    """Velocities of gas and dust relative to Keplerian rotation, in the unit of the headwind."""

    gas_radial: np.ndarray
    gas_azimuthal: np.ndarray
    dust_radial: np.ndarray
    dust_azimuthal: np.ndarray


def velocities(stokes: ArrayLike, dust_ratio: ArrayLike, headwind: ArrayLike) -> Drift:
    """Return the steady drift of gas and one dust population, eqs. (1) to (4).

    Parameters
    ----------
    stokes : array_like
        Stokes number Omega t_stop. Arguments broadcast.
    dust_ratio : array_like
        Dust-to-gas ratio; 0 for one-way drag.
    headwind : array_like
        eta v_K, the Keplerian velocity less that of gas without dust. In 2D eta = (p + q) h^2/2, with h = H/r,
        Sigma ~ r^-p and c_s^2 ~ r^-q.

    Returns
    -------
    Drift
        Velocities relative to Keplerian rotation in the unit of `headwind`, of the arguments' joint shape.
    """
    stokes, dust_ratio = (np.asarray(x, dtype=float)[None] for x in (stokes, dust_ratio))
    found = velocities_of_populations(stokes, dust_ratio, headwind)
    return Drift(found.gas_radial, found.gas_azimuthal, found.dust_radial[0], found.dust_azimuthal[0])


def velocities_of_populations(
    stokes: ArrayLike, ratios: ArrayLike, headwind: ArrayLike, push: ArrayLike | None = None
) -> Drift:
    """Return the steady drift of gas and several dust populations, eqs. (1) to (8).

    Parameters
    ----------
    stokes, ratios : array_like, shape (populations, ...)
        Stokes numbers, and dust-to-gas ratios; 0 for one-way drag.
    headwind : array_like, shape (...)
        eta v_K.
    push : array_like, shape (populations, ...), optional
        Outward force on grains alone as a velocity f, which is beta v_K for radiation pressure.

    Returns
    -------
    Drift
        Velocities relative to Keplerian rotation in the unit of `headwind`; those of gas have shape (...), those of
        dust (populations, ...).
    """
    stokes, ratios, headwind = (np.asarray(x, dtype=float) for x in (stokes, ratios, headwind))
    share = ratios / (1 + stokes**2)
    a, b = share.sum(axis=0), (share * stokes).sum(axis=0)
    scale = headwind / ((1 + a) ** 2 + b**2)
    # B - (1 + A) St_j is the sum of shares times differences of Stokes numbers, which vanish for one population.
    differences = np.array([(share * (stokes - own)).sum(axis=0) for own in stokes])
    drift = Drift(
        gas_radial=2 * b * scale,  # eq. (1)
        gas_azimuthal=-(1 + a) * scale,  # eq. (2)
        dust_radial=2 * (differences - stokes) * scale / (1 + stokes**2),  # eq. (3)
        dust_azimuthal=-(1 + a + b * stokes) * scale / (1 + stokes**2),  # eq. (4)
    )
    if push is None:
        return drift
    return Drift(*map(np.add, drift, _drift_by_push(stokes, share, np.asarray(push, dtype=float))))


def drift_about_circular_orbits(
    stokes: ArrayLike, ratios: ArrayLike, headwind: ArrayLike, keplerian: ArrayLike, push: ArrayLike | None = None
) -> Drift:
    """Return the steady drift of gas and several dust populations for a headwind of any size, eqs. (9) and (10).

    Parameters
    ----------
    stokes, ratios : array_like, shape (populations, n)
        Stokes numbers, and dust-to-gas ratios; 0 for one-way drag.
    headwind, keplerian : array_like, shape (n,)
        eta v_K, with eta < 1/2, and v_K.
    push : array_like, shape (populations, n), optional
        Outward force on grains alone as a velocity f, which is beta v_K for radiation pressure.

    Returns
    -------
    Drift
        Velocities relative to Keplerian rotation; those of gas have shape (n,), those of dust (populations, n).
    """
    stokes, ratios, headwind, unit = (np.asarray(x, dtype=float) for x in (stokes, ratios, headwind, keplerian))
    lag = 2 * headwind / unit  # v_K is 1 from here on
    circle = np.sqrt(np.maximum(1 - lag, SLOWEST**2))
    force = lag - (0.0 if push is None else np.asarray(push, dtype=float) / unit) + np.zeros_like(stokes)
    gas, dust = np.zeros_like(circle), np.zeros_like(stokes)  # W and w_j
    for _ in range(ROUNDS):
        # The factors 2 v_g + W and Omega / 2 are those of the last iteration; the rest is linear.
        own_gas, own = np.maximum(circle + gas, SLOWEST), np.maximum(circle + dust, SLOWEST)
        turn_gas, turn, shear_gas, shear = circle + own_gas, circle + own, 0.5 * own_gas, 0.5 * own
        held = 1 / (1 + stokes * (turn * shear) * stokes)
        load = ratios * held
        radial_by_gas, radial_by_turn = (load * shear).sum(axis=0), (load * shear * turn * stokes).sum(axis=0)
        push_out, push_along = (load * force).sum(axis=0), (load * shear * stokes * force).sum(axis=0)
        by_turn = turn_gas + (load * turn).sum(axis=0)
        by_radial = shear_gas + radial_by_gas
        whole = by_turn * by_radial + radial_by_turn**2
        before = gas, dust
        gas = (push_out * by_radial + radial_by_turn * push_along) / whole
        gas_radial = (push_along * by_turn - radial_by_turn * push_out) / whole
        slip = turn * gas - force
        dust_radial = (gas_radial + stokes * slip) * held
        dust = (gas - stokes * shear * (gas_radial - stokes * force)) * held
        if max(np.abs(gas - before[0]).max(initial=0.0), np.abs(dust - before[1]).max(initial=0.0)) < CLOSE:
            break
    lags = np.maximum(-lag, SLOWEST**2 - 1) / (1 + circle)
    return Drift(*(unit * v for v in (gas_radial, lags + gas, dust_radial, lags + dust)))


def _drift_by_push(stokes: np.ndarray, share: np.ndarray, push: np.ndarray) -> Drift:
    """Return the velocities caused by outward forces on grains, eqs. (5) to (8).

    share: eps_j / (1 + St_j^2) of each population. push: f_j.
    """
    a, b = share.sum(axis=0), (share * stokes).sum(axis=0)
    c, d = (share * push).sum(axis=0), (share * stokes * push).sum(axis=0)
    n = (1 + a) ** 2 + b**2
    v, w = (b * c - (1 + a) * d) / n, -((1 + a) * c + b * d) / (2 * n)  # eqs. (5), (6)
    slow = 1 + stokes**2
    return Drift(v, w, (v + 2 * stokes * w + stokes * push) / slow, (w - 0.5 * stokes * (v + stokes * push)) / slow)
