"""Operators of effects: what each one does in a step, and the part of the state that it sees.

An effect lists its operators. The place of each in a step is its `Slot` (`run/integrators.py` has the order). Operators
of the slots FIELD, FORCE, DRIFT_FORCE, LIMIT and KICK_INPUT may run at the same time as others. They declare the
arrays that they read and write, and see no others. All other operators run one after another and see the whole state.
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
    """Place of an operator in a step, and the arguments of its `run`.

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

    In the first half of a step, operators of AROUND_DRIFT see velocities ahead of positions (`state.lag` below 0), in
    the second half behind them, and they run in the opposite order. On a circle of frequency Omega such velocities are
    rotated against positions by asin(Omega lag), unless the drift rotates them too.
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
OF_BODIES = frozenset({
    "bodies", "central", "central_mass", "star_mass", "star_pull", "star_place", "centre", "from_centre", "from_star",
    "kepler_omega", "cooled",
})  # fmt: skip
# Attributes of particles that every operator sees: numbers, order and spare memory, none of which a kernel changes.
ALWAYS = frozenset({"count", "everywhere", "ids", "immobile", "global_index", "unsorted_rows", "spare"})
PLAIN = frozenset({"scene", "time", "step", "earlier", "lag", "grid", "acc_unshared"})  # of the state


class Limit(NamedTuple):
    """Limit of the time step by an effect, in code units.

    Attributes
    ----------
    step : float
        Longest step, before the Courant factor.
    unstable : float or None
        Step above which errors grow without end; None for GROWS times `step`, inf for none.
    row : callable, optional
        `row()` returns the index of the particle that sets the limit; by default the one with the largest acceleration.
    remedy : str
        Change of the scene that makes the limit longer, for messages.
    """

    step: float
    unstable: float | None = None
    row: Callable[[], int] | None = None
    remedy: str = ""

    @property
    def growing(self) -> float:
        """Step above which errors grow without end."""
        return GROWS * self.step if self.unstable is None else self.unstable


class Operator(NamedTuple):
    """One operation of an effect in a step.

    Attributes
    ----------
    name : str
        "<effect>.<noun>", which is also the name of the result of `run`.
    slot : Slot
        Place in a step.
    run : callable
        The operation; its arguments are those of the slot.
    reads : frozenset of str
        Arrays such as "gas.pos", results of other operators by name, and "bodies" for the star and its companions.
    writes : frozenset of str
        Arrays that `run` changes. A force adds to "gas.acc" and "dust.acc", accelerations that gas and dust at one
        place share, or to "gas.acc_unshared" and "dust.acc_unshared", all others. Drag relaxes the slip with the
        latter inside.
    starts : bool
        Whether `run` writes to uninitialised accelerations of which `view.is_first` is True. Otherwise they are set to
        0 before.
    """

    name: str
    slot: Slot
    run: Callable[..., Any]
    reads: frozenset[str] = frozenset()
    writes: frozenset[str] = frozenset()
    starts: bool = False


class Operating(Protocol):
    """Effect, or anything else that has operators."""

    def operators(self, state: State) -> list[Operator]: ...


def arrays(species: str | Iterable[str], names: str) -> frozenset[str]:
    """Return names for `reads` and `writes`: arrays("gas", "pos vel") is {"gas.pos", "gas.vel"}."""
    every = [species] if isinstance(species, str) else species
    return frozenset(f"{one}.{name}" for one in every for name in names.split())


@cache
def _declared(names: frozenset[str], species: str) -> frozenset[str]:
    return ALWAYS | {name.partition(".")[2] for name in names if name.partition(".")[0] == species}


class Declared:
    """Particles of a species with the arrays that an operator declares; any other is an AttributeError."""

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
    """State as an operator sees it: `gas`, `dust` and `species` with its declared arrays, and plain values.

    `scene`, `time`, `step`, `earlier`, `lag` and `grid` are those of the state. An operator that reads "bodies" has the
    attributes of the state that depend on the star and its companions too. `view[name]` is the result of another
    operator.
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
        """Return the result of another operator and remove it, for the only reader of a result.

        Without a default a missing result is a KeyError.
        """
        self._check(name)
        return self._results.pop(name, *default)

    def is_first(self, name: str) -> bool:
        """Return whether accelerations such as "gas.acc" are still uninitialised."""
        return name in self._first

    def __getattr__(self, name: str) -> Any:
        if name in PLAIN or (name in OF_BODIES and "bodies" in self._operator.reads):
            return getattr(self._state, name)
        if name in OF_BODIES:
            raise AttributeError(f'the operator {self._operator.name} does not declare that it reads "bodies"')
        raise AttributeError(f"an operator has no {name}")


def accelerate(effect: Operating, state: State, with_drift: bool = False) -> dict[str, Any]:
    """Add the accelerations of one effect to `acc` (n, dimensions), and return the results of its operators by name.

    with_drift: whether to add the accelerations that the drift contains too.
    """
    results: dict[str, Any] = {}
    operators = effect.operators(state)
    for slot in (Slot.FIELD, Slot.FORCE, *([Slot.DRIFT_FORCE] if with_drift else [])):
        for operator in operators:
            if operator.slot is slot:
                results[operator.name] = operator.run(View(state, operator, results))
    return results


def limits(effect: Operating, state: State, results: dict[str, Any]) -> dict[str, Limit]:
    """Return the limits of one effect by species, from the results of `accelerate`."""
    found: dict[str, Limit] = {}
    for operator in effect.operators(state):
        if operator.slot is Slot.LIMIT:
            found |= operator.run(View(state, operator, results))
    return found


def longest_step(effect: Operating, state: State, results: dict[str, Any]) -> float:
    """Return the longest step that one effect allows, from the results of `accelerate`."""
    return least_step(limits(effect, state, results), state.unnoticed)


def least_step(found: Mapping[str, Limit], unnoticed: bool) -> float:
    """Return the least step of some limits by species; `unnoticed`: without those of the dust, which is one-way."""
    return min((limit.step for name, limit in found.items() if name != "dust" or not unnoticed), default=math.inf)
