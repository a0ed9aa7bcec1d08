"""Checks of the operators that effects list, also those of other packages. Each fault is a PartError of one line."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields
from difflib import get_close_matches
from itertools import combinations, product
from typing import Any

from discsim.effects.base import Effect
from discsim.numerics.operators import ALL, Limit, Operator, Slot
from discsim.numerics.state import Dust, Gas, State
from discsim.parts import PartError

ACCELERATIONS = ("acc", "acc_unshared")
ARRAYS = {
    f"{species}.{name}"
    for species, kind in (("gas", Gas), ("dust", Dust)) for name in (*(f.name for f in fields(kind)), *ACCELERATIONS)
}  # fmt: skip
# Slots whose results an operator may read, by its own slot.
EARLIER = {
    Slot.FORCE: (Slot.FIELD,),
    Slot.LIMIT: (Slot.FIELD, Slot.FORCE, Slot.EVENT),
}


def checked(effects: Mapping[str, Effect], state: State) -> list[tuple[str, Operator]]:
    """Return the operators of all effects, each with the name of its effect. Raises PartError."""
    listed = [(name, operator) for name, effect in effects.items() for operator in _listed(name, effect, state)]
    slots: dict[str, Slot] = {}
    for name, operator in listed:
        if operator.name in slots:
            raise PartError(f"{operator.name}: another operator has the same name; expected different names")
        slots[operator.name] = operator.slot
        if operator.slot is Slot.KICK and name not in state.species and not effects[name].role.kicks:
            raise PartError(f"{operator.name}: only a base.KickEffect, and gas and dust themselves, may have a kick")
    read = {name for _, operator in listed if operator.slot is Slot.FORCE for name in operator.reads}
    for _, operator in listed:
        _check_names(operator, slots)
        if operator.slot is Slot.FIELD and operator.name not in read:
            raise PartError(f"{operator.name}: no force reads this field; expected its name in the reads of a force")
        if operator.slot is Slot.FORCE and not operator.writes:
            raise PartError(f"{operator.name}: the force writes nothing; expected accelerations in its writes")
    _check_at_once([operator for _, operator in listed])
    return listed


def _listed(name: str, effect: Effect, state: State) -> list[Operator]:
    found = effect.operators(state)
    if not isinstance(found, list) or not all(isinstance(each, Operator) for each in found):
        raise PartError(f"{name}.operators returns {_shown(found)}; expected a list of base.Operator")
    for each in found:
        if not isinstance(each.slot, Slot):
            raise PartError(f"{each.name}: {each.slot!r} is not a slot; expected one like base.Slot.FORCE")
        for names in (each.reads, each.writes):
            if not isinstance(names, set | frozenset):
                raise PartError(f"{each.name}: {names!r} is not a set of names; expected one like base.arrays(...)")
        if not each.name.startswith(f"{name}."):
            raise PartError(f'{each.name}: the operator is of the effect {name}; expected a name like "{name}.force"')
    return found


def _check_names(operator: Operator, slots: Mapping[str, Slot]) -> None:
    """Raise PartError if an operator reads or writes a name that is unknown, or not allowed in its slot."""
    earlier = {name for name, slot in slots.items() if slot in EARLIER.get(operator.slot, ())}
    to_read = {name for name in ARRAYS if not name.endswith(".acc_unshared")} | earlier | {"bodies"}
    for names, known in ((operator.reads, to_read), (operator.writes, ARRAYS)):
        for name in sorted(names - known):
            close = get_close_matches(name, known, 1)
            hint = f'; did you mean "{close[0]}"?' if close else ""
            raise PartError(f'{operator.name}: there is no "{name}" to read or write in its slot{hint}')
    if operator.slot is not Slot.LIMIT and (found := operator.reads & {"gas.acc", "dust.acc"}):
        raise PartError(f"{operator.name}: {min(found)} is not complete before the limits; expected it in writes alone")


def _check_at_once(listed: list[Operator]) -> None:
    """Raise PartError if operators that may run at the same time use the same arrays."""
    of_slot = {slot: [each for each in listed if each.slot is slot] for slot in Slot}
    pairs = [*combinations(of_slot[Slot.FIELD], 2), *product(of_slot[Slot.FORCE], of_slot[Slot.KICK_INPUT])]
    for one, other in pairs:
        if both := one.writes & (other.reads | other.writes) | other.writes & one.reads:
            raise PartError(
                f"{one.name} and {other.name} run at the same time, and one changes {min(both)}, which the other uses; "
                "expected different arrays"
            )


def checked_limits(operator: Operator, found: Any) -> Mapping[str, Limit]:
    """Return the limits that an operator has found. Raises PartError if they are no limits by species."""
    if not isinstance(found, Mapping) or not all(isinstance(limit, Limit) for limit in found.values()):
        raise PartError(
            f"{operator.name} returns {_shown(found)}; expected limits by species, like {{base.ALL: base.Limit(step)}}"
        )
    if unknown := found.keys() - {"gas", "dust", ALL}:
        raise PartError(f'{operator.name}: "{min(unknown)}" is no species; expected "gas", "dust" or base.ALL')
    return found


def _shown(found: Any) -> str:
    return f"a {type(found).__name__}" + (f" of {_kinds(found)}" if isinstance(found, list | tuple | Mapping) else "")


def _kinds(found: Any) -> str:
    kinds: Iterator[Any] = iter(found.values() if isinstance(found, Mapping) else found)
    return ", ".join(sorted({type(each).__name__ for each in kinds})) or "nothing"
