"""Arrays of snapshots that are not arrays of the state."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from discsim.effects.base import Column, Effect
from discsim.numerics.state import Gas, State
from discsim.physics.eos import pressure_and_sound_speed

Array = np.ndarray


def columns(state: State, effects: Iterable[Effect]) -> dict[str, dict[str, Array | Column]]:
    """Return the arrays that effects add to a snapshot, by species and name.

    state: state with velocities at the time of the positions.
    """
    extra: dict[str, dict[str, Array | Column]] = {}
    for effect in effects:
        for species, arrays in effect.columns(state).items():
            extra[species] = extra.get(species, {}) | dict(arrays)
    return extra


def with_present_pressure(state: State) -> Gas | None:
    """Return the gas with pressure and sound speed from its present energy; forces used a predicted energy."""
    gas = state.gas
    if gas is None or gas.u is None:
        return gas
    pressure, sound_speed = pressure_and_sound_speed(state.scene, state.from_centre(gas.pos), gas.density, gas.u)
    return replace(gas, pressure=pressure, sound_speed=sound_speed)
