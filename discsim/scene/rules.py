"""Rules between the tables of a scene.

A rule takes a `Draft` and yields faults (path of the key, message). A rule that reads an invalid table yields
nothing: that table has messages of its own.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from discsim.formulas.smoothing import SMOOTHING
from discsim.parts import EFFECTS, EOS, LAWS, SCHEMES, STARTS
from discsim.scene.fields import MOST_SNAPSHOTS

if TYPE_CHECKING:
    from discsim.initial.base import Start

COURANT_ORBITS = 2.2  # times the limits of star and companions; steps of 2.4 times these limits eject particles
# Artificial viscosity with alpha = DAMPING stabilises steps longer by the fraction DAMPED; less alpha, in proportion.
DAMPING, DAMPED = 0.3, 0.5

# Times the limit of alpha_viscosity: velocities on a lattice grow in steps of 0.82 times that limit. Sound, which this
# viscosity damps, is stable up to 1.05 times or more, so this bound is the lower one for every kernel.
COURANT_VISCOUS = 0.72
# With reconstructed velocities: at 0.7, discs of adiabatic gas with dust reach negative energies.
COURANT_ADIABATIC = 0.6

Problem = tuple[tuple[str | int, ...], str]
Rule = Callable[["Draft"], Iterator[Problem]]


class InvalidTableError(Exception):
    """Error for access to a table that the scene has but that is invalid."""


class Draft:
    """The valid tables of a scene, as attributes; None if the scene has no such table.

    An attribute whose table is invalid raises `InvalidTableError`.
    """

    def __init__(self, raw: dict[str, Any], tables: dict[str, Any]) -> None:
        self._raw = raw
        self._tables = tables

    def __getattr__(self, name: str) -> Any:
        if name in self._raw and name not in self._tables:
            raise InvalidTableError(name)
        return self._tables.get(name)

    def has(self, name: str) -> bool:
        """Return whether the scene has the table, valid or not."""
        return name in self._raw

    def gives(self, table: str, key: str) -> bool:
        """Return whether the scene itself writes this key."""
        return isinstance(self._raw.get(table), dict) and key in self._raw[table]

    @property
    def kind(self) -> str:
        return self.initial.kind if self.initial else ""

    @property
    def start(self) -> Start | None:
        """The start that the scene names; None if the caller sets the particles."""
        return STARTS[self.kind] if self.kind else None

    @property
    def dimensions(self) -> int:
        return self.space.dimensions if self.space else 2

    @property
    def in_code_units(self) -> bool:
        units = self._raw.get("units")
        return isinstance(units, dict) and units.get("system") == "code"

    @property
    def one_way_beside_gas(self) -> bool:
        """True if the scene has gas, and drag that acts on the dust only."""
        return self.has("gas") and self.drag is not None and self.drag.direction == "one-way"

    @property
    def eos_kind(self) -> str:
        return self.gas.eos.kind if self.gas else ""

    @property
    def eos(self) -> Any:
        """The equation of state of [gas] (`physics/eos.py`)."""
        return EOS[self.eos_kind] if self.gas else None


def broken_rules(draft: Draft) -> list[Problem]:
    """Return all faults between the tables of `draft`: by RULES, and by the rules of the parts that the scene names."""
    problems: list[Problem] = []
    for rule in (*RULES, *_rules_of_parts(draft)):
        try:
            problems.extend(rule(draft))
        except InvalidTableError:
            continue
    return problems


def _rules_of_parts(draft: Draft) -> Iterator[Rule]:
    """Yield the rules of the effects, start, equation of state, drag scheme and law of a draft."""
    for name in EFFECTS:
        if draft.has(name):
            yield from EFFECTS[name].rules
    with suppress(InvalidTableError):
        if draft.start:
            yield from draft.start.rules
    with suppress(InvalidTableError):
        if draft.eos:
            yield from draft.eos.rules
    with suppress(InvalidTableError):
        if draft.drag:
            yield from (*SCHEMES[draft.drag.scheme].rules, *LAWS[draft.drag.law].rules)


def _someone_is_there(draft: Draft) -> Iterator[Problem]:
    """Yield a fault if the scene has neither gas nor dust."""
    if not draft.has("gas") and not draft.has("dust"):
        yield (), "there is neither [gas] nor [dust]; expected at least one of these tables"


def _output_times(draft: Draft) -> Iterator[Problem]:
    """Yield a fault if both intervals and number of snapshots are given, or for too many snapshots."""
    if draft.run and draft.run.every is not None and draft.gives("run", "snapshots"):
        yield ("run", "every"), "run.snapshots is also given; expected only one of the two"
    elif draft.run and draft.run.every is not None and draft.run.until > MOST_SNAPSHOTS * draft.run.every:
        number = draft.run.until / draft.run.every
        yield ("run", "every"), f"gives {number:.3g} snapshots until run.until; expected at most {MOST_SNAPSHOTS:g}"


def _periodic_cells(draft: Draft) -> Iterator[Problem]:
    """Yield a fault if the sides of a periodic box are no whole numbers of square cells."""
    space = draft.space
    if not space or space.boundary != "periodic" or not space.cells:
        return
    cells = [side / max(space.size) * space.cells for side in space.size]
    if any(abs(number - round(number)) > 1e-9 * number or round(number) < 1 for number in cells):
        text = " x ".join(f"{number:g}" for number in cells)
        yield ("space", "cells"), f"the sides of the periodic space are {text} square cells; expected whole numbers"


def _cells_of_a_rectangle(draft: Draft) -> Iterator[Problem]:
    """Yield a fault if a periodic box with unequal sides has no number of cells."""
    space = draft.space
    if space and space.boundary == "periodic" and not space.cells and min(space.size) < max(space.size):
        yield (
            ("space", "cells"),
            "missing, but a periodic space with unequal sides needs it; expected a whole number of square cells "
            "per side",
        )


def _boundary_of_the_start(draft: Draft) -> Iterator[Problem]:
    wanted = draft.start.boundary if draft.start else None
    if draft.space and wanted not in (None, draft.space.boundary):
        found = draft.space.boundary
        yield (
            ("space", "boundary"),
            f'"{found}" is not possible with initial.kind = "{draft.kind}"; expected "{wanted}"',
        )


def _dimensions_of_the_start(draft: Draft) -> Iterator[Problem]:
    if draft.start and draft.dimensions not in draft.start.dimensions:
        wanted = " or ".join(map(str, draft.start.dimensions))
        yield (
            ("space", "dimensions"),
            f'{draft.dimensions} is not possible with initial.kind = "{draft.kind}"; expected {wanted}',
        )


def _gas_of_the_start(draft: Draft) -> Iterator[Problem]:
    """Yield a fault if the start needs gas, or another equation of state."""
    allowed = draft.start.eos if draft.start else None
    if allowed is None:
        return
    if not draft.has("gas"):
        yield ("initial", "kind"), f'"{draft.kind}" needs gas; expected a table [gas] too'
    elif draft.gas and draft.eos_kind not in allowed:
        words = " or ".join(f'"{kind}"' for kind in allowed)
        yield (
            ("gas", "eos", "kind"),
            f'"{draft.eos_kind}" is not possible with initial.kind = "{draft.kind}"; expected {words}',
        )


def _room_for_the_start(draft: Draft) -> Iterator[Problem]:
    """Yield a fault if space is too small for the start."""
    if not draft.space or not draft.start or not draft.start.reach:
        return
    key, reach = draft.start.reach
    half = 0.5 * min(draft.space.size)
    length = reach * (getattr(draft.initial, key) or 0.0)
    if length > half * (1 + 1e-9):
        share = half / length
        of = f"{reach:g} initial.{key}" if reach > 1 else f"initial.{key}"
        yield ("space", "size"), f"the space is too small: half a side is {share:.3g} times {of}; expected at least 1"


def kinds(which: Callable[[Start], Any]) -> list[str]:
    """Return the kinds of starts that satisfy the predicate `which`."""
    return [name for name, start in STARTS.items() if which(start)]


def _one_kick(draft: Draft) -> Iterator[Problem]:
    """Yield a fault if two effects each kick gas and dust together (`Role.kicks`)."""
    owners = [name for name in EFFECTS if draft.has(name) and EFFECTS[name].role.kicks]
    if len(owners) > 1:
        first, second = owners[:2]
        yield (second,), f"[{first}] already couples gas and dust; expected only one of the two tables"


def longest_courant(draft: Draft) -> tuple[float, str]:
    """Return the largest stable Courant factor and the instability beyond it; (inf, "") without a bound.

    Leapfrog of a frequency w is stable for w dt < 2 (docs/physics/step.md).
    """
    gas, found = draft.gas, (math.inf, "")
    if draft.has("star") and not draft.has("background"):  # in a given disc circular orbits are exact
        found = (COURANT_ORBITS, "orbits about the star are unstable")
    if gas and not (draft.start and draft.start.uniform):
        braked = gas.viscosity is not None and gas.viscosity.acts_in_shear
        kernel, alpha = SMOOTHING[gas.kernel], gas.viscosity.alpha if braked else 0.0
        sound = 2.0 / kernel.fastest[draft.dimensions - 1] * (1.0 + DAMPED * min(1.0, alpha / DAMPING))
        if draft.has("alpha_viscosity"):
            found = (COURANT_VISCOUS, "viscous gas is unstable")
        elif sound < found[0]:
            found = (sound, f'sound waves are unstable with kernel "{gas.kernel}"')
        if draft.eos.holds_heat and gas.viscosity is not None and not braked and found[0] > COURANT_ADIABATIC:
            found = (COURANT_ADIABATIC, "cold gas gets a negative energy")
    return found


def _stable_steps(draft: Draft) -> Iterator[Problem]:
    """Yield a fault if the Courant factor exceeds `longest_courant`."""
    on_grid = draft.drag and SCHEMES[draft.drag.scheme].on_grid
    if not draft.run or draft.run.timestep is not None or on_grid:
        return
    most, what = longest_courant(draft)
    if draft.run.courant > most:
        yield (
            ("run", "courant"),
            f"{draft.run.courant:g} gives time steps so long that {what}; expected at most {_floor(most)}",
        )


def _floor(value: float) -> str:
    """Return a number rounded down to two decimals, as text."""
    return f"{math.floor(100.0 * value) / 100.0:g}"


RULES: tuple[Rule, ...] = (
    _stable_steps,
    _someone_is_there,
    _output_times,
    _periodic_cells,
    _cells_of_a_rectangle,
    _boundary_of_the_start,
    _dimensions_of_the_start,
    _gas_of_the_start,
    _room_for_the_start,
    _one_kick,
)
