"""Forecast of a run: number of steps, CPU time and memory, from stored costs and the last long runs on this machine.

Stored costs are CPU nanoseconds per particle, cell or neighbour and step, in the module of each effect and drag scheme.
They are results of `python analysis/throughput.py`; those of pairs and of a given disc are from `costs.csv` of runs
with such a scheme and with [background]. The speed of this machine relative to them is stored by each long run
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
from discsim.preview import stored_runs
from discsim.preview.derived import grid, grid_bytes, particle_count
from discsim.preview.outlook import Outlooks
from discsim.scene import Scene

companion_effect = Lazy("discsim.effects.companion")

TIMES = 64  # times of a run at which its step is estimated
BYTES = {"gas": 600, "dust": 180}  # memory per particle, with temporary arrays of a step
BASE = 250e6  # memory of the interpreter with its libraries
# A run measures the speed of the machine if it takes at least LONG CPU seconds, a CPU time of at least QUIET of its
# wall time (which includes compilation), and by stored costs HEAVY_STEP seconds per step. Python's share of such a step
# is at most 10%.
LONG, QUIET, HEAVY_STEP = 20.0, 0.7, 0.02
KEPT, OTHERS = 7, 50  # stored runs of this machine, and of others that share the folder


class Steps(NamedTuple):
    """Number of steps of a run; the effect that sets most of them, the place where it does, and its share of steps."""

    number: float
    by: str
    where: str = ""
    share: float = 1.0


class Forecast(NamedTuple):
    """Steps of a run, CPU seconds per step, memory in bytes, and CPU seconds of the relaxation before t = 0."""

    steps: Steps
    step_seconds: float
    memory: float
    relaxation: float = 0.0

    @property
    def seconds(self) -> float:
        return self.steps.number * self.step_seconds + self.relaxation


def forecast(scene: Scene) -> Forecast | None:
    """Return the forecast of a run; None for particles passed by the caller, or if no effect limits the step."""
    if scene.initial is None:
        return None
    steps = expected_steps(scene)
    if not math.isfinite(steps.number):
        return None
    gas = effect_classes(scene)["gas"].nanoseconds(scene, _counts(scene)) if scene.gas else 0.0
    relaxing = 1e-9 * slowness() * _steps_of_relaxation(scene) * gas
    return Forecast(steps, step_seconds(scene), memory(scene), relaxing)


def step_seconds(scene: Scene) -> float:
    """Return the CPU seconds of a step on this machine."""
    counts = _counts(scene)
    return 1e-9 * slowness() * sum(effect.nanoseconds(scene, counts) for effect in effect_classes(scene).values())


def memory(scene: Scene) -> float:
    """Return the memory of a run in bytes."""
    counts, found = _counts(scene), grid(scene)
    particles = BYTES["gas"] * counts.gas + BYTES["dust"] * counts.dust
    return BASE + particles + (0.0 if found is None else grid_bytes(scene, found[1]))


def _counts(scene: Scene) -> Counts:
    gas = particle_count(scene, scene.gas) if scene.gas else 0
    dust = sum(particle_count(scene, population) for population in scene.dust or ())
    found = grid(scene)
    return Counts(gas, dust, math.prod(found[1]) if found is not None else 0)


def expected_steps(scene: Scene, until: float | None = None, without: str | None = None) -> Steps:
    """Return the steps from the start to a time, by default the end: the integral of dt over the least limit.

    without: name of an effect whose limit is ignored.
    """
    run, begins = scene.run, start_time(scene)
    length = (run.until if until is None else until) - begins
    if run.timestep is not None:
        return Steps(length / run.timestep, "run.timestep")
    effects, outlooks = effect_classes(scene), Outlooks(scene)
    names = [name for name in effects if name != without]
    rates, least = np.zeros(len(names)), [Expected()] * len(names)  # mean of 1 / step while each effect sets it
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
    """Yield warnings of companions far inside the inner edge whose orbits set the steps of the run."""
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
            f"the orbit of companion {k} needs about {times:.1g} times as many steps, but the gravity of the pair at "
            f"the inner edge differs from that of a single star only by a fraction of {differs:.1g}: leave the "
            f"companion out, and set star.mass = {scene.units.show(mass, 'mass')}"
        )


def _steps_of_relaxation(scene: Scene) -> float:
    """Return the number of steps before t = 0, in which rings of gas relax (`run/relaxation.py`)."""
    orbits = getattr(scene.initial, "relax", 0.0)
    if orbits == 0.0:
        return 0.0
    outlook, effects = Outlooks(scene).at(start_time(scene)), effect_classes(scene)
    # Rings have no particle noise during the relaxation.
    gas = effects["gas"].expected_limit(scene, replace(outlook, nearest=math.inf))
    step = min(float(np.min(gas.step)), 1.0 / float(kepler_omega(scene, outlook.inner)))
    orbit = 2.0 * math.pi / float(kepler_omega(scene, scene.initial.reference_radius))
    return orbits * orbit / (scene.run.courant * step)


def _kept() -> list[dict[str, Any]]:
    """Return the stored runs, each with its machine and its slowness."""
    return stored_runs.kept("speed", lambda run: isinstance(run.get("machine"), str) and 0.05 < run["slowness"] < 50.0)


def known_runs() -> list[float]:
    """Return the CPU time of each of the last long runs on this machine, over that by stored costs."""
    here = platform.node()
    return [run["slowness"] for run in _kept() if run["machine"] == here]


def slowness() -> float:
    """Return the CPU time of this machine over that by stored costs: the median of its last long runs, or 1."""
    return statistics.median(known_runs() or [1.0])


def learn(scene: Scene, steps: int, cpu_seconds: float, wall_seconds: float) -> None:
    """Store the CPU time of `steps` steps for the next forecast, if the run measures the speed of this machine.

    It does if it is long, rarely waits for other processes, and if work on particles and cells dominates its steps.
    wall_seconds: of the whole run. Nothing is stored if the cache cannot be written.
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
    stored_runs.keep("speed", others[-OTHERS:] + own[-KEPT:])
