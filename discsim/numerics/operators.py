"""Operators: functions of effects that a step calls, with the arrays that each may use.

An effect lists its operators. The `Slot` of an operator says when a step calls it (`run/integrators.py` has the order).
Operators in the slots FIELD, FORCE, DRIFT_FORCE, LIMIT and KICK_INPUT may run at the same time as others. They declare
the arrays that they read and write, and have access to no others. All other operators run one after another, with
access to the whole state.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from enum import Enum, auto
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

if TYPE_CHECKING:
    from discsim.numerics.state import Particles, State


class Slot(Enum):
    """Stage of a step at which an operator is called.

    The second column has the arguments of its `run`, the third one its result or what it changes:

        FIELD         run(view)       a result that forces need, such as a density or a potential
        FORCE         run(view)       accelerations
        DRIFT_FORCE   run(view)       accelerations that the drift contains; a step does not call them
        LIMIT         run(view)       limits of the step: a `Limit` by species or, for all particles, by ALL
        KICK_INPUT    run(view)       a result that the kick needs, such as drag cells
        KICK          run(state, dt)  velocities, from accelerations
        AROUND_DRIFT  run(state, dt)  velocities or energies, over half a step before the drift and half a step after it
        DRIFT         run(state, dt)  positions of the effect's own species
        MOVE          run(state, dt)  positions in other ways, after the drift
        SORT          run(state)      order of the arrays of the effect's own species, in some steps
        EVENT         run(state)      changes of the particles at the end of a step

    Operators of DRIFT, and those of SORT, may run at the same time, so they must not use other species.

    Operators of AROUND_DRIFT run twice. Before the drift, velocities are ahead of the positions (`state.velocity_lag`
    is negative). After the drift, velocities are behind, and the operators run in the opposite order. On a circular
    orbit of frequency Omega these velocities are rotated relative to the positions by asin(Omega velocity_lag), unless
    the drift rotates velocities too.
    """

    FIELD = auto()
    FORCE = auto()
    DRIFT_FORCE = auto()
    LIMIT = auto()
    KICK_INPUT = auto()
    KICK = auto()
    AROUND_DRIFT = auto()
    DRIFT = auto()
    MOVE = auto()
    SORT = auto()
    EVENT = auto()


ALL = "all"  # key of a limit for all particles
GROWS = 2.5  # a leapfrog of frequency 1 / step is unstable above 2; 2.5 leaves a margin, as limits are estimates

# Attributes of the state that depend on the star and its companions; operators that read "bodies" may use them.
BODY_ATTRIBUTES = frozenset({
    "bodies", "central", "central_mass", "star_mass", "star_pull", "star_place", "centre", "from_centre", "from_star",
    "kepler_omega", "cooled_energy",
})  # fmt: skip
# Attributes that every operator may read: of particles (numbers, order and spare memory) and of the state.
PARTICLE_ATTRIBUTES = frozenset({
    "count", "global_count", "ids", "immobile", "global_index", "unsorted_rows", "spare",
})  # fmt: skip
STATE_ATTRIBUTES = frozenset({"scene", "time", "step", "earlier", "velocity_lag", "grid", "acc_unshared"})


class Limit(NamedTuple):
    """Limit of the time step by an effect, in code units.

    Attributes
    ----------
    step : float
        Longest step, before the Courant factor.
    unstable : float or None
        Step above which errors grow without bound. None (default): GROWS times `step`. inf: stable at any step.
    row : callable, optional
        `row()` returns the index of the particle that sets the limit. None: the particle with the largest acceleration.
    remedy : str
        Change of the scene that makes `step` longer, for messages.
    """

    step: float
    unstable: float | None = None
    row: Callable[[], int] | None = None
    remedy: str = ""

    @property
    def unstable_step(self) -> float:
        """Step above which errors grow without bound, in code units."""
        return GROWS * self.step if self.unstable is None else self.unstable


class Operator(NamedTuple):
    """Function of an effect that a step calls.

    Attributes
    ----------
    name : str
        "<effect>.<noun>"; the result of `run` has the same name.
    slot : Slot
        Stage of the step at which `run` is called.
    run : callable
        Function with the arguments given in `Slot`.
    reads : frozenset of str
        Names of the arrays that `run` reads, such as "gas.pos", names of other operators whose results it reads, and
        "bodies" for the star and its companions.
    writes : frozenset of str
        Names of the arrays that `run` changes. A force that accelerates gas and dust at one position equally adds to
        "gas.acc" and "dust.acc". Any other force adds to "gas.acc_unshared" or "dust.acc_unshared", which drag includes
        in the relaxation of the slip.
    starts : bool
        Whether `run` overwrites the acceleration arrays to which no force was added before (`view.is_unset`). If False,
        these arrays are set to 0 before the call.
    """

    name: str
    slot: Slot
    run: Callable[..., Any]
    reads: frozenset[str] = frozenset()
    writes: frozenset[str] = frozenset()
    starts: bool = False


class HasOperators(Protocol):
    """Protocol of an effect, as far as this module uses it."""

    def operators(self, state: State) -> list[Operator]: ...


def arrays(species: str | Iterable[str], names: str) -> frozenset[str]:
    """Return array names for `reads` and `writes`: arrays("gas", "pos vel") is {"gas.pos", "gas.vel"}."""
    every = [species] if isinstance(species, str) else species
    return frozenset(f"{one}.{name}" for one in every for name in names.split())


@cache
def _readable_attributes(names: frozenset[str], species: str) -> frozenset[str]:
    """Return the attributes of a species that an operator may use; names: its `reads` and `writes` as one set."""
    declared = {name.partition(".")[2] for name in names if name.partition(".")[0] == species}
    return PARTICLE_ATTRIBUTES | declared


class ParticleView:
    """View of the particles of a species for one operator, with the arrays that the operator declares.

    Any other attribute raises AttributeError. acc: acceleration arrays by name, such as "gas.acc", which replace those
    of the particles.
    """

    __slots__ = ("_acc", "_names", "_operator", "_particles", "_species")

    def __init__(self, operator: Operator, species: str, particles: Particles, acc: Mapping[str, np.ndarray]) -> None:
        names = _readable_attributes(operator.reads | operator.writes, species)
        for slot, value in zip(self.__slots__, (acc, names, operator, particles, species), strict=True):
            object.__setattr__(self, slot, value)

    def __getattr__(self, name: str) -> Any:
        if name not in self._names:
            raise AttributeError(f"the operator {self._operator.name} does not declare {self._species}.{name}")
        if name in ("acc", "acc_unshared") and f"{self._species}.{name}" in self._operator.writes:
            return self._acc.get(f"{self._species}.{name}", self._particles.acc)
        return getattr(self._particles, name)

    def __setattr__(self, name: str, value: Any) -> None:
        if name != "spare" and f"{self._species}.{name}" not in self._operator.writes:
            raise AttributeError(f"the operator {self._operator.name} does not declare that it writes {name}")
        if name not in ("acc", "acc_unshared"):
            setattr(self._particles, name, value)
        elif value is not getattr(self, name):  # as `+=` sets the array that it has changed
            raise AttributeError(
                f"{name} is a sum of several forces and cannot be replaced; change it in place, like {name} += ..."
            )


class View:
    """View of the state for one operator: `gas`, `dust` and `species` with the arrays that the operator declares.

    The view has the attributes of the state in STATE_ATTRIBUTES and, if the operator declares that it reads
    "bodies", also those in BODY_ATTRIBUTES. `view[name]` is the result of the operator `name`.

    results: results of other operators by name. acc: acceleration arrays by name, which replace those of the particles.
    first: names of the acceleration arrays that are still uninitialised.
    """

    def __init__(
        self,
        state: State,
        operator: Operator,
        results: dict[str, Any],
        acc: Mapping[str, np.ndarray] | None = None,
        first: Iterable[str] = (),
    ) -> None:
        self._state, self._operator, self._results, self._first = state, operator, results, first
        self.species: dict[str, Any] = {
            name: ParticleView(operator, name, p, acc or {}) for name, p in state.species.items()
        }
        self.gas, self.dust = self.species.get("gas"), self.species.get("dust")

    def __getitem__(self, name: str) -> Any:
        self._check_reads(name)
        return self._results[name]

    def _check_reads(self, name: str) -> None:
        if name not in self._operator.reads:
            raise KeyError(f"the operator {self._operator.name} does not declare that it reads {name}")

    def pop(self, name: str, *default: Any) -> Any:
        """Return the result of the operator `name`, and remove it from the stored results, as `dict.pop`.

        Only for results that no other operator reads. A missing result raises KeyError unless a default is given.
        """
        self._check_reads(name)
        return self._results.pop(name, *default)

    def is_unset(self, name: str) -> bool:
        """Return whether the acceleration array `name`, such as "gas.acc", is still uninitialised."""
        return name in self._first

    def __getattr__(self, name: str) -> Any:
        if name in STATE_ATTRIBUTES or (name in BODY_ATTRIBUTES and "bodies" in self._operator.reads):
            return getattr(self._state, name)
        if name in BODY_ATTRIBUTES:
            raise AttributeError(f'the operator {self._operator.name} does not declare that it reads "bodies"')
        raise AttributeError(f"an operator has no {name}")


def accelerate(effect: HasOperators, state: State, with_drift: bool = False) -> dict[str, Any]:
    """Add the accelerations of one effect to `acc` of each species, and return the results of its operators by name.

    with_drift: whether to also add accelerations that are part of the drift (DRIFT_FORCE).
    """
    results: dict[str, Any] = {}
    operators = effect.operators(state)
    for slot in (Slot.FIELD, Slot.FORCE, *([Slot.DRIFT_FORCE] if with_drift else [])):
        for operator in operators:
            if operator.slot is slot:
                results[operator.name] = operator.run(View(state, operator, results))
    return results


def limits(effect: HasOperators, state: State, results: dict[str, Any]) -> dict[str, Limit]:
    """Return the time-step limits of one effect by species; results: results of its operators, from `accelerate`."""
    found: dict[str, Limit] = {}
    for operator in effect.operators(state):
        if operator.slot is Slot.LIMIT:
            found |= operator.run(View(state, operator, results))
    return found


def longest_step(effect: HasOperators, state: State, results: dict[str, Any]) -> float:
    """Return the longest step that one effect allows; results: results of its operators, from `accelerate`."""
    return smallest_limits(limits(effect, state, results), state.dust_is_passive)[0]


def smallest_limits(found: Mapping[str, Limit], dust_is_passive: bool) -> tuple[float, float]:
    """Return the smallest step and the smallest unstable step of time-step limits; inf if there are no limits.

    found: limits by species. dust_is_passive: whether to leave out the limits of dust (`State.dust_is_passive`).
    """
    some = [limit for name, limit in found.items() if name != "dust" or not dust_is_passive]
    smallest = min((limit.step for limit in some), default=math.inf)
    return smallest, min((limit.unstable_step for limit in some), default=math.inf)
