"""Light of the star as a share of its pull: a grain of beta = F_rad / F_grav feels a star of mass (1 - beta) M.

Both fall as 1/r^2, so that a population of dust has one beta at every radius (Burns, Lamy & Soter 1979, eq. 19).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from discsim.physics.centre import star_pull

if TYPE_CHECKING:
    from discsim.scene import Scene


def pull_share(scene: Scene) -> np.ndarray:
    """1 - beta of each population of dust (populations,): what light leaves of the star's pull; below 0 it pushes."""
    count = len(scene.dust or ())
    if scene.radiation_pressure is None:
        return np.ones(count)
    return np.ones(count) - np.broadcast_to(np.array(scene.radiation_pressure.beta), count)


def pushes(scene: Scene, r: np.ndarray, keplerian: np.ndarray) -> np.ndarray | None:
    """Light's push on each population as a velocity (populations, n), r times it over the Keplerian one (n,), beta v_K
    about the star alone; None where there is no light. The star alone shines, whatever else the disc turns about.
    """
    if scene.radiation_pressure is None:
        return None
    return (1.0 - pull_share(scene))[:, None] * r * star_pull(scene, r) / keplerian


def lag(scene: Scene, species: np.ndarray, r: np.ndarray, keplerian: np.ndarray) -> np.ndarray:
    """By how much grains without drag, of populations `species` (n,), turn faster than the Keplerian velocity (n,) on
    their circles: less than 0. Those that light drives off turn with none.
    """
    found = pushes(scene, r, keplerian)
    assert found is not None
    own = found[species, np.arange(len(r))]
    return np.sqrt(np.maximum(keplerian * (keplerian - own), 0.0)) - keplerian
