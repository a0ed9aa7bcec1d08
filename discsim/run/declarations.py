"""Checks of the operators that effects list, including effects of other packages; each fault is a PartError."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields
from difflib import get_close_matches
from itertools import chain, combinations, product
from typing import Any

from discsim.effects.base import Effect
from discsim.numerics.operators import ALL, Limit, Operator, Slot
from discsim.numerics.state import Dust, Gas, State
from discsim.parts import PartError

Named = list[tuple[str, Operator]]  # operators, each with the name of its effect
ACCELERATIONS = ("acc", "acc_unshared")
ARRAYS = {
    f"{species}.{name}"
    for species, kind in (("gas", Gas), ("dust", Dust)) for name in (*(f.name for f in fields(kind)), *ACCELERATIONS)
}  # fmt: skip
# Slots whose results an operator may read, by the slot of the operator.
READABLE_SLOTS = {
    Slot.FORCE: (Slot.FIELD,),
    Slot.LIMIT: (Slot.FIELD, Slot.FORCE, Slot.EVENT),
}


def checked_operators(effects: Mapping[str, Effect], state: State) -> Named:
    """Return the operators of all effects, each with the name of its effect. Raises PartError at the first fault."""
    listed: Named = []
    for name, effect in effects.items():
        found = effect.operators(state)
        if not isinstance(found, list) or not all(isinstance(each, Operator) for each in found):
            raise PartError(f"{name}.operators returns {_type_text(found)}; expected a list of base.Operator")
        listed += [(name, operator) for operator in found]
    may_kick = {*state.species, *(name for name, effect in effects.items() if effect.role.kicks)}
    for fault in chain(
        _type_faults(listed), _slot_faults(listed, may_kick), _name_faults(listed), _conflict_faults(listed)
    ):
        raise PartError(fault)
    return listed


def _type_faults(listed: Named) -> Iterator[str]:
    """Yield messages about operators whose name, slot, `reads` or `writes` has a wrong form."""
    for effect, operator in listed:
        if not isinstance(operator.slot, Slot):
            yield f"{operator.name}: {operator.slot!r} is not a slot; expected a slot like base.Slot.FORCE"
        for names in (operator.reads, operator.writes):
            if not isinstance(names, set | frozenset):
                yield f"{operator.name}: {names!r} is not a set of names; expected a set like base.arrays(...)"
        if not operator.name.startswith(f"{effect}."):
            yield (
                f"{operator.name}: the operator belongs to the effect {effect}; expected a name that "
                f'begins with the effect, like "{effect}.force"'
            )


def _slot_faults(listed: Named, may_kick: set[str]) -> Iterator[str]:
    """Yield messages about repeated names, and about operators that are not allowed or have no purpose in their slot.

    may_kick: names of the effects that may have an operator in KICK.
    """
    names: set[str] = set()
    read_by_forces = {name for _, operator in listed if operator.slot is Slot.FORCE for name in operator.reads}
    for effect, operator in listed:
        if operator.name in names:
            yield f"{operator.name}: another operator has the same name; rename one operator"
        names.add(operator.name)
        if operator.slot is Slot.KICK and effect not in may_kick:
            yield (
                f"{operator.name}: the operator is in the slot KICK, which only a base.KickEffect, gas and "
                f"dust may use; choose another slot"
            )
        if operator.slot is Slot.FIELD and operator.name not in read_by_forces:
            yield f"{operator.name}: no force reads this field; add its name to the `reads` of a force"
        if operator.slot is Slot.FORCE and not operator.writes:
            yield f"{operator.name}: the force writes nothing; add accelerations to its `writes`"


def _name_faults(listed: Named) -> Iterator[str]:
    """Yield messages about names in `reads` and `writes` that are unknown or not allowed in the operator's slot."""
    for _, operator in listed:
        slots = READABLE_SLOTS.get(operator.slot, ())
        results = {other.name for _, other in listed if other.slot in slots}
        readable = {name for name in ARRAYS if not name.endswith(".acc_unshared")} | results | {"bodies"}
        for names, known in ((operator.reads, readable), (operator.writes, ARRAYS)):
            for name in sorted(names - known):
                close = get_close_matches(name, known, 1)
                hint = f'; did you mean "{close[0]}"?' if close else ""
                yield f'{operator.name}: there is no "{name}" to read or write in its slot{hint}'
        if operator.slot is not Slot.LIMIT and (found := operator.reads & {"gas.acc", "dust.acc"}):
            yield f"{operator.name}: {min(found)} is complete only in the slot LIMIT; remove the name from `reads`"


def _conflict_faults(listed: Named) -> Iterator[str]:
    """Yield messages about pairs of operators that may run at the same time, if one changes an array of the other."""
    of_slot = {slot: [each for _, each in listed if each.slot is slot] for slot in Slot}
    for one, other in [*combinations(of_slot[Slot.FIELD], 2), *product(of_slot[Slot.FORCE], of_slot[Slot.KICK_INPUT])]:
        if both := one.writes & (other.reads | other.writes) | other.writes & one.reads:
            yield (
                f"{one.name} and {other.name} run at the same time, and one of the two changes {min(both)}, "
                f"which the other one uses; "
                "let the two operators use different arrays"
            )


def checked_limits(operator: Operator, found: Any) -> Mapping[str, Limit]:
    """Return `found`, the result of an operator in LIMIT. Raises PartError unless it is a dict of limits by species."""
    if not isinstance(found, Mapping) or not all(isinstance(limit, Limit) for limit in found.values()):
        raise PartError(
            f"{operator.name} returns {_type_text(found)}; expected limits by species, "
            "like {base.ALL: base.Limit(step)}"
        )
    if unknown := found.keys() - {"gas", "dust", ALL}:
        raise PartError(f'{operator.name}: "{min(unknown)}" is not a species; expected "gas", "dust" or base.ALL')
    return found


def _type_text(value: Any) -> str:
    """Return the type of a value as text for messages, with the types of its entries, such as "a list of str"."""
    text = f"a {type(value).__name__}"
    if not isinstance(value, list | tuple | Mapping):
        return text
    entries = value.values() if isinstance(value, Mapping) else value
    return f"{text} of {', '.join(sorted({type(each).__name__ for each in entries})) or 'nothing'}"
