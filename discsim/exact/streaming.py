"""Streaming instability of gas and dust in a shearing box: steady drift, and growth of small perturbations.

The box is a plane of radius x and height z, without vertical gravity. Nothing depends on the azimuth y. The velocities
u of gas and w_j of the dust populations are relative to the shear flow -q Omega x. With the headwind b = eta v_K,
dust-to-gas ratios eps_j and stopping times t_j (Youdin & Johansen 2007, ApJ 662, 613, sec. 2; Krapp et al. 2019,
ApJL 878, L30)

    Du/Dt   = 2 Omega (u_y + b) e_x - (2 - q) Omega u_x e_y - grad P / rho_g + sum_j eps_j (w_j - u) / t_j    (1)
    Dw_j/Dt = 2 Omega w_y e_x - (2 - q) Omega w_x e_y + (u - w_j) / t_j                                       (2)

with P = c_s^2 rho_g. A uniform state with constant velocities, the drift of Nakagawa, Sekiya & Hayashi (1986), solves
(1) and (2). Small perturbations of this state grow as exp(i k.x + s t). They are vectors of the relative density and of
the three velocity components of gas, and of each population, so that s and the perturbations are the eigenvalues and
eigenvectors of a matrix (4 + 4 N, 4 + 4 N).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

Array = np.ndarray


class Box(NamedTuple):
    """Parameters of a shearing box with gas and N populations of dust, in any consistent units.

    Attributes
    ----------
    stopping_times, ratios : ndarray, shape (N,)
        Stopping times t_j and dust-to-gas ratios eps_j; ratio 0 for one-way drag.
    headwind : float
        b = eta v_K.
    sound_speed : float
        c_s; the drift does not depend on it.
    omega : float
        Orbital frequency Omega.
    shear : float
        q = -d ln Omega / d ln r; 1.5 about a point mass.
    """

    stopping_times: Array
    ratios: Array
    headwind: float = 1.0
    sound_speed: float = 20.0
    omega: float = 1.0
    shear: float = 1.5


class Mode(NamedTuple):
    """Growing perturbation of a shearing box.

    Attributes
    ----------
    rate : complex
        s; the real part is the growth rate.
    amplitudes : ndarray of complex, shape (N + 1, 4)
        Amplitudes of the relative density and of the velocity (x, y, z) of gas (row 0) and of each population, relative
        to the density amplitude of the first population.
    left : ndarray of complex, shape (N + 1, 4)
        The sum of `left` times the amplitudes of any perturbation with the same wave vector is the part of this mode.
    """

    rate: complex
    amplitudes: Array
    left: Array


def box(
    stopping_times: ArrayLike, ratios: ArrayLike, headwind: float = 1.0, sound_speed: float = 20.0, omega: float = 1.0,
    shear: float = 1.5,
) -> Box:  # fmt: skip
    """Return a `Box` with arrays (N,) of the stopping times and ratios, which may be single numbers."""
    times, shares = np.broadcast_arrays(np.atleast_1d(stopping_times), np.atleast_1d(ratios))
    return Box(times.astype(float), shares.astype(float), headwind, sound_speed, omega, shear)


def drift(given: Box) -> Array:
    """Return the steady drift: velocities (N + 1, 2) along x and y, of gas and of each population.

    Examples
    --------
    Grains with Omega t = 0.1 and three times the mass of the gas drift inwards:

    >>> from discsim.exact import streaming
    >>> streaming.drift(streaming.box(0.1, 3.0)).round(4)
    array([[ 0.0375, -0.2502],
           [-0.0125, -0.2499]])
    """
    rates = _rates(given)
    source = np.zeros(len(rates))
    source[0] = -2.0 * given.omega * given.headwind
    return np.linalg.solve(rates, source).reshape(-1, 2)


def _rates(given: Box) -> Array:
    """Return the matrix of (1) and (2) for uniform velocities along x and y, (2 N + 2, 2 N + 2)."""
    count = len(given.ratios)
    couple = given.ratios / given.stopping_times
    out = np.kron(np.eye(count + 1), [[0.0, 2.0 * given.omega], [-(2.0 - given.shear) * given.omega, 0.0]])
    for axis in (0, 1):
        dust = 2 + 2 * np.arange(count) + axis
        out[axis, axis] -= couple.sum()
        out[axis, dust] += couple
        out[dust, dust] -= 1.0 / given.stopping_times
        out[dust, axis] += 1.0 / given.stopping_times
    return out


def matrix(given: Box, kx: float, kz: float) -> Array:
    """Return the matrix (4 N + 4, 4 N + 4) whose eigenvalues are the rates s for the wave vector (kx, kz)."""
    steady, count = drift(given), len(given.ratios)
    couple = given.ratios / given.stopping_times
    shear = np.zeros((4, 4), complex)
    shear[0, [1, 3]] = -1j * kx, -1j * kz
    shear[1, 2], shear[2, 1] = 2.0 * given.omega, -(2.0 - given.shear) * given.omega
    out = np.kron(np.eye(count + 1), shear) - 1j * kx * np.diag(np.repeat(steady[:, 0], 4))
    out[[1, 3], 0] = -1j * given.sound_speed**2 * np.array([kx, kz])
    for number in range(count):
        density = 4 + 4 * number
        for axis in (1, 2, 3):
            dust = density + axis
            out[axis, axis] -= couple[number]
            out[axis, dust] += couple[number]
            out[dust, dust] -= 1.0 / given.stopping_times[number]
            out[dust, axis] += 1.0 / given.stopping_times[number]
        slip = couple[number] * (steady[number + 1] - steady[0])
        out[[1, 2], density] += slip
        out[[1, 2], 0] -= slip
    return out


def fastest_mode(given: Box, kx: float, kz: float) -> Mode:
    """Return the mode with the largest growth rate for the wave vector (kx, kz).

    Parameters
    ----------
    given : Box
        Gas and dust; stopping times do not depend on density.
    kx, kz : float
        Wave numbers along radius and height.

    Returns
    -------
    Mode
        Rate and amplitudes.

    Examples
    --------
    The mode linA of Youdin & Johansen (2007), table 1, with K = 30 in units of 1 / (eta r):

    >>> from discsim.exact import streaming
    >>> rate = streaming.fastest_mode(streaming.box(0.1, 3.0), 30.0, 30.0).rate
    >>> print(f"{rate:.5f}")
    0.41901-0.34801j
    """
    values, right = np.linalg.eig(matrix(given, kx, kz))
    chosen = int(values.real.argmax())
    unit = right[4, chosen]
    left = np.linalg.inv(right)[chosen] * unit
    return Mode(complex(values[chosen]), (right[:, chosen] / unit).reshape(-1, 4), left.reshape(-1, 4))
