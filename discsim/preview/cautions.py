"""What will run, but perhaps not as meant: each with its number and what to change."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from discsim.effects.self_gravity import KERNEL_KEYS
from discsim.formulas.smoothing import SMOOTHING
from discsim.initial import start_of
from discsim.numerics.layout import LOADED
from discsim.parts import SCHEMES, USUAL_SCHEME
from discsim.preview.derived import (
    Local,
    drag_cell_counts,
    drag_cell_sides,
    gas_mass,
    gas_step,
    grid,
    local,
    particle_count,
    resolution,
    resolution_by_mass,
    stopping_times,
)
from discsim.scene import Scene

if TYPE_CHECKING:
    from discsim.drag.base import Scheme

# In one dimension cells grow by eight for want of dust: gas between grains that are farther apart is not dragged along.
# One grain in a cell cures that.
LONELY = (0, 0.25)
# h over H: sound, and viscosity in shear, want half of one. Of a disc's edge, where h/H is largest and what is near it
# spreads and falls in whatever h is, a tenth of the gas may do with less, but none with an h above H.
FINE, COARSE, EDGE = 0.5, 1.0, 0.1
HEAVY = 3.0  # Toomre's Q, above which nothing is amplified (Toomre 1981), and a softening cannot change that
CLUMP = 6  # kernels' particles that a collapsing mass wants (Nelson 2006, abstract)
CELLS = 4  # of the grid, that it is to span


def warnings(scene: Scene) -> list[str]:
    """What will run, but perhaps not as meant: each with its number and what to change."""
    if scene.initial is None:
        return []
    at = local(scene)
    kinds = (_gas_warnings, _step_warnings, _start_warnings, _gravity_warnings, _collapse_warnings, _drag_warnings)
    return [line for kind in (*kinds, _scheme_warnings, _midplane_warnings) for line in kind(scene, at)]


def _gas_warnings(scene: Scene, at: Local) -> Iterator[str]:
    if not scene.gas or at.h is None or at.scale_height is None:
        return
    ratio = resolution(scene, at.h) / at.scale_height
    worst = int(np.argmax(ratio))
    where = f"h/H = {ratio[worst]:.2g} {at.where(worst)}"
    by_mass, below = resolution_by_mass(scene)
    coarse = 1.0 - float(np.interp(FINE, by_mass, below))
    most = float(np.interp(1.0 - EDGE, below, by_mass))  # of all gas but the coarsest
    needed = scene.gas.particles * max(ratio[worst] / COARSE, most / FINE) ** 2
    if ratio[worst] > COARSE:
        yield f"{where}, above {COARSE:g}: raise gas.particles to about {needed:.2g}"
    elif coarse > EDGE:
        yield (
            f"{where}, and above {FINE} for {coarse:.0%} of the gas, more than {EDGE:.0%}: "
            f"raise gas.particles to about {needed:.2g}"
        )


def _gravity_warnings(scene: Scene, at: Local) -> Iterator[str]:
    if not scene.self_gravity:
        return
    kernel = scene.self_gravity.kernel
    name = KERNEL_KEYS[kernel]
    length = getattr(scene.self_gravity, name)
    shown = scene.units.show(length, "length")
    for other in set(KERNEL_KEYS.values()) - {name}:
        if getattr(scene.self_gravity, other) is not None:
            yield f'self_gravity.{other} is not used by kernel "{kernel}": leave it out'
    cell = _grid_cell(scene)
    if length < cell:
        needed = math.ceil(max(scene.space.size) / length)
        yield (
            f"self_gravity.{name} = {shown} is {length / cell:.2g} of a grid cell: "
            f"raise space.cells to {needed}, or the {name} to {scene.units.show(cell, 'length')}"
        )
    if at.scale_height is not None and at.toomre_q is not None:
        # A softening is to be below H wherever self-gravity counts; a thickness is to be H somewhere.
        counts = at.toomre_q <= max(HEAVY, at.toomre_q.min())
        softest = np.where(counts, at.scale_height, np.inf).argmin()
        worst = int(softest if kernel == "plummer" else at.scale_height.argmax())
        height = at.scale_height[worst]
        if length > height:
            yield (
                f"self_gravity.{name} = {shown} is {length / height:.2g} H {at.where(worst)}, above 1: "
                f"lower it to {scene.units.show(height, 'length')}"
            )


def _grid_cell(scene: Scene) -> float:
    found = grid(scene)
    assert found is not None
    return found[0]


def _step_warnings(scene: Scene, at: Local) -> Iterator[str]:
    """A step of the scene's own that is beyond the gas's."""
    dt = scene.run.timestep
    if dt is None or at.h is None or at.sound_speed is None:
        return
    most = gas_step(scene, at)
    worst = int(np.argmin(most))
    if dt > most[worst]:
        given, best = (scene.units.show(time, "time") for time in (dt, most[worst]))
        yield (
            f"run.timestep = {given} is {dt / most[worst]:.2g} times what sound allows {at.where(worst)}: "
            f"lower it to {best}, or leave it out"
        )


def _midplane_warnings(scene: Scene, at: Local) -> Iterator[str]:
    if scene.external and scene.external.vertical_frequency > 0.0 and scene.space.boundary == "periodic":
        yield (
            "external.vertical_frequency pulls to the midplane 0, one end of a periodic space, from the other end too: "
            'set space.boundary to "open", or leave it out'
        )


def _start_warnings(scene: Scene, at: Local) -> Iterator[str]:
    told = start_of(scene).warnings
    if told is not None:
        yield from told(scene)


def _collapse_warnings(scene: Scene, at: Local) -> Iterator[str]:
    """What collapses, 2 c_s^2 / (G Sigma) wide and pi c_s^4 / (G^2 Sigma) heavy (Nelson 2006, sec. 2), where Q < 2."""
    if not scene.self_gravity or not scene.gas or at.sound_speed is None or at.h is None or scene.space.dimensions == 1:
        return
    length = 2 * at.sound_speed**2 / at.density
    mass = math.pi * at.sound_speed**4 / at.density
    heavy = np.ones(len(at.density), bool) if at.toomre_q is None else at.toomre_q < 2
    if not heavy.any():
        return
    worst = int(np.argmin(np.where(heavy, mass, np.inf)))
    where = at.where(worst)
    reach = math.pi * (SMOOTHING[scene.gas.kernel].support * scene.gas.eta) ** 2
    held = mass[worst] / (reach * gas_mass(scene) / particle_count(scene, scene.gas))
    if held < CLUMP:
        yield (
            f"a mass that collapses {where} has {held:.2g} times the particles of a kernel, below {CLUMP}: "
            f"raise gas.particles {CLUMP / held:.2g} times"
        )
    cell = _grid_cell(scene)
    if length[worst] < CELLS * cell:
        yield (
            f"what collapses {where} is {length[worst] / cell:.2g} grid cells wide, below {CELLS}: "
            f"raise space.cells {CELLS * cell / length[worst]:.2g} times"
        )


def _scheme_warnings(scene: Scene, at: Local) -> Iterator[str]:
    """Explicit steps, and schemes that compare velocities at the places of the particles."""
    drag = scene.drag
    if drag is None or at.h is None or at.sound_speed is None:
        return
    scheme: Scheme = SCHEMES[drag.scheme]
    for time in stopping_times(scene, at):
        if scheme.explicit:
            loaded = max(1.0, sum(dust.ratio for dust in scene.dust or ()))
            short = gas_step(scene, at) / (time / loaded)
            worst = int(np.argmax(short))
            if short[worst] > 1:
                yield (
                    f'drag.scheme "{drag.scheme}" is explicit: {at.where(worst)} its steps are {short[worst]:.2g} '
                    f'times shorter than the gas\'s: take "{USUAL_SCHEME}"'
                )
        if scheme.damps:
            ratio = resolution(scene, at.h) / (at.sound_speed * time)
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
