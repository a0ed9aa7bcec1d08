"""wave: a plane wave in the densities and velocities of gas and dust (DustyWave; Laibe & Price 2011).

    rho / rho_0 = 1 + A sin(k.x),    v = u = v_0 + A sin(k.x) k / |k|,    k = 2 pi wavenumber (direction / size)

in code units. v: velocity of gas. u: velocity of dust. v_0 = `initial.velocity`. rho_0 is 1 for gas and the
dust-to-gas ratio for dust.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, ValidationInfo

from discsim.initial.base import Array, Arrays, Curve, Places, Start
from discsim.initial.lattice import everywhere, stretch, uniform
from discsim.initial.measure import ErrorMeasure, Simulated, velocity_errors
from discsim.parts import LAWS
from discsim.physics.eos import eos_of
from discsim.scene.fields import Count, Measure, Number, Table, VelocityVector, units_of

if TYPE_CHECKING:
    from discsim.scene import Scene
    from discsim.scene.rules import Draft, Problem

_ALONG_X = (1, 0)


def _direction(value: Any, info: ValidationInfo) -> Any:
    # The default [1, 0] is along x in 1D as well.
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
    out = uniform(scene, 1.0)
    for arrays in out.values():
        phase = stretch(arrays["pos"], wavevector, start.amplitude)
        arrays["pos"] %= size
        arrays["vel"] += np.outer(start.amplitude * np.sin(phase), along) + np.array(start.velocity)
    return out


def cells(scene: Scene, x: Array, dx: float) -> tuple[Array, Arrays, Array | None]:
    start = scene.initial
    waves = start.wavenumber * start.direction[0]
    wave = start.amplitude * np.sin(2.0 * np.pi * waves / scene.space.size[0] * x)
    vel = start.velocity[0] + np.sign(waves) * wave
    return 1.0 + wave, {"gas": vel, "dust": vel}, None


def places(scene: Scene) -> Places:
    return everywhere(1.0)


def measure(scene: Scene) -> ErrorMeasure | None:
    drag = scene.drag
    if scene.gas is None or not eos_of(scene).one_speed:
        return None
    rate = LAWS[drag.law].uniform_rate if drag and drag.direction == "two-way" else None
    if scene.dust and (rate is None or len(scene.dust) > 1):
        return None
    from discsim.exact import dustywave  # imports scipy

    def exact(sim: Simulated, kind: str) -> tuple[Array, Array | float]:
        start, sound = scene.initial, scene.gas.eos.sound_speed
        size = np.array(scene.space.size)
        wavevector = start.wavenumber * np.array(start.direction) / size
        waves = float(np.linalg.norm(wavevector))
        along, frame = wavevector / waves, np.array(start.velocity)
        ratio = scene.dust[0].ratio if scene.dust else 1e-30
        coefficient = rate(drag, ratio, 1.0) if scene.dust else 0.0
        place = sim.state.species[kind].pos @ along - sim.time * (frame @ along)
        wave = dustywave.solution(place, sim.time, coefficient, ratio, sound, start.amplitude, waves)
        return frame + np.outer(getattr(wave, f"{kind}_velocity"), along), frame

    return ErrorMeasure("particle velocities compared with the exact wave", velocity_errors(exact))


def curves(scene: Scene, time: float, x: Array) -> dict[str, Curve]:
    """Return the exact curves of gas and dust; none unless drag is two-way with one population and a uniform rate."""
    start, drag = scene.initial, scene.drag
    if scene.gas is None or not eos_of(scene).one_speed or drag is None:
        return {}
    rate = LAWS[drag.law].uniform_rate
    if rate is None or drag.direction != "two-way" or len(scene.dust) > 1:
        return {}
    from discsim.exact import dustywave  # imports scipy

    sound, ratio = scene.gas.eos.sound_speed, scene.dust[0].ratio
    whole = (start.wavenumber, scene.space.size[0], start.velocity[0])
    wave = dustywave.solution(x, time, rate(drag, ratio, 1.0), ratio, sound, start.amplitude, *whole)
    return {"gas": (x, wave.gas_density, wave.gas_velocity), "dust": (x, wave.dust_density, wave.dust_velocity)}


def needs_a_direction(draft: Draft) -> Iterator[Problem]:
    if not any(draft.initial.direction):
        yield ("initial", "direction"), "all numbers are zero; expected at least one wavelength along one side"


START = Start(Wave, particles, places, cells=cells, rules=(needs_a_direction,), measure=measure, curves=curves)
