"""What the tables of a scene demand of each other.

A rule looks at a draft and yields (path of the key, what is wrong). A rule that touches a faulty table is
silent: that table has its own messages already.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from math import ceil, erf, exp, log10, pi, sqrt
from typing import Any

from discsim.formulas.smoothing import SMOOTHING
from discsim.parts import EFFECTS, EOS, LAWS, SCHEMES, STARTS
from discsim.scene.fields import LARGEST, MOST_SNAPSHOTS

Problem = tuple[tuple[str | int, ...], str]
Rule = Callable[["Draft"], Iterator[Problem]]

# Which equations of state a start goes with, where not all.
EOS_OF = {
    "shock": ("adiabatic", "isothermal"),
    "blast": ("adiabatic",),
    "vortex": ("adiabatic",),
    "settling": ("isothermal",),
}
BRINGS_PRESSURE = ("shock", "blast", "vortex")  # starts that need no temperature of the eos
REACH = {"blast": ("radius", 1.0), "vortex": ("radius", 2.0), "settling": ("vertical_extent", 1.0)}
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
        if draft.kind:
            yield from STARTS[draft.kind].rules
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
    if not draft.space:
        return
    wanted = "open" if draft.kind in ("disc", "shock", "settling") else "periodic"
    if draft.kind not in ("", "blast") and draft.space.boundary != wanted:
        found = draft.space.boundary
        yield ("space", "boundary"), f'"{found}" does not go with a {draft.kind}; expected "{wanted}"'


def _dimensions_of_the_start(draft: Draft) -> Iterator[Problem]:
    wanted = {"disc": 2, "shock": 1, "settling": 1, "blast": 2, "vortex": 2}.get(draft.kind, draft.dimensions)
    if draft.dimensions != wanted:
        yield (
            ("space", "dimensions"),
            f"{draft.dimensions} does not go with a {draft.kind}; expected {wanted}",
        )


def _disc_edges(draft: Draft) -> Iterator[Problem]:
    if draft.kind != "disc":
        return
    disc = draft.initial
    if disc.outer <= disc.inner:
        yield ("initial", "outer"), "the outer edge is not outside the inner one; expected outer > inner"
    elif draft.space and min(draft.space.size) < 2 * disc.outer:
        share = min(draft.space.size) / (2 * disc.outer)
        yield (
            ("space", "size"),
            f"the grid is smaller than the disc: its half side is {share:.3g} of initial.outer; "
            "expected more than 1 (1.3 leaves room to spread)",
        )
    elif disc.inner_taper + disc.outer_taper > disc.outer - disc.inner:
        wide = (disc.inner_taper + disc.outer_taper) / (disc.outer - disc.inner)
        key = "inner_taper" if disc.inner_taper > disc.outer_taper else "outer_taper"
        yield ("initial", key), f"the tapers are {wide:.3g} times as wide as the disc; expected 1 at most"


def _power_laws(draft: Draft) -> Iterator[Problem]:
    """Powers of the radius stay within floats all over a disc."""
    if draft.kind != "disc":
        return
    gas = draft.gas or draft.background
    laws = [("initial", draft.initial, "surface_density_index")]
    if draft.has("background"):
        laws.append(("background", draft.background, "surface_density_index"))
    if gas and hasattr(gas.eos, "temperature_index"):
        laws.append(("gas" if draft.gas else "background", gas.eos, "temperature_index"))
    for table, law, key in laws:
        index, where = getattr(law, key), law.reference_radius
        if max(abs(index * log10(r / where)) for r in (draft.initial.inner, draft.initial.outer)) > log10(LARGEST):
            path = (table, "eos", key) if key == "temperature_index" else (table, key)
            yield path, f"{index:g} takes powers of the radius beyond {LARGEST:g} in the disc; expected a lesser slope"


def _disc_mass(draft: Draft) -> Iterator[Problem]:
    if draft.kind != "disc":
        return
    scales = ("mass", "toomre_q", "surface_density")
    given = [key for key in scales if getattr(draft.initial, key) is not None]
    if len(given) != 1:
        wrong = "{} are there together".format(" and ".join(given)) if given else "the disc has no mass"
        yield ("initial", *given[-1:]), f"{wrong}; expected exactly one of {', '.join(scales)}"


def _disc_needs_a_centre(draft: Draft) -> Iterator[Problem]:
    if draft.kind == "disc" and not draft.has("star") and not draft.has("self_gravity"):
        yield (
            ("initial", "kind"),
            "nothing holds the disc together; expected a table [star] or [self_gravity]",
        )


def _toomre_q(draft: Draft) -> Iterator[Problem]:
    if draft.kind == "disc" and draft.initial.toomre_q is not None:
        for table in ("gas", "star"):
            if not draft.has(table):
                yield ("initial", "toomre_q"), f"Q = c_s kappa / (pi G Sigma) needs a table [{table}]"


def _gas_of_the_start(draft: Draft) -> Iterator[Problem]:
    allowed = EOS_OF.get(draft.kind)
    if allowed is None:
        return
    if not draft.has("gas"):
        yield ("initial", "kind"), f"a {draft.kind} needs a table [gas]"
    elif draft.gas and draft.eos_kind not in allowed:
        words = " or ".join(f'"{kind}"' for kind in allowed)
        yield ("gas", "eos", "kind"), f'"{draft.eos_kind}" does not go with a {draft.kind}; expected {words}'


def _room_for_the_start(draft: Draft) -> Iterator[Problem]:
    if not draft.space:
        return
    key, reach = REACH.get(draft.kind, ("", 0.0))
    half = 0.5 * min(draft.space.size)
    length = reach * (getattr(draft.initial, key) or 0.0) if key else 0.0
    if length > half * (1 + 1e-9):
        share = half / length
        of = f"{reach:g} initial.{key}" if reach > 1 else f"initial.{key}"
        yield ("space", "size"), f"half a side is {share:.3g} of {of}, which it is to hold; expected 1 at least"


def _layer_needs_gravity(draft: Draft) -> Iterator[Problem]:
    if draft.kind == "settling" and not (draft.external and draft.external.vertical_frequency > 0):
        path = ("external", "vertical_frequency") if draft.has("external") else ("external",)
        yield path, "missing; the layer's weight is -Omega^2 z with Omega = external.vertical_frequency > 0"


def _layer_reaches(draft: Draft) -> Iterator[Problem]:
    """Particles of equal mass are far apart where the layer ends: at most ten lengths over which it falls by e."""
    if draft.kind != "settling" or not (draft.gas and draft.space and draft.external):
        return
    if draft.eos_kind != "isothermal" or draft.external.vertical_frequency == 0.0:
        return
    height = draft.gas.eos.sound_speed / draft.external.vertical_frequency
    top = (draft.initial.vertical_extent or 0.5 * draft.space.size[0]) / height
    if top > 30.0:
        wrong = f"a layer {2.0 * top:.3g} scale heights thick has no gas at its ends"
        yield ("initial", "vertical_extent"), f"{wrong}; expected some scale heights c_s / Omega = {height:.3g}"
        return
    needed = ceil(0.1 * sqrt(2.0 * pi) * erf(top / sqrt(2.0)) * top * exp(0.5 * top * top))
    if draft.gas.particles < needed:
        wrong = f"too few for a layer that reaches to {top:.3g} scale heights, where next to none would be"
        yield ("gas", "particles"), f"{wrong}; expected {needed} at least, or a smaller initial.vertical_extent"


def _wave_direction(draft: Draft) -> Iterator[Problem]:
    if draft.kind == "wave" and not any(draft.initial.direction):
        yield ("initial", "direction"), "all zeros; expected whole waves along one side at least"


def _star_space(draft: Draft) -> Iterator[Problem]:
    if draft.has("star") and draft.dimensions == 1:
        yield ("star",), "a star needs two dimensions, but space.dimensions is 1"
    elif draft.has("star") and draft.space and draft.space.boundary == "periodic" and draft.kind != "disc":
        yield ("star",), "a periodic space has no centre, and the star's images would pull; expected open boundaries"


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
        if draft.kind == "disc" and dust.offset:
            yield ("dust", i, "offset"), "a disc has no gas spacing; expected another kind"
        for key in ("inner", "outer"):
            if draft.kind not in ("disc", "") and getattr(dust, key) is not None:
                yield ("dust", i, key), f"a {draft.kind} has no radius; expected a disc"
        if dust.inner is not None and dust.outer is not None and dust.outer <= dust.inner:
            yield ("dust", i, "outer"), "not outside dust.inner; expected outer > inner"
        elif draft.kind == "disc" and dust.inner is not None and dust.inner >= draft.initial.outer:
            yield ("dust", i, "inner"), "beyond the disc, where there is no gas; expected less than initial.outer"
        elif draft.kind == "disc" and dust.outer is not None and dust.outer <= draft.initial.inner:
            yield ("dust", i, "outer"), "in the disc's hole, where there is no gas; expected more than initial.inner"


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
    if draft.initial and draft.kind == "disc" and draft.initial.toomre_q is not None:
        yield ("initial", "toomre_q"), "there is no [gas] to have a Q; expected mass or surface_density"


def _self_gravity_in_1d(draft: Draft) -> Iterator[Problem]:
    if draft.has("self_gravity") and draft.dimensions == 1 and draft.space and draft.space.boundary == "open":
        yield ("space", "boundary"), '"open" does not go with self_gravity in 1D; expected "periodic"'


def _self_gravity_of_columns(draft: Draft) -> Iterator[Problem]:
    """In code units a number may stand for either density, and own particles bring whatever they are meant to."""
    if (
        draft.has("self_gravity")
        and draft.dimensions == 1
        and draft.kind in ("box", "wave")
        and not draft.in_code_units
    ):
        wrong = (
            f"in 1D it is that of a thin sheet, which has a surface density, but a {draft.kind} has a volume density"
        )
        yield ("self_gravity",), f'{wrong}; expected initial.kind = "sheet", or space.dimensions = 2'


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
    _disc_edges,
    _power_laws,
    _disc_mass,
    _disc_needs_a_centre,
    _toomre_q,
    _gas_of_the_start,
    _room_for_the_start,
    _layer_needs_gravity,
    _layer_reaches,
    _wave_direction,
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
