"""Rules between the tables of a scene.

A rule is a function that takes a `Draft` and yields a `Problem` for every fault: the path of the key, and the message.
Access to an invalid table ends a rule without a problem, because the invalid table has messages of its own.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from discsim.formulas.smoothing import SMOOTHING
from discsim.parts import EFFECTS, EOS, LAWS, SCHEMES, STARTS
from discsim.scene.fields import MAX_SNAPSHOTS, shown

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
COURANT_POLAR = 1.0  # bound for gas in polar cells, whose sound waves grow above 1.5 times their limit

Problem = tuple[tuple[str | int, ...], str]
Rule = Callable[["Draft"], Iterator[Problem]]


class InvalidTableError(Exception):
    """Error for access to an invalid table of a `Draft`."""


class Draft:
    """A scene during validation: its valid tables as attributes.

    An attribute is None if the scene has no such table. Access to an invalid table raises `InvalidTableError`. The
    argument `raw` has the tables as the scene writes them, `tables` the valid tables.
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
        """The name of the start, `initial.kind`; "" if the caller sets the particles."""
        return self.initial.kind if self.initial else ""

    @property
    def start(self) -> Start | None:
        """The start that the scene names; None if the caller sets the particles."""
        return STARTS[self.kind] if self.kind else None

    @property
    def dimensions(self) -> int:
        """Dimensions of space; 2 without a table [space]."""
        return self.space.dimensions if self.space else 2

    @property
    def in_code_units(self) -> bool:
        """True if the scene has units.system = "code"."""
        units = self._raw.get("units")
        return isinstance(units, dict) and units.get("system") == "code"

    @property
    def has_gas_and_one_way_drag(self) -> bool:
        """True if the scene has gas, and drag that does not act on it."""
        return self.has("gas") and self.drag is not None and self.drag.direction == "one-way"

    @property
    def eos_kind(self) -> str:
        """The name of the equation of state of [gas]; "" without gas."""
        return self.gas.eos.kind if self.gas else ""

    @property
    def eos(self) -> Any:
        """The equation of state of [gas], a part of `physics/eos.py`; None without gas."""
        return EOS[self.eos_kind] if self.gas else None


def broken_rules(draft: Draft) -> list[Problem]:
    """Return all problems that the rules find: RULES, and the rules of the parts that the scene names."""
    problems: list[Problem] = []
    for rule in (*RULES, *_rules_of_parts(draft)):
        try:
            problems.extend(rule(draft))
        except InvalidTableError:
            continue
    return problems


def _rules_of_parts(draft: Draft) -> Iterator[Rule]:
    """Yield the rules of the parts that the scene names: effects, start, equation of state, drag scheme and law."""
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


def _missing_species(draft: Draft) -> Iterator[Problem]:
    """Yield a problem if the scene has neither gas nor dust."""
    if not draft.has("gas") and not draft.has("dust"):
        yield (), "there is neither [gas] nor [dust]; add at least one of these tables"


def _output_time_problems(draft: Draft) -> Iterator[Problem]:
    """Yield a problem if run.every and run.snapshots are both given, or if run.every gives too many snapshots."""
    run = draft.run
    if not run or run.every is None:
        return
    if draft.gives("run", "snapshots"):
        yield ("run", "every"), "run.snapshots is also given; keep run.every or run.snapshots"
    elif run.until > MAX_SNAPSHOTS * run.every:
        number = run.until / run.every
        yield (
            ("run", "every"),
            f"the interval gives {number:.3g} snapshots until run.until; expected at most {MAX_SNAPSHOTS:g} snapshots",
        )


def _cell_problems(draft: Draft) -> Iterator[Problem]:
    """Yield a problem if square cells do not fill a periodic box: space.cells is missing, or does not fit the sides."""
    space = draft.space
    if not space or space.boundary != "periodic":
        return
    if not space.cells:
        if min(space.size) < max(space.size):
            wrong = "missing, but required in a periodic space with unequal sides"
            yield (
                ("space", "cells"),
                f"{wrong}; add a number of cells that gives a whole number of square cells on each side",
            )
        return
    cells = [side / max(space.size) * space.cells for side in space.size]
    if any(abs(number - round(number)) > 1e-9 * number or round(number) < 1 for number in cells):
        text = " x ".join(f"{number:g}" for number in cells)
        wrong = f"the sides of the periodic space are {text} square cells"
        yield ("space", "cells"), f"{wrong}; change space.cells so that these numbers are whole"


def _exclusion_by_start(draft: Draft, path: tuple[str, ...], found: Any, allowed: Iterable[Any]) -> Problem:
    """Return the problem that the start excludes `found`, the value of the key at `path`, and allows only `allowed`."""
    words = " or ".join(map(shown, allowed))
    return path, f'{shown(found)} is not possible with initial.kind = "{draft.kind}"; expected {words}'


def _space_problems_of_start(draft: Draft) -> Iterator[Problem]:
    """Yield a problem if the start does not allow the boundary, and one if the start does not allow the dimensions."""
    start = draft.start
    if start and draft.space and start.boundary not in (None, draft.space.boundary):
        yield _exclusion_by_start(draft, ("space", "boundary"), draft.space.boundary, [start.boundary])
    if start and draft.dimensions not in start.dimensions:
        yield _exclusion_by_start(draft, ("space", "dimensions"), draft.dimensions, start.dimensions)


def _gas_problems_of_start(draft: Draft) -> Iterator[Problem]:
    """Yield a problem if the start needs gas that the scene lacks, or does not allow the equation of state."""
    allowed = draft.start.eos if draft.start else None
    if allowed is None:
        return
    if not draft.has("gas"):
        yield ("initial", "kind"), f'"{draft.kind}" needs gas; add a table [gas]'
    elif draft.gas and draft.eos_kind not in allowed:
        yield _exclusion_by_start(draft, ("gas", "eos", "kind"), draft.eos_kind, allowed)


def _size_problem_of_start(draft: Draft) -> Iterator[Problem]:
    """Yield a problem if the start reaches beyond the nearest side of space."""
    if not draft.space or not draft.start or not draft.start.min_half_side:
        return
    key, reach = draft.start.min_half_side
    half = 0.5 * min(draft.space.size)
    length = reach * (getattr(draft.initial, key) or 0.0)
    if length > half * (1 + 1e-9):
        share = half / length
        of = f"{reach:g} initial.{key}" if reach > 1 else f"initial.{key}"
        yield (
            ("space", "size"),
            f"the space is too small: half a side is {share:.3g} times {of}; expected a factor of at least 1",
        )


def quoted(names: Iterable[str]) -> str:
    """Return names in quotes, joined by "or"."""
    return " or ".join(f'"{name}"' for name in names)


def missing_tables(draft: Draft, where: tuple[str | int, ...], reasons: Mapping[str, str]) -> Iterator[Problem]:
    """Yield a fault at the key `where` for each table that the scene lacks.

    reasons: why each table is needed, as text by the name of the table.
    """
    for table, reason in reasons.items():
        if not draft.has(table):
            yield where, f"{reason}; add a table [{table}]"


def starts_where(which: Callable[[Start], Any]) -> list[str]:
    """Return the names of the starts for which `which(start)` is true."""
    return [name for name, start in STARTS.items() if which(start)]


def _coupling_problem(draft: Draft) -> Iterator[Problem]:
    """Yield a problem if the scene has two effects that kick gas and dust together (`Role.kicks`)."""
    owners = [name for name in EFFECTS if draft.has(name) and EFFECTS[name].role.kicks]
    if len(owners) > 1:
        first, second = owners[:2]
        yield (second,), f"[{first}] already couples gas and dust; keep [{first}] or [{second}]"


def longest_courant(draft: Draft) -> tuple[float, str]:
    """Return the largest stable Courant factor, and the instability above it as text; (inf, "") if none is known.

    A leapfrog step dt of an oscillation with frequency w is stable for w dt < 2 (docs/physics/step.md).
    """
    gas, found = draft.gas, (math.inf, "")
    if draft.has("star") and not draft.has("background"):  # with [background], circular orbits are exact
        found = (COURANT_ORBITS, "orbits about the star are unstable")
    if gas and gas.method == "grid":
        return min(found, (COURANT_POLAR, "gas in polar cells is unstable"))
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


def _courant_problem(draft: Draft) -> Iterator[Problem]:
    """Yield a problem if the Courant factor exceeds `longest_courant`."""
    on_grid = draft.drag and SCHEMES[draft.drag.scheme].on_grid
    if not draft.run or draft.run.timestep is not None or on_grid:
        return
    most, what = longest_courant(draft)
    if draft.run.courant > most:
        wrong = f"the value {draft.run.courant:g} gives time steps so long that {what}"
        yield ("run", "courant"), f"{wrong}; expected at most {math.floor(100.0 * most) / 100.0:g}"


RULES: tuple[Rule, ...] = (
    _courant_problem,
    _missing_species,
    _output_time_problems,
    _cell_problems,
    _space_problems_of_start,
    _gas_problems_of_start,
    _size_problem_of_start,
    _coupling_problem,
)
