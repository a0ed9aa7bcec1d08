"""Operators of a step: kick, operations around the move, move, events and forces of all effects."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from discsim.effects.base import Effect, to_sort
from discsim.numerics import world
from discsim.numerics.operators import Slot
from discsim.numerics.state import State
from discsim.numerics.thread_pool import run_concurrently
from discsim.run import forces, guards
from discsim.run.costs import Costs
from discsim.run.forces import Limits, PhysicsError, Plan


class Operators:
    """Operators of the effects of a run on its state, with costs by effect and guards behind their results.

    limits: step limits by the last forces. shown: whether a caller had access to the arrays since the last kick.
    """

    def __init__(self, state: State, effects: dict[str, Effect]) -> None:
        self.state, self.effects, self.plan = state, effects, Plan(effects, state)
        self.costs = Costs(effects)
        self.limits = Limits()
        self.reversals = guards.Reversals()
        self.shown = True

    def kick(self, dt: float) -> None:
        """Advance velocities and energies over dt, by the effect that kicks all species or by the kick of each."""
        # Results of forces and kicks are checked where they are made. This check takes 2% of a step.
        if self.shown:
            self.take_back()
        elif self.plan[Slot.AROUND_DRIFT] and guards.coupled(self.state):
            self._check(guards.check_inputs)
        self._run(Slot.KICK, dt)
        if self.state.bodies is not None:
            self.state.bodies.kick(dt)
        self._check(guards.check_kicked)

    def take_back(self) -> None:
        """Check arrays that a caller had access to, and drop results from their earlier values. Raises ValueError."""
        self._check(guards.check_entries)
        world.processes.forget()
        for _, operator in self.plan[Slot.KICK_INPUT]:
            self.state.results.pop(operator.name, None)
        self.shown = False

    def close(self) -> None:
        """Make the closing kick that the velocities await."""
        if self.state.lag > 0.0:
            self.kick(self.state.lag)
            self.state.lag = 0.0

    def operate(self, dt: float, backwards: bool = False) -> None:
        """Run the operators around the drift over dt, one after another, or in the opposite order if `backwards`."""
        for name, operator in self.plan[Slot.AROUND_DRIFT][:: -1 if backwards else 1]:
            with self.costs(name):
                operator.run(self.state, dt)

    def move(self, dt: float) -> None:
        try:
            self._at_once(Slot.DRIFT, dt)
        except FloatingPointError as fault:
            raise PhysicsError(str(fault)) from fault
        world.processes.forget_positions()  # operators of MOVE use the new positions, and results of the last kick
        self._run(Slot.MOVE, dt)
        world.processes.forget()

    def events(self) -> None:
        if to_sort(self.state.step):
            self._at_once(Slot.SORT)
        self._run(Slot.EVENT)

    def _run(self, slot: Slot, *given: float) -> None:
        """Run the operators of a slot one after another, and keep the results of events for the forces."""
        for name, operator in self.plan[slot]:
            try:
                with self.costs(name):
                    result = operator.run(self.state, *given)
            except FloatingPointError as fault:
                raise PhysicsError(str(fault)) from fault
            if slot is Slot.EVENT:
                self.state.results[operator.name] = result

    def _at_once(self, slot: Slot, *given: float) -> None:
        """Run the operators of a slot, which use an effect's own species alone, on several threads at the same time.

        Several processes run them one after another, as collective calls have to come in one order.
        """

        def do(name: str, run: Callable[..., Any]) -> None:
            with self.costs(name, calls=int(slot is Slot.DRIFT)):
                run(self.state, *given)

        each = [partial(do, name, operator.run) for name, operator in self.plan[slot]]
        for together in [[one] for one in each] if world.processes.many else [each]:
            run_concurrently(*together)

    def forces(self) -> None:
        """Compute the accelerations of all effects at the present positions, and their step limits."""
        world.processes.settle(self.state)
        forces.add_forces(self.state, self.plan, self.costs)
        limits, self.limits = forces.limits_of(self.state, self.plan, self.costs)
        self._check(guards.check_forces, limits)
        self._check(self.reversals.check)

    def _check(self, guard: Callable[..., None], *more: Any) -> None:
        """Call a guard, and raise its exception on all processes if it raises on one."""
        world.processes.raise_together(lambda: guard(self.state, self.effects, *more))
