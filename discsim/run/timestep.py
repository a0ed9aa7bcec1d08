"""Length of the next step: a fraction of the limit or a fixed step, shortened to end at a given time."""

from __future__ import annotations

import math

from discsim.initial import start_of
from discsim.numerics.state import State
from discsim.run.forces import Limits, PhysicsError

MAX_ERROR_GROWTH = 8.0  # power of ten of the factor by which rounding errors, of 1e-16, may grow


def next_step(state: State, limits: Limits, until: float) -> float:
    """Return the length of the next step, which ends at the time `until` at the latest.

    The length is inf if nothing limits the step: no effect, no `until`, and no end of the run, as it was reached
    before. Raises PhysicsError if the step has collapsed, or if `run.timestep` is far above the limit of stability.
    """
    run, left = state.scene.run, until - state.time
    _check_fixed_step(state, limits, left)
    dt = run.timestep if run.timestep is not None else run.courant * limits.step
    if not math.isfinite(dt):
        if left == math.inf and state.time >= run.until:
            return math.inf
        dt = run.until - state.time if left == math.inf else left
    if abs(dt - left) <= 1e-9 * dt:
        return dt  # rounding must not change the length of a fixed step
    if dt > left:
        return left
    if run.timestep is None and 2.0 * dt > left:
        return 0.5 * left  # two equal steps rather than a long and a tiny one
    if state.time + dt == state.time:
        raise PhysicsError(f"the time step became too small, {dt:g}, by the limit of {limits.by}")
    return dt


def _check_fixed_step(state: State, limits: Limits, left: float) -> None:
    """Raise PhysicsError if the fixed step `run.timestep` is so long that errors grow without bound.

    left: time after which the step must end, which may be shorter than the fixed step.
    """
    fixed = state.scene.run.timestep
    if fixed is None or min(fixed, left) <= limits.unstable or _ends_before_errors_grow(state, limits, left):
        return
    raise PhysicsError(
        f"run.timestep is {fixed / limits.step:.3g} times the step limit of {limits.by}: "
        f"above {limits.unstable / limits.step:.3g} times the limit, sound waves and orbits are unstable; "
        f"lower run.timestep to at most {state.scene.units.show(limits.step, 'time')}"
    )


def _ends_before_errors_grow(state: State, limits: Limits, left: float) -> bool:
    """Return whether a run of uniform gas with a fixed step ends before its rounding errors become large.

    left: time until the end of the run, or inf. Drag in uniform gas is exact for any step, so tests of drag may make a
    few steps that are longer than the limit of stability.
    """
    run = state.scene.run
    if state.scene.initial is None or not start_of(state.scene).stays_uniform or run.timestep is None:
        return False
    steps = math.ceil((run.until if left == math.inf else state.time + left) / run.timestep - 1e-9)
    # A step of x times the limit multiplies rounding errors by x^2 at most.
    return steps <= 1 or 2 * steps * math.log10(run.timestep / limits.step) < MAX_ERROR_GROWTH
