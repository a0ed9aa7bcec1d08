"""Start of a simulation: the state before the first step, and the effects."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from discsim.effects import load_effects
from discsim.effects.base import Effect
from discsim.initial import make_particles, make_state, start_of
from discsim.initial.frame import make_bodies, transform_to_run_frame
from discsim.numerics.state import State
from discsim.run.relaxation import RelaxationReport, relax
from discsim.scene import Scene, SceneError

Given = dict[str, dict[str, Any]]
RAISE_ON_OVERFLOW: Any = {"over": "raise", "divide": "raise", "invalid": "raise"}  # numpy's error handling in a start


class InitialState(NamedTuple):
    """State before the first step, effects by name, and a report if the gas was relaxed."""

    state: State
    effects: dict[str, Effect]
    relaxed: RelaxationReport | None = None


def begin(scene: Scene, particles: Given | None = None, to_restore: bool = False) -> InitialState:
    """Return the state of a scene before the first step, and its effects. Raises SceneError.

    particles: the user's own arrays by species and name; None: particles are made as in [initial]. to_restore: whether
    a checkpoint will replace the state, so that the gas need not be relaxed.
    """
    try:
        return _begin(scene, particles, to_restore)
    except ValueError as error:
        raise SceneError([str(error)]) from error
    except (FloatingPointError, ZeroDivisionError, OverflowError) as error:
        raise SceneError([f"numbers of the start are too extreme: {error}; choose less extreme values"]) from error


def _made_particles(scene: Scene) -> Given:
    """Return the particles of [initial]. Raises FloatingPointError if a number overflows."""
    with np.errstate(**RAISE_ON_OVERFLOW):
        return make_particles(scene)


def _begin(scene: Scene, particles: Given | None, to_restore: bool) -> InitialState:
    """Return the result of `begin`; faults are exceptions of any type."""
    start = start_of(scene) if particles is None else None
    state = make_state(scene, _made_particles(scene) if particles is None else particles)
    state.bodies = make_bodies(scene, with_start=start is not None)
    effects = load_effects(scene, state)
    if start is not None and start.settle is not None:
        with np.errstate(**RAISE_ON_OVERFLOW):
            start.settle(state, effects)
    for effect in effects.values():
        effect.begin(state, effects)
    relaxed = None if start is None or to_restore else relax(state, effects)
    transform_to_run_frame(state, with_particles=start is not None)
    if start is not None and start.restore is not None:
        start.restore(state)
    return InitialState(state, effects, relaxed)
