"""Length of the next step: a share of the limit or the fixed step, cut so as to land on a given time."""

from __future__ import annotations

import math

from discsim.initial import start_of
from discsim.numerics.state import State
from discsim.run.forces import Limits, PhysicsError

GROWN = 8.0  # powers of ten by which rounding errors, of 1e-16, may grow


def next_step(state: State, limits: Limits, until: float) -> float:
    """Return the length of the next step. Raises PhysicsError if it has collapsed, or is fixed far above the stable
    one.
    """
    run, left = state.scene.run, until - state.time
    _check_fixed(state, limits, left)
    dt = run.timestep if run.timestep is not None else run.courant * limits.step
    if not math.isfinite(dt):
        if left == math.inf and state.time >= run.until:
            return math.inf
        dt = run.until - state.time if left == math.inf else left
    if abs(dt - left) <= 1e-9 * dt:
        return dt  # not cut: a landing must not change a fixed step by a rounding
    if dt > left:
        return left
    if run.timestep is None and 2.0 * dt > left:
        return 0.5 * left  # two even steps rather than a long and a tiny one
    if state.time + dt == state.time:
        raise PhysicsError(f"the time step collapsed to {dt:g}, set by {limits.by}")
    return dt


def _check_fixed(state: State, limits: Limits, left: float) -> None:
    """Raise PhysicsError if a fixed step is so long that errors grow without end."""
    fixed = state.scene.run.timestep
    if fixed is None or min(fixed, left) <= limits.growing or _over_before_it_grows(state, limits, left):
        return
    raise PhysicsError(
        f"run.timestep is {fixed / limits.step:.3g} times the step limit of {limits.by}: "
        f"above {limits.growing / limits.step:.3g} times the limit, sound waves and orbits are unstable; "
        f"expected at most {limits.step:.3g} code units"
    )


def _over_before_it_grows(state: State, limits: Limits, left: float) -> bool:
    """Return whether rounding errors stay small in the few steps of uniform gas, whose drag is exact at any length."""
    run = state.scene.run
    if state.scene.initial is None or not start_of(state.scene).uniform or run.timestep is None:
        return False
    steps = math.ceil((run.until if left == math.inf else state.time + left) / run.timestep - 1e-9)
    # A step of x times the limit multiplies rounding errors by x^2 at most.
    return steps <= 1 or 2 * steps * math.log10(run.timestep / limits.step) < GROWN
