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
from typing import Any, NamedTuple

from discsim.effects import effect_classes
from discsim.effects.base import Counts
from discsim.initial import start_of, start_time
from discsim.physics.centre import kepler_omega
from discsim.preview import learnt
from discsim.preview.derived import grid, grid_bytes, local, particle_count
from discsim.scene import Scene

SHRINK = 0.85  # of the smooth start's shortest step is what noise and spreading edges leave
BYTES = {"gas": 600, "dust": 180}  # a particle, with what a step needs
BASE = 250e6  # the interpreter with its libraries
# A run tells the machine's speed that takes so many CPU seconds, at least this share of its wall time (compilation is
# in that), and, by the stored figures, so many seconds a step, of which calls and loops of Python are a tenth or less.
LONG, QUIET, HEAVY_STEP = 20.0, 0.7, 0.02
KEPT, OTHERS = 7, 50  # runs that are kept of this machine, and of others that share the folder


class Forecast(NamedTuple):
    """Steps of a run, CPU seconds of one, bytes, and CPU seconds in which the start settles before t = 0."""

    steps: float
    step_seconds: float
    memory: float
    relaxation: float = 0.0

    @property
    def seconds(self) -> float:
        return self.steps * self.step_seconds + self.relaxation


def forecast(scene: Scene) -> Forecast | None:
    """The forecast of a run in two dimensions; None in one, or where the step is not known beforehand."""
    if scene.initial is None or scene.space.dimensions == 1:
        return None
    steps = _steps(scene)
    if steps is None:
        return None
    gas = particle_count(scene, scene.gas) if scene.gas else 0
    dust = sum(particle_count(scene, population) for population in scene.dust or ())
    memory = BASE + BYTES["gas"] * gas + BYTES["dust"] * dust
    found = grid(scene)
    if found is not None:
        memory += grid_bytes(scene, found[1])
    counts = Counts(gas, dust, math.prod(found[1]) if found is not None else 0)
    nanoseconds = sum(effect.nanoseconds(scene, counts) for effect in effect_classes(scene).values())
    relaxing = _steps_of_relaxation(scene) * effect_classes(scene)["gas"].nanoseconds(scene, counts) if gas else 0.0
    second = 1e-9 * slowness()
    return Forecast(steps, second * nanoseconds, memory, second * relaxing)


def _steps(scene: Scene) -> float | None:
    at, run, start = local(scene), scene.run, start_of(scene)
    length = run.until - start_time(scene)
    if run.timestep is not None:
        return length / run.timestep
    if not start.known_step:
        return None
    of_effects = min(effect.expected_limit(scene) for effect in effect_classes(scene).values())
    if at.step is not None:
        return length / (run.courant * min(SHRINK * float(at.step.min()), of_effects))
    if scene.star and start.edges is not None:
        orbit = 1.0 / float(kepler_omega(scene, start.edges(scene)[0]))
        return length / (run.courant * min(orbit, of_effects))
    return None


def _steps_of_relaxation(scene: Scene) -> float:
    """Steps before t = 0, in which rings of gas settle (`run/relaxation.py`)."""
    orbits, step = getattr(scene.initial, "relax", 0.0), local(scene).step
    if orbits == 0.0 or step is None:
        return 0.0
    orbit = 2.0 * math.pi / float(kepler_omega(scene, scene.initial.reference_radius))
    return orbits * orbit / (scene.run.courant * SHRINK * float(step.min()))


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
    expected = forecast(scene)
    if expected is None or cpu_seconds < LONG or cpu_seconds < QUIET * wall_seconds:
        return
    stored = expected.step_seconds / slowness()
    if stored < HEAVY_STEP:
        return
    here, runs = platform.node(), _kept()
    own = [run for run in runs if run["machine"] == here]
    others = [run for run in runs if run["machine"] != here]
    own.append({"machine": here, "slowness": cpu_seconds / steps / stored})
    learnt.keep("speed", others[-OTHERS:] + own[-KEPT:])
