"""What a run will take: number of steps, CPU time and memory, from stored figures and the last long runs here.

The figures are CPU nanoseconds of a particle, cell or neighbour in a step, in the file of each effect and drag scheme,
from `python analysis/throughput.py` (those of pairs and of a given disc from `costs.csv` of runs with such a scheme and
with [background]); another machine differs by a factor, which long runs that have ended leave for the next forecast
(`learn`).
"""

from __future__ import annotations

import math
import platform
import statistics
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from discsim.effects import effect_classes
from discsim.effects.base import Counts
from discsim.initial import start_time
from discsim.parts import Lazy
from discsim.physics.centre import kepler_omega
from discsim.physics.local import PHASES, Expected
from discsim.preview import learnt
from discsim.preview.derived import grid, grid_bytes, particle_count
from discsim.preview.outlook import Outlooks
from discsim.scene import Scene

companion_effect = Lazy("discsim.effects.companion")

TIMES = 64  # of a run, at which its steps are expected
BYTES = {"gas": 600, "dust": 180}  # a particle, with what a step needs
BASE = 250e6  # the interpreter with its libraries
# A run tells the machine's speed that takes so many CPU seconds, at least this share of its wall time (compilation is
# in that), and, by the stored figures, so many seconds a step, of which calls and loops of Python are a tenth or less.
LONG, QUIET, HEAVY_STEP = 20.0, 0.7, 0.02
KEPT, OTHERS = 7, 50  # runs that are kept of this machine, and of others that share the folder


class Steps(NamedTuple):
    """Steps of a run; the effect that sets most of them, where it does, and its share of them."""

    number: float
    by: str
    where: str = ""
    share: float = 1.0


class Forecast(NamedTuple):
    """Steps of a run, CPU seconds of one, bytes, and CPU seconds in which the start settles before t = 0."""

    steps: Steps
    step_seconds: float
    memory: float
    relaxation: float = 0.0

    @property
    def seconds(self) -> float:
        return self.steps.number * self.step_seconds + self.relaxation


def forecast(scene: Scene) -> Forecast | None:
    """The forecast of a run; None of the caller's own particles, and where nothing is known to limit the step."""
    if scene.initial is None:
        return None
    steps = expected_steps(scene)
    if not math.isfinite(steps.number):
        return None
    gas = effect_classes(scene)["gas"].nanoseconds(scene, _counts(scene)) if scene.gas else 0.0
    relaxing = 1e-9 * slowness() * _steps_of_relaxation(scene) * gas
    return Forecast(steps, step_seconds(scene), memory(scene), relaxing)


def step_seconds(scene: Scene) -> float:
    """CPU seconds of a step on this machine."""
    counts = _counts(scene)
    return 1e-9 * slowness() * sum(effect.nanoseconds(scene, counts) for effect in effect_classes(scene).values())


def memory(scene: Scene) -> float:
    """Bytes of a run."""
    counts, found = _counts(scene), grid(scene)
    particles = BYTES["gas"] * counts.gas + BYTES["dust"] * counts.dust
    return BASE + particles + (0.0 if found is None else grid_bytes(scene, found[1]))


def _counts(scene: Scene) -> Counts:
    gas = particle_count(scene, scene.gas) if scene.gas else 0
    dust = sum(particle_count(scene, population) for population in scene.dust or ())
    found = grid(scene)
    return Counts(gas, dust, math.prod(found[1]) if found is not None else 0)


def expected_steps(scene: Scene, until: float | None = None, without: str | None = None) -> Steps:
    """Steps from the start to a time, by default the end: the integral of dt over the least limit of all effects.

    without: an effect whose limit is left out.
    """
    run, begins = scene.run, start_time(scene)
    length = (run.until if until is None else until) - begins
    if run.timestep is not None:
        return Steps(length / run.timestep, "run.timestep")
    effects, outlooks = effect_classes(scene), Outlooks(scene)
    names = [name for name in effects if name != without]
    rates, least = np.zeros(len(names)), [Expected()] * len(names)  # mean of 1 / step where each sets it
    for time in begins + length * (np.arange(TIMES) + 0.5) / TIMES:
        outlook = outlooks.at(float(time))
        found = [effects[name].expected_limit(scene, outlook) for name in names]
        steps = np.array([np.broadcast_to(one.step, PHASES) for one in found])
        sets = np.argmin(steps, axis=0)
        np.add.at(rates, sets, 1.0 / steps[sets, np.arange(PHASES)] / PHASES / TIMES)
        for k in np.unique(sets):
            least[k] = min(least[k], found[k]._replace(step=float(steps[k].min())))
    by, total = int(np.argmax(rates)), float(rates.sum())
    if total == 0.0:
        return Steps(math.inf, "")
    return Steps(max(length / run.courant * total, 1.0), names[by], least[by].where, float(rates[by]) / total)


def close_pairs(scene: Scene) -> Iterator[str]:
    """Warn of companions far within the disc whose orbits set the steps of the run."""
    found = [
        (k, scene.star.mass + companion.mass, differs)
        for k, companion in enumerate(scene.table("companion") or (), 1)
        if (differs := companion_effect.quadrupole_of_pair(scene, companion)) is not None
    ]
    if not found or (steps := expected_steps(scene)).by != "companion":
        return
    times = steps.number / expected_steps(scene, without="companion").number
    for k, mass, differs in found:
        yield (
            f"the orbit of companion {k} makes about {times:.1g} times as many steps, and the pull of the pair at "
            f"the inner edge differs from that of one star by {differs:.1g} of it: leave the companion out, and "
            f"set star.mass = {scene.units.show(mass, 'mass')}"
        )


def _steps_of_relaxation(scene: Scene) -> float:
    """Steps before t = 0, in which rings of gas settle (`run/relaxation.py`)."""
    orbits = getattr(scene.initial, "relax", 0.0)
    if orbits == 0.0:
        return 0.0
    outlook, effects = Outlooks(scene).at(start_time(scene)), effect_classes(scene)
    # Rings that settle have no noise yet.
    gas = effects["gas"].expected_limit(scene, replace(outlook, nearest=math.inf))
    step = min(float(np.min(gas.step)), 1.0 / float(kepler_omega(scene, outlook.inner)))
    orbit = 2.0 * math.pi / float(kepler_omega(scene, scene.initial.reference_radius))
    return orbits * orbit / (scene.run.courant * step)


def _kept() -> list[dict[str, Any]]:
    """What runs have left: of each its machine and its slowness."""
    return learnt.kept("speed", lambda run: isinstance(run.get("machine"), str) and 0.05 < run["slowness"] < 50.0)


def known_runs() -> list[float]:
    """CPU time that the last long runs on this machine took, each over that of the stored figures."""
    here = platform.node()
    return [run["slowness"] for run in _kept() if run["machine"] == here]


def slowness() -> float:
    """CPU time that this machine takes over that of the stored figures: the median of its last long runs; 1 without."""
    return statistics.median(known_runs() or [1.0])


def learn(scene: Scene, steps: int, cpu_seconds: float, wall_seconds: float) -> None:
    """Keep what `steps` steps took here, for the next forecast, if that says anything of the machine.

    It does where the run is long, is hardly kept waiting by others, and where particles and cells are what a step
    takes. wall_seconds: of the whole run. Where nothing can be kept, nothing is.
    """
    if scene.initial is None or cpu_seconds < LONG or cpu_seconds < QUIET * wall_seconds:
        return
    stored = step_seconds(scene) / slowness()
    if stored < HEAVY_STEP:
        return
    here, runs = platform.node(), _kept()
    own = [run for run in runs if run["machine"] == here]
    others = [run for run in runs if run["machine"] != here]
    own.append({"machine": here, "slowness": cpu_seconds / steps / stored})
    learnt.keep("speed", others[-OTHERS:] + own[-KEPT:])
