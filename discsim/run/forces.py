"""Forces of all effects on the particles at their present positions, and the smallest time-step limit."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from discsim.effects.base import Effect, kick_effect_name
from discsim.numerics import alloc, world
from discsim.numerics.operators import GROWS, Limit, Operator, Slot, View, accelerate, limits, smallest_limits
from discsim.numerics.state import State
from discsim.numerics.thread_pool import run_concurrently, several_threads
from discsim.numerics.threads import copied, parallel_for
from discsim.parts import Lazy
from discsim.printable import UserError
from discsim.run import declarations
from discsim.run.costs import Costs

moves = Lazy("discsim.kernels.common.move")

Effects = Mapping[str, Effect]
Array = np.ndarray


class PhysicsError(UserError):
    """Error that ends a run: a number is not finite, or the time step has collapsed."""


@contextmanager
def physics_errors() -> Iterator[None]:
    """Convert a FloatingPointError within the context to a PhysicsError with the same message."""
    try:
        yield
    except FloatingPointError as fault:
        raise PhysicsError(str(fault)) from fault


class Limits(NamedTuple):
    """Smallest time-step limit of all effects, in code units, before the Courant factor.

    step, by: longest step, and the name of the effect that sets it. dust, dust_by: longest step in which one-way dust
    keeps its orbits, and the name of the effect that sets it. Longer steps are an error, as one-way dust does not
    shorten `step`. unstable: step above which integration errors grow without bound.
    """

    step: float = math.inf
    by: str = ""
    dust: float = math.inf
    dust_by: str = ""
    unstable: float = math.inf


class Plan(dict[Slot, list[tuple[str, Operator]]]):
    """Operators of all effects by slot: `plan[slot]` is a list of (name of the effect, operator).

    Forces that accelerate gas and dust equally come first. names: names of the effects. kicks_together: name of the
    effect that kicks gas and dust together, or None. Raises PartError if operators are not valid
    (`discsim/run/declarations.py`).
    """

    def __init__(self, effects: Effects, state: State) -> None:
        super().__init__((slot, []) for slot in Slot)
        self.names, self.kicks_together = [*effects], kick_effect_name(effects)
        for name, operator in declarations.checked_operators(effects, state):
            if operator.slot is not Slot.KICK or self.kicks_together in (None, name):
                self[operator.slot].append((name, operator))
        self[Slot.FORCE].sort(key=lambda each: not any(name.endswith(".acc") for name in each[1].writes))

    def fields_of(self, operator: Operator) -> list[tuple[str, Operator]]:
        """Return the entries of `plan[Slot.FIELD]` whose results `operator` reads."""
        return [field for field in self[Slot.FIELD] if field[1].name in operator.reads]

    def writes(self, name: str) -> bool:
        """Return whether any force writes to the acceleration array `name`, such as "gas.acc"."""
        return any(name in operator.writes for _, operator in self[Slot.FORCE])


class _AccelerationSums:
    """Acceleration arrays while forces are added: `acc`, a dict by name, such as "gas.acc" and "gas.acc_unshared".

    If an effect kicks gas and dust together, shared and unshared accelerations have separate arrays. Otherwise the
    shared and the unshared name of a species refer to the same array.
    """

    def __init__(self, state: State, plan: Plan) -> None:
        self.state, self.has_separate_arrays = state, plan.kicks_together is not None
        self.acc: dict[str, Array] = {}
        for name, p in state.species.items():
            shared, unshared = plan.writes(f"{name}.acc"), plan.writes(f"{name}.acc_unshared")
            if shared or not unshared or not self.has_separate_arrays:
                self.acc[f"{name}.acc"] = p.acc
            if unshared:
                both = shared and self.has_separate_arrays
                self.acc[f"{name}.acc_unshared"] = alloc.allocate_like(p.acc) if both else p.acc
        self._uninitialised = {id(array): array for array in self.acc.values()}

    def start_arrays(self, operator: Operator) -> set[str]:
        """Return the names of the acceleration arrays that `operator` is the first to write.

        Set these arrays to 0, unless the operator overwrites them (`Operator.starts`).
        """
        found = set()
        for name in sorted(operator.writes & self.acc.keys()):
            if self._uninitialised.pop(id(self.acc[name]), None) is not None:
                found.add(name)
                if not operator.starts:
                    _set_to_zero(self.acc[name])
        return found

    def merge(self) -> None:
        """Store the sum of shared and unshared accelerations in `acc` of each species, and set `state.acc_unshared`."""
        state = self.state
        for array in self._uninitialised.values():
            _set_to_zero(array)
        if not self.has_separate_arrays:
            return
        state.acc_unshared = {
            name: self.acc.get(f"{name}.acc_unshared", p.acc[:0]) for name, p in state.species.items()
        }
        for name, p in state.species.items():
            unshared = self.acc.get(f"{name}.acc_unshared")
            if unshared is p.acc:
                p.acc = copied(p.acc)
            elif unshared is not None:
                parallel_for(moves.add_scaled, p.count, p.acc, unshared, 1.0, light=True)


def _set_to_zero(array: Array) -> None:
    parallel_for(moves.set_to_zero, len(array), array, light=True)


def add_forces(state: State, plan: Plan, costs: Costs) -> None:
    """Set `acc` of each species by the forces of all effects, and compute the results of FIELD and KICK_INPUT.

    If an effect kicks gas and dust together, also set `state.acc_unshared`, the accelerations that act on one species
    only. On several threads all fields are computed at the same time, then the kick inputs at the same time as the
    forces. On one thread each field is computed just before its first reader, while it is in the cache, and kick inputs
    are left to the kick. With several processes the order is the same as on one thread, as all processes must make
    collective calls in the same order.
    """

    def tasks(slot: Slot) -> list[Callable[[], None]]:
        return [partial(_run_operator, state, *each, costs) for each in plan[slot]]

    for _, operator in [*plan[Slot.FIELD], *plan[Slot.KICK_INPUT]]:
        state.results.pop(operator.name, None)  # those of earlier positions
    try:
        if not several_threads() or world.processes.is_parallel:
            _add_forces_in_order(state, plan, costs)
        else:
            run_concurrently(*tasks(Slot.FIELD))
            run_concurrently(partial(_add_forces_in_order, state, plan, costs), *tasks(Slot.KICK_INPUT))
    except BaseException:
        state.results.clear()
        raise


def _add_forces_in_order(state: State, plan: Plan, costs: Costs) -> None:
    """Set `acc` of each species by the forces of all effects, one after another, each after the fields that it reads.

    Fields that have a result in `state.results` are not computed again.
    """
    sums = _AccelerationSums(state, plan)
    for name, operator in plan[Slot.FORCE]:
        for field in plan.fields_of(operator):
            if field[1].name not in state.results:
                _run_operator(state, *field, costs)
        _run_operator(state, name, operator, costs, sums)
        for species, p in state.species.items():
            if p.immobile is not None:
                for written in operator.writes & {f"{species}.acc", f"{species}.acc_unshared"}:
                    sums.acc[written][p.immobile] = 0.0
    with nullcontext() if plan.kicks_together is None else costs(plan.kicks_together, calls=0):
        sums.merge()


def _run_operator(
    state: State, name: str, operator: Operator, costs: Costs, sums: _AccelerationSums | None = None
) -> None:
    """Run an operator, store its result in `state.results`, and add its CPU time to the effect `name` in `costs`.

    sums: acceleration arrays, if the operator is a force.
    """
    with physics_errors(), costs(name, calls=int(sums is not None)):
        given = () if sums is None else (sums.acc, sums.start_arrays(operator))
        state.results[operator.name] = operator.run(View(state, operator, state.results, *given))


def _without_accelerations(state: State) -> State:
    """Return `state` with copies of the bodies and of the particles, whose accelerations are zero.

    Copies are needed because the operators of an effect change other arrays than `acc` too.
    """
    gas, dust, bodies = state.gas, state.dust, state.bodies
    own = replace(state, gas=gas and gas.copy(), dust=dust and dust.copy(), bodies=bodies and bodies.copy())
    for p in own.species.values():
        p.acc[:] = 0.0
    return own


def acceleration_of(effect: Effect, state: State) -> dict[str, Array]:
    """Return the accelerations (n, dimensions) that one effect causes at the present positions, by species.

    The result includes accelerations that are part of the drift, such as the pull of the star on Kepler orbits.
    """
    own = _without_accelerations(state)
    accelerate(effect, own, with_drift=True)
    return {name: p.acc for name, p in own.species.items()}


def limiting_grain(effect: Effect, state: State) -> tuple[int, str]:
    """Return the row of the dust particle that sets the time-step limit of `effect` on dust, and a remedy as text."""
    own = _without_accelerations(state)
    limit: Limit = limits(effect, own, accelerate(effect, own))["dust"]
    row = int((own.species["dust"].acc ** 2).sum(axis=1).argmax()) if limit.row is None else limit.row()
    return row, limit.remedy


def limits_of(state: State, plan: Plan, costs: Costs) -> tuple[dict[str, float], Limits]:
    """Return the time-step limit of each effect by name, and the smallest limits of all effects."""
    passive, none = state.dust_is_passive, Limit(math.inf)
    found: dict[str, dict[str, Limit]] = {name: {} for name in plan.names}
    for name, operator in plan[Slot.LIMIT]:
        with costs(name, calls=0):
            found[name] |= declarations.checked_limits(operator, operator.run(View(state, operator, state.results)))
    each = np.empty((3, len(found)))  # longest step, unstable step, and longest step of one-way dust
    for k, of_effect in enumerate(found.values()):
        each[:2, k] = smallest_limits(of_effect, passive)
        # The limit of dust is 1 / frequency. A circular orbit keeps its energy to 12% in steps of this length, and to
        # 1% in half of it.
        each[2, k] = of_effect.get("dust", none).unstable_step / GROWS if passive else math.inf
    steps, unstable, dust = (dict(zip(found, row, strict=True)) for row in world.processes.min(each).tolist())
    by = min(steps, key=steps.__getitem__)
    dust_by = min(dust, key=dust.__getitem__) if passive else ""
    return steps, Limits(steps[by], by, dust.get(dust_by, math.inf), dust_by, min(unstable.values()))
