"""What the effects give to the particles where these are: accelerations, and the longest steps that they allow."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import NamedTuple

import numpy as np

from discsim.effects.base import Effect, doing
from discsim.numerics import room, world
from discsim.numerics.state import State
from discsim.numerics.teams import beside, several_threads
from discsim.numerics.threads import copied, share
from discsim.parts import Lazy
from discsim.run.costs import Costs

moves = Lazy("discsim.kernels.move")

Effects = Mapping[str, Effect]


class PhysicsError(Exception):
    """The run cannot go on: something is not finite, or the step has collapsed."""


class Limits(NamedTuple):
    """The longest step, and the effect that sets it; that of one-way dust, which limits no step, apart."""

    step: float = math.inf
    by: str = ""
    dust: float = math.inf
    dust_by: str = ""


def kick_owner(effects: Effects) -> str | None:
    """The effect that kicks gas and dust together; None where each species kicks itself."""
    return next((name for name, effect in effects.items() if effect.is_kick), None)


def accelerate(state: State, effects: Effects, costs: Costs) -> None:
    """Accelerations of all effects; and, apart, what gas and dust at one place do not both feel, for the kick's owner.

    On several threads effects first prepare at the same time; then the kick's owner prepares its kick while all others
    accelerate. On one thread nothing is prepared early: it would have left the caches before it is used. On several
    processes neither, as what they ask each other has to come in one order.
    """
    try:
        if not several_threads() or world.together.many:
            _add_all(state, effects, costs)
            return
        preparing = (
            partial(_do, effects[name].prepare, state, name, costs, calls=0) for name in doing(effects, "prepare")
        )
        beside(*preparing)
        accelerating: list[Callable[[], None]] = [partial(_add_all, state, effects, costs)]
        owner = kick_owner(effects)
        if owner is not None:
            accelerating.append(partial(_do, effects[owner].prepare_kick, state, owner, costs, calls=0))
        beside(*accelerating)
    except BaseException:
        state.blank.clear()
        for effect in effects.values():
            effect.discard()
        raise


def _add_all(state: State, effects: Effects, costs: Costs) -> None:
    own = {name: effect.acts_on for name, effect in effects.items() if not effect.shared}
    order = [*own, *(name for name in effects if name not in own)]
    state.blank.clear()
    for species, p in state.species.items():
        if _written_first(order, effects, species):
            state.blank[species] = p.acc[:0]
        else:
            share(moves.blank, p.count, p.acc, light=True)
    for name in own:
        _add(state, effects[name], name, costs)
    owner = kick_owner(effects)
    if owner is not None:
        alone = {name for acts_on in own.values() for name in acts_on}
        with costs(owner):
            _keep_own(state, alone, effects, order[len(own) :])
    for name in order[len(own) :]:
        _add(state, effects[name], name, costs)


def _written_first(order: list[str], effects: Effects, species: str) -> bool:
    """Whether the first of effects that accelerates a species begins with what is blank."""
    first = next((name for name in order if species in effects[name].acts_on), None)
    return first is not None and effects[first].writes_first


def _keep_own(state: State, alone: set[str], effects: Effects, left: list[str]) -> None:
    """What those species that feel something alone feel until now; their `acc` goes on from it."""
    state.own_acc = {name: p.acc if name in alone else p.acc[:0] for name, p in state.species.items()}
    for name, p in state.species.items():
        if name not in alone:
            continue
        if _written_first(left, effects, name):
            p.acc = room.like(p.acc)
            state.blank[name] = state.own_acc[name]
        else:
            p.acc = copied(p.acc)


def _do(what: Callable[[State], None], state: State, name: str, costs: Costs, calls: int = 1) -> None:
    try:
        with costs(name, calls):
            what(state)
    except FloatingPointError as fault:
        raise PhysicsError(str(fault)) from fault


def _add(state: State, effect: Effect, name: str, costs: Costs) -> None:
    _do(effect.accelerate, state, name, costs)
    for species in effect.acts_on:
        state.blank.pop(species, None)
    for p in state.species.values():
        if p.immobile is not None:
            p.acc[p.immobile] = 0.0


def acceleration_of(effect: Effect, state: State) -> dict[str, np.ndarray]:
    """What one effect gives now, (n, dimensions) by species; made on copies, since some settle more than `acc`."""
    gas, dust, bodies = state.gas, state.dust, state.bodies
    try:
        state.gas, state.dust, state.bodies = gas and gas.copy(), dust and dust.copy(), bodies and bodies.copy()
        for p in state.species.values():
            p.acc[:] = 0.0
        effect.accelerate(state)
        return {name: p.acc for name, p in state.species.items()}
    finally:
        state.gas, state.dust, state.bodies = gas, dust, bodies


def limits_of(state: State, effects: Effects) -> tuple[dict[str, float], Limits]:
    """What each effect allows, and the least of it."""
    limits = _least_of_all({name: effect.limit(state) for name, effect in effects.items()})
    least = Limits(*_least(limits))
    if state.unnoticed:
        of_dust = _least_of_all({name: effect.limit_of(state, "dust") for name, effect in effects.items()})
        least = Limits(*least[:2], *_least(of_dust))
    return limits, least


def _least_of_all(limits: dict[str, float]) -> dict[str, float]:
    """The least that any process of the run has found."""
    return dict(zip(limits, world.together.least(np.array([*limits.values()])).tolist(), strict=True))


def _least(limits: dict[str, float]) -> tuple[float, str]:
    name = min(limits, key=limits.__getitem__)
    return limits[name], name
