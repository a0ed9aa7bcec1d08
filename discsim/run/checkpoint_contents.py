"""Contents of a checkpoint of a state, and checks of them before they replace a state of its scene.

A file may be damaged, so each array is checked for the type, shape and range that kernels rely on.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from discsim.effects.added_force import descriptions
from discsim.effects.base import kick_effect_name
from discsim.initial import start_time
from discsim.numerics.bodies import Bodies
from discsim.numerics.entries import EntryError, check_arrays, check_finite, check_like, check_ranges
from discsim.numerics.state import Ledger, State, SubcycleClock
from discsim.output.checkpoint import CheckpointError, Scalar, Values
from discsim.run.costs import Costs
from discsim.run.forces import Effects, Limits
from discsim.scene.units import clipped

if TYPE_CHECKING:
    from discsim.run.operators import Operators
    from discsim.scene import Scene

Array = np.ndarray
Groups = Mapping[str, Any]
# Names of the fields of `Limits` in a checkpoint, in the same order.
LIMITS = ("limit", "limited_by", "dust_limit", "dust_limited_by", "growing_limit")
ADDED_FORCES = "added_forces"  # descriptions of added forces, in a checkpoint of a run that has some


class CheckedContents(NamedTuple):
    """Checked contents of a checkpoint.

    particles: arrays by species and name. of_state: other attributes of the state by name. limits: time-step limits for
    the next step. costs: CPU time of each effect so far.
    """

    particles: dict[str, dict[str, Array]]
    of_state: dict[str, Any]
    limits: Limits
    costs: Costs


def contents_of(
    scene: Scene, state: State, operators: Operators
) -> tuple[dict[str, dict[str, Array]], dict[str, Scalar]]:
    """Return the contents of a checkpoint of `state`: arrays by group and name, and single values."""
    groups = {name: p.arrays() for name, p in state.species.items()}
    groups["own_acc"] = state.acc_unshared
    groups["ledger"] = {name: np.atleast_1d(value) for name, value in asdict(state.ledger).items()}
    if state.bodies is not None:
        groups["bodies"] = state.bodies.arrays()
    groups["scene"] = {"text": np.frombuffer(scene.text.encode(), np.uint8)}
    groups["costs"] = operators.costs.arrays()
    values: dict[str, Scalar] = {"time": state.time, "step": state.step, "lag": state.velocity_lag}
    values |= dict(zip(LIMITS, operators.limits, strict=True))
    values |= _values_of_added_forces(operators.effects)
    if state.subcycle_clock is not None:
        values |= {f"pace_{name}": value for name, value in state.subcycle_clock._asdict().items()}
    return groups, values


def _values_of_added_forces(effects: Effects) -> dict[str, Scalar]:
    """Return the value of a checkpoint that records the forces of `add_force`; none for a run without them."""
    found = descriptions(effects)
    return {ADDED_FORCES: "; ".join(found)} if found else {}


def refuse_other_forces(values: Values, effects: Effects) -> None:
    """Raise CheckpointError unless a run with `effects` has the added forces of the checkpoint with these values."""
    before = values.text(ADDED_FORCES).split("; ") if ADDED_FORCES in values else []
    now = descriptions(effects)
    if before == now:
        return
    if missing := [each for each in before if each not in now]:
        wrong = f"its run has the added force {clipped(missing[0])}"
        name = clipped(missing[0].partition(" on ")[0])  # in quotes
        raise CheckpointError(
            f"{values.path}: {wrong}; expected sim.add_force(..., name={name}) in Python, then sim.restore(path)"
        )
    if extra := [each for each in now if each not in before]:
        raise CheckpointError(
            f"{values.path}: its run has no added force {extra[0]}; expected a Simulation without this force: "
            "restore the checkpoint first, then add the force"
        )
    raise CheckpointError(f"{values.path}: its run has the added forces in the order {clipped('; '.join(before))}; "
                          f"expected add_force in this order, found {'; '.join(now)}")  # fmt: skip


def checked_contents(
    path: str | Path, state: State, effects: Effects, groups: Groups, values: Values
) -> CheckedContents:
    """Check the contents of the checkpoint at `path`, and return them as attributes of a state.

    state, effects: a state of the scene, whose arrays have the expected types and shapes, and the effects of the
    scene. groups, values: contents of the checkpoint, arrays by group and name, and single values. Raises
    CheckpointError.
    """
    try:
        return _checked_contents(state, effects, groups, values)
    except EntryError as fault:
        raise CheckpointError(
            f"{path}: damaged checkpoint, or written by another version of discsim: {fault}"
        ) from None


def _checked_contents(state: State, effects: Effects, groups: Groups, values: Values) -> CheckedContents:
    particles = {name: _checked_particles(state, name, groups[name]) for name in state.species}
    time = values.number("time", start_time(state.scene))
    of_state = {
        "acc_unshared": _checked_acc_unshared(state, effects, groups["own_acc"], particles),
        "ledger": _checked_ledger(groups["ledger"]),
        "bodies": None if state.bodies is None else _checked_bodies(state.bodies, groups["bodies"], time),
        "time": time,
        "step": values.whole("step"),
        "velocity_lag": values.number("lag", 0.0),
        "subcycle_clock": None,
    }
    if state.subcycle_clock is not None:
        since, rate = values.number("pace_since", 0.0), values.number("pace_rate", 0.0, may_be_infinite=True)
        of_state["subcycle_clock"] = SubcycleClock(since, rate)
    (step, by), (dust, dust_by) = (_checked_limit(values, effects, *names) for names in (LIMITS[:2], LIMITS[2:4]))
    limits = Limits(step, by, dust, dust_by, values.number(LIMITS[4], 0.0, may_be_infinite=True))
    return CheckedContents(particles, of_state, limits, _checked_costs(effects, groups["costs"]))


def _checked_particles(state: State, name: str, held: dict[str, Array]) -> dict[str, Array]:
    """Check the arrays `held` of a species in a checkpoint, and return them."""
    own = state.species[name].arrays()
    arrays = {key: held[key] for key in own}
    if others := held.keys() - own.keys():
        raise EntryError(
            f"{name} has an extra array {min(others)}; expected only the arrays of this scene: {', '.join(own)}"
        )
    check_arrays(name, arrays, state.scene.space.dimensions)
    check_finite(name, arrays)
    check_ranges(name, arrays, populations=len(state.scene.dust or ()))
    return arrays


def _checked_acc_unshared(
    state: State, effects: Effects, held: dict[str, Array], particles: Groups
) -> dict[str, Array]:
    """Check the stored accelerations that act on one species only, and return them as `State.acc_unshared`.

    held: arrays of the group own_acc by species; each must have one row per particle, or none.
    """
    wanted = [*particles] if kick_effect_name(effects) is not None else []
    if held.keys() != {*wanted}:
        raise EntryError(
            f"own_acc has accelerations of {', '.join(held) or 'no species'}; expected accelerations of "
            f"{', '.join(wanted) or 'no species'}, as in this scene"
        )
    for name, array in held.items():
        count = check_arrays(f"own_acc of {name}", {"acc": array}, state.scene.space.dimensions)
        if count not in (0, len(particles[name]["mass"])):
            raise EntryError(f"own_acc of {name} has {count} rows; expected one row per particle")
    check_finite("own_acc", held)
    return dict(held)


def _checked_ledger(held: dict[str, Array]) -> Ledger:
    """Check the arrays `held` of the group ledger, and return them as a ledger."""
    empty = {name: np.atleast_1d(value) for name, value in asdict(Ledger()).items()}
    check_like("ledger", {name: held[name] for name in empty}, empty)
    check_finite("ledger", held)
    entries: dict[str, Any] = {name: held[name] if len(held[name]) > 1 else float(held[name][0]) for name in empty}
    return Ledger(**entries)


def _checked_bodies(own: Bodies, held: dict[str, Array], time: float) -> Bodies:
    """Check the arrays `held` of the group bodies, and return them as bodies; time: time of the checkpoint."""
    check_like("bodies", held, own.arrays())
    check_finite("bodies", held)
    check_ranges("bodies", held, time=time)
    return Bodies(**held)


def _checked_limit(values: Values, effects: Effects, length: str, by: str) -> tuple[float, str]:
    """Check a time-step limit, and return it with the name of the effect that sets it; "" without a limit.

    length, by: names, in the checkpoint, of the limit and of the effect that sets it.
    """
    found, name = values.number(length, 0.0, may_be_infinite=True), values.text(by)
    if found == 0.0:
        values.refuse(length, "a number above 0")
    if name not in {*effects, *([""] if found == math.inf else [])}:
        values.refuse(by, f"one of {', '.join(effects)}")
    return found, name


def _checked_costs(effects: Effects, held: dict[str, Array]) -> Costs:
    """Check the arrays `held` of the group costs, and return them as costs."""
    costs = Costs(effects)
    own = costs.arrays()
    check_like("costs", {name: held[name] for name in own}, own)
    check_finite("costs", held)
    costs.calls.update(zip(effects, held["calls"].tolist(), strict=True))
    costs.seconds.update(zip(effects, held["seconds"].tolist(), strict=True))
    return costs
