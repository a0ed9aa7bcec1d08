"""Check of the contents of a checkpoint against the scene that is to be resumed, before the state changes.

A file may be damaged, so each array is checked for the type, shape and range that kernels rely on. Functions raise
EntryError for a wrong array, and CheckpointError for a wrong single value.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, NamedTuple

import numpy as np

from discsim.effects.base import kick_effect_name
from discsim.initial import start_time
from discsim.numerics.bodies import Bodies
from discsim.numerics.entries import EntryError, check_arrays, check_finite, check_like, check_ranges
from discsim.numerics.state import Ledger, State, SubcycleClock
from discsim.output.checkpoint import Values
from discsim.run.costs import Costs
from discsim.run.forces import Effects, Limits

Array = np.ndarray
Groups = Mapping[str, Any]
# Names of the entries of `Limits` in a checkpoint.
LIMIT_NAMES = (("limit", "limited_by"), ("dust_limit", "dust_limited_by"))
GROWING_LIMIT = "growing_limit"


class Restored(NamedTuple):
    """Checked contents of a checkpoint.

    particles: arrays by species and name. of_state: the other attributes of the state.
    """

    particles: dict[str, dict[str, Array]]
    of_state: dict[str, Any]
    limits: Limits
    costs: Costs


def restored(state: State, effects: Effects, groups: Groups, values: Values) -> Restored:
    """Check the contents of a checkpoint, and return them in the form of a state.

    groups: arrays by group and name. values: single values.
    """
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
    (step, by), (dust, dust_by) = (_checked_limit(values, effects, *names) for names in LIMIT_NAMES)
    limits = Limits(step, by, dust, dust_by, values.number(GROWING_LIMIT, 0.0, may_be_infinite=True))
    return Restored(particles, of_state, limits, _checked_costs(effects, groups["costs"]))


def _checked_particles(state: State, name: str, held: dict[str, Array]) -> dict[str, Array]:
    """Check the arrays `held` of a species in a checkpoint, and return them."""
    own = state.species[name].arrays()
    arrays = {key: held[key] for key in own}
    if others := held.keys() - own.keys():
        raise EntryError(
            f"{name} has an extra array {min(others)}; expected only those of this scene: {', '.join(own)}"
        )
    check_arrays(name, arrays, state.scene.space.dimensions)
    check_finite(name, arrays)
    check_ranges(name, arrays, populations=len(state.scene.dust or ()))
    return arrays


def _checked_acc_unshared(
    state: State, effects: Effects, held: dict[str, Array], particles: Groups
) -> dict[str, Array]:
    """Check the stored accelerations that act on one species only, and return them.

    There must be one for each particle of a species, or none.
    """
    wanted = set(particles) if kick_effect_name(effects) is not None else set()
    if held.keys() != wanted:
        raise EntryError(
            f"the accelerations of own_acc are those of {', '.join(held) or 'no species'}; "
            f"expected those of {', '.join(wanted) or 'no species'}, as in this scene"
        )
    for name, array in held.items():
        count = check_arrays(f"own_acc of {name}", {"acc": array}, state.scene.space.dimensions)
        if count not in (0, len(particles[name]["mass"])):
            raise EntryError(f"own_acc of {name} has {count} rows; expected one per particle")
    check_finite("own_acc", held)
    return dict(held)


def _checked_ledger(held: dict[str, Array]) -> Ledger:
    empty = {name: np.atleast_1d(value) for name, value in asdict(Ledger()).items()}
    check_like("ledger", {name: held[name] for name in empty}, empty)
    check_finite("ledger", held)
    entries: dict[str, Any] = {name: held[name] if len(held[name]) > 1 else float(held[name][0]) for name in empty}
    return Ledger(**entries)


def _checked_bodies(own: Bodies, held: dict[str, Array], time: float) -> Bodies:
    check_like("bodies", held, own.arrays())
    check_finite("bodies", held)
    check_ranges("bodies", held, time=time)
    return Bodies(**held)


def _checked_limit(values: Values, effects: Effects, length: str, by: str) -> tuple[float, str]:
    """Return a time-step limit, and the effect that sets it; "" if none does.

    length, by: names of the two values in the checkpoint.
    """
    found, name = values.number(length, 0.0, may_be_infinite=True), values.text(by)
    if found == 0.0:
        values.refuse(length, "a number above 0")
    if name not in {*effects, *([""] if found == math.inf else [])}:
        values.refuse(by, f"one of {', '.join(effects)}")
    return found, name


def _checked_costs(effects: Effects, held: dict[str, Array]) -> Costs:
    costs = Costs(effects)
    like = {"calls": np.array([*costs.calls.values()]), "seconds": np.array([*costs.seconds.values()])}
    check_like("costs", {name: held[name] for name in like}, like)
    check_finite("costs", held)
    for table, name in ((costs.calls, "calls"), (costs.seconds, "seconds")):
        table.update(zip(effects, held[name].tolist(), strict=True))
    return costs
