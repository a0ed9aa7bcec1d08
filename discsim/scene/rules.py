"""What the tables of a scene demand of each other.

A rule looks at a draft and yields (path of the key, what is wrong). A rule that touches a faulty table is
silent: that table has its own messages already.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from discsim.formulas.smoothing import SMOOTHING
from discsim.parts import EFFECTS, EOS, LAWS, SCHEMES, STARTS
from discsim.scene.fields import MOST_SNAPSHOTS

if TYPE_CHECKING:
    from discsim.initial.base import Start

Problem = tuple[tuple[str | int, ...], str]
Rule = Callable[["Draft"], Iterator[Problem]]

KERNEL_KEYS = {"plummer": "softening", "thin-disc": "thickness"}


class Faulty(Exception):
    """The table asked for is in the scene, but could not be read."""


class Draft:
    """The tables of a scene that could be read, as attributes; None where the scene has no such table."""

    def __init__(self, raw: dict[str, Any], tables: dict[str, Any]) -> None:
        self._raw = raw
        self._tables = tables

    def __getattr__(self, name: str) -> Any:
        if name in self._raw and name not in self._tables:
            raise Faulty(name)
        return self._tables.get(name)

    def has(self, name: str) -> bool:
        """Is the table there, faulty or not?"""
        return name in self._raw

    def gives(self, table: str, key: str) -> bool:
        """Did the scene itself write this key?"""
        return isinstance(self._raw.get(table), dict) and key in self._raw[table]

    @property
    def kind(self) -> str:
        return self.initial.kind if self.initial else ""

    @property
    def start(self) -> Start | None:
        """What the scene starts with; None where that is the caller's own particles."""
        return STARTS[self.kind] if self.kind else None

    @property
    def dimensions(self) -> int:
        return self.space.dimensions if self.space else 2

    @property
    def in_code_units(self) -> bool:
        units = self._raw.get("units")
        return isinstance(units, dict) and units.get("system") == "code"

    @property
    def eos_kind(self) -> str:
        return self.gas.eos.kind if self.gas else ""

    @property
    def eos(self) -> Any:
        """The equation of state of [gas] (`physics/eos.py`)."""
        return EOS[self.eos_kind] if self.gas else None


def broken_rules(draft: Draft) -> list[Problem]:
    """Every problem between the tables of `draft`: by the rules here, and by those of the parts that it names."""
    problems: list[Problem] = []
    for rule in (*RULES, *_rules_of_parts(draft)):
        try:
            problems.extend(rule(draft))
        except Faulty:
            continue
    return problems


def _rules_of_parts(draft: Draft) -> Iterator[Rule]:
    for name in EFFECTS:
        if draft.has(name):
            yield from EFFECTS[name].rules
    with suppress(Faulty):
        if draft.start:
            yield from draft.start.rules
    with suppress(Faulty):
        if draft.eos:
            yield from draft.eos.rules
    with suppress(Faulty):
        if draft.drag:
            yield from (*SCHEMES[draft.drag.scheme].rules, *LAWS[draft.drag.law].rules)


def _someone_is_there(draft: Draft) -> Iterator[Problem]:
    if not draft.has("gas") and not draft.has("dust"):
        yield (), "neither [gas] nor [dust] is there; expected one of them at least"


def _output_times(draft: Draft) -> Iterator[Problem]:
    if draft.run and draft.run.every is not None and draft.gives("run", "snapshots"):
        yield ("run", "every"), "run.snapshots is there too; expected one of the two"
    elif draft.run and draft.run.every is not None and draft.run.until > MOST_SNAPSHOTS * draft.run.every:
        number = draft.run.until / draft.run.every
        yield ("run", "every"), f"makes {number:.3g} snapshots until run.until; expected {MOST_SNAPSHOTS:g} at most"


def _periodic_cells(draft: Draft) -> Iterator[Problem]:
    space = draft.space
    if not space or space.boundary != "periodic" or not space.cells:
        return
    cells = [side / max(space.size) * space.cells for side in space.size]
    if any(abs(number - round(number)) > 1e-9 * number or round(number) < 1 for number in cells):
        text = " x ".join(f"{number:g}" for number in cells)
        yield ("space", "cells"), f"a periodic space of {text} square cells; expected whole numbers of cells"


def _cells_for_gravity(draft: Draft) -> Iterator[Problem]:
    space = draft.space
    if not space or not draft.has("self_gravity") or space.boundary == "periodic" or not space.cells:
        return
    if min(space.size) / max(space.size) * space.cells < 5:
        yield (
            ("space", "cells"),
            "self-gravity differentiates over five cells; expected 5 at least along each side",
        )


def _cells_of_a_rectangle(draft: Draft) -> Iterator[Problem]:
    space = draft.space
    if space and space.boundary == "periodic" and not space.cells and min(space.size) < max(space.size):
        yield (
            ("space", "cells"),
            "missing; a periodic space with unequal sides needs whole square cells along both",
        )


def _boundary_of_the_start(draft: Draft) -> Iterator[Problem]:
    wanted = draft.start.boundary if draft.start else None
    if draft.space and wanted not in (None, draft.space.boundary):
        found = draft.space.boundary
        yield ("space", "boundary"), f'"{found}" does not go with a {draft.kind}; expected "{wanted}"'


def _dimensions_of_the_start(draft: Draft) -> Iterator[Problem]:
    if draft.start and draft.dimensions not in draft.start.dimensions:
        wanted = " or ".join(map(str, draft.start.dimensions))
        yield ("space", "dimensions"), f"{draft.dimensions} does not go with a {draft.kind}; expected {wanted}"


def _gas_of_the_start(draft: Draft) -> Iterator[Problem]:
    allowed = draft.start.eos if draft.start else None
    if allowed is None:
        return
    if not draft.has("gas"):
        yield ("initial", "kind"), f"a {draft.kind} needs a table [gas]"
    elif draft.gas and draft.eos_kind not in allowed:
        words = " or ".join(f'"{kind}"' for kind in allowed)
        yield ("gas", "eos", "kind"), f'"{draft.eos_kind}" does not go with a {draft.kind}; expected {words}'


def _room_for_the_start(draft: Draft) -> Iterator[Problem]:
    if not draft.space or not draft.start or not draft.start.reach:
        return
    key, reach = draft.start.reach
    half = 0.5 * min(draft.space.size)
    length = reach * (getattr(draft.initial, key) or 0.0)
    if length > half * (1 + 1e-9):
        share = half / length
        of = f"{reach:g} initial.{key}" if reach > 1 else f"initial.{key}"
        yield ("space", "size"), f"half a side is {share:.3g} of {of}, which it is to hold; expected 1 at least"


def _star_space(draft: Draft) -> Iterator[Problem]:
    if not draft.has("star"):
        return
    if draft.dimensions == 1:
        yield ("star",), "a star needs two dimensions, but space.dimensions is 1"
    elif (
        draft.has("star")
        and draft.space
        and draft.space.boundary == "periodic"
        and not (draft.start and draft.start.edges)
    ):
        yield ("star",), "a periodic space has no centre, and the star's images would pull; expected open boundaries"


def kinds_with(which: Callable[[Start], Any]) -> list[str]:
    """The kinds of starts of which something is true, for a message."""
    return [name for name, start in STARTS.items() if which(start)]


def _fixed_smoothing(draft: Draft) -> Iterator[Problem]:
    if draft.gas and draft.gas.smoothing_length is not None and draft.gives("gas", "eta"):
        yield ("gas", "smoothing_length"), "gas.eta is there too; expected one of the two"
    elif draft.gas and draft.space and (draft.gas.smoothing_length or 0.0) > 2 * max(draft.space.size):
        times = draft.gas.smoothing_length / max(draft.space.size)
        yield ("gas", "smoothing_length"), f"{times:.3g} times as long as space.size; expected at most twice it"


def _neighbours(draft: Draft) -> Iterator[Problem]:
    if not draft.gas or draft.gas.smoothing_length is not None:
        return
    kernel = SMOOTHING[draft.gas.kernel]
    least = kernel.least_eta[draft.dimensions - 1]
    if draft.gas.eta < least:
        wrong = f'{draft.gas.eta:g} leaves a particle of kernel "{draft.gas.kernel}" without neighbours'
        usual = kernel.eta[draft.dimensions - 1]
        yield ("gas", "eta"), f"{wrong}; expected more than {least:g}, like {usual:g}"


def _conductivity(draft: Draft) -> Iterator[Problem]:
    if draft.gas and draft.gas.conductivity and draft.eos_kind != "adiabatic":
        found = draft.eos_kind
        yield ("gas", "conductivity"), f'conducts heat, but the gas is "{found}"; expected kind = "adiabatic"'


def _dust_place(draft: Draft) -> Iterator[Problem]:
    for i, dust in enumerate(draft.dust or ()):
        for key in ("inner", "outer"):
            if draft.start and not draft.start.edges and getattr(dust, key) is not None:
                kinds = " or ".join(kinds_with(lambda start: start.edges))
                yield ("dust", i, key), f"a {draft.kind} has no radius; expected a {kinds}"
        if dust.inner is not None and dust.outer is not None and dust.outer <= dust.inner:
            yield ("dust", i, "outer"), "not outside dust.inner; expected outer > inner"


def _background(draft: Draft) -> Iterator[Problem]:
    if not draft.has("background"):
        return
    if draft.has("gas"):
        yield ("background",), "[gas] is there too; expected one of the two: SPH gas, or gas as a given disc"
    for table, why in (("dust", "moves in it"), ("star", "it turns about"), ("drag", "couples dust to it")):
        if not draft.has(table):
            yield ("background",), f"nothing {why}; expected a table [{table}] too"
    if draft.space and (draft.dimensions != 2 or draft.space.boundary != "open"):
        yield ("space",), 'a [background] is a disc; expected dimensions = 2 and boundary = "open"'
    if draft.run and draft.run.integrator != "kdk":
        yield ("run", "integrator"), 'dust in a [background] needs "kdk"'
    if draft.drag and draft.drag.direction != "one-way":
        yield ("drag", "direction"), 'nothing moves a [background]; expected direction = "one-way"'


def _self_gravity_in_1d(draft: Draft) -> Iterator[Problem]:
    if draft.has("self_gravity") and draft.dimensions == 1 and draft.space and draft.space.boundary == "open":
        yield ("space", "boundary"), '"open" does not go with self_gravity in 1D; expected "periodic"'


def _self_gravity_of_columns(draft: Draft) -> Iterator[Problem]:
    """In code units a number may stand for either density, and own particles bring whatever they are meant to."""
    start = draft.start
    if not draft.has("self_gravity") or draft.dimensions != 1 or draft.in_code_units or not start or start.column:
        return
    if 1 in start.dimensions and start.boundary == "periodic":  # what does not go with either is told already
        wrong = (
            f"in 1D it is that of a thin sheet, which has a surface density, but a {draft.kind} has a volume density"
        )
        kinds = " or ".join(f'"{name}"' for name in kinds_with(lambda start: start.column))
        yield ("self_gravity",), f"{wrong}; expected initial.kind = {kinds}, or space.dimensions = 2"


def _self_gravity_kernel(draft: Draft) -> Iterator[Problem]:
    if not draft.self_gravity:
        return
    kernel = draft.self_gravity.kernel
    needed = KERNEL_KEYS[kernel]
    unsaid = not draft.gives("self_gravity", "kernel")
    if unsaid and draft.self_gravity.thickness is not None:
        yield ("self_gravity", "thickness"), 'nothing uses it; expected kernel = "thin-disc" beside it'
    elif getattr(draft.self_gravity, needed) is None:
        yield ("self_gravity", needed), f'missing; kernel "{kernel}" needs it'


def _self_gravity_sources(draft: Draft) -> Iterator[Problem]:
    if not draft.self_gravity:
        return
    sources = draft.self_gravity.sources
    if len(set(sources)) < len(sources):
        yield ("self_gravity", "sources"), "a source is there twice; expected each once"
    for name in sources:
        if draft.gives("self_gravity", "sources") and not draft.has(name):
            yield ("self_gravity", "sources"), f'"{name}" is to attract, but there is no table [{name}]'


RULES: tuple[Rule, ...] = (
    _someone_is_there,
    _output_times,
    _periodic_cells,
    _cells_for_gravity,
    _cells_of_a_rectangle,
    _boundary_of_the_start,
    _dimensions_of_the_start,
    _gas_of_the_start,
    _room_for_the_start,
    _star_space,
    _fixed_smoothing,
    _neighbours,
    _conductivity,
    _dust_place,
    _background,
    _self_gravity_in_1d,
    _self_gravity_kernel,
    _self_gravity_sources,
    _self_gravity_of_columns,
)
