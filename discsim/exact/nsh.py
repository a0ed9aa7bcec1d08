"""Steady drift of gas and dust in a Keplerian disc (Nakagawa, Sekiya & Hayashi 1986), with any number of populations.

Velocities relative to the Keplerian one in units of the headwind eta v_K, with St_j = Omega t_j and eps_j = rho_j/rho_g
of each population, and A = sum_j eps_j / (1 + St_j^2), B = sum_j eps_j St_j / (1 + St_j^2), N = (1 + A)^2 + B^2:

    gas    radial    2 B / N                                      (1)
    gas    azimuth   -(1 + A) / N                                 (2)
    dust   radial    2 (B - (1 + A) St_j) / (N (1 + St_j^2))      (3)
    dust   azimuth   -(1 + A + B St_j) / (N (1 + St_j^2))         (4)

which is where the pressure, the drag, and the Coriolis and shear terms balance (Tanaka, Himeno & Ida 2005, sec. 2.2;
Benitez-Llambay, Krapp & Pessah 2019, arXiv:1811.07925, sec. 3.5.1). For one population these are Youdin & Johansen
(2007), eqs. (7a)-(7d); of grains without mass (7) is Takeuchi & Artymowicz (2001), eq. (23), at small St. (3) is
evaluated with its differences carried out, so that it keeps its digits at any St.

A force outwards on the grains alone, of acceleration Omega f_j (light's has f_j = beta_j v_K), adds velocities in the
unit of f, with C = sum_j f_j eps_j / (1 + St_j^2) and D = sum_j f_j eps_j St_j / (1 + St_j^2):

    gas    radial    V = (B C - (1 + A) D) / N                    (5)
    gas    azimuth   W = -((1 + A) C + B D) / (2 N)               (6)
    dust   radial    (V + 2 St_j W + St_j f_j) / (1 + St_j^2)     (7)
    dust   azimuth   (W - St_j V / 2 - St_j^2 f_j / 2) / (1 + St_j^2)    (8)
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike


class Drift(NamedTuple):
    """Velocities relative to Keplerian rotation, in the headwind's unit."""

    gas_radial: np.ndarray
    gas_azimuthal: np.ndarray
    dust_radial: np.ndarray
    dust_azimuthal: np.ndarray


def velocities(stokes: ArrayLike, dust_ratio: ArrayLike, headwind: ArrayLike) -> Drift:
    """Drift of gas and one population at Stokes number `stokes` = Omega t_stop and dust/gas ratio `dust_ratio`.

    `headwind` is eta v_K: by how much gas alone lags the Keplerian velocity (2D: eta = (p + q) h^2/2). Arrays of the
    inputs' joint shape.
    """
    stokes, dust_ratio = (np.asarray(x, dtype=float)[None] for x in (stokes, dust_ratio))
    found = of_populations(stokes, dust_ratio, headwind)
    return Drift(found.gas_radial, found.gas_azimuthal, found.dust_radial[0], found.dust_azimuthal[0])


def of_populations(stokes: ArrayLike, ratios: ArrayLike, headwind: ArrayLike, push: ArrayLike | None = None) -> Drift:
    """The same with populations of `stokes` and `ratios` (populations, ...) and a headwind (...), that of one-way dust
    with ratios of 0; the gas's velocities have shape (...), the dust's (populations, ...).

    `push` (populations, ...): a force outwards on grains alone, as a velocity, beta v_K of light.
    """
    stokes, ratios, headwind = (np.asarray(x, dtype=float) for x in (stokes, ratios, headwind))
    share = ratios / (1 + stokes**2)
    a, b = share.sum(axis=0), (share * stokes).sum(axis=0)
    scale = headwind / ((1 + a) ** 2 + b**2)
    # B - (1 + A) St_j is the sum of shares times differences of Stokes numbers, which vanish for one population.
    differences = np.array([(share * (stokes - own)).sum(axis=0) for own in stokes])
    found = Drift(
        gas_radial=2 * b * scale,  # eq. (1)
        gas_azimuthal=-(1 + a) * scale,  # eq. (2)
        dust_radial=2 * (differences - stokes) * scale / (1 + stokes**2),  # eq. (3)
        dust_azimuthal=-(1 + a + b * stokes) * scale / (1 + stokes**2),  # eq. (4)
    )
    return found if push is None else Drift(*map(np.add, found, _pushed(stokes, share, np.asarray(push, dtype=float))))


def _pushed(stokes: np.ndarray, share: np.ndarray, push: np.ndarray) -> Drift:
    """What forces on the grains add; `share` is eps_j / (1 + St_j^2)."""
    a, b = share.sum(axis=0), (share * stokes).sum(axis=0)
    c, d = (share * push).sum(axis=0), (share * stokes * push).sum(axis=0)
    n = (1 + a) ** 2 + b**2
    v, w = (b * c - (1 + a) * d) / n, -((1 + a) * c + b * d) / (2 * n)  # eqs. (5), (6)
    slow = 1 + stokes**2
    return Drift(v, w, (v + 2 * stokes * w + stokes * push) / slow, (w - 0.5 * stokes * (v + stokes * push)) / slow)
