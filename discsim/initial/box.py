"""box: uniform gas and dust with different velocities in a periodic box (DustyBox; Laibe & Price 2011)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np
from pydantic import Field

from discsim.initial.base import Array, Arrays, SamplePoints, Start
from discsim.initial.lattice import sample_uniform_gas, uniform_particles
from discsim.initial.measure import ErrorMeasure, Simulated, velocity_errors
from discsim.parts import LAWS
from discsim.scene.fields import Density, Table, VelocityVector

if TYPE_CHECKING:
    from discsim.scene import Scene


class Box(Table):
    """A uniform periodic box (DustyBox)."""

    kind: Literal["box"] = "box"
    density: Density = Field(1.0, gt=0, description="density of the gas")
    gas_velocity: VelocityVector = Field(
        0, validate_default=True, description="initial velocity of the gas: a number (along x) or [x, y]"
    )
    dust_velocity: VelocityVector = Field(
        0, validate_default=True, description="initial velocity of the dust: a number (along x) or [x, y]"
    )


def particles(scene: Scene) -> dict[str, Arrays]:
    start = scene.initial
    out = uniform_particles(scene, start.density)
    for name, arrays in out.items():
        arrays["vel"] += np.array(getattr(start, f"{name}_velocity"))
    return out


def cell_values(scene: Scene, x: Array, dx: float) -> tuple[Array, Arrays, Array | None]:
    start = scene.initial
    vel = {"gas": np.full_like(x, start.gas_velocity[0]), "dust": np.full_like(x, start.dust_velocity[0])}
    return np.full_like(x, start.density), vel, None


def sample_points(scene: Scene) -> SamplePoints:
    return sample_uniform_gas(scene.initial.density)


def measure(scene: Scene) -> ErrorMeasure | None:
    """Return the `ErrorMeasure` of particle velocities, relative to the initial velocity difference of gas and dust.

    None if the scene has no exact solution, which needs gas, a single dust population and a uniform drag rate.
    """
    drag = scene.drag
    rate = LAWS[drag.law].uniform_rate if drag else None
    if not scene.gas or len(scene.dust or ()) != 1 or rate is None:
        return None
    from discsim.exact import dustybox  # imports scipy

    def exact(sim: Simulated, kind: str) -> tuple[Array, Array | float]:
        start, ratio = scene.initial, scene.dust[0].ratio
        gas, dust = np.array(start.gas_velocity, dtype=float), np.array(start.dust_velocity, dtype=float)
        pulls = [np.array(getattr(scene.external, name, 0.0 * gas)) for name in ("gas", "dust")]
        coefficient = rate(scene, scene.dust[0], start.density)
        if drag.direction == "one-way":
            # Gas without back-reaction is equivalent to infinitely heavy gas.
            coefficient, ratio = coefficient * 1e-12 / ratio, 1e-12
        exact = dustybox.velocities(sim.time, gas, dust, 1.0, ratio, coefficient, *pulls)[kind == "dust"]
        return exact, exact - (dust - gas)

    return ErrorMeasure("particle velocities compared with the exact relaxation", velocity_errors(exact))


START = Start(
    Box,
    particles,
    sample_points,
    cell_values=cell_values,
    measure=measure,
    exact_effects=("external",),
    stays_uniform=True,
)
