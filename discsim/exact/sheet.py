"""Waves and Jeans instability of a softened razor-thin sheet (Toomre 1964; Binney & Tremaine 2008, sec. 5.6).

    omega^2 = c_s^2 k^2 - 2 pi G Sigma k exp(-k e)                                                    (1)

The Plummer softening e replaces the field in the sheet by the field at the height e, which is smaller by exp(-k e).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def omega_squared(
    k: ArrayLike, surface_density: float, sound_speed: float, softening: float = 0.0, gravity: float = 1.0
) -> np.ndarray:
    """Return the squared angular frequency of a wave, eq. (1).

    Parameters
    ----------
    k : array_like
        Wavenumber in radians per length. Any consistent units.
    surface_density : float
        Mean surface density Sigma.
    sound_speed : float
        Isothermal sound speed c_s.
    softening : float
        Plummer softening e.
    gravity : float
        G; 0 without self-gravity.

    Returns
    -------
    ndarray
        omega^2, of the shape of `k`; negative if the sheet is unstable.
    """
    k = np.asarray(k, dtype=float)
    self_gravity = 2 * np.pi * gravity * surface_density * k * np.exp(-k * softening)
    return sound_speed**2 * k**2 - self_gravity  # eq. (1)


def growth_rate(
    k: ArrayLike, surface_density: float, sound_speed: float, softening: float = 0.0, gravity: float = 1.0
) -> np.ndarray:
    """Return the growth rate of a wave.

    Parameters
    ----------
    k, surface_density, sound_speed, softening, gravity
        Arguments of `omega_squared`.

    Returns
    -------
    ndarray
        Growth rate, of the shape of `k`; 0 if the sheet is stable.
    """
    return np.sqrt(np.maximum(-omega_squared(k, surface_density, sound_speed, softening, gravity), 0))


def frequency(
    k: ArrayLike, surface_density: float, sound_speed: float, softening: float = 0.0, gravity: float = 1.0
) -> np.ndarray:
    """Return the angular frequency of a wave.

    Parameters
    ----------
    k, surface_density, sound_speed, softening, gravity
        Arguments of `omega_squared`.

    Returns
    -------
    ndarray
        Angular frequency, of the shape of `k`; 0 if the sheet is unstable.
    """
    return np.sqrt(np.maximum(omega_squared(k, surface_density, sound_speed, softening, gravity), 0))
