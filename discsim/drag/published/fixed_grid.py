"""Rules of the schemes on a fixed grid: one line of cells, and no table or key that needs particles."""

from __future__ import annotations

from collections.abc import Iterator

from discsim.parts import EOS, LAWS
from discsim.scene.rules import Draft, Problem, kinds

OF_SPH = (
    "kernel",
    "eta",
    "smoothing_length",
    "viscosity",
    "conductivity",
    "quiet",
)  # keys of the gas that apply to SPH particles only


def _tables(draft: Draft) -> Iterator[Problem]:
    """Yield problems of tables and keys that do not go with a fixed grid."""
    scheme = _named(draft)
    if draft.space and draft.dimensions != 1:
        yield ("space", "dimensions"), f"{scheme} is a fixed grid along a line; expected 1"
    for table in ("star", "self_gravity", "external", "background"):
        if draft.has(table):
            yield (table,), f"does not go with {scheme}, whose forces are pressure and drag; expected no such table"
    for key in OF_SPH:
        if draft.gives("gas", key):
            yield ("gas", key), f"{scheme} has no SPH particles; expected no such key"
    if draft.drag.supersonic or LAWS[draft.drag.law].by_column:
        key = "supersonic" if draft.drag.supersonic else "law"
        yield ("drag", key), f"{scheme} has no drag that depends on the slip; expected another law"
    if draft.drag.direction != "two-way":
        yield ("drag", "direction"), f'{scheme} moves gas and dust together; expected "two-way"'
    if draft.run and draft.run.integrator != "kdk":
        yield ("run", "integrator"), f"{scheme} has steps of its own; expected no such key"
    if draft.start and not draft.start.cells:
        *some, last = kinds(lambda start: start.cells)
        yield ("initial", "kind"), f"{scheme} has no such start; expected {', '.join(some)} or {last}"


def _cells(draft: Draft) -> Iterator[Problem]:
    """Yield problems of gas and dust that are not in the same cells."""
    if not draft.gas:
        return
    scheme, cells = _named(draft), draft.gas.particles
    if draft.eos is not None and not draft.eos.on_grid:
        words = " or ".join(f'"{kind}"' for kind, eos in EOS.items() if eos.on_grid)
        yield ("gas", "eos", "kind"), f"{scheme} has no such gas; expected {words}"
    if draft.space and draft.space.cells not in (None, cells):
        yield ("space", "cells"), f"the cells of {scheme} are the gas.particles; expected {cells}, or no such key"
    if draft.dust and len(draft.dust) > 1:
        yield ("dust",), f"{scheme} moves one population of dust; expected one"
    for i, dust in enumerate(draft.dust or ()):
        if dust.particles != cells:
            wrong = f"{scheme} has gas and dust in the same cells"
            yield ("dust", i, "particles"), f"{wrong}; expected {cells}, as many as gas.particles"
        if dust.offset or dust.placement != "even":
            key = "offset" if dust.offset else "placement"
            yield ("dust", i, key), f"{scheme} has gas and dust in the same cells; expected no such key"


def _named(draft: Draft) -> str:
    return f'drag.scheme = "{draft.drag.scheme}"'


RULES = (_tables, _cells)
