"""Warnings about scenes that run, but perhaps not as intended. Each warning names the number and the remedy."""

from __future__ import annotations

import numpy as np

from discsim.effects import effect_classes
from discsim.initial import start_of, support
from discsim.preview.derived import local
from discsim.preview.forecast import close_pair_warnings
from discsim.scene import Scene


def warnings(scene: Scene) -> list[str]:
    """Return the warnings about a scene: of its effects, its radial support, its companions and its start."""
    if scene.initial is None:
        return []
    at = local(scene)
    of_start = start_of(scene).warnings
    with np.errstate(over="ignore"):  # an infinite length or mass compares correctly
        told = [line for effect in effect_classes(scene).values() for line in effect.report(scene, at).warnings]
        told += [*support.warnings(scene), *close_pair_warnings(scene)]
        return told if of_start is None else [*told, *of_start(scene)]
