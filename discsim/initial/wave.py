"""A sin(k x) in the densities and velocities of gas and dust (DustyWave; Laibe & Price 2011).

rho = 1 + A sin(k.x), v = u = boost + A sin(k.x) k/|k|, in code units; k = 2 pi wavenumber (direction / size).
"""

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, ValidationInfo

from discsim.initial.base import Start
from discsim.initial.lattice import stretch, uniform
from discsim.scene.fields import Count, Measure, Number, Table, VelocityVector, units_of

_ALONG_X = (1, 0)


def _direction(value: Any, info: ValidationInfo) -> Any:
    # The default [1, 0] is along x in 1D as well.
    return [1] if value == _ALONG_X and units_of(info).dimensions == 1 else value


class Wave(Table):
    """A sin(k x) in density and velocity of both species on [0, size)."""

    kind: Literal["wave"] = "wave"
    amplitude: Number = Field(1e-4, gt=-1, lt=1, description="A")
    wavenumber: Count = Field(1, ge=1, description="whole waves on the side")
    velocity: VelocityVector = Field(0, validate_default=True, description="uniform boost of everything")
    direction: Annotated[tuple[float, ...], Measure(vector=True, whole=True), BeforeValidator(_direction)] = Field(
        _ALONG_X, validate_default=True, description="whole waves along x and y"
    )


def particles(scene):
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


START = Start(Wave, particles)
