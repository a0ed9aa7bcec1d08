"""A cold start on two cores: slow kernels of a kick compile in a second process beside those of all else.

numba compiles one function at a time in a process, on however many threads, and finds in its cache what another process
has compiled. The second one kicks some particles of the scene once, enough to say for what types of arguments, and
ends. Whatever it fails at, the first compiles itself.
"""

from __future__ import annotations

import math
import subprocess
import sys
import tomllib
from typing import Any

import numpy as np

from discsim import collect_rarely
from discsim.effects import effect_classes
from discsim.scene import Scene, load_scene

COUNT = 64  # particles of a kind


def begin(scene: Scene) -> subprocess.Popen[bytes] | None:
    """Start the second process, where a kick has slow kernels; None elsewhere, and where none can start."""
    if not any(effect.slow_kernels for effect in effect_classes(scene).values()):
        return None
    nowhere = subprocess.DEVNULL
    try:
        return subprocess.Popen(
            [sys.executable, "-m", "discsim.run.ahead", scene.text],
            stdin=nowhere,
            stdout=nowhere,
            stderr=nowhere,
            start_new_session=True,  # Ctrl-C is for the run, which ends it
        )
    except OSError:  # the run needs none
        return None


def kick_once(scene: Scene) -> None:
    """One kick of a few particles about a point of the scene, whose other forces are left out."""
    from discsim.run.forces import kick_owner
    from discsim.run.simulation import Simulation

    sim = Simulation(scene, particles=some_particles(scene))
    gas = sim.gas
    assert gas is not None
    gas.density[:], gas.sound_speed[:], gas.h[:] = gas.mass / gas.h**scene.space.dimensions, 1.0, gas.h.max()
    owner = kick_owner(sim.effects)
    assert owner is not None
    for name in set(sim.effects) - {owner}:
        sim.effects[name].prepare = lambda state: None  # type: ignore[method-assign]
        sim.effects[name].accelerate = lambda state: None  # type: ignore[method-assign]
        sim.effects[name].limit = lambda state: math.inf  # type: ignore[method-assign]
    sim.operators.forces()
    sim.effects[owner].kick(sim.state, 1e-3)


def some_particles(scene: Scene) -> dict[str, dict[str, Any]]:
    """Gas and dust about a point within the scene's space, as dense as its smoothing length asks for."""
    dim, stream = scene.space.dimensions, np.random.default_rng(1)
    size = np.ravel(scene.space.size)
    middle = 0.5 * size if scene.space.boundary == "periodic" else 0.25 * size
    out: dict[str, dict[str, Any]] = {}
    for name in ("gas", "dust"):
        pos = middle + 0.1 * size.min() * (stream.random((COUNT, dim)) - 0.5)
        out[name] = {"pos": pos, "vel": np.zeros((COUNT, dim)), "mass": np.ones(COUNT)}
    out["gas"]["density"] = COUNT / (0.1 * size.min()) ** dim
    assert scene.dust is not None
    out["dust"]["species"] = np.arange(COUNT) % len(scene.dust)
    return out


if __name__ == "__main__":
    collect_rarely()
    kick_once(load_scene(tomllib.loads(sys.argv[1])))
