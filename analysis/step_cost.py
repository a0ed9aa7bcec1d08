"""The step of a disc, measured: CPU time, where it goes, and memory, beside what the same process takes for a triad and
for an FFT. `apart` measures in a process of its own, as memory is that of the process.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import time
import tomllib
from collections import Counter
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from passes import watched

from discsim.parts import DEFAULT_SCHEME

if TYPE_CHECKING:
    from discsim import Simulation

FIRST = 2  # steps, in which kernels compile
STEPS = 16  # between two sorts of the particles: one is among them
ETA = 1.41  # 25 neighbours
MAIN = Path(__file__).parents[1] / "setups" / "dusty_disc.toml"


def scene(gas: int, dust: int, tables: dict[str, Any], threads: int = 1) -> dict[str, Any]:
    """The disc in code units with `gas` and `dust` particles and more `tables`, those of [dust] completed."""
    cells = 2 ** round(np.log2(np.sqrt(2.7 * gas)))
    out = {
        "units": {"system": "code"},
        "run": {"until": 1e3, "courant": 0.3, "threads": threads},
        "space": {"size": 25.0, "cells": cells},
        "initial": {"kind": "disc", "mass": 0.02, "inner": 1.0, "outer": 10.0},
        "gas": {
            "particles": gas,
            "kernel": "cubic",
            "eta": ETA,
            "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.05},
            "viscosity": {},
        },
        "star": {"mass": 1.0, "accretion_radius": 1.0},
    }
    return out | tables | ({"dust": {"particles": dust} | tables["dust"]} if "dust" in tables else {})


def case(name: str, size: int, threads: int, scheme: str | None = None) -> dict[str, Any]:
    """The scene of a line, of `size` particles of the kind that it measures."""
    if name == "main":
        out = tomllib.loads(MAIN.read_text())
        out["run"] |= {"threads": threads}
        out["drag"] |= {"scheme": scheme or out["drag"]["scheme"]}
        return out
    drag = {"law": "stokes-number", "stokes": 0.1, "scheme": scheme or DEFAULT_SCHEME}
    gravity = {"softening": 0.1, "sources": ["gas"]}
    dust = {"ratio": 0.01}
    if name == "gas":
        return scene(size, 0, {}, threads)
    if name == "box":
        return in_box(scene(size, 0, {}, threads))
    if name == "gravity":
        return scene(size, 0, {"self_gravity": gravity}, threads)
    if name == "mix":
        gravity = {"softening": 0.1}
        return scene(size, 10 * size, {"self_gravity": gravity, "dust": dust, "drag": drag}, threads)
    drag["direction"] = name.split()[1]
    return scene(size // 10, size, {"self_gravity": gravity, "dust": dust, "drag": drag}, threads)


def in_box(tables: dict[str, Any]) -> dict[str, Any]:
    """The gas of a disc as a sound wave in a periodic box."""
    return {key: value for key, value in tables.items() if key != "star"} | {
        "space": {"size": 1.0, "boundary": "periodic"},
        "initial": {"kind": "wave", "amplitude": 0.1},
        "gas": tables["gas"] | {"eos": {"kind": "isothermal", "sound_speed": 1.0}},
    }


def without_dust(tables: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in tables.items() if key not in ("dust", "drag")}


def measure(tables: dict[str, Any]) -> dict[str, Any]:
    """Figures of one scene."""
    from discsim import Simulation
    from discsim.kernels.sph.smoothing import KERNELS, SUPPORT

    before = resident()
    sim = Simulation(tables)
    cpu, wall, effects, passes = timed_steps(sim)
    gas, dust = sim.gas, sim.dust
    reach = SUPPORT[KERNELS[sim.scene.gas.kernel]] * gas.h
    count = gas.count + (dust.count if dust else 0)
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    return {
        "gas": gas.count,
        "dust": dust.count if dust else 0,
        "cells": sim.state.grid.shape[0] ** 2 if sim.state.grid else 0,
        "threads": tables["run"]["threads"],
        "cpu": cpu,
        "wall": wall,
        "neighbours": float(np.median(np.pi * reach**2 * gas.density / gas.mass)),
        "effects": effects,
        "passes": passes,
        "bytes": (most - before) / count,
        "triad": triad(),
        "fft": fft_pair(sim.state.grid.shape[0]) if "self_gravity" in tables else None,
    }


def timed_steps(sim: Simulation) -> tuple[float, float, dict[str, float], dict[str, float]]:
    """CPU and wall seconds of a step of a simulation, CPU seconds by effect and by pass: the mean over STEPS, behind
    the FIRST ones.

    All in one `evolve`, as in a run: between two of these somebody may change particles, so that what several threads
    have made of them for the next kick would be made again.
    """
    marks: list[tuple[float, float, dict[str, float]]] = []
    passes: list[Counter[str]] = []
    with ExitStack() as watching:

        def after_step() -> bool:
            if sim.state.step == FIRST:
                passes.append(watching.enter_context(watched()))
            if sim.state.step in (FIRST, FIRST + STEPS):
                marks.append((time.process_time(), time.perf_counter(), sim.costs.copy().seconds))
            return len(marks) == 2

        sim.evolve(np.inf, after_step, read_only=True)
    (cpu, wall, before), (cpu_then, wall_then, after) = marks
    return (
        (cpu_then - cpu) / STEPS,
        (wall_then - wall) / STEPS,
        {name: (after[name] - before[name]) / STEPS for name in sim.effects},
        {name: seconds / STEPS for name, seconds in passes[0].most_common()},
    )


def resident() -> int:
    """Bytes that this process holds now."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def triad(count: int = 20_000_000) -> float:
    """CPU seconds of an element of a[i] = b[i] + s c[i], far out of the caches; the best of five."""
    a, b, c = np.zeros(count), np.ones(count), np.ones(count)
    from numba import njit

    @njit(error_model="numpy")
    def add(a, b, c, s):
        for i in range(len(a)):
            a[i] = b[i] + s * c[i]

    return best(lambda: add(a, b, c, 3.0)) / count


def fft_pair(cells: int) -> float:
    """CPU seconds of a real transform and its inverse of the grid padded to twice its sides; the best of five."""
    import pyfftw

    field = pyfftw.zeros_aligned((2 * cells, 2 * cells))
    modes = pyfftw.zeros_aligned((2 * cells, cells + 1), complex)
    there = pyfftw.FFTW(field, modes, axes=(0, 1), flags=("FFTW_MEASURE",))
    back = pyfftw.FFTW(modes, field, axes=(0, 1), direction="FFTW_BACKWARD", flags=("FFTW_MEASURE",))

    def pair() -> None:
        there.execute()
        back.execute()

    return best(pair)


def best(work: Any) -> float:
    taken = []
    for _ in range(6):  # the first compiles, or touches its memory
        start = time.process_time()
        work()
        taken.append(time.process_time() - start)
    return min(taken[1:])


def apart(tables: dict[str, Any]) -> dict[str, Any]:
    """`measure` in a process of its own."""
    command = [sys.executable, __file__, json.dumps(tables)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise SystemExit(done.stderr.strip().rsplit("\n", 1)[-1])
    return json.loads(done.stdout)


if __name__ == "__main__":
    print(json.dumps(measure(json.loads(sys.argv[1]))))
