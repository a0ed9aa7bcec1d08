"""Light of the star as a share of its pull: a grain of beta = F_rad / F_grav feels a star of mass (1 - beta) M.

Both fall as 1/r^2, so that a population of dust has one beta at every radius (Burns, Lamy & Soter 1979, eq. 19).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from discsim.scene import Scene


def pull_share(scene: Scene) -> np.ndarray:
    """1 - beta of each population of dust (populations,): what light leaves of the star's pull; below 0 it pushes."""
    count = len(scene.dust or ())
    table = scene.table("radiation_pressure")
    if table is None:
        return np.ones(count)
    return np.ones(count) - np.broadcast_to(np.array(table.beta, float), count)
