"""Snapshots of a run: their times, and their arrays that are not arrays of the state."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import replace
from fractions import Fraction

import numpy as np

from discsim.effects.base import Column, Effect, kick_effect_name
from discsim.numerics.state import Gas, State
from discsim.output.open_step import OpenStep, open_step_of
from discsim.output.snapshot_writer import write_snapshot
from discsim.physics.eos import pressure_and_sound_speed
from discsim.scene import Scene
from discsim.scene.tables import Run


def output_times(run: Run) -> list[float]:
    """Return the times of all snapshots after the initial one; the last is the end of the run.

    The times are multiples of `run.every`, or of the end time of the run divided by `run.snapshots`. Multiples are
    computed with exact fractions, so that runs of different lengths have bitwise equal times.
    """
    until = Fraction(repr(run.until))
    if run.every is None:
        return [float(until * k / run.snapshots) for k in range(1, run.snapshots + 1)]
    every = Fraction(repr(run.every))
    # An end within rounding of a multiple counts as the multiple, at which a longer run would have a snapshot too.
    whole = int(until / every + Fraction(1, 10**9))
    times = [float(every * k) for k in range(1, whole + 1)]
    return times if times and np.isclose(times[-1], run.until, rtol=1e-9, atol=0.0) else [*times, run.until]


def due_times(run: Run, reached: float, last_output: float) -> list[float]:
    """Return the times of the snapshots that are still to be written.

    reached: present time of the run. last_output: time of the last snapshot written. If the run was stopped after the
    checkpoint at an output time and before the snapshot, this snapshot is due at once.
    """
    near = 1e-9 * reached
    later = [t for t in output_times(run) if t >= reached - near and t > last_output * (1.0 + 1e-9)]
    return [reached if abs(t - reached) <= near else t for t in later]


def effect_columns(state: State, effects: Iterable[Effect]) -> dict[str, dict[str, np.ndarray | Column]]:
    """Return the arrays that effects add to a snapshot, by species and name.

    state: state with velocities at the time of the positions.
    """
    extra: dict[str, dict[str, np.ndarray | Column]] = {}
    for effect in effects:
        for species, arrays in effect.columns(state).items():
            extra[species] = extra.get(species, {}) | dict(arrays)
    return extra


def with_present_pressure(state: State) -> Gas | None:
    """Return the gas of `state` with pressure and sound speed from its present energy.

    The pressure in the state follows from a predicted energy, which the forces use.
    """
    gas = state.gas
    if gas is None or gas.u is None:
        return gas
    pressure, sound_speed = pressure_and_sound_speed(state.scene, state.from_centre(gas.pos), gas.density, gas.u)
    return replace(gas, pressure=pressure, sound_speed=sound_speed)


def open_step_between(state: State, effects: Mapping[str, Effect]) -> OpenStep:
    """Return the open step of a state between two steps, before its closing kick."""
    return open_step_of(state, kick_effect_name(effects) is not None)


def write_state(
    path: str | os.PathLike[str], scene: Scene, state: State, effects: Mapping[str, Effect], open_step: OpenStep
) -> None:
    """Write a snapshot of a state after its closing kick, with the open step from before this kick. Raises OSError."""
    extra, gas = effect_columns(state, effects.values()), with_present_pressure(state)
    write_snapshot(path, scene, state.time, gas, state.dust, extra, state.bodies, open_step)
