"""Linear sound wave in isothermal gas coupled to dust (DustyWave; Laibe & Price 2011, 2012).

Perturbations d_g = drho_g/rho_g, d_d = drho_d/rho_d and velocities v, u, all ~ exp(i k x), eps = rho_d/rho_g:

    d_g' = -i k v      v' = -i k c_s^2 d_g + (K/rho_g)(u - v)
    d_d' = -i k u      u' = -(K/(eps rho_g))(u - v)

With the barycentric velocity V = (v + eps u)/(1 + eps) and the slip s = u - v only one entry is stiff:

    y = (d_g, d_d, V):   y' = A y + b s      s' = c y - lam s      lam = (K/rho_g)(1 + 1/eps)        (1)

The solution is the exponential of the 4x4 matrix of (1). Its error is lam t/2^53, so for large lam (1) is decoupled
first. With s = R y + z and y = w + q z the same system is, exactly,

    c - lam R - R A - R b R = 0       (A + b R + lam + R b) q = -b                                   (2)
    w' = (A + b R) w                  z' = -(lam + R b) z                                            (3)

In the limit K -> inf it is a wave of speed c_s/sqrt(1 + eps).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

_STIFF = 50.0  # lam/(k c_s) above which eq. (2) is solved: its iteration then gains more than a digit each time


class Wave(NamedTuple):
    """Densities and velocities of gas and dust at the requested positions, each of the positions' shape."""

    gas_density: np.ndarray
    gas_velocity: np.ndarray
    dust_density: np.ndarray
    dust_velocity: np.ndarray


def solution(
    x: np.ndarray,
    time: float,
    drag_coefficient: float,
    dust_ratio: float,
    sound_speed: float = 1.0,
    amplitude: float = 1e-4,
    wavenumber: float = 1.0,
    length: float = 1.0,
    boost: float = 0.0,
    gas_density: float = 1.0,
) -> Wave:
    """Return the wave that starts as A sin(k x) in rho_g/rho_g0, rho_d/rho_d0, v and u.

    Parameters
    ----------
    x : ndarray
        Position; for an oblique wave, position along the wave vector. Any consistent units.
    time : float
        Time since the start.
    drag_coefficient : float
        K, the force density on the gas per unit slip.
    dust_ratio : float
        Dust-to-gas ratio eps, above 0.
    sound_speed : float
        Isothermal sound speed c_s.
    amplitude : float
        Relative amplitude A. Velocities have the amplitude A in the unit of `sound_speed`.
    wavenumber : float
        Number of waves on `length`.
    length : float
        Length of the periodic box.
    boost : float
        Uniform velocity added to gas and dust.
    gas_density : float
        Mean density rho_g0 of the gas.

    Returns
    -------
    Wave
        Densities and velocities of gas and dust, of the shape of `x`; velocities are along the wave vector.
    """
    k = 2 * np.pi * wavenumber / length
    y, slip = _evolve(time, k, drag_coefficient / gas_density, dust_ratio, sound_speed)
    gas_velocity = y[2] - slip * dust_ratio / (1 + dust_ratio)
    dust_velocity = y[2] + slip / (1 + dust_ratio)
    wave = np.exp(1j * k * (np.asarray(x) - boost * time))

    def field(mode: complex) -> np.ndarray:
        return amplitude * (mode * wave).imag

    return Wave(
        gas_density=gas_density * (1 + field(y[0])),
        gas_velocity=boost + field(gas_velocity),
        dust_density=gas_density * dust_ratio * (1 + field(y[1])),
        dust_velocity=boost + field(dust_velocity),
    )


def _evolve(time: float, k: float, drag: float, ratio: float, sound_speed: float) -> tuple[np.ndarray, complex]:
    """Return the amplitudes (d_g, d_d, V) and s at `time`, which are (1, 1, 1) and 0 at the start.

    k: wavenumber. drag: K/rho_g. ratio: eps.
    """
    a = -1j * k * np.array([[0, 0, 1], [0, 0, 1], [sound_speed**2 / (1 + ratio), 0, 0]])
    b = -1j * k / (1 + ratio) * np.array([-ratio, 1, 0])
    c = 1j * k * sound_speed**2 * np.array([1, 0, 0])
    lam = drag * (1 + 1 / ratio)
    start = np.ones(3, dtype=complex)
    if lam < _STIFF * k * sound_speed:
        matrix = np.block([[a, b[:, None]], [c[None, :], np.array([[-lam]])]])
        end = expm(matrix * time) @ np.append(start, 0)
        return end[:3], end[3]
    slow = np.zeros(3, dtype=complex)
    for _ in range(40):
        slow = (c - slow @ a - (slow @ b) * slow) / lam  # eq. (2)
    reduced, rate = a + np.outer(b, slow), lam + slow @ b
    q = np.linalg.solve(reduced + rate * np.eye(3), -b)
    z = -slow @ start
    w = expm(reduced * time) @ (start - q * z)  # eq. (3)
    z = z * np.exp(-rate * time)
    y = w + q * z
    return y, slow @ y + z
