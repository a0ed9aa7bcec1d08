"""What a run will take: number of steps, CPU time and memory, from stored figures and the last long run here.

The figures below are CPU nanoseconds of a particle, cell or neighbour in a step, from `python analysis/throughput.py`
(those of pairs and of a given disc from `costs.csv` of runs with such a scheme and with [background]); another machine
differs by a factor, which a run that has ended leaves for the next forecast (`learn`).
"""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import NamedTuple

from discsim.derived import SUPPORT_OF, gas_step, grid, grid_bytes, local, particle_count
from discsim.initial import profile
from discsim.scene import Scene

GAS, NEIGHBOUR = 300.0, 27.0  # a gas particle, and each of its neighbours
DUST, STAR = 2.0, 6.0  # moving a particle of dust, the star's pull on any
CELL, MOVED = 58.0, 21.0  # a cell of self-gravity, and a particle that it deposits and pulls
DRAG = {"tsc": 500.0, "idic-linear": 100.0, "idic": 90.0}  # of a particle of either kind
PAIRS = 3000.0  # the same in schemes between pairs
BACKGROUND = 150.0  # a particle in a given disc
SHRINK = 0.85  # of the smooth start's shortest step is what noise and spreading edges leave
BYTES = {"gas": 600, "dust": 180}  # a particle, with what a step needs
BASE = 250e6  # the interpreter with its libraries


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
    at, run = local(scene), scene.run
    if run.timestep is not None:
        return run.until / run.timestep
    if scene.gas and at.h is not None and at.sound_speed is not None:
        return run.until / (run.courant * SHRINK * float(gas_step(scene, at).min()))
    if scene.star and scene.initial is not None and scene.initial.kind == "disc":
        return run.until / run.courant * float(profile.kepler_omega(scene, scene.initial.inner))
    return None


def _step_nanoseconds(scene: Scene, gas: int, dust: int, cells: int) -> float:
    both = gas + dust
    total = DUST * dust + (STAR * both if scene.star else 0.0)
    if scene.gas:
        neighbours = math.pi * (SUPPORT_OF[scene.gas.kernel] * scene.gas.eta) ** 2
        total += gas * (GAS + NEIGHBOUR * neighbours)
    if scene.self_gravity:
        total += CELL * cells + MOVED * both
    if scene.background:
        total += BACKGROUND * dust
    elif scene.drag:
        total += DRAG.get(scene.drag.scheme, PAIRS) * both
    return total


def _store() -> Path:
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "discsim" / "speed.json"


def slowness() -> float:
    """CPU time that this machine takes over that of the stored figures, by its last long run; 1 without one."""
    try:
        found = float(json.loads(_store().read_text())["slowness"])
    except (OSError, ValueError, KeyError, TypeError):
        return 1.0
    return found if 0.05 < found < 50.0 else 1.0


def learn(scene: Scene, step_seconds: float) -> None:
    """Keep what a step took here, for the next forecast; where nothing can be kept, nothing is."""
    expected = forecast(scene)
    if expected is None or step_seconds <= 0.0:
        return
    path = _store()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = path.with_suffix(".part")
        temporary.write_text(json.dumps({"slowness": step_seconds / (expected.step_seconds / slowness())}) + "\n")
        os.replace(temporary, path)
    except OSError:
        return
