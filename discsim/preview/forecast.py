"""What a run will take: number of steps, CPU time and memory, from stored figures and the last long runs here.

The figures below are CPU nanoseconds of a particle, cell or neighbour in a step, from `python analysis/throughput.py`
(those of pairs and of a given disc from `costs.csv` of runs with such a scheme and with [background]), that of drag in
the file of each scheme; another machine differs by a factor, which long runs that have ended leave for the next
forecast (`learn`).
"""

from __future__ import annotations

import json
import math
import os
import platform
import statistics
from pathlib import Path
from typing import Any, NamedTuple

from discsim.formulas.smoothing import SMOOTHING
from discsim.initial import start_of
from discsim.output.files import written
from discsim.parts import SCHEMES
from discsim.physics import profile
from discsim.preview.derived import gas_step, grid, grid_bytes, local, particle_count
from discsim.scene import Scene

GAS, NEIGHBOUR = 300.0, 27.0  # a gas particle, and each of its neighbours
DUST, STAR = 2.0, 6.0  # moving a particle of dust, the star's pull on any
CELL, MOVED = 58.0, 21.0  # a cell of self-gravity, and a particle that it deposits and pulls
BACKGROUND = 150.0  # a particle in a given disc
SHRINK = 0.85  # of the smooth start's shortest step is what noise and spreading edges leave
BYTES = {"gas": 600, "dust": 180}  # a particle, with what a step needs
BASE = 250e6  # the interpreter with its libraries
# A run tells the machine's speed that takes so many CPU seconds, at least this share of its wall time (compilation is
# in that), and, by the stored figures, so many seconds a step, of which calls and loops of Python are a tenth or less.
LONG, QUIET, HEAVY_STEP = 20.0, 0.7, 0.02
KEPT, OTHERS = 7, 50  # runs that are kept of this machine, and of others that share the folder


class Forecast(NamedTuple):
    """Steps of a run, CPU seconds of one, and bytes."""

    steps: float
    step_seconds: float
    memory: float

    @property
    def seconds(self) -> float:
        return self.steps * self.step_seconds


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
    cells = 0
    found = grid(scene)
    if scene.self_gravity and found is not None:
        cells = math.prod(found[1])
        memory += grid_bytes(scene, found[1])
    return Forecast(steps, 1e-9 * _step_nanoseconds(scene, gas, dust, cells) * slowness(), memory)


def _steps(scene: Scene) -> float | None:
    at, run, start = local(scene), scene.run, start_of(scene)
    if run.timestep is not None:
        return run.until / run.timestep
    if not start.known_step:
        return None
    if scene.gas and at.h is not None and at.sound_speed is not None:
        return run.until / (run.courant * SHRINK * float(gas_step(scene, at).min()))
    if scene.star and start.edges is not None:
        return run.until / run.courant * float(profile.kepler_omega(scene, start.edges(scene)[0]))
    return None


def _step_nanoseconds(scene: Scene, gas: int, dust: int, cells: int) -> float:
    both = gas + dust
    total = DUST * dust + (STAR * both if scene.star else 0.0)
    if scene.gas:
        neighbours = math.pi * (SMOOTHING[scene.gas.kernel].support * scene.gas.eta) ** 2
        total += gas * (GAS + NEIGHBOUR * neighbours)
    if scene.self_gravity:
        total += CELL * cells + MOVED * both
    if scene.background:
        total += BACKGROUND * dust
    elif scene.drag:
        total += SCHEMES[scene.drag.scheme].nanoseconds * both
    return total


def _store() -> Path:
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "discsim" / "speed.json"


def _kept() -> list[dict[str, Any]]:
    """What runs have left: of each its machine and its slowness."""
    try:
        runs = json.loads(_store().read_text())["runs"]
        return [run for run in runs if isinstance(run["machine"], str) and 0.05 < run["slowness"] < 50.0]
    except (OSError, ValueError, KeyError, TypeError):
        return []


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
    path = _store()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with written(path) as temporary:
            temporary.write_text(json.dumps({"runs": others[-OTHERS:] + own[-KEPT:]}, indent=1) + "\n")
    except OSError:
        return
