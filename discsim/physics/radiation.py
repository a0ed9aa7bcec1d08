"""Radiation pressure of the star: a grain with beta = F_rad / F_grav moves as about a star of mass (1 - beta) M.

Both forces fall as 1/r^2, so that a dust population has one beta at every radius (Burns, Lamy & Soter 1979, eq. 19).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from discsim.physics.centre import star_pull

if TYPE_CHECKING:
    from discsim.scene import Scene


def gravity_factor(scene: Scene) -> np.ndarray:
    """Return 1 - beta (populations,), the factor by which radiation multiplies the gravity on each dust population."""
    count = len(scene.dust or ())
    if scene.radiation_pressure is None:
        return np.ones(count)
    return np.ones(count) - np.broadcast_to(np.array(scene.radiation_pressure.beta), count)


def radiation_velocities(scene: Scene, r: np.ndarray, keplerian: np.ndarray) -> np.ndarray | None:
    """Return the radiation force per mass f on each population as the velocity r f / v (populations, n).

    r (n,): radii. keplerian (n,): Keplerian velocity v. About a single star the result is beta v. Only the star
    radiates, even if the central mass includes companions. Returns None without radiation pressure.
    """
    if scene.radiation_pressure is None:
        return None
    return (1.0 - gravity_factor(scene))[:, None] * r * star_pull(scene, r) / keplerian


def circular_minus_keplerian(scene: Scene, species: np.ndarray, r: np.ndarray, keplerian: np.ndarray) -> np.ndarray:
    """Return the circular velocity of grains without drag, minus the Keplerian velocity (n,).

    species (n,): populations of the grains. r (n,): radii. keplerian (n,): Keplerian velocity. The result is negative,
    as radiation pressure reduces gravity. Grains that radiation expels have the circular velocity 0.
    """
    own = radiation_velocities(scene, r, keplerian)[species, np.arange(len(r))]
    return np.sqrt(np.maximum(keplerian * (keplerian - own), 0.0)) - keplerian
