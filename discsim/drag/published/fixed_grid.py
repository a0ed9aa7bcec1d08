"""Rules for scenes with a drag scheme on a fixed 1D grid: no tables and keys about particles or 2D space."""

from __future__ import annotations

from collections.abc import Iterator

from discsim.parts import EOS, LAWS
from discsim.scene.rules import Draft, Problem, starts_where

# Keys of [gas] that apply only to SPH particles.
OF_SPH = ("kernel", "eta", "smoothing_length", "precision", "viscosity", "conductivity", "quiet")


def _problems_of_keys(draft: Draft) -> Iterator[Problem]:
    """Yield the problems of tables and keys that do not apply to a fixed grid."""
    scheme = _scheme_as_text(draft)
    if draft.space and draft.dimensions != 1:
        yield ("space", "dimensions"), f"{scheme} is a fixed 1D grid; set space.dimensions = 1"
    for table in ("star", "self_gravity", "external", "background"):
        if draft.has(table):
            yield (table,), f"not possible with {scheme}, which has only pressure and drag; remove the table [{table}]"
    for key in OF_SPH:
        if draft.gives("gas", key):
            yield ("gas", key), f"{scheme} has no SPH particles; remove this key"
    if draft.drag.supersonic or LAWS[draft.drag.law].needs_mean_free_path:
        key = "supersonic" if draft.drag.supersonic else "law"
        yield ("drag", key), f"{scheme} allows only drag linear in velocity; choose another drag.law"
    if draft.drag.direction != "two-way":
        yield ("drag", "direction"), f'{scheme} always couples gas and dust both ways; expected "two-way"'
    if draft.run and draft.run.integrator != "kdk":
        yield ("run", "integrator"), f"{scheme} has its own time integrator; remove this key"
    if draft.start and not draft.start.cell_values:
        *some, last = starts_where(lambda start: start.cell_values)
        yield ("initial", "kind"), f"{scheme} does not support this start; expected {', '.join(some)} or {last}"


def _problems_of_cells(draft: Draft) -> Iterator[Problem]:
    """Yield a problem of each key that would put gas and dust into different cells."""
    if not draft.gas:
        return
    scheme, cells = _scheme_as_text(draft), draft.gas.particles
    if draft.eos is not None and not draft.eos.on_grid:
        words = " or ".join(f'"{kind}"' for kind, eos in EOS.items() if eos.on_grid)
        yield ("gas", "eos", "kind"), f"{scheme} does not support this equation of state; expected {words}"
    if draft.space and draft.space.cells not in (None, cells):
        wrong = f"with {scheme} the number of cells is gas.particles"
        yield ("space", "cells"), f"{wrong}; expected {cells}, or this key left out"
    if draft.dust and len(draft.dust) > 1:
        yield ("dust",), f"{scheme} allows one population of dust; expected one table [[dust]]"
    for i, dust in enumerate(draft.dust or ()):
        if dust.particles != cells:
            wrong = f"{scheme} has gas and dust in the same cells"
            yield ("dust", i, "particles"), f"{wrong}; expected {cells}, as many as gas.particles"
        if dust.offset or dust.placement != "even":
            key = "offset" if dust.offset else "placement"
            yield ("dust", i, key), f"{scheme} has gas and dust in the same cells; remove this key"


def _scheme_as_text(draft: Draft) -> str:
    """Return the scheme of a scene as text for messages."""
    return f'drag.scheme = "{draft.drag.scheme}"'


RULES = (_problems_of_keys, _problems_of_cells)
