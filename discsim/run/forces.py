"""Forces of all effects on the particles at their present positions, and the least of the effects' step limits."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import NamedTuple

import numpy as np

from discsim.effects.base import Effect, overriding
from discsim.numerics import alloc, world
from discsim.numerics.state import State
from discsim.numerics.thread_pool import run_concurrently, several_threads
from discsim.numerics.threads import copied, parallel_for
from discsim.parts import Lazy
from discsim.printable import UserError
from discsim.run.costs import Costs

moves = Lazy("discsim.kernels.common.move")

Effects = Mapping[str, Effect]


class PhysicsError(UserError):
    """End of a run by its physics: a number is not finite, or the step has collapsed."""


class Limits(NamedTuple):
    """Longest step, and the effect that sets it.

    dust, dust_by: the longest step in which one-way dust keeps its orbits, and the effect that sets it. One-way dust
    does not limit the step. growing: the step above which errors grow without end.
    """

    step: float = math.inf
    by: str = ""
    dust: float = math.inf
    dust_by: str = ""
    growing: float = math.inf


def kick_owner(effects: Effects) -> str | None:
    """Return the effect that kicks gas and dust together; None if each species has its own kick."""
    return next((name for name, effect in effects.items() if effect.is_kick), None)


def accelerate(state: State, effects: Effects, costs: Costs) -> None:
    """Compute the accelerations of all effects and, for the owner of the kick, those that gas and dust do not share.

    On several threads all effects prepare at the same time. Then the owner of the kick prepares its kick while all
    effects accelerate. On one thread nothing is prepared early, as it would leave the caches before its use. On
    several processes nothing is prepared early either, as collective calls have to come in one order.
    """
    try:
        if not several_threads() or world.together.many:
            _add_all(state, effects, costs)
            return
        preparing = (
            partial(_do, effects[name].prepare, state, name, costs, calls=0) for name in overriding(effects, "prepare")
        )
        run_concurrently(*preparing)
        accelerating: list[Callable[[], None]] = [partial(_add_all, state, effects, costs)]
        owner = kick_owner(effects)
        if owner is not None:
            accelerating.append(partial(_do, effects[owner].prepare_kick, state, owner, costs, calls=0))
        run_concurrently(*accelerating)
    except BaseException:
        state.blank.clear()
        for effect in effects.values():
            effect.discard()
        raise


def _add_all(state: State, effects: Effects, costs: Costs) -> None:
    """Add the accelerations of all effects, those that gas and dust share first.

    On several threads one of them still makes the position data of the kick, and short loops gain nothing from two
    threads. The sums of the gas's forces, which do gain, come last.
    """
    alike = [name for name, effect in effects.items() if effect.shared]
    own = [name for name in effects if name not in alike]
    owner = kick_owner(effects)
    state.blank.clear()
    _blank(state, effects, alike if owner is not None else [*alike, *own], [*state.species])
    for name in alike:
        _add(state, effects[name], name, costs)
    felt = {species for name in alike for species in effects[name].acts_on}
    common: dict[str, np.ndarray] = {}
    if owner is not None:
        with costs(owner):
            common = _save_shared(state, felt & _acted_on(effects, own), effects, own)
    for name in own:
        _add(state, effects[name], name, costs)
    if owner is not None:
        with costs(owner):
            _merge_accelerations(state, _acted_on(effects, own), common)


def _acted_on(effects: Effects, names: list[str]) -> set[str]:
    """Return the species that the effects `names` accelerate."""
    return {species for name in names for species in effects[name].acts_on}


def _blank(state: State, effects: Effects, order: list[str], species: Iterable[str]) -> None:
    """Set `acc` of the given species to 0, unless the first effect in `order` that accelerates a species overwrites
    it.
    """
    for name in species:
        p = state.species[name]
        first = next((effects[one] for one in order if name in effects[one].acts_on), None)
        if first is not None and first.writes_first:
            state.blank.add(name)
        else:
            parallel_for(moves.blank, p.count, p.acc, light=True)


def _save_shared(state: State, species: set[str], effects: Effects, left: list[str]) -> dict[str, np.ndarray]:
    """Return the shared accelerations of the given species, and give the species a new `acc`.

    left: effects still to accelerate.
    """
    found = {name: p.acc for name, p in state.species.items() if name in species}
    for name in found:
        state.species[name].acc = alloc.allocate_like(found[name])
    _blank(state, effects, left, found)
    return found


def _merge_accelerations(state: State, alone: set[str], common: dict[str, np.ndarray]) -> None:
    """Store the unshared accelerations in `own_acc`, and add the shared ones, `common`, to `acc`.

    alone: species with unshared accelerations.
    """
    state.own_acc = {name: p.acc if name in alone else p.acc[:0] for name, p in state.species.items()}
    for name, p in state.species.items():
        if name in common:
            own, p.acc = p.acc, common[name]
            parallel_for(moves.add_scaled, p.count, p.acc, own, 1.0, light=True)
        elif name in alone:
            p.acc = copied(p.acc)


def _do(what: Callable[[State], None], state: State, name: str, costs: Costs, calls: int = 1) -> None:
    """Call `what(state)` at the cost of `name`; a FloatingPointError becomes a PhysicsError."""
    try:
        with costs(name, calls):
            what(state)
    except FloatingPointError as fault:
        raise PhysicsError(str(fault)) from fault


def _add(state: State, effect: Effect, name: str, costs: Costs) -> None:
    _do(effect.accelerate, state, name, costs)
    for species in effect.acts_on:
        state.blank.discard(species)
    for p in state.species.values():
        if p.immobile is not None:
            p.acc[p.immobile] = 0.0


def acceleration_of(effect: Effect, state: State) -> dict[str, np.ndarray]:
    """Return the present accelerations by one effect, (n, dimensions) by species.

    The effect acts on copies, since some effects change more than `acc`.
    """
    gas, dust, bodies = state.gas, state.dust, state.bodies
    try:
        state.gas, state.dust, state.bodies = gas and gas.copy(), dust and dust.copy(), bodies and bodies.copy()
        for p in state.species.values():
            p.acc[:] = 0.0
        effect.acceleration(state)
        return {name: p.acc for name, p in state.species.items()}
    finally:
        state.gas, state.dust, state.bodies = gas, dust, bodies


def limits_of(state: State, effects: Effects) -> tuple[dict[str, float], Limits]:
    """Return the step limit of each effect, and the least of all."""
    limits = _least_of_all({name: effect.limit(state) for name, effect in effects.items()})
    least = Limits(*_least(limits), growing=min(_unstable_step(effects[name], limit) for name, limit in limits.items()))
    if state.unnoticed:
        # The limit of dust is 1 / frequency. A circular orbit keeps its energy to 12% in such steps, to 1% in half.
        of_dust = _least_of_all(
            {
                name: _unstable_step(effect, effect.limit_of(state, "dust")) / Effect.grows_at
                for name, effect in effects.items()
            }
        )
        dust, by = _least(of_dust)
        least = least._replace(dust=dust, dust_by=by)
    return limits, least


def _unstable_step(effect: Effect, limit: float) -> float:
    """Return the step above which errors grow without end in what an effect limits.

    The result is inf if they grow at no step, even for a limit of 0.
    """
    return effect.grows_at * limit if effect.grows_at < math.inf else math.inf


def _least_of_all(limits: dict[str, float]) -> dict[str, float]:
    """Return the least limits over all processes."""
    return dict(zip(limits, world.together.least(np.array([*limits.values()])).tolist(), strict=True))


def _least(limits: dict[str, float]) -> tuple[float, str]:
    name = min(limits, key=limits.__getitem__)
    return limits[name], name
