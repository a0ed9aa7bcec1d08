"""How texts and legends call the dust populations of a scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from discsim.scene.units import clipped


@dataclass(frozen=True)
class Population:
    """A dust population: number, name (`dust.name` or the number), size as text, and `text` for legends.

    The latter has the grain size or, without one, the Stokes number; and the name if the scene gives one, or if another
    population has the same size.
    """

    number: int
    name: str
    size: str
    text: str

    @property
    def legend(self) -> str:
        """The text for legends, with "dust" before it if the scene does not name the population."""
        return f"dust {self.text}" if self.name == str(self.number) else self.text

    @property
    def phrase(self) -> str:
        """The name in a sentence, like 'dust "pebbles"'; "dust 1 mm" or "dust 0" if the scene does not name it."""
        return self.legend if self.name == str(self.number) else f'dust "{self.name}"'


def populations_of(tables: Mapping[str, Any]) -> list[Population]:
    """Return the dust populations of a scene, given as its tables, in the order of their tables."""
    dust = tables.get("dust", [])
    each = [dust] if isinstance(dust, dict) else dust
    sizes = [size_text(table.get("grain_size")) or _stokes_text(tables.get("drag", {})) for table in each]
    found = []
    for number, (table, size) in enumerate(zip(each, sizes, strict=True)):
        name = clipped(str(table.get("name", number)))
        alone = size and (sizes.count(size) == 1) and "name" not in table
        text = size if alone or size == name else ", ".join(filter(None, (name, size)))
        found.append(Population(number, name, size, text))
    return found


def size_text(given: Any) -> str:
    """Return a grain size of a scene as text; "" for none."""
    if isinstance(given, dict):
        return f"{clipped(str(given.get('smallest')))} to {clipped(str(given.get('largest')))}"
    if given is None:
        return ""
    return clipped(given) if isinstance(given, str) else f"s = {clipped(str(given))}"


def _stokes_text(drag: Mapping[str, Any]) -> str:
    """Return the Stokes number that a table [drag] gives to all dust, as text; "" for none."""
    return f"St = {clipped(str(drag['stokes']))}" if drag.get("law") == "stokes-number" and "stokes" in drag else ""
