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
    is below 0). After the drift, velocities are behind, and operators run in the opposite order. On a circular orbit of
    frequency Omega these velocities are rotated relative to the positions by asin(Omega velocity_lag), unless the drift
    rotates velocities too.
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

# Attributes of the state that depend on the star and its companions, for operators that read "bodies".
BODY_ATTRIBUTES = frozenset({
    "bodies", "central", "central_mass", "star_mass", "star_pull", "star_place", "centre", "from_centre", "from_star",
    "kepler_omega", "cooled_energy",
})  # fmt: skip
# Attributes of particles that every operator sees: numbers, order and spare memory, none of which a kernel changes.
COMMON_ARRAYS = frozenset({"count", "global_count", "ids", "immobile", "global_index", "unsorted_rows", "spare"})
PLAIN_ATTRIBUTES = frozenset(
    {"scene", "time", "step", "earlier", "velocity_lag", "grid", "acc_unshared"}
)  # of the state


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
    def growing(self) -> float:
        """Step above which errors grow without bound."""
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
        Whether `run` overwrites acceleration arrays for which `view.is_first` is True. If False, these arrays are set
        to 0 before.
    """

    name: str
    slot: Slot
    run: Callable[..., Any]
    reads: frozenset[str] = frozenset()
    writes: frozenset[str] = frozenset()
    starts: bool = False


class Operating(Protocol):
    """Protocol of effects and of other objects that have operators."""

    def operators(self, state: State) -> list[Operator]: ...


def arrays(species: str | Iterable[str], names: str) -> frozenset[str]:
    """Return array names for `reads` and `writes`: arrays("gas", "pos vel") is {"gas.pos", "gas.vel"}."""
    every = [species] if isinstance(species, str) else species
    return frozenset(f"{one}.{name}" for one in every for name in names.split())


@cache
def _declared(names: frozenset[str], species: str) -> frozenset[str]:
    return COMMON_ARRAYS | {name.partition(".")[2] for name in names if name.partition(".")[0] == species}


class Declared:
    """View of the particles of a species with the arrays that an operator declares; others raise AttributeError.

    acc: acceleration arrays to use in place of those of the particles, by name, such as "gas.acc".
    """

    __slots__ = ("_acc", "_names", "_operator", "_particles", "_species")

    def __init__(self, operator: Operator, species: str, particles: Particles, acc: Mapping[str, np.ndarray]) -> None:
        found = {
            "_operator": operator, "_species": species, "_particles": particles, "_acc": acc,
            "_names": _declared(operator.reads | operator.writes, species),
        }  # fmt: skip
        for name, value in found.items():
            object.__setattr__(self, name, value)

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
            raise AttributeError(f"{name} is a sum of several forces; expected a change in place, like {name} += ...")


class View:
    """View of the state for one operator: `gas`, `dust` and `species` with the arrays that it declares.

    The view has the attributes of the state in PLAIN_ATTRIBUTES and, for an operator that reads "bodies", those in
    BODY_ATTRIBUTES. `view[name]` is the result of the operator `name`.
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
            name: Declared(operator, name, p, acc or {}) for name, p in state.species.items()
        }
        self.gas, self.dust = self.species.get("gas"), self.species.get("dust")

    def __getitem__(self, name: str) -> Any:
        self._check(name)
        return self._results[name]

    def _check(self, name: str) -> None:
        if name not in self._operator.reads:
            raise KeyError(f"the operator {self._operator.name} does not declare that it reads {name}")

    def take(self, name: str, *default: Any) -> Any:
        """Return the result of the operator `name` and remove it from the stored results.

        Only for results with a single reader. A missing result raises KeyError unless a default is given.
        """
        self._check(name)
        return self._results.pop(name, *default)

    def is_first(self, name: str) -> bool:
        """Return whether the acceleration array `name`, such as "gas.acc", is still uninitialised."""
        return name in self._first

    def __getattr__(self, name: str) -> Any:
        if name in PLAIN_ATTRIBUTES or (name in BODY_ATTRIBUTES and "bodies" in self._operator.reads):
            return getattr(self._state, name)
        if name in BODY_ATTRIBUTES:
            raise AttributeError(f'the operator {self._operator.name} does not declare that it reads "bodies"')
        raise AttributeError(f"an operator has no {name}")


def accelerate(effect: Operating, state: State, with_drift: bool = False) -> dict[str, Any]:
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


def limits(effect: Operating, state: State, results: dict[str, Any]) -> dict[str, Limit]:
    """Return the time-step limits of one effect by species.

    results: results of its operators from `accelerate`.
    """
    found: dict[str, Limit] = {}
    for operator in effect.operators(state):
        if operator.slot is Slot.LIMIT:
            found |= operator.run(View(state, operator, results))
    return found


def longest_step(effect: Operating, state: State, results: dict[str, Any]) -> float:
    """Return the longest step that one effect allows; results: of its operators, from `accelerate`."""
    return least_step(limits(effect, state, results), state.dust_is_passive)


def least_step(found: Mapping[str, Limit], without_dust: bool) -> float:
    """Return the smallest step of the limits `found` by species; inf if there are none.

    without_dust: whether to leave out the limits of dust, as for one-way dust.
    """
    return min((limit.step for name, limit in found.items() if name != "dust" or not without_dust), default=math.inf)
