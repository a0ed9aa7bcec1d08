"""Parameters of a shearing box with the mean densities of its gas and dust."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from discsim.exact import streaming
from discsim.parts import LAWS
from discsim.physics.laws import stopping_times

if TYPE_CHECKING:
    from discsim.scene import Scene


def mean_box(scene: Scene, density: float, ratios: ArrayLike) -> streaming.Box:
    """Return the parameters of the scene's shearing box for the drift and for growth rates.

    density: mean density of the gas. ratios (populations,): mass of each population of dust divided by that of the gas.
    Dust without drag, or without gas, has infinite stopping times. With one-way drag, ratios in the result are 0.
    """
    keys, count = scene.table("shearing_box"), len(scene.dust or ())
    times, sound = np.full(count, np.inf), 1.0
    if scene.gas is not None:
        sound = float(scene.gas.eos.sound_speed)
        if scene.drag is not None:
            times = np.concatenate(stopping_times(scene, np.array([density]), np.array([sound]), None))
    acts = scene.drag is not None and scene.drag.direction == "two-way"
    shares = np.asarray(ratios, float) if acts else np.zeros(count)
    return streaming.Box(times, shares, keys.headwind, sound, keys.omega, keys.shear)


def has_mode(scene: Scene) -> bool:
    """Return whether `streaming.fastest_mode` holds in a scene: two-way drag with fixed stopping times of all dust."""
    drag = scene.drag
    return drag is not None and drag.direction == "two-way" and LAWS[drag.law].uniform_time is not None
