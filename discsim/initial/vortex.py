"""vortex: Gresho's vortex in the middle of a periodic box (`exact/gresho.py`); dust rotates with the gas."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np
from pydantic import Field

from discsim.exact import gresho
from discsim.initial.base import Array, Arrays, Curve, SamplePoints, Start
from discsim.initial.lattice import sample_uniform_gas, uniform_particles
from discsim.initial.measure import ErrorMeasure, Simulated
from discsim.scene.fields import Density, Length, Table, Velocity, VelocityVector

if TYPE_CHECKING:
    from discsim.scene import Scene


class Vortex(Table):
    """Gresho's vortex in the middle of a periodic box."""

    kind: Literal["vortex"] = "vortex"
    density: Density = Field(1.0, gt=0, description="surface density of the gas")
    speed: Velocity = Field(1.0, gt=0, description="maximum rotation speed")
    radius: Length = Field(
        0.2, gt=0, description="radius of the maximum speed; the speed is zero beyond twice this radius"
    )
    velocity: VelocityVector = Field(0, validate_default=True, description="uniform velocity added to gas and dust")


def particles(scene: Scene) -> dict[str, Arrays]:
    start = scene.initial
    out = uniform_particles(scene, start.density)
    for arrays in out.values():
        away, r = _about_middle(scene, arrays["pos"])
        turn = gresho.speed(r, start.speed, start.radius) / r
        arrays["vel"] = turn[:, None] * np.stack([-away[:, 1], away[:, 0]], axis=1) + np.array(start.velocity)
    _, r = _about_middle(scene, out["gas"]["pos"])
    pressure = gresho.pressure(r, start.density, start.speed, start.radius)
    out["gas"]["u"] = pressure / (scene.gas.eos.gamma - 1.0) / start.density
    return out


def _about_middle(scene: Scene, pos: Array) -> tuple[Array, Array]:
    """Return the positions `pos` (n, 2) relative to the middle of the box, and their distances (n,) > 0 from it."""
    away = pos - 0.5 * np.array(scene.space.size)
    return away, np.maximum(np.sqrt((away**2).sum(axis=1)), 1e-300)


def sample_points(scene: Scene) -> SamplePoints:
    start = scene.initial
    return sample_uniform_gas(start.density, gresho.pressure(np.zeros(1), start.density, start.speed, start.radius))


def measure(scene: Scene) -> ErrorMeasure | None:
    """Return the `ErrorMeasure` of the azimuthal velocity; None with dust, for which no exact solution is known."""
    if scene.dust:
        return None

    def errors(sim: Simulated) -> dict[str, float]:
        start, size = scene.initial, np.array(scene.space.size)
        frame = np.array(start.velocity)
        away = (sim.gas.pos - 0.5 * size - frame * sim.time + 0.5 * size) % size - 0.5 * size
        vel = sim.gas.vel - frame
        r = np.hypot(*away.T)
        turning = (away[:, 0] * vel[:, 1] - away[:, 1] * vel[:, 0]) / r
        inside = r < 2.0 * start.radius
        return {"gas": float(np.abs(turning - gresho.speed(r, start.speed, start.radius))[inside].mean() / start.speed)}

    return ErrorMeasure("mean azimuthal velocity in the vortex compared with the exact one", errors)


def exact_curves(scene: Scene, time: float, r: Array) -> dict[str, Curve]:
    start = scene.initial
    if scene.dust:
        return {}
    return {"gas": (r, np.full_like(r, start.density), gresho.speed(r, start.speed, start.radius))}


START = Start(
    Vortex,
    particles,
    sample_points,
    dimensions=(2,),
    eos=("adiabatic",),
    sets_pressure=True,
    min_half_side=("radius", 2.0),
    measure=measure,
    exact_curves=exact_curves,
    figure_velocity="azimuthal",
)
