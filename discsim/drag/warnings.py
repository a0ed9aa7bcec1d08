"""Warnings about drag: settings that a run accepts but that probably give wrong results. Each names a remedy."""

from __future__ import annotations

import math
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

# Numbers of gas and dust particles per cell in one dimension below which a scene gets a warning. A cell without dust is
# enlarged at most eightfold; if its nearest grain is farther away, its gas feels no drag. One grain in every fourth
# cell prevents this.
ADEQUATE_IN_1D = (0, 0.25)
WIDE = 1.4  # side of a drag cell, in H, from which on the drift with `tsc` has an error of 20%


def drag_warnings(scene: Scene, at: GasSamples) -> Iterator[str]:
    """Yield the warnings about drag of a scene with [drag]; at: properties of the gas at sample points."""
    yield from _weak_drag(scene, at)
    yield from _wide_cells(scene, at)
    yield from _sparse_cells(scene, at)
    yield from _scheme_limits(scene, at)


def _weak_drag(scene: Scene, at: GasSamples) -> Iterator[str]:
    """Yield a warning for each population with Stokes numbers above 10, for which drag is weak."""
    for i, time in enumerate(laws.stopping_times(scene, at.density, at.thermal_speed, at.omega)):
        if at.omega is not None and (time * at.omega).max() > 10:
            stokes = time * at.omega
            where = at.where(int(np.argmax(stokes)))
            yield (
                f"{scene.dust_phrases[i]}: St = {stokes.max():.3g} {where}, above 10, where drag is negligible: "
                f"shorten the stopping time by a factor of {stokes.max() / 10:.2g}, or leave out [drag]"
            )


def _wide_cells(scene: Scene, at: GasSamples) -> Iterator[str]:
    """Yield a warning if drag cells of the default scheme are wider than WIDE scale heights."""
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
            cure = "remove drag.cell"
        elif at.cell is not None and at.cell > at.h[worst]:
            cells = max(scene.space.size) / at.cell
            cure = f"raise space.cells from {cells:.0f} to {math.ceil(narrower * cells)}"
        else:
            cure = f"raise gas.particles by a factor of {narrower**2:.3g}"
        yield (
            f"drag cells are {widths[worst]:.2g} H wide {at.where(worst)}, above {WIDE:g} H: the drift of small grains "
            f"there has a relative error of {error}: {cure}"
        )


def _sparse_cells(scene: Scene, at: GasSamples) -> Iterator[str]:
    """Yield warnings if drag cells have too few particles and the dust is massive enough to act on the gas."""
    massive = sum(dust.ratio for dust in scene.dust or ()) > NOISY_LOADING
    if not massive or scene.drag.direction == "one-way":
        return
    found, dim = at.in_drag_cells(), scene.space.dimensions
    if found is None:
        return
    even = all(dust.placement == "even" for dust in scene.dust or ())
    cells = SCHEMES[scene.drag.scheme].cells
    adequate = (cells.adequate if even else cells.adequate_random) if dim == 2 else ADEQUATE_IN_1D
    for name, count, enough in zip(("gas", "dust"), found[1:], adequate, strict=True):
        least = count[count > 0].min(initial=enough)  # points without any dust do not count
        if least < enough:
            where = at.where(int(np.flatnonzero(count == least)[0]))
            more, wider = enough / least, (max(enough, 1) / least) ** (1 / dim)
            yield (
                f"{least:.3g} {name} particles in a drag cell {where}, below {enough}: "
                f"raise {name}.particles by a factor of {more:.3g}, or drag.cell by {wider:.3g}"
            )


def _scheme_limits(scene: Scene, at: GasSamples) -> Iterator[str]:
    """Yield warnings about schemes with much shorter time steps than those of the gas, or with too strong damping."""
    drag = scene.drag
    if drag is None or at.step is None or at.resolution is None or at.sound_speed is None:
        return
    scheme: Scheme = SCHEMES[drag.scheme]
    for time in laws.stopping_times(scene, at.density, at.thermal_speed, at.omega):
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
