"""Linear sound wave in isothermal gas coupled to dust (DustyWave; Laibe & Price 2011, 2012).

Perturbations d_g = drho_g/rho_g, d_d = drho_d/rho_d and velocities v, u, all ~ exp(i k x), eps = rho_d/rho_g:

    d_g' = -i k v      v' = -i k c_s^2 d_g + (K/rho_g)(u - v)
    d_d' = -i k u      u' = -(K/(eps rho_g))(u - v)

in the barycentric velocity V = (v + eps u)/(1 + eps) and the slip s = u - v, where only one entry is stiff:

    y = (d_g, d_d, V):   y' = A y + b s      s' = c y - lam s      lam = (K/rho_g)(1 + 1/eps)        (1)

The exponential of the 4x4 matrix of (1) is the answer; its error is lam t/2^53, so for large lam (1)
is decoupled first. With s = R y + z and y = w + q z,

    c - lam R - R A - R b R = 0       (A + b R + lam + R b) q = -b                                   (2)
    w' = (A + b R) w                  z' = -(lam + R b) z                                            (3)

is the same system, exactly. Limits: K -> inf is a wave of speed c_s/sqrt(1 + eps).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

_STIFF = 50.0  # lam/(k c_s) above which eq. (2) is solved: its iteration then gains more than a digit a turn


class Wave(NamedTuple):
    """Fields at the asked places, each of their shape."""

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
    """What starts as A sin(k x) in rho_g/rho_g0, rho_d/rho_d0, v and u, at the places `x` and `time`.

    `drag_coefficient` is K (force density K (u - v)), `wavenumber` the number of waves on `length`, `boost` a
    uniform velocity of everything. For an oblique wave x and the velocities are along the wave vector.
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
    """The mode ((d_g, d_d, V), s) at `time` that was (1, 1, 1), 0."""
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
