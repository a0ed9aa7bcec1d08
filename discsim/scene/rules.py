"""Rules between the tables of a scene.

A rule takes a `Draft` and yields faults (path of the key, message). A rule ends without a fault at the first access to
an invalid table, which has messages of its own.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from discsim.formulas.smoothing import SMOOTHING
from discsim.parts import EFFECTS, EOS, LAWS, SCHEMES, STARTS
from discsim.scene.fields import MAX_SNAPSHOTS

if TYPE_CHECKING:
    from discsim.initial.base import Start

# The following bounds of the Courant factor are multiples of an effect's time-step limit.
COURANT_ORBITS = 2.2  # bound by star and companions: 2.4 times their limits eject particles
# Artificial viscosity with alpha >= STABILISING_ALPHA raises the bound by sound waves by the fraction STABILISED; a
# smaller alpha raises it in proportion.
STABILISING_ALPHA, STABILISED = 0.3, 0.5

# Bound by [alpha_viscosity]: velocities on a lattice grow at 0.82 times its limit. Sound, which this viscosity damps,
# is stable up to 1.05 times its limit or more, so that the bound by viscosity is the lower one for every kernel.
COURANT_VISCOUS = 0.72
# Bound for adiabatic gas with reconstructed velocities: at 0.7, discs with dust reach negative energies.
COURANT_ADIABATIC = 0.6

Problem = tuple[tuple[str | int, ...], str]
Rule = Callable[["Draft"], Iterator[Problem]]


class InvalidTableError(Exception):
    """Error for access to an invalid table of a scene."""


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
        """Return whether the scene has the table `name`, valid or not."""
        return name in self._raw

    def gives(self, table: str, key: str) -> bool:
        """Return whether the scene sets this key explicitly, not by a default."""
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
    """Return all faults between the tables of `draft`.

    The rules are RULES and those of the parts that the scene names: effects, start, equation of state, drag.
    """
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


def _has_gas_or_dust(draft: Draft) -> Iterator[Problem]:
    """Yield a fault if the scene has neither gas nor dust."""
    if not draft.has("gas") and not draft.has("dust"):
        yield (), "there is neither [gas] nor [dust]; expected at least one of these tables"


def _output_times(draft: Draft) -> Iterator[Problem]:
    """Yield a fault if both run.every and run.snapshots are given, or if run.every gives too many snapshots."""
    if draft.run and draft.run.every is not None and draft.gives("run", "snapshots"):
        yield ("run", "every"), "run.snapshots is also given; expected only one of the two"
    elif draft.run and draft.run.every is not None and draft.run.until > MAX_SNAPSHOTS * draft.run.every:
        number = draft.run.until / draft.run.every
        yield ("run", "every"), f"gives {number:.3g} snapshots until run.until; expected at most {MAX_SNAPSHOTS:g}"


def _periodic_cells(draft: Draft) -> Iterator[Problem]:
    """Yield a fault if a side of a periodic box is not a whole number of square cells."""
    space = draft.space
    if not space or space.boundary != "periodic" or not space.cells:
        return
    cells = [side / max(space.size) * space.cells for side in space.size]
    if any(abs(number - round(number)) > 1e-9 * number or round(number) < 1 for number in cells):
        text = " x ".join(f"{number:g}" for number in cells)
        yield ("space", "cells"), f"the sides of the periodic space are {text} square cells; expected whole numbers"


def _cells_of_a_rectangle(draft: Draft) -> Iterator[Problem]:
    """Yield a fault if space.cells is missing for a periodic box with unequal sides."""
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
    """Yield a fault if gas is missing that the start needs, or if the start excludes the equation of state."""
    allowed = draft.start.eos if draft.start else None
    if allowed is None:
        return
    if not draft.has("gas"):
        yield ("initial", "kind"), f'"{draft.kind}" needs gas; expected a table [gas] too'
    elif draft.gas and draft.eos_kind not in allowed:
        wrong = f'"{draft.eos_kind}" is not possible with initial.kind = "{draft.kind}"'
        yield ("gas", "eos", "kind"), f"{wrong}; expected {quoted(allowed)}"


def _size_for_the_start(draft: Draft) -> Iterator[Problem]:
    """Yield a fault if space is too small for the start."""
    if not draft.space or not draft.start or not draft.start.min_half_side:
        return
    key, reach = draft.start.min_half_side
    half = 0.5 * min(draft.space.size)
    length = reach * (getattr(draft.initial, key) or 0.0)
    if length > half * (1 + 1e-9):
        share = half / length
        of = f"{reach:g} initial.{key}" if reach > 1 else f"initial.{key}"
        yield ("space", "size"), f"the space is too small: half a side is {share:.3g} times {of}; expected at least 1"


def quoted(names: Iterable[str]) -> str:
    """Return names in quotes, joined by "or"."""
    return " or ".join(f'"{name}"' for name in names)


def missing_tables(draft: Draft, where: tuple[str | int, ...], reasons: Mapping[str, str]) -> Iterator[Problem]:
    """Yield a fault at the key `where` for each table that the scene lacks.

    reasons: why each table is needed, as text by the name of the table.
    """
    for table, reason in reasons.items():
        if not draft.has(table):
            yield where, f"{reason}; expected a table [{table}] too"


def kinds(which: Callable[[Start], Any]) -> list[str]:
    """Return the names of the starts for which `which(start)` is true."""
    return [name for name, start in STARTS.items() if which(start)]


def _only_one_coupling(draft: Draft) -> Iterator[Problem]:
    """Yield a fault if two effects each kick gas and dust together (`Role.kicks`)."""
    owners = [name for name in EFFECTS if draft.has(name) and EFFECTS[name].role.kicks]
    if len(owners) > 1:
        first, second = owners[:2]
        yield (second,), f"[{first}] already couples gas and dust; expected only one of the two tables"


def longest_courant(draft: Draft) -> tuple[float, str]:
    """Return the largest stable Courant factor, and the instability beyond it as text; (inf, "") without a bound.

    A leapfrog step dt of an oscillation with frequency w is stable for w dt < 2 (docs/physics/step.md).
    """
    gas, found = draft.gas, (math.inf, "")
    if draft.has("star") and not draft.has("background"):  # in a given disc circular orbits are exact
        found = (COURANT_ORBITS, "orbits about the star are unstable")
    if gas and not (draft.start and draft.start.stays_uniform):
        braked = gas.viscosity is not None and gas.viscosity.acts_in_shear
        kernel, alpha = SMOOTHING[gas.kernel], gas.viscosity.alpha if braked else 0.0
        sound = 2.0 / kernel.fastest[draft.dimensions - 1] * (1.0 + STABILISED * min(1.0, alpha / STABILISING_ALPHA))
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
            f"{draft.run.courant:g} gives time steps so long that {what}; expected at most {_rounded_down(most)}",
        )


def _rounded_down(value: float) -> str:
    """Return a number rounded down to two decimals, as text."""
    return f"{math.floor(100.0 * value) / 100.0:g}"


RULES: tuple[Rule, ...] = (
    _stable_steps,
    _has_gas_or_dust,
    _output_times,
    _periodic_cells,
    _cells_of_a_rectangle,
    _boundary_of_the_start,
    _dimensions_of_the_start,
    _gas_of_the_start,
    _size_for_the_start,
    _only_one_coupling,
)
