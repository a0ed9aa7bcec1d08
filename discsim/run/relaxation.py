"""A quiet start: before t = 0 the gas alone settles under damping of its velocities for `initial.relax` orbits.

The run of the same gas, star and self-gravity, all of it a zone of [damping] to the inner edge; its places are then the
start's, and the velocities those of balance there. Dust, drag and companions wait.
"""

from __future__ import annotations

import math
import tomllib
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.initial import start_of
from discsim.physics import profile
from discsim.physics.eos import initial_energy, radius
from discsim.scene import Scene, load_scene
from discsim.scene.units import Units

if TYPE_CHECKING:
    from discsim.effects.base import Effect
    from discsim.numerics.state import State

KEPT = ("units", "run", "space", "initial", "gas", "star", "self_gravity", "external", "alpha_viscosity")
TIME = 0.3  # orbits at the inner edge, in which velocities relax


def orbits(scene: Scene) -> float:
    """How long the gas is to settle, in orbits at the reference radius."""
    return float(getattr(scene.initial, "relax", 0.0))


def relax(state: State, effects: dict[str, Effect]) -> None:
    """Move the gas of the start `state` to where it settles, and give all the velocities of balance."""
    from discsim.run.simulation import Simulation

    scene, gas = state.scene, state.gas
    assert gas is not None
    alone = Simulation(_alone(scene))
    alone.run()
    found = alone.gas
    assert found is not None
    order = np.empty(gas.count, np.int64)
    order[found.ids] = np.arange(found.count)
    order = order[gas.ids]
    gas.pos[:], gas.h[:] = found.pos[order], found.h[order]
    if gas.u is not None:
        gas.u[:] = initial_energy(scene, radius(gas.pos))
    settle = start_of(scene).settle
    assert settle is not None
    settle(state, effects)


def _alone(scene: Scene) -> Scene:
    """The scene of the gas that settles."""
    start: Any = scene.initial
    data: dict[str, Any] = {k: v for k, v in tomllib.loads(scene.text).items() if k in KEPT}
    data["initial"].pop("relax")
    data["star"] = {key: value for key, value in data["star"].items() if key in ("mass", "softening")}
    data.get("self_gravity", {}).pop("sources", None)
    period = 2.0 * math.pi / float(profile.kepler_omega(scene, start.reference_radius))
    inner, outer = profile.radial(scene).inner, profile.radial(scene).outer
    written = _texts(scene.units)
    data["run"] = {**data["run"], "until": written(start.relax * period, "time")}
    for key in ("snapshots", "every"):
        data["run"].pop(key, None)
    data["damping"] = {"inner": [written(inner, "length"), written(2.0 * outer, "length")], "time": TIME}
    folder = getattr(getattr(start, "file", None), "path", None)
    return load_scene(data, folder=folder.parent if folder else None)


def _texts(units: Units) -> Any:
    """A function that writes a value in code units as a scene has it."""
    if units.system == "code":
        return lambda value, name: float(value)
    base = {"time": "s", "length": "cm"}
    return lambda value, name: f"{float(value) * units.cgs(name)!r} {base[name]}"
