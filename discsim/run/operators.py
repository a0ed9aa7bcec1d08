"""Stages of a step: each calls the operators of all effects in one slot (`numerics/operators.py`)."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from discsim.effects.base import Effect, is_sort_step
from discsim.numerics import world
from discsim.numerics.operators import Slot
from discsim.numerics.state import State
from discsim.numerics.thread_pool import run_concurrently
from discsim.run import forces, guards
from discsim.run.costs import Costs
from discsim.run.forces import Limits, Plan, physics_errors


class Operators:
    """Stages of a step on `state`, with the cost of each effect and checks of the results.

    plan: operators by slot. limits: time-step limits from the last call of `forces`. reversals: check for unstable gas.
    arrays_exposed: whether a caller may have changed arrays since the last kick, so that the next kick must check them.
    """

    def __init__(self, state: State, effects: dict[str, Effect]) -> None:
        self.state, self.effects, self.plan = state, effects, Plan(effects, state)
        self.costs = Costs(effects)
        self.limits = Limits()
        self.reversals = guards.ReversalGuard()
        self.arrays_exposed = True

    def change_effects(self, effects: dict[str, Effect]) -> None:
        """Replace the effects; the caller computes forces again. Raises PartError as `Plan`."""
        self.plan = Plan(effects, self.state)
        self.effects = effects
        self.costs = self.costs.of(effects)
        self.reversals.forget()  # accelerations change without a step

    def kick(self, dt: float) -> None:
        """Advance velocities and energies over dt: run the operators of KICK, and kick the bodies."""
        # Results of forces and kicks are checked where they are made. The check of other changes takes 2% of a step; it
        # is needed if particles interact, as a number that is not finite then spreads to other particles.
        interacts = self.state.gas is not None or self.state.grid is not None
        if self.arrays_exposed:
            self.check_exposed_arrays()
        elif interacts and self.plan[Slot.AROUND_DRIFT]:
            self._check(guards.check_inputs)
        self._run(Slot.KICK, dt)
        if self.state.bodies is not None:
            self.state.bodies.kick(dt)
        self._check(guards.check_after_kick)

    def check_exposed_arrays(self) -> None:
        """Check arrays that a caller may have changed, and drop results that were cached for their earlier values.

        Raises EntryError, a ValueError, for a wrong type, shape or range, and PhysicsError for a number that is not
        finite.
        """
        self._check(guards.check_entries)
        world.processes.drop_caches()
        for _, operator in self.plan[Slot.KICK_INPUT]:
            self.state.results.pop(operator.name, None)
        self.arrays_exposed = False

    def close(self) -> None:
        """Make the closing kick, if it is due; velocities are then at the time of the positions."""
        if self.state.velocity_lag > 0.0:
            self.kick(self.state.velocity_lag)
            self.state.velocity_lag = 0.0

    def operate(self, dt: float, backwards: bool = False) -> None:
        """Run the operators of AROUND_DRIFT over dt, one after another; in the opposite order if `backwards`."""
        for name, operator in self.plan[Slot.AROUND_DRIFT][:: -1 if backwards else 1]:
            with self.costs(name):
                operator.run(self.state, dt)

    def move(self, dt: float) -> None:
        """Change positions over dt by the operators of DRIFT and then of MOVE."""
        self._run_concurrently(Slot.DRIFT, dt)
        world.processes.drop_position_caches()  # operators of MOVE use the new positions, and results of the last kick
        self._run(Slot.MOVE, dt)
        world.processes.drop_caches()

    def events(self) -> None:
        """Run the operators of SORT, in the steps in which arrays are reordered, and then those of EVENT."""
        if is_sort_step(self.state.step):
            self._run_concurrently(Slot.SORT)
        self._run(Slot.EVENT)

    def _run(self, slot: Slot, *given: float) -> None:
        """Run the operators of a slot one after another with the state and `given`; store the results of events."""
        for name, operator in self.plan[slot]:
            with physics_errors(), self.costs(name):
                result = operator.run(self.state, *given)
            if slot is Slot.EVENT:
                self.state.results[operator.name] = result

    def _run_concurrently(self, slot: Slot, *given: float) -> None:
        """Run the operators of a slot, each of which uses only the species of its effect, at the same time.

        given: arguments after the state. With several processes the operators run one after another, as all
        processes must make collective calls in the same order.
        """

        def do(name: str, run: Callable[..., Any]) -> None:
            with physics_errors(), self.costs(name, calls=int(slot is Slot.DRIFT)):
                run(self.state, *given)

        tasks = [partial(do, name, operator.run) for name, operator in self.plan[slot]]
        for concurrent in [[task] for task in tasks] if world.processes.is_parallel else [tasks]:
            run_concurrently(*concurrent)

    def forces(self) -> None:
        """Compute the accelerations of all effects at the present positions, and their step limits; check them.

        With several processes, particles are sent to their new owners first.
        """
        world.processes.migrate(self.state)
        forces.add_forces(self.state, self.plan, self.costs)
        limits, self.limits = forces.limits_of(self.state, self.plan, self.costs)
        self._check(guards.check_forces, limits)
        self._check(self.reversals.check)

    def _check(self, guard: Callable[..., None], *more: Any) -> None:
        """Call a check of `run/guards.py`; if it raises on one process, raise its exception on all."""
        world.processes.raise_on_all(lambda: guard(self.state, self.effects, *more))
