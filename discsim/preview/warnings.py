"""Warnings about scenes that run, but perhaps not as intended. Each one gives a number and a remedy."""

from __future__ import annotations

import numpy as np

from discsim.effects import effect_classes
from discsim.initial import start_of, support
from discsim.preview.derived import gas_at_start
from discsim.preview.forecast import close_pair_warnings
from discsim.scene import Scene


def warnings(scene: Scene) -> list[str]:
    """Return the warnings about a scene, as texts: of its effects, its radial support, its companions and its start."""
    if scene.initial is None:
        return []
    at = gas_at_start(scene)
    of_start = start_of(scene).warnings
    with np.errstate(over="ignore"):  # an infinite length or mass compares correctly
        lines = [line for effect in effect_classes(scene).values() for line in effect.report(scene, at).warnings]
        lines += [*support.warnings(scene), *close_pair_warnings(scene)]
        return lines if of_start is None else [*lines, *of_start(scene)]
