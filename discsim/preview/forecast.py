"""Forecast of a run: number of steps, CPU time and memory, from stored costs and the last long runs on this machine.

Stored costs are CPU nanoseconds per step and per particle, cell or neighbour, in the module of each effect and drag
scheme. They are results of `python analysis/throughput.py`, except those of drag between pairs and of [background],
which are from `costs.csv` of runs. Each long run stores the slowness of this machine (`store_slowness`): its CPU time
over the CPU time by stored costs.
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

SAMPLE_TIMES = 64  # times of a run at which its step is estimated
BYTES_PER_PARTICLE = {"gas": 600, "dust": 180}  # memory per particle, with temporary arrays of a step
BASE_BYTES = 250e6  # memory of the interpreter with its libraries
# Smallest CPU time of a run that measures the speed of the machine, smallest fraction of CPU time in its wall time
# (which includes compilation), and smallest CPU seconds of its steps by stored costs. Python's share of such a step is
# at most 10%.
MIN_CPU_SECONDS, MIN_CPU_FRACTION, MIN_STEP_SECONDS = 20.0, 0.7, 0.02
MAX_STORED_HERE = 7  # largest number of stored runs of this machine
MAX_STORED_ELSEWHERE = 50  # largest number of stored runs of other machines with the same cache directory


class Steps(NamedTuple):
    """Number of steps of a run, and the effect that limits most of them.

    by: name of this effect. where: the place with its shortest limit, as text. share: fraction of steps it limits.
    """

    number: float
    by: str
    where: str = ""
    share: float = 1.0


class Forecast(NamedTuple):
    """Forecast of a run: its steps, CPU seconds per step, memory in bytes, and CPU seconds of the relaxation.

    The relaxation of gas comes before t = 0 (`initial.relax`).
    """

    steps: Steps
    step_seconds: float
    memory: float
    relaxation: float = 0.0

    @property
    def seconds(self) -> float:
        return self.steps.number * self.step_seconds + self.relaxation


def forecast(scene: Scene) -> Forecast | None:
    """Return the forecast of a run; None for particles that the caller passes, or if no effect limits the step."""
    if scene.initial is None:
        return None
    steps = expected_steps(scene)
    if not math.isfinite(steps.number):
        return None
    gas = effect_classes(scene)["gas"].nanoseconds(scene, _particle_and_cell_counts(scene)) if scene.gas else 0.0
    relaxing = 1e-9 * slowness() * _relaxation_steps(scene) * gas
    return Forecast(steps, step_seconds(scene), memory(scene), relaxing)


def step_seconds(scene: Scene) -> float:
    """Return the CPU seconds of a step on this machine."""
    counts = _particle_and_cell_counts(scene)
    return 1e-9 * slowness() * sum(effect.nanoseconds(scene, counts) for effect in effect_classes(scene).values())


def memory(scene: Scene) -> float:
    """Return the memory of a run in bytes."""
    counts, found = _particle_and_cell_counts(scene), grid(scene)
    particles = BYTES_PER_PARTICLE["gas"] * counts.gas + BYTES_PER_PARTICLE["dust"] * counts.dust
    return BASE_BYTES + particles + (0.0 if found is None else grid_bytes(scene, found[1]))


def _particle_and_cell_counts(scene: Scene) -> Counts:
    gas = particle_count(scene, scene.gas) if scene.gas else 0
    dust = sum(particle_count(scene, population) for population in scene.dust or ())
    found = grid(scene)
    return Counts(gas, dust, math.prod(found[1]) if found is not None else 0)


def expected_steps(scene: Scene, until: float | None = None, without: str | None = None) -> Steps:
    """Return the steps from the start to the time `until`: the integral of dt / (Courant factor * shortest limit).

    until: by default the end of the run. without: name of an effect whose limit is ignored.
    """
    run, begins = scene.run, start_time(scene)
    length = (run.until if until is None else until) - begins
    if run.timestep is not None:
        return Steps(length / run.timestep, "run.timestep")
    effects, outlooks = effect_classes(scene), Outlooks(scene)
    names = [name for name in effects if name != without]
    rates, least = np.zeros(len(names)), [Expected()] * len(names)  # mean of 1 / step while each effect sets it
    for time in begins + length * (np.arange(SAMPLE_TIMES) + 0.5) / SAMPLE_TIMES:
        outlook = outlooks.at(float(time))
        found = [effects[name].expected_limit(scene, outlook) for name in names]
        steps = np.array([np.broadcast_to(one.step, PHASES) for one in found])
        sets = np.argmin(steps, axis=0)
        np.add.at(rates, sets, 1.0 / steps[sets, np.arange(PHASES)] / PHASES / SAMPLE_TIMES)
        for k in np.unique(sets):
            least[k] = min(least[k], found[k]._replace(step=float(steps[k].min())))
    by, total = int(np.argmax(rates)), float(rates.sum())
    if total == 0.0:
        return Steps(math.inf, "")
    return Steps(max(length / run.courant * total, 1.0), names[by], least[by].where, float(rates[by]) / total)


def close_pair_warnings(scene: Scene) -> Iterator[str]:
    """Yield a warning for each companion far inside the inner edge, if orbits of companions limit most steps."""
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


def _relaxation_steps(scene: Scene) -> float:
    """Return the number of steps before t = 0 in which the gas relaxes (`run/relaxation.py`)."""
    orbits = getattr(scene.initial, "relax", 0.0)
    if orbits == 0.0:
        return 0.0
    outlook, effects = Outlooks(scene).at(start_time(scene)), effect_classes(scene)
    # Rings have no particle noise during the relaxation.
    gas = effects["gas"].expected_limit(scene, replace(outlook, nearest=math.inf))
    step = min(float(np.min(gas.step)), 1.0 / float(kepler_omega(scene, outlook.inner)))
    orbit = 2.0 * math.pi / float(kepler_omega(scene, scene.initial.reference_radius))
    return orbits * orbit / (scene.run.courant * step)


def _stored_runs() -> list[dict[str, Any]]:
    """Return the stored runs of all machines, each with its `machine` and its `slowness`."""
    return stored_runs.read_list(
        "speed", lambda run: isinstance(run.get("machine"), str) and 0.05 < run["slowness"] < 50.0
    )


def known_runs() -> list[float]:
    """Return the slowness of each of the last long runs on this machine: CPU time over CPU time by stored costs."""
    here = platform.node()
    return [run["slowness"] for run in _stored_runs() if run["machine"] == here]


def slowness() -> float:
    """Return the median slowness of the last long runs on this machine (`known_runs`), or 1 without such runs."""
    return statistics.median(known_runs() or [1.0])


def store_slowness(scene: Scene, steps: int, cpu_seconds: float, wall_seconds: float) -> None:
    """Store the slowness of this machine for later forecasts, if the finished run is suited to measure it.

    A suited run is long, rarely waits for other processes, and has steps dominated by work on particles and cells.
    steps, cpu_seconds: number of steps and CPU time of all of them. wall_seconds: wall time of the whole run.
    Nothing is stored if the cache cannot be written.
    """
    if scene.initial is None or cpu_seconds < MIN_CPU_SECONDS or cpu_seconds < MIN_CPU_FRACTION * wall_seconds:
        return
    stored = step_seconds(scene) / slowness()
    if stored < MIN_STEP_SECONDS:
        return
    here, runs = platform.node(), _stored_runs()
    own = [run for run in runs if run["machine"] == here]
    others = [run for run in runs if run["machine"] != here]
    own.append({"machine": here, "slowness": cpu_seconds / steps / stored})
    stored_runs.write_list("speed", others[-MAX_STORED_ELSEWHERE:] + own[-MAX_STORED_HERE:])
