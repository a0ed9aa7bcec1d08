"""Waves and Jeans instability of a softened razor-thin sheet (Toomre 1964; Binney & Tremaine 2008, sec. 5.6).

    omega^2 = c_s^2 k^2 - 2 pi G Sigma k exp(-k e)                                                    (1)

where exp(-k e) is the Plummer kernel 1/sqrt(r^2 + e^2) in k: the sheet feels its own field at the height e.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def omega_squared(
    k: ArrayLike, surface_density: float, sound_speed: float, softening: float = 0.0, gravity: float = 1.0
) -> np.ndarray:
    """Squared frequency of the wavenumber `k` (radians per length); negative where the sheet is unstable."""
    k = np.asarray(k, dtype=float)
    self_gravity = 2 * np.pi * gravity * surface_density * k * np.exp(-k * softening)
    return sound_speed**2 * k**2 - self_gravity  # eq. (1)


def growth_rate(
    k: ArrayLike, surface_density: float, sound_speed: float, softening: float = 0.0, gravity: float = 1.0
) -> np.ndarray:
    """Growth rate of the wavenumber `k`: 0 where it is stable."""
    return np.sqrt(np.maximum(-omega_squared(k, surface_density, sound_speed, softening, gravity), 0))


def frequency(
    k: ArrayLike, surface_density: float, sound_speed: float, softening: float = 0.0, gravity: float = 1.0
) -> np.ndarray:
    """Angular frequency of the wavenumber `k`: 0 where it is unstable."""
    return np.sqrt(np.maximum(omega_squared(k, surface_density, sound_speed, softening, gravity), 0))
