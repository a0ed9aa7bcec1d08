"""What will run, but perhaps not as meant: each with its number and what to change."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from discsim.effects import effect_classes
from discsim.initial import start_of
from discsim.numerics.layout import LOADED
from discsim.parts import SCHEMES, USUAL_SCHEME
from discsim.physics.local import Local
from discsim.preview.derived import (
    drag_cell_counts,
    drag_cell_sides,
    local,
    stopping_times,
)
from discsim.scene import Scene

if TYPE_CHECKING:
    from discsim.drag.base import Scheme

# In one dimension cells grow by eight for want of dust: gas between grains that are farther apart is not dragged along.
# One grain in a cell cures that.
LONELY = (0, 0.25)


def warnings(scene: Scene) -> list[str]:
    """What will run, but perhaps not as meant: each with its number and what to change."""
    if scene.initial is None:
        return []
    at = local(scene)
    with np.errstate(over="ignore"):  # a length or mass beyond floats is long and heavy enough
        told = [line for effect in effect_classes(scene).values() for line in effect.warnings(scene, at)]
        told += [line for kind in (_drag_warnings, _scheme_warnings) for line in kind(scene, at)]
        return [*told, *_start_warnings(scene, at)]


def _start_warnings(scene: Scene, at: Local) -> Iterator[str]:
    told = start_of(scene).warnings
    if told is not None:
        yield from told(scene)


def _scheme_warnings(scene: Scene, at: Local) -> Iterator[str]:
    """Explicit steps, and schemes that compare velocities at the places of the particles."""
    drag = scene.drag
    if drag is None or at.step is None or at.resolution is None or at.sound_speed is None:
        return
    scheme: Scheme = SCHEMES[drag.scheme]
    for time in stopping_times(scene, at):
        if scheme.explicit:
            loaded = max(1.0, sum(dust.ratio for dust in scene.dust or ()))
            short = at.step / (time / loaded)
            worst = int(np.argmax(short))
            if short[worst] > 1:
                yield (
                    f'drag.scheme "{drag.scheme}" is explicit: {at.where(worst)} its steps are {short[worst]:.2g} '
                    f'times shorter than the gas\'s: take "{USUAL_SCHEME}"'
                )
        if scheme.damps:
            ratio = at.resolution / (at.sound_speed * time)
            worst = int(np.argmax(ratio))
            if ratio[worst] > 1:
                more = ratio[worst] ** scene.space.dimensions
                yield (
                    f"h is {ratio[worst]:.2g} times c_s t_stop {at.where(worst)}, above 1, where "
                    f'drag.scheme "{drag.scheme}" damps too much: take "{USUAL_SCHEME}", or gas.particles '
                    f"{more:.2g} times as many"
                )


def _drag_warnings(scene: Scene, at: Local) -> Iterator[str]:
    for i, time in enumerate(stopping_times(scene, at)):
        if at.omega is not None and (time * at.omega).max() > 10:
            stokes = time * at.omega
            where = at.where(int(np.argmax(stokes)))
            which = f"dust.{i}" if len(scene.dust or ()) > 1 else "dust"
            yield (
                f"{which}: St = {stokes.max():.3g} {where}, above 10, where gas hardly drags: "
                f"lower the stopping time {stokes.max() / 10:.2g} times, or leave out [drag]"
            )
    yield from _count_warnings(scene, at)


def _count_warnings(scene: Scene, at: Local) -> Iterator[str]:
    side = drag_cell_sides(scene, at)
    strong = sum(dust.ratio for dust in scene.dust or ()) > LOADED
    if side is None or not scene.drag or not strong or scene.drag.direction == "one-way":
        return
    counts, dim = drag_cell_counts(scene, at, side), scene.space.dimensions
    even = all(dust.placement == "even" for dust in scene.dust or ())
    cells = SCHEMES[scene.drag.scheme].cells
    wanted = (cells.few if even else cells.few_random) if dim == 2 else LONELY
    for name, count, few in zip(("gas", "dust"), counts, wanted, strict=True):
        least = count[count > 0].min(initial=few)  # where a population is absent nothing is to be counted
        if least < few:
            where = at.where(int(np.flatnonzero(count == least)[0]))
            more, wider = few / least, (max(few, 1) / least) ** (1 / dim)
            yield (
                f"{least:.3g} {name} particles in a drag cell {where}, below {few}: "
                f"raise {name}.particles {more:.3g} times, or drag.cell {wider:.3g} times"
            )
