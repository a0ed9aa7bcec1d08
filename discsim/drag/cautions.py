"""Warnings about drag: settings that allow a run but are probably wrong, each with a number and a remedy."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from discsim.drag.width import drift_error
from discsim.numerics.layout import NOISY_LOADING
from discsim.parts import DEFAULT_SCHEME, SCHEMES
from discsim.physics import laws
from discsim.physics.local import GasSamples

if TYPE_CHECKING:
    from discsim.drag.base import Scheme
    from discsim.scene import Scene

# Smallest adequate numbers of gas and dust particles in a cell in one dimension. Cells without dust grow at most by a
# factor of 8, and gas between grains farther apart feels no drag. One grain in every fourth cell prevents this.
FEW_IN_1D = (0, 0.25)
WIDE = 1.4  # width in H of a drag cell of `tsc` in which the drift has an error of 20%


def warnings(scene: Scene, at: GasSamples) -> Iterator[str]:
    """Yield the warnings of a scene with [drag], for any model of the gas."""
    yield from _negligible_drag(scene, at)
    yield from _wide_cells(scene, at)
    yield from _sparse_cells(scene, at)
    yield from _scheme_limits(scene, at)


def _stopping_times(scene: Scene, at: GasSamples) -> list[np.ndarray]:
    """Return the stopping times (n,) of each population at the points of `at`; an empty list if undefined."""
    return laws.stopping_times(scene, at.density, at.thermal_speed, at.omega)


def _negligible_drag(scene: Scene, at: GasSamples) -> Iterator[str]:
    """Yield a warning of grains with large Stokes numbers, for which drag is negligible."""
    for i, time in enumerate(_stopping_times(scene, at)):
        if at.omega is not None and (time * at.omega).max() > 10:
            stokes = time * at.omega
            where = at.where(int(np.argmax(stokes)))
            which = f"dust.{i}" if len(scene.dust or ()) > 1 else "dust"
            yield (
                f"{which}: St = {stokes.max():.3g} {where}, above 10, where drag is negligible: "
                f"shorten the stopping time by a factor of {stokes.max() / 10:.2g}, or leave out [drag]"
            )


def _wide_cells(scene: Scene, at: GasSamples) -> Iterator[str]:
    """Yield a warning of drag cells that are wider than the scale height."""
    found, drag = at.in_drag_cells(), scene.drag
    if drag.scheme != DEFAULT_SCHEME or found is None or at.scale_height is None:
        return
    widths = found[0] / at.scale_height
    worst = int(np.argmax(widths))
    if widths[worst] > WIDE:
        off = drift_error(widths[worst])
        error = f"{off:.1g}" if off < 1.0 else "more than 1"
        narrower = widths[worst] / WIDE
        if drag.cell is not None or drag.cell_length is not None:
            cure = "leave out drag.cell"
        elif at.cell is not None and at.cell > at.h[worst]:
            cure = f"raise space.cells by a factor of {narrower:.3g}"
        else:
            cure = f"raise gas.particles by a factor of {narrower**2:.3g}"
        yield (
            f"drag cells are {widths[worst]:.2g} H wide {at.where(worst)}, above {WIDE:g}: the drift of small grains "
            f"there has a relative error of {error}: {cure}"
        )


def _sparse_cells(scene: Scene, at: GasSamples) -> Iterator[str]:
    """Yield warnings of drag cells with too few particles."""
    strong = sum(dust.ratio for dust in scene.dust or ()) > NOISY_LOADING
    if not strong or scene.drag.direction == "one-way":
        return
    found, dim = at.in_drag_cells(), scene.space.dimensions
    if found is None:
        return
    even = all(dust.placement == "even" for dust in scene.dust or ())
    cells = SCHEMES[scene.drag.scheme].cells
    wanted = (cells.few if even else cells.few_random) if dim == 2 else FEW_IN_1D
    for name, count, few in zip(("gas", "dust"), found[1:], wanted, strict=True):
        least = count[count > 0].min(initial=few)  # places without any dust do not count
        if least < few:
            where = at.where(int(np.flatnonzero(count == least)[0]))
            more, wider = few / least, (max(few, 1) / least) ** (1 / dim)
            yield (
                f"{least:.3g} {name} particles in a drag cell {where}, below {few}: "
                f"raise {name}.particles by a factor of {more:.3g}, or drag.cell by {wider:.3g}"
            )


def _scheme_limits(scene: Scene, at: GasSamples) -> Iterator[str]:
    """Yield warnings of explicit schemes with short steps, and of schemes that damp waves too much."""
    drag = scene.drag
    if drag is None or at.step is None or at.resolution is None or at.sound_speed is None:
        return
    scheme: Scheme = SCHEMES[drag.scheme]
    for time in _stopping_times(scene, at):
        if scheme.explicit:
            loaded = max(1.0, sum(dust.ratio for dust in scene.dust or ()))
            short = at.step / (time / loaded)
            worst = int(np.argmax(short))
            if short[worst] > 1:
                yield (
                    f'drag.scheme "{drag.scheme}" is explicit: {at.where(worst)} its time steps are {short[worst]:.2g} '
                    f'times shorter than those of the gas: use "{DEFAULT_SCHEME}"'
                )
        if scheme.damps:
            ratio = at.resolution / (at.sound_speed * time)
            worst = int(np.argmax(ratio))
            if ratio[worst] > 1:
                more = ratio[worst] ** scene.space.dimensions
                yield (
                    f"h is {ratio[worst]:.2g} times c_s t_stop {at.where(worst)}, above 1, where "
                    f'drag.scheme "{drag.scheme}" damps too much: use "{DEFAULT_SCHEME}", or raise gas.particles '
                    f"by a factor of {more:.2g}"
                )
