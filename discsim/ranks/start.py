"""Initial state of a run on several ranks.

Rank 0 makes the initial state with all particles. The other ranks get the same effects and no particles, until the
particles are distributed (`division.py`).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from discsim.effects import load_effects
from discsim.numerics.state import Dust, Gas, State
from discsim.numerics.threads import set_threads
from discsim.ranks.agreed import on_root
from discsim.ranks.comm import Comm
from discsim.run.start import InitialState, begin
from discsim.scene import Scene

PARTICLE_TYPES: dict[str, Any] = {"gas": Gas, "dust": Dust}
# Fields of a state that are the same on all ranks.
SHARED_FIELDS = ("time", "step", "earlier", "velocity_lag", "ledger", "subcycle_clock", "bodies")


def begun(comm: Comm, scene: Scene, to_restore: bool) -> InitialState:
    """Return the start of a scene as `run.start.begin`, with all particles on rank 0."""
    set_threads(scene.run.threads)
    made: list[InitialState] = []

    def make() -> Any:
        made.append(begin(scene, to_restore=to_restore))
        return told(made[0])

    heard = on_root(comm, make)
    return made[0] if made else without_particles(scene, heard)


def told(begun: InitialState) -> dict[str, Any]:
    """Return the data of a start that the other ranks need: shapes and types of arrays, and values of the state."""
    state = begun.state
    return {
        "arrays": {
            name: {key: (array.shape, array.dtype) for key, array in p.arrays().items()}
            for name, p in state.species.items()
        },
        "state": {name: getattr(state, name) for name in SHARED_FIELDS},
        "effects": {
            name: {key: getattr(effect, key) for key in effect.from_start} for name, effect in begun.effects.items()
        },
    }


def without_particles(scene: Scene, told: dict[str, Any]) -> InitialState:
    """Return the start on another rank than 0: the same state and effects, but arrays without particles."""
    # Effects need a state with as many particles: zeros, which take no memory until they are written.
    species: dict[str, Any] = {
        name: PARTICLE_TYPES[name](**{key: np.zeros(*like) for key, like in arrays.items()})
        for name, arrays in told["arrays"].items()
    }
    state = State(scene, species.get("gas"), species.get("dust"), None)
    for name, value in told["state"].items():
        setattr(state, name, value)
    effects = load_effects(scene, state)
    for name, effect in effects.items():
        for key, value in told["effects"][name].items():
            setattr(effect, key, value)
        if not effect.from_start:
            effect.begin(state, effects)
    state.subcycle_clock = told["state"]["subcycle_clock"]  # which an effect may have reset
    for p in species.values():
        for key, array in p.arrays().items():
            setattr(p, key, array[:0].copy())
    return InitialState(state, effects)
