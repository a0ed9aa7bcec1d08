"""Operators of a step: kick, operations around the move, move, events and forces of all effects."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from discsim.effects.base import Effect, overriding, to_sort
from discsim.numerics import world
from discsim.numerics.state import State
from discsim.numerics.thread_pool import run_concurrently
from discsim.run import forces, guards
from discsim.run.costs import Costs
from discsim.run.forces import Limits, PhysicsError


class Operators:
    """Operators of the effects of a run on its state, with costs by effect and guards behind their results.

    limits: step limits by the last forces. shown: whether a caller had access to the arrays since the last kick.
    """

    def __init__(self, state: State, effects: dict[str, Effect]) -> None:
        self.state, self.effects = state, effects
        self.operating = overriding(effects, "operate")
        self.costs = Costs(effects)
        self.limits = Limits()
        self.reversals = guards.Reversals()
        self.shown = True

    def kick(self, dt: float) -> None:
        """Advance velocities and energies over dt, by the owner of the kick or by each species' own kick."""
        # Results of forces and kicks are checked where they are made. This check takes 2% of a step.
        if self.shown:
            self.take_back()
        elif self.operating and guards.coupled(self.state):
            self._check(guards.check_inputs)
        owner = forces.kick_owner(self.effects)
        try:
            for name in [owner] if owner is not None else self.effects:
                with self.costs(name):
                    self.effects[name].kick(self.state, dt)
        except FloatingPointError as fault:
            raise PhysicsError(str(fault)) from fault
        if self.state.bodies is not None:
            self.state.bodies.kick(dt)
        self._check(guards.check_kicked)

    def take_back(self) -> None:
        """Check arrays that a caller had access to, and drop results from their earlier values. Raises ValueError."""
        self._check(guards.check_entries)
        world.together.forget()
        owner = forces.kick_owner(self.effects)
        if owner is not None:
            self.effects[owner].discard()
        self.shown = False

    def close(self) -> None:
        """Make the closing kick that the velocities await."""
        if self.state.lag > 0.0:
            self.kick(self.state.lag)
            self.state.lag = 0.0

    def operate(self, dt: float, backwards: bool = False) -> None:
        """Call `operate` of the effects over dt, one after another, or in the opposite order if `backwards`."""
        for name in self.operating[:: -1 if backwards else 1]:
            with self.costs(name):
                self.effects[name].operate(self.state, dt)

    def move(self, dt: float) -> None:
        try:
            self._at_once("drift", dt)
            for name, effect in self.effects.items():
                with self.costs(name):
                    effect.move(self.state, dt)
        except FloatingPointError as fault:
            raise PhysicsError(str(fault)) from fault
        world.together.forget()

    def events(self) -> None:
        if to_sort(self.state.step):
            self._at_once("sort")
        for name, effect in self.effects.items():
            with self.costs(name):
                effect.event(self.state)

    def _at_once(self, what: str, *given: float) -> None:
        """Call a method that uses an effect's own species alone for all effects, on several threads at the same time.

        Several processes call effects one after another, as collective calls have to come in one order.
        """

        def do(name: str) -> None:
            with self.costs(name, calls=0):
                getattr(self.effects[name], what)(self.state, *given)

        names = overriding(self.effects, what)
        for together in [[name] for name in names] if world.together.many else [names]:
            run_concurrently(*(partial(do, name) for name in together))

    def forces(self) -> None:
        """Compute the accelerations of all effects at the present positions, and their step limits."""
        world.together.settle(self.state)
        forces.accelerate(self.state, self.effects, self.costs)
        limits, self.limits = forces.limits_of(self.state, self.effects)
        self._check(guards.check_forces, limits)
        self._check(self.reversals.check)

    def _check(self, guard: Callable[..., None], *more: Any) -> None:
        """Call a guard, and raise its exception on all processes if it raises on one."""
        world.together.alike(lambda: guard(self.state, self.effects, *more))
