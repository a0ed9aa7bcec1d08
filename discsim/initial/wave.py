"""wave: a plane wave in the densities and velocities of gas and dust (DustyWave; Laibe & Price 2011).

    rho / rho_0 = 1 + A sin(k.x),    v = u = v_0 + A sin(k.x) k / |k|,    k = 2 pi wavenumber (direction / size)

in code units, at the start. rho_0: mean density, 1 for gas and the dust-to-gas ratio for dust. v, u: velocities of gas
and dust. v_0: `initial.velocity`. A: `initial.amplitude`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, ValidationInfo

from discsim.initial.base import Array, Arrays, Curve, SamplePoints, Start
from discsim.initial.lattice import sample_uniform_gas, stretch_lattice, uniform_particles
from discsim.initial.measure import ErrorMeasure, Simulated, velocity_errors
from discsim.parts import LAWS
from discsim.physics.eos import eos_of
from discsim.scene.fields import Count, Measure, Number, Table, VelocityVector, units_of

if TYPE_CHECKING:
    from discsim.scene import Scene
    from discsim.scene.rules import Draft, Problem

_ALONG_X = (1, 0)


def _direction(value: Any, info: ValidationInfo) -> Any:
    # In 1D the default [1, 0] means [1].
    return [1] if value == _ALONG_X and units_of(info).dimensions == 1 else value


class Wave(Table):
    """A wave A sin(k x) in density and velocity of both species on [0, size)."""

    kind: Literal["wave"] = "wave"
    amplitude: Number = Field(1e-4, gt=-1, lt=1, description="relative amplitude A")
    wavenumber: Count = Field(1, ge=1, description="number of wavelengths in the box")
    velocity: VelocityVector = Field(0, validate_default=True, description="uniform velocity added to gas and dust")
    direction: Annotated[tuple[float, ...], Measure(vector=True, whole=True), BeforeValidator(_direction)] = Field(
        _ALONG_X, validate_default=True, description="number of wavelengths along x and y"
    )


def particles(scene: Scene) -> dict[str, Arrays]:
    start = scene.initial
    size = np.array(scene.space.size)
    wavevector = 2.0 * np.pi * start.wavenumber * np.array(start.direction) / size
    along = wavevector / np.linalg.norm(wavevector)
    out = uniform_particles(scene, 1.0)
    for arrays in out.values():
        phase = stretch_lattice(arrays["pos"], wavevector, start.amplitude)
        arrays["pos"] %= size
        arrays["vel"] += np.outer(start.amplitude * np.sin(phase), along) + np.array(start.velocity)
    return out


def cell_values(scene: Scene, x: Array, dx: float) -> tuple[Array, Arrays, Array | None]:
    start = scene.initial
    waves = start.wavenumber * start.direction[0]
    wave = start.amplitude * np.sin(2.0 * np.pi * waves / scene.space.size[0] * x)
    vel = start.velocity[0] + np.sign(waves) * wave
    return 1.0 + wave, {"gas": vel, "dust": vel}, None


def sample_points(scene: Scene) -> SamplePoints:
    return sample_uniform_gas(1.0)


def _exact_drag(scene: Scene) -> tuple[float, float] | None:
    """Return drag coefficient K and dust-to-gas ratio of the exact solution; None if the scene has no exact solution.

    An exact solution needs gas with a single sound speed. With dust it also needs a single population, two-way drag
    and a uniform drag rate.
    """
    drag = scene.drag
    if scene.gas is None or not eos_of(scene).one_speed:
        return None
    if not scene.dust:
        return 0.0, 1e-30
    rate = LAWS[drag.law].uniform_rate if drag and drag.direction == "two-way" else None
    if rate is None or len(scene.dust) > 1:
        return None
    return rate(scene, scene.dust[0], 1.0), scene.dust[0].ratio


def measure(scene: Scene) -> ErrorMeasure | None:
    """Return the `ErrorMeasure` of particle velocities; None if the scene has no exact solution."""
    if (found := _exact_drag(scene)) is None:
        return None
    from discsim.exact import dustywave  # imports scipy

    def exact(sim: Simulated, kind: str) -> tuple[Array, Array | float]:
        start, sound = scene.initial, scene.gas.eos.sound_speed
        size = np.array(scene.space.size)
        wavevector = start.wavenumber * np.array(start.direction) / size
        waves = float(np.linalg.norm(wavevector))
        along, frame = wavevector / waves, np.array(start.velocity)
        x = sim.state.species[kind].pos @ along - sim.time * (frame @ along)
        wave = dustywave.solution(x, sim.time, *found, sound, start.amplitude, waves)
        return frame + np.outer(getattr(wave, f"{kind}_velocity"), along), frame

    return ErrorMeasure("particle velocities compared with the exact wave", velocity_errors(exact))


def exact_curves(scene: Scene, time: float, x: Array) -> dict[str, Curve]:
    """Return the exact curves of gas and dust; {} without drag, or if the scene has no exact solution."""
    if scene.drag is None or (found := _exact_drag(scene)) is None:
        return {}
    from discsim.exact import dustywave  # imports scipy

    start, sound = scene.initial, scene.gas.eos.sound_speed
    whole = (start.wavenumber, scene.space.size[0], start.velocity[0])
    wave = dustywave.solution(x, time, *found, sound, start.amplitude, *whole)
    return {"gas": (x, wave.gas_density, wave.gas_velocity), "dust": (x, wave.dust_density, wave.dust_velocity)}


def direction_problems(draft: Draft) -> Iterator[Problem]:
    """Yield a problem if the wave has no direction."""
    if not any(draft.initial.direction):
        yield (
            ("initial", "direction"),
            "there are 0 wavelengths along x and y; expected at least one wavelength along x or y",
        )


START = Start(
    Wave,
    particles,
    sample_points,
    cell_values=cell_values,
    rules=(direction_problems,),
    measure=measure,
    exact_curves=exact_curves,
)
