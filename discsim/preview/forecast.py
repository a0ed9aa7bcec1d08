"""Forecast of a run: number of steps, CPU time and memory.

The module of each effect and drag scheme has reference costs: CPU nanoseconds per step and per particle, cell or
neighbour. The costs are results of `python analysis/throughput.py`, except those of drag between pairs and of
[background], which are from `costs.csv` of runs. Each long run stores the slowness of its machine
(`store_slowness`): its CPU time, divided by the CPU time according to the reference costs. Forecasts multiply by the
slowness of the last long runs.
"""

from __future__ import annotations

import math
import os
import platform
import statistics
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from discsim.effects import effect_classes
from discsim.effects.base import Counts
from discsim.initial import start_time
from discsim.parts import EOS, Lazy
from discsim.physics.centre import kepler_omega
from discsim.physics.local import PHASES, Expected
from discsim.preview import stored_runs
from discsim.preview.derived import grid, grid_bytes, particle_count
from discsim.preview.evolution import EstimatedEvolution
from discsim.scene import Scene

companion_effect = Lazy("discsim.effects.companion")

SAMPLE_TIMES = 64  # number of times of a run at which its time step is estimated
BYTES_PER_GRAIN = 180  # memory per dust particle, with temporary arrays of a step; of gas: `GasModel.gas_bytes`
BASE_BYTES = 250e6  # memory of the interpreter with its libraries
# A run measures the speed of the machine if it has at least this CPU time, this ratio of CPU time to wall time (which
# includes compilation), and this CPU time of a step by reference costs (Python takes at most 10% of such a step).
MIN_CPU_SECONDS, MIN_CPU_FRACTION, MIN_STEP_SECONDS = 20.0, 0.7, 0.02
MAX_STORED_HERE = 7  # largest number of stored runs of this machine
MAX_STORED_ELSEWHERE = 50  # largest number of stored runs of other machines with the same cache directory


class Steps(NamedTuple):
    """Number of steps of a run, and the effect that limits most of them.

    limiter: name of this effect, or "run.timestep". where: place at which its limit is shortest, as text, like "at
    12 au". share: fraction of the steps that this effect limits.
    """

    number: float
    limiter: str
    where: str = ""
    share: float = 1.0


class Forecast(NamedTuple):
    """Forecast of a run: its steps, CPU seconds per step, memory in bytes, and CPU seconds of the relaxation.

    relaxation: CPU time in which the gas relaxes before t = 0 (`initial.relax`).
    """

    steps: Steps
    step_seconds: float
    memory: float
    relaxation: float = 0.0

    @property
    def seconds(self) -> float:
        """CPU seconds of the run."""
        return self.steps.number * self.step_seconds + self.relaxation


def forecast(scene: Scene) -> Forecast | None:
    """Return the forecast of a run; None if the user passes the particles, or if no effect limits the time step."""
    if scene.initial is None:
        return None
    steps = expected_steps(scene)
    if not math.isfinite(steps.number):
        return None
    gas = effect_classes(scene)["gas"].nanoseconds(scene, _particle_and_cell_counts(scene)) if scene.gas else 0.0
    relaxation = 1e-9 * slowness() * _relaxation_steps(scene) * gas
    return Forecast(steps, step_seconds(scene), memory_bytes(scene), relaxation)


def step_seconds(scene: Scene) -> float:
    """Return the estimated CPU seconds of a step on this machine."""
    counts = _particle_and_cell_counts(scene)
    return 1e-9 * slowness() * sum(effect.nanoseconds(scene, counts) for effect in effect_classes(scene).values())


def memory_bytes(scene: Scene) -> float:
    """Return the estimated memory of a run in bytes.

    The grid is not counted in 1D, nor if the user passes the particles.
    """
    gas, dust = _particle_counts(scene)
    per_gas = scene.model.gas_bytes[scene.gas is not None and EOS[scene.gas.eos.kind].holds_heat]
    particles = per_gas * gas + BYTES_PER_GRAIN * dust
    found = grid(scene) if scene.initial is not None and scene.space.dimensions == 2 else None
    return BASE_BYTES + particles + (0.0 if found is None else grid_bytes(scene, found[1]))


def memory_warnings(scene: Scene) -> Iterator[str]:
    """Yield a warning if a run of the scene needs more memory than the machine has."""
    needed, available = memory_bytes(scene), os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if needed > available:
        yield (
            f"memory: the run needs about {needed / 2**30:.3g} GiB, and this machine has {available / 2**30:.3g} GiB; "
            "choose fewer particles or cells"
        )


def _particle_counts(scene: Scene) -> tuple[int, int]:
    """Return the numbers of gas and of dust particles."""
    gas = particle_count(scene, scene.gas) if scene.gas else 0
    return gas, sum(particle_count(scene, population) for population in scene.dust or ())


def _particle_and_cell_counts(scene: Scene) -> Counts:
    """Return the numbers of gas particles, dust particles and grid cells, on which the CPU time of effects depends."""
    found = grid(scene)
    return Counts(*_particle_counts(scene), math.prod(found[1]) if found is not None else 0)


def expected_steps(scene: Scene, until: float | None = None, without: str | None = None) -> Steps:
    """Return the estimated steps of a run: the time integral of 1 / (Courant factor * shortest limit of an effect).

    until: time at which the integral ends; None: the end of the run. without: name of an effect whose limit does not
    count.
    """
    run, begin = scene.run, start_time(scene)
    length = (run.until if until is None else until) - begin
    if run.timestep is not None:
        return Steps(length / run.timestep, "run.timestep")
    effects, evolution = effect_classes(scene), EstimatedEvolution(scene)
    names = [name for name in effects if name != without]
    # Mean over the run of 1 / limit while each effect has the shortest limit, and the shortest limit of each effect.
    rates, shortest = np.zeros(len(names)), [Expected()] * len(names)
    for time in begin + length * (np.arange(SAMPLE_TIMES) + 0.5) / SAMPLE_TIMES:
        outlook = evolution.state_at(float(time))
        found = [effects[name].expected_limit(scene, outlook) for name in names]
        limits = np.array([np.broadcast_to(one.step, PHASES) for one in found])
        limiters = np.argmin(limits, axis=0)
        np.add.at(rates, limiters, 1.0 / limits[limiters, np.arange(PHASES)] / PHASES / SAMPLE_TIMES)
        for k in np.unique(limiters):
            shortest[k] = min(shortest[k], found[k]._replace(step=float(limits[k].min())))
    main, total = int(np.argmax(rates)), float(rates.sum())
    if total == 0.0:
        return Steps(math.inf, "")
    return Steps(max(length / run.courant * total, 1.0), names[main], shortest[main].where, float(rates[main]) / total)


def close_pair_warnings(scene: Scene) -> Iterator[str]:
    """Yield a warning for each companion far inside the inner edge, if orbits of companions limit most steps."""
    differences = {}
    for k, companion in enumerate(scene.table("companion") or (), 1):
        if (difference := companion_effect.quadrupole_of_pair(scene, companion)) is not None:
            differences[k] = scene.star.mass + companion.mass, difference
    if not differences or (steps := expected_steps(scene)).limiter != "companion":
        return
    factor = steps.number / expected_steps(scene, without="companion").number
    for k, (mass, difference) in differences.items():
        yield (
            f"the orbit of companion {k} needs about {factor:.1g} times as many steps, but the gravity of the pair at "
            f"the inner edge differs from that of a single star only by a fraction of {difference:.1g}: remove the "
            f"companion, and set star.mass = {scene.units.show(mass, 'mass')}"
        )


def _relaxation_steps(scene: Scene) -> float:
    """Return the estimated number of steps in which the gas relaxes before t = 0 (`run/relaxation.py`)."""
    orbits = getattr(scene.initial, "relax", 0.0)
    if orbits == 0.0:
        return 0.0
    outlook, effects = EstimatedEvolution(scene).state_at(start_time(scene)), effect_classes(scene)
    # Rings have no particle noise during the relaxation.
    gas = effects["gas"].expected_limit(scene, replace(outlook, nearest=math.inf))
    step = min(float(np.min(gas.step)), 1.0 / float(kepler_omega(scene, outlook.inner)))
    orbit = 2.0 * math.pi / float(kepler_omega(scene, scene.initial.reference_radius))
    return orbits * orbit / (scene.run.courant * step)


def _stored_runs() -> list[dict[str, Any]]:
    """Return the stored runs of all machines, each as a dict with the keys `machine` and `slowness`."""
    return stored_runs.read_list(
        "speed", lambda run: isinstance(run.get("machine"), str) and 0.05 < run["slowness"] < 50.0
    )


def stored_slowness() -> list[float]:
    """Return the slowness of each of the last long runs on this machine: CPU time over CPU time by reference costs."""
    here = platform.node()
    return [run["slowness"] for run in _stored_runs() if run["machine"] == here]


def slowness() -> float:
    """Return the median slowness of the last long runs on this machine, or 1 without such runs."""
    return statistics.median(stored_slowness() or [1.0])


def store_slowness(scene: Scene, steps: int, cpu_seconds: float, wall_seconds: float) -> None:
    """Store the slowness of this machine for later forecasts, if the finished run can measure it.

    A run can measure the slowness if it is long, rarely waits for other processes, and spends most CPU time on
    particles and cells. steps, cpu_seconds: number of steps and CPU time of all steps. wall_seconds: wall time of
    the whole run. Nothing is stored if the cache cannot be written.
    """
    if scene.initial is None or cpu_seconds < MIN_CPU_SECONDS or cpu_seconds < MIN_CPU_FRACTION * wall_seconds:
        return
    reference = step_seconds(scene) / slowness()
    if reference < MIN_STEP_SECONDS:
        return
    here, runs = platform.node(), _stored_runs()
    own = [run for run in runs if run["machine"] == here]
    others = [run for run in runs if run["machine"] != here]
    own.append({"machine": here, "slowness": cpu_seconds / steps / reference})
    stored_runs.write_list("speed", others[-MAX_STORED_ELSEWHERE:] + own[-MAX_STORED_HERE:])
