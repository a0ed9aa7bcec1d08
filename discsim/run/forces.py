"""Forces of all effects on the particles at their present positions, and the smallest time-step limit."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from typing import NamedTuple

import numpy as np

from discsim.effects.base import Effect, kick_effect_name
from discsim.numerics import alloc, world
from discsim.numerics.operators import GROWS, Limit, Operator, Slot, View, accelerate, limits
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


class Limits(NamedTuple):
    """Smallest time-step limit of all effects, in code units, before the Courant factor.

    step, by: the limit, and the effect that sets it. dust, dust_by: longest step in which one-way dust keeps its
    orbits, and the effect that sets this limit; one-way dust does not shorten `step`. growing: step above which
    integration errors grow without bound.
    """

    step: float = math.inf
    by: str = ""
    dust: float = math.inf
    dust_by: str = ""
    growing: float = math.inf


class Plan:
    """Operators of all effects by slot: `plan[slot]` lists (effect name, operator).

    Forces that act equally on gas and dust come first. kicks_together: name of the effect that kicks gas and dust
    together, or None. Raises PartError if operators are not valid (`discsim/run/declarations.py`).
    """

    def __init__(self, effects: Effects, state: State) -> None:
        self.names, self.kicks_together = [*effects], kick_effect_name(effects)
        self._slots: dict[Slot, list[tuple[str, Operator]]] = {slot: [] for slot in Slot}
        for name, operator in declarations.checked(effects, state):
            if operator.slot is not Slot.KICK or self.kicks_together in (None, name):
                self._slots[operator.slot].append((name, operator))
        self._slots[Slot.FORCE].sort(key=lambda each: not _acts_on_both(each[1]))

    def __getitem__(self, slot: Slot) -> list[tuple[str, Operator]]:
        return self._slots[slot]

    def fields_of(self, operator: Operator) -> list[tuple[str, Operator]]:
        """Return the operators of FIELD whose results an operator reads."""
        return [field for field in self[Slot.FIELD] if field[1].name in operator.reads]

    def writes(self, name: str) -> bool:
        """Return whether any force writes to the acceleration array `name`, such as "gas.acc"."""
        return any(name in operator.writes for _, operator in self[Slot.FORCE])


def _acts_on_both(operator: Operator) -> bool:
    return any(name.endswith(".acc") for name in operator.writes)


class _AccelerationSums:
    """Acceleration arrays while forces are added, by name, such as "gas.acc" and "gas.acc_unshared".

    If an effect kicks gas and dust together (`apart`), shared and unshared accelerations have separate arrays.
    Otherwise both names refer to the same array.
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
        """Return the names of acceleration arrays that `operator` is the first to write.

        Such an array is set to 0 before, unless the operator declares `starts`, i.e. overwrites it.
        """
        found = set()
        for name in sorted(operator.writes & self.acc.keys()):
            if self._uninitialised.pop(id(self.acc[name]), None) is not None:
                found.add(name)
                if not operator.starts:
                    _set_to_zero(self.acc[name])
        return found

    def merge(self) -> None:
        """Store the sum of all accelerations in `acc` of each species, and unshared ones in `state.acc_unshared`."""
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
    parallel_for(moves.blank, len(array), array, light=True)


def add_forces(state: State, plan: Plan, costs: Costs) -> None:
    """Compute the accelerations by all effects and the results of FIELD and KICK_INPUT operators.

    If an effect kicks gas and dust together, `state.acc_unshared` has the accelerations that act on one species only.
    On several threads all fields are computed at the same time, then the kick inputs at the same time as the forces. On
    one thread each field is computed just before its first reader, while it is in the cache. Several processes use this
    order too, as all must make collective calls in the same order.
    """
    for _, operator in [*plan[Slot.FIELD], *plan[Slot.KICK_INPUT]]:
        state.results.pop(operator.name, None)  # those of earlier positions
    try:
        if not several_threads() or world.processes.many:
            _add_forces_in_order(state, plan, costs)
            return
        run_concurrently(*(partial(_run_operator, state, *each, costs) for each in plan[Slot.FIELD]))
        inputs: list[Callable[[], None]] = [
            partial(_run_operator, state, *each, costs) for each in plan[Slot.KICK_INPUT]
        ]
        run_concurrently(partial(_add_forces_in_order, state, plan, costs), *inputs)
    except BaseException:
        state.results.clear()
        raise


def _add_forces_in_order(state: State, plan: Plan, costs: Costs) -> None:
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
    if plan.kicks_together is None:
        sums.merge()
    else:
        with costs(plan.kicks_together, calls=0):
            sums.merge()


def _run_operator(
    state: State, name: str, operator: Operator, costs: Costs, sums: _AccelerationSums | None = None
) -> None:
    """Run an operator, store its result in `state.results`, and add its CPU time to the effect `name`.

    sums: acceleration arrays, for a force. A FloatingPointError becomes a PhysicsError.
    """
    try:
        with costs(name, calls=int(sums is not None)):
            seen = View(
                state, operator, state.results, *(() if sums is None else (sums.acc, sums.start_arrays(operator)))
            )
            state.results[operator.name] = operator.run(seen)
    except FloatingPointError as fault:
        raise PhysicsError(str(fault)) from fault


@contextmanager
def _copied_particles(state: State) -> Iterator[None]:
    """Replace particles and bodies by copies within the context, with zero accelerations of the particles.

    Copies are needed because operators of an effect also change other arrays than `acc`.
    """
    gas, dust, bodies = state.gas, state.dust, state.bodies
    try:
        state.gas, state.dust, state.bodies = gas and gas.copy(), dust and dust.copy(), bodies and bodies.copy()
        for p in state.species.values():
            p.acc[:] = 0.0
        yield
    finally:
        state.gas, state.dust, state.bodies = gas, dust, bodies


def acceleration_of(effect: Effect, state: State) -> dict[str, Array]:
    """Return the accelerations (n, dimensions) that one effect causes at present, by species.

    Accelerations that are part of the drift, such as the star's on Kepler orbits, are included.
    """
    with _copied_particles(state):
        accelerate(effect, state, with_drift=True)
        return {name: p.acc for name, p in state.species.items()}


def limit_of_dust(effect: Effect, state: State) -> tuple[int, str]:
    """Return the index of the grain that sets the time-step limit of `effect`, and a remedy as text for a message."""
    with _copied_particles(state):
        found: Limit = limits(effect, state, accelerate(effect, state))["dust"]
        row = int((state.species["dust"].acc ** 2).sum(axis=1).argmax()) if found.row is None else found.row()
        return row, found.remedy


def limits_of(state: State, plan: Plan, costs: Costs) -> tuple[dict[str, float], Limits]:
    """Return the time-step limit of each effect by name, and the smallest limits of all effects."""
    dust_is_passive, none = state.dust_is_passive, Limit(math.inf)
    found: dict[str, dict[str, Limit]] = {name: {} for name in plan.names}
    for name, operator in plan[Slot.LIMIT]:
        with costs(name, calls=0):
            found[name] |= declarations.checked_limits(operator, operator.run(View(state, operator, state.results)))
    each = np.empty((3, len(found)))  # longest step, unstable step, and longest step of one-way dust
    for k, of_effect in enumerate(found.values()):
        noticed = {species: limit for species, limit in of_effect.items() if species != "dust" or not dust_is_passive}
        each[0, k] = min((limit.step for limit in noticed.values()), default=math.inf)
        each[1, k] = min((limit.growing for limit in noticed.values()), default=math.inf)
        # The limit of dust is 1 / frequency. A circular orbit keeps its energy to 12% in such steps, to 1% in half.
        each[2, k] = of_effect.get("dust", none).growing / GROWS if dust_is_passive else math.inf
    steps, growing, dust = (dict(zip(found, row, strict=True)) for row in world.processes.least(each).tolist())
    least = Limits(*_smallest_limit(steps), growing=min(growing.values()))
    if dust_is_passive:
        longest, by = _smallest_limit(dust)
        least = least._replace(dust=longest, dust_by=by)
    return steps, least


def _smallest_limit(limits: dict[str, float]) -> tuple[float, str]:
    name = min(limits, key=limits.__getitem__)
    return limits[name], name
