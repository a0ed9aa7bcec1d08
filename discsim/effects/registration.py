"""Registration of effects from a script or notebook, for this process; a package has entry points instead."""

from __future__ import annotations

from typing import Any

from discsim.effects.base import Effect
from discsim.parts import EFFECTS, PartError
from discsim.printable import printable
from discsim.scene import Scene
from discsim.scene.fields import Table
from discsim.scene.tables import TABLES


def register(**effects: type[Effect]) -> None:
    """Add effects to the tables that scenes may have, until this process ends.

    Parameters
    ----------
    **effects : type
        Classes of effects by the name of their table: `register(lamp=Lamp)` lets a scene have a table [lamp]. Each is
        a subclass of `discsim.effects.base.Effect`, with `keys`. A step calls them after all other effects.

    Raises
    ------
    PartError
        A name or a class cannot be used; then no effect is added. A name that exists cannot get another class.

    Examples
    --------
    >>> import discsim
    >>> from discsim.effects import base
    >>> from discsim.scene.fields import Number, Table
    >>> class Keys(Table):
    ...     strength: Number
    >>> class Lamp(base.Effect):
    ...     keys = Keys
    >>> discsim.register(example_lamp=Lamp)
    """
    for name, effect in effects.items():
        _check(name, effect)
    for name, effect in effects.items():
        EFFECTS.add(name, effect)


def _check(name: str, effect: Any) -> None:
    """Raise PartError unless `effect` may be the effect of the table `name`."""
    if not (name.isidentifier() and name.isascii()):
        raise PartError(f'register: "{printable(name)}" is no name of a table; expected letters, digits and _')
    reserved = ("title", *(table for table in TABLES if table not in EFFECTS), *Scene.model_fields)
    if EFFECTS.added.get(name) is not effect and (name in EFFECTS or name in reserved):
        earlier = EFFECTS.added.get(name)
        whose = "is a name of discsim or of a package" if earlier is None else f"is registered as {_name_of(earlier)}"
        remedy = "expected another name" + ("" if earlier is None else ", or a new process (restart the notebook)")
        raise PartError(f"register: {name} {whose}; {remedy}")
    if not (isinstance(effect, type) and issubclass(effect, Effect)):
        what = _name_of(effect) if isinstance(effect, type) else f"of type {type(effect).__name__}"
        raise PartError(f"register: {name} is {what}; expected a subclass of discsim.effects.base.Effect")
    keys = getattr(effect, "keys", None)
    if not (isinstance(keys, type) and issubclass(keys, Table)):
        wrong = f"{_name_of(effect)} has no keys for [{name}]"
        raise PartError(f"register: {wrong}; expected keys = a subclass of discsim.scene.fields.Table")


def _name_of(effect: type) -> str:
    return f"{effect.__module__}.{effect.__qualname__}"
